"""An analytic head from the mouth to the vertex: skin, skull, brain, ventricles, nose, ears, jaw and spine."""

import numpy as np

from gpubspline.ct.bodies import Body, Floats, Layer, Level, cone, ellipsoid, elliptic_tube, smooth_union

AIR_HU = -1000.0
SOFT_HU = 45.0
TABLE_HU = 1250.0  # outer and inner table of the skull
DIPLOE_HU = 550.0
BRAIN_HU = 36.0
FLUID_HU = 8.0  # of the ventricles
JAW_HU = 700.0
SPINE_HU = 420.0

CRANIUM = (0.0, 6.0, 106.0)
CRANIUM_SEMI_AXES = np.array([76.0, 95.0, 80.0])  # of the scalp; what lies under it is given by its depth


def skin_level(points: Floats) -> Floats:
    """Level of the outer boundary, mm; x left, y towards the back, z up from the mouth."""
    mirrored = np.concatenate([np.abs(points[..., :1]), points[..., 1:]], axis=-1)
    neck = np.maximum(elliptic_tube(points - np.array([0.0, 22.0, 0.0]), (55.0, 58.0)), points[..., 2] - 70)
    head = smooth_union(_cranium(0)(points), ellipsoid(points, (0, -26, 28), (58, 60, 92)), 40)
    head = smooth_union(head, neck, 35)
    head = smooth_union(head, cone(points, (0, -88, 80), (0, -97, 44), (5, 11)), 14)
    return smooth_union(head, ellipsoid(mirrored, (74, 8, 66), (10, 12, 28)), 10)


def _cranium(depth_mm: float) -> Level:
    semi_axes = tuple(CRANIUM_SEMI_AXES - depth_mm)
    return lambda points: ellipsoid(points, CRANIUM, semi_axes)


def _jaw(points: Floats) -> Floats:
    return ellipsoid(points, (0, -38, 18), (40, 36, 34))


def _spine(points: Floats) -> Floats:
    return np.maximum(elliptic_tube(points - np.array([0.0, 32.0, 0.0]), (22.0, 17.0)), points[..., 2] - 45)


def _ventricles(points: Floats) -> Floats:
    mirrored = np.concatenate([np.abs(points[..., :1]), points[..., 1:]], axis=-1)
    return ellipsoid(mirrored, (13, 4, 112), (6, 28, 11))


def _constant(hu: float) -> Level:
    return lambda points: np.full(points.shape[:-1], hu)


def head() -> Body:
    """Give the head's body in air."""
    layers = (
        Layer(skin_level, _constant(SOFT_HU)),
        Layer(_jaw, _constant(JAW_HU)),
        Layer(_spine, _constant(SPINE_HU)),
        Layer(_cranium(7), _constant(TABLE_HU)),
        Layer(_cranium(9), _constant(DIPLOE_HU)),
        Layer(_cranium(12), _constant(TABLE_HU)),
        Layer(_cranium(14), _constant(BRAIN_HU)),
        Layer(_ventricles, _constant(FLUID_HU)),
    )
    return Body(layers, AIR_HU)
