"""An analytic left proximal femur: shaft, neck, head, trochanters; cortical shell, cancellous core, marrow canal."""

from dataclasses import dataclass

import numpy as np

from gpubspline.ct.bodies import Body, Floats, Layer, cone, ellipsoid, elliptic_tube, ramp, smooth_union, sphere

WATER_HU = 0.0  # an excised bone is scanned in a water bath
MARROW_HU = -30.0  # fatty marrow of the canal
CANCELLOUS_HU = 320.0
HEAD_HU = 130.0  # on top of it, where the head carries load
CORTICAL_HU = 1450.0  # just below the 1630 that the paper takes for the densest cortical bone
THIN_CORTEX_HU = 1100.0

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Femur:
    """Measures in mm; the origin lies on the shaft's axis, where the scan cuts it, in LPS with the head towards -x.

    Attributes
    ----------
    length: from the cut to the top of the head.
    head_radius: of the head.
    offset: of the head's centre from the shaft's axis.
    neck_angle: degrees, between the axes of neck and shaft.
    neck_radii: at its root and at its narrowest.
    shaft: semi-axes along x and y at the cut.
    flare: length over which the shaft widens below the neck, and what it adds to either semi-axis.
    cortex: thickness of the shell in the shaft and in the head.
    trochanter: centre of the greater trochanter (along x, and above the root of the neck) and its semi-axes.
    scale: of fillets and lesser trochanter, 1 for an adult.
    """

    length: float
    head_radius: float
    offset: float
    neck_angle: float
    neck_radii: tuple[float, float]
    shaft: tuple[float, float]
    flare: Point
    cortex: tuple[float, float]
    trochanter: tuple[float, float, Point]
    scale: float

    @property
    def head_centre(self) -> Point:
        """Centre of the head."""
        return (-self.offset, 0.0, self.length - self.head_radius)

    @property
    def root(self) -> float:
        """Height where the axes of neck and shaft meet."""
        return float(self.head_centre[2] - self.offset / np.tan(np.radians(180 - self.neck_angle)))

    def level(self, points: Floats) -> Floats:
        """Level of the outer boundary, mm, negative inside."""
        s, root = self.scale, self.root
        along, above, semi_axes = self.trochanter
        bone = smooth_union(
            self._shaft(points), cone(points, (4 * s, 0, root - 3 * s), self.head_centre, self.neck_radii), 14 * s
        )
        bone = smooth_union(bone, ellipsoid(points, (along, 2 * s, root + above), semi_axes), 12 * s)
        bone = smooth_union(bone, ellipsoid(points, (-14 * s, 5 * s, root - 28 * s), (8 * s, 8 * s, 14 * s)), 8 * s)
        return smooth_union(bone, sphere(points, self.head_centre, self.head_radius), 5 * s)

    def _shaft(self, points: Floats) -> Floats:
        height, add_x, add_y = self.flare
        wide = ramp(points[..., 2], self.root - height, self.root + 5 * self.scale)
        tube = elliptic_tube(points, (self.shaft[0] + wide * add_x, self.shaft[1] + wide * add_y))
        return np.maximum(tube, 0.8 * (points[..., 2] - self.root - 8 * self.scale))

    def canal_level(self, points: Floats) -> Floats:
        """Level of the inside of the cortical shell."""
        thick, thin = self.cortex
        return self.level(points) + thick + (thin - thick) * self._proximal(points)

    def _proximal(self, points: Floats) -> Floats:
        return ramp(points[..., 2], 0.25 * self.root, self.root)

    def cortical_hu(self, points: Floats) -> Floats:
        """HU of the shell, less where it is thin."""
        return CORTICAL_HU + (THIN_CORTEX_HU - CORTICAL_HU) * self._proximal(points)

    def core_hu(self, points: Floats) -> Floats:
        """HU within the shell: marrow in the shaft, cancellous bone above, densest in the head."""
        spongy = ramp(points[..., 2], 0.4 * self.root, 0.85 * self.root)
        loaded = 1 - ramp(sphere(points, self.head_centre, 0.0), 0.3 * self.head_radius, self.head_radius)
        return MARROW_HU + (CANCELLOUS_HU - MARROW_HU) * spongy + HEAD_HU * loaded


ADULT = Femur(
    length=193.2,
    head_radius=23.5,
    offset=41.0,
    neck_angle=128.0,
    neck_radii=(21.0, 15.5),
    shaft=(14.0, 13.0),
    flare=(60.0, 7.0, 4.0),
    cortex=(6.0, 1.8),
    trochanter=(13.0, 9.0, (14.0, 15.0, 24.0)),
    scale=1.0,
)
CHILD = Femur(
    length=100.8,
    head_radius=14.5,
    offset=25.0,
    neck_angle=136.0,
    neck_radii=(13.0, 9.8),
    shaft=(8.8, 8.2),
    flare=(34.0, 4.5, 3.0),
    cortex=(3.2, 1.4),
    trochanter=(8.0, 3.0, (8.0, 9.0, 13.0)),
    scale=0.62,
)


def femur(bone: Femur) -> Body:
    """Give the femur's body in water."""
    layers = (Layer(bone.level, bone.cortical_hu), Layer(bone.canal_level, bone.core_hu))
    return Body(layers, WATER_HU)
