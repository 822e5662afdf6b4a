"""Meshes of blocks: bodies whose distance is known, checked by VTK and by counting."""

import numpy as np
import pytest

from gpubspline.ct.region import Region
from gpubspline.errors import InputError
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.distance import surface_distance
from gpubspline.mesh.quality import assess


def region_of(distance, low, high, spacing):
    """Region of a distance function (..., 3) -> (...) sampled between two corners."""
    lines = [np.arange(a, b + spacing / 2, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    values = distance(points).astype(np.float32)
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = low
    return Region(values < 0, values, affine)


def ball(p):
    return np.linalg.norm(p, axis=-1) - 10


def torus(p):
    return np.hypot(np.hypot(p[..., 0], p[..., 1]) - 12, p[..., 2]) - 5


def check(made, region, device, floor):
    mesh, quality = assess(made.mesh, device)
    assert quality.inverted == 0 and quality.min >= floor
    assert made.report.min_scaled_jacobian == pytest.approx(quality.min, abs=1e-4)
    assert made.report.euler["mesh"] == made.report.euler["region"]
    pyvista = pytest.importorskip("pyvista")
    assert pyvista
    vtk = mesh.to_pyvista().cell_quality("scaled_jacobian").cell_data["scaled_jacobian"]
    assert vtk.min() == pytest.approx(quality.min, abs=1e-3)
    return mesh


@pytest.mark.parametrize(("body", "euler"), [(ball, 1), (torus, 0)])
def test_bodies(body, euler, device):
    region = region_of(body, (-20, -20, -14), (20, 20, 14), 1.0)
    size = 1.8
    made = blocks_mesh(region, size, device=device)
    mesh = check(made, region, device, 0.65)
    assert made.report.euler["mesh"] == euler
    assert mesh.volume_mm3 == pytest.approx(region.volume_mm3, rel=0.01)
    off = surface_distance(mesh, region, device)
    assert off.mean < 0.02 * size and off.max < 0.25 * size
    assert made.report.off_surface_nodes["count"] == 0 and not made.report.lost_features
    faces = mesh.boundary()
    assert np.array_equal(np.unique(faces), mesh.node_sets["surface"])


def test_same_mesh_each_time(device):
    region = region_of(ball, (-14, -14, -14), (14, 14, 14), 1.0)
    first, second = (blocks_mesh(region, 3.0, device=device).mesh for _ in range(2))
    assert np.array_equal(first.points, second.points) and np.array_equal(first.cells, second.cells)


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, 60.0])
def test_sizes_that_no_mesh_has(size, device):
    region = region_of(ball, (-14, -14, -14), (14, 14, 14), 1.0)
    with pytest.raises(InputError, match="size"):
        blocks_mesh(region, size, device=device)
