"""Modulus at the nodes of a scanned phantom beside that of its exact HU: ``python -m gpubspline.bench.modulus``.

Prints the second table of docs/mapping.md. The same nodes get the law of the phantom's own HU there, those of the
surface a little inside of it: what the scan's blur, its noise and each way to read it do to E, and no mesh.
"""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import ndimage

from gpubspline.bench.mass import LAW, Floats, body_of, meshed_blocks
from gpubspline.ct.partial_volume import folding
from gpubspline.ct.phantom import Phantom, phantom
from gpubspline.ct.sampler import hu_sampler
from gpubspline.device import Device, open_device
from gpubspline.material.assign import Mapping, assign
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import integral
from gpubspline.recipe import Body

ELEMENTS, INSIDE_MM = 8000, 0.02

HEADS = ("body", "HU read", "mass", "E", "E off, mean", "E on the surface")


def exact_hu(scanned: Phantom, points: Floats) -> Floats:
    """HU (n,) of a phantom at points (n, 3), those on or off its surface moved a little inside."""
    points = points.copy()
    for _ in range(20):
        out = scanned.distance_mm(points) > -INSIDE_MM / 2
        if not out.any():
            break
        steps = 0.05 * np.eye(3)
        slope = [scanned.distance_mm(points[out] + s) - scanned.distance_mm(points[out] - s) for s in steps]
        normal = np.stack(slope, axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
        points[out] -= normal * (np.maximum(scanned.distance_mm(points[out]), 0) + INSIDE_MM)[:, None]
    return scanned.hu(points)


def nearest_inside(body: Body, points: Floats) -> Floats:
    """HU (n,) of the nearest voxel that lies three quarters of a width below the surface; deeper points as they lie."""
    volume, region = body.volume, body.region
    assert volume is not None
    deep = region.distance_mm < -0.75 * float(np.mean(region.spacing_mm))
    index = volume.to_indices(points)[:, ::-1]
    voxel = tuple(np.clip(np.rint(index).astype(int), 0, np.array(deep.shape) - 1).T)
    spacing = region.spacing_mm[::-1]
    near = ndimage.distance_transform_edt(~deep, sampling=spacing, return_distances=False, return_indices=True)
    lying = ndimage.map_coordinates(volume.hu, index.T, np.float64, order=1, mode="nearest")
    inside = tuple(axis[voxel] for axis in near)
    return np.asarray(np.where(deep[voxel], lying, volume.hu[inside]))


def ways(mesh: Mesh, body: Body, device: Device) -> Iterator[tuple[str, Mesh]]:
    """Each way to read HU near the surface, and the mesh with its material."""
    volume, region, points = body.volume, body.region, mesh.points.astype(np.float64)
    assert volume is not None
    lying = hu_sampler(volume, points, device).at(points)
    folded = lying + folding(volume, region, points, device).correction(points)
    width = float(np.mean(region.spacing_mm))
    known: dict[str, Any] = {"volume": volume, "region": region, "device": device}

    def mapped(hu: Floats, how: str = "nodal", depth: float | None = None, treatment: str = "none") -> Mesh:
        mapping = Mapping(how, depth, partial_volume=treatment)
        return assign(mesh.with_fields({"HU": hu.astype(np.float32)}), LAW, mapping, **known)[0]

    yield "as they lie", mapped(lying)
    yield "half a width deep", mapped(lying, depth=0.5 * width)
    yield "a width deep", mapped(lying, depth=width)
    yield "nearest voxel inside", mapped(nearest_inside(body, points))
    yield "folded", mapped(folded, treatment="fold")
    yield "folded, `nodal-e`", mapped(folded, "nodal-e", treatment="fold")


def rows(device: Device) -> Iterator[str]:
    """Rows of the table, per cent of what the exact HU make at the same nodes."""
    yield f"| {' | '.join(HEADS)} |"
    yield "|---" * len(HEADS) + "|"
    for name in ("adult-femur", "child-femur"):
        scanned = phantom(name)
        body = body_of(None, scanned, "fold")
        mesh = meshed_blocks(body, ELEMENTS, device)
        hu = exact_hu(scanned, mesh.points.astype(np.float64)).astype(np.float32)
        exact, _ = assign(mesh.with_fields({"HU": hu}), LAW, Mapping(), device=device)
        own, outer = exact.fields["E_MPa"].astype(np.float64), np.unique(mesh.boundary())
        whole = integral(exact, "E_MPa", device)
        for way, made in ways(mesh, body, device):
            modulus = made.fields["E_MPa"].astype(np.float64)
            off = made.with_fields({"off": np.abs(modulus - own)})
            ratios = (
                integral(made, "density_g_cm3", device) / integral(exact, "density_g_cm3", device) - 1,
                integral(made, "E_MPa", device) / whole - 1,
                integral(off, "off", device) / whole,
                modulus[outer].mean() / own[outer].mean() - 1,
            )
            cells = [f"{100 * ratio:{'' if place == 2 else '+'}.0f}" for place, ratio in enumerate(ratios)]
            yield f"| {name}, {mesh.n_elements:,} hexes | {way} | {' | '.join(cells)} |"


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for row in rows(open_device()):
        print(row, flush=True)
