"""Blocks curved on to their level set."""

import numpy as np
import pytest

from gpubspline.ct.enclosed import enclosed_volume
from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.mesh.blocks.curved import along, curve, onto
from gpubspline.mesh.blocks.level_set import SAMPLES
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.quality import assess


def torus() -> Region:
    lines = [np.arange(-20.0, 21.0), np.arange(-20.0, 21.0), np.arange(-9.0, 10.0)]
    x, y, z = np.meshgrid(*lines, indexing="ij")
    distance = (np.hypot(np.hypot(x, y) - 12, z) - 5).transpose(2, 1, 0).astype(np.float32)
    affine = np.eye(4)
    affine[:3, 3] = [line[0] for line in lines]
    return Region(distance < 0, distance, affine)


def test_curved_blocks_follow_the_level_set(device: Device) -> None:
    made = blocks_mesh(torus(), 2.0, device=device)
    level = enclosed_volume(made.level.phi, made.level.to_mm @ np.diag([1 / SAMPLES] * 3 + [1]))
    curved = curve(made, device=device)
    hex27 = curved.sample(1, "hex27")
    straight, bent = (abs(mesh.volume_mm3 / level - 1) for mesh in (made.mesh, hex27))
    assert bent < 0.002 and bent < straight / 8
    # corners come back by the sag that straight faces need them outside for: a fiftieth of an element
    assert assess(hex27, device)[1].min == pytest.approx(made.report.min_scaled_jacobian, abs=0.02)
    assert abs(level / (2 * np.pi**2 * 12 * 25) - 1) < 0.01


def test_any_density_lies_on_the_level_set(device: Device) -> None:
    made = blocks_mesh(torus(), 2.5, device=device)
    project = onto(made.surface(), device)
    fine = curve(made, floor=0.3, device=device).sample(3, exact=True)
    assert fine.n_elements == 27 * made.mesh.n_elements
    assert assess(fine, device)[1].min > 0.3
    surface = fine.points[np.unique(fine.boundary())]
    assert np.abs(project(surface, np.zeros_like(surface)) - surface).max() < 1e-3
    assert np.abs(np.hypot(np.hypot(surface[:, 0], surface[:, 1]) - 12, surface[:, 2]) - 5).max() < 0.15


def test_normals_that_run_along_the_surface_are_not_followed() -> None:
    """Below a plane and a step in it, 0.7 ahead: up to the plane, which is 0.1 away, not ahead to the step."""
    z, x = np.meshgrid(np.arange(13.0) / SAMPLES - 2, np.arange(13.0) / SAMPLES - 2, indexing="ij")
    phi = np.repeat(np.maximum(z, x)[:, None], 13, axis=1).astype(np.float32)
    at, normals = np.array([[1.3, 2.0, 1.9]] * 3), np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [1.0, 0.0, 0.0]])
    there = along(phi, at, normals)
    assert np.allclose(there[:2, 2], 2.0, atol=0.02) and np.array_equal(there[2], at[2])
