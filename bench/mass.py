"""Mass of meshes beside that of the body: ``python -m gpubspline.bench.mass CT_FOLDER [BODY]``.

Prints the table of docs/mapping.md. The folder is that of the real CT that tests use. What a phantom weighs is known:
its exact HU by the law, over its exact body. What a real bone weighs is what the scan holds of it, whatever its blur:
HU over the bone and a voxel and a half around it, less what they are farther out, which is read along the normal.
Nothing of it is folded.
"""

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.clock import Clock
from gpubspline.ct.phantom import Phantom, phantom
from gpubspline.ct.region import otsu_threshold, region_from_threshold
from gpubspline.device import Device, open_device
from gpubspline.errors import InputError
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.mapping import map_material
from gpubspline.material.registry import law
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.methods import choose, mesh_body
from gpubspline.pipeline import fit_body
from gpubspline.recipe import Body, Meshing, Sampling, Shaping, Source
from gpubspline.segment import find_body

Floats = NDArray[np.float64]
LAW = law()
SHELL = 1.5
"""Widths of a voxel along the normal, beyond which a scan's blur has ended."""

COLUMNS: tuple[tuple[str, str, str, float | None], ...] = (
    ("as they lie: nodes", "none", "nodal", None),
    ("element-e", "none", "element-e", None),
    ("half a width deep: nodes", "none", "nodal", 0.5),
    ("a width deep", "none", "nodal", 1.0),
    ("folded: nodes", "fold", "nodal", None),
    ("element-e", "fold", "element-e", None),
)
"""Head, treatment, mapping, and depth in mean widths of a voxel."""


def bodies(folder: Path) -> Iterator[tuple[str, Source | None, Phantom | None]]:
    """Name of a body, and where it is."""
    yield "adult femur, phantom", None, phantom("adult-femur")
    yield "child femur, phantom", None, phantom("child-femur")
    vertebra = folder / "vertebra" / "sub-ct_label-22_ct.nii.gz"
    labels = {name: folder / "vertebra" / f"sub-ct_seg-{name}_label-22_msk.nii.gz" for name in ("vert", "subreg")}
    yield "vertebra L3, 1.5 mm voxels", Source(vertebra, mask=labels["vert"], label=22), None
    yield "its body alone", Source(vertebra, mask=labels["subreg"], label=49), None
    hip = folder / "hips" / "example_ct.nii.gz"
    yield "hip above 250 HU, 3 mm", Source(hip, threshold_hu=250, box_mm=(-146, -66, -190, -100, 94, 160)), None
    yield "head above -200 HU, slices of 4 mm", Source(folder / "head" / "ct_example.nii.gz", threshold_hu=-200), None


def body_of(source: Source | None, scanned: Phantom | None, treatment: str) -> Body:
    """Read or scan a body."""
    if source is not None:
        found = find_body(source, Clock())
        return Body(found.whole, found.volume, found.region, found.threshold_hu, partial_volume=treatment)
    assert scanned is not None
    volume = scanned.scan()
    threshold = otsu_threshold(volume)
    return Body(volume, volume, region_from_threshold(volume, threshold, fill="slice"), threshold, None, treatment)


def exact_g(body: Phantom, device: Device, step_mm: float = 0.4) -> float:
    """Mass of a phantom's exact body, by the law of its exact HU."""
    low = body.affine[:3, 3]
    high = low + body.affine[:3, :3] @ (np.array(body.shape) - 1)
    x, y, z = (np.arange(a + step_mm / 2, b, step_mm) for a, b in zip(low, high, strict=True))
    total = 0.0
    for height in z:
        points = np.stack([*(a.ravel() for a in np.meshgrid(x, y)), np.full(x.size * y.size, height)], axis=1)
        hu = body.hu(points[body.level(points) < 0])
        if hu.size:
            total += float(map_material(hu, LAW, device=device).density_g_cm3.sum(dtype=np.float64))
    return total * step_mm**3 / 1000


def held_g(body: Body, device: Device) -> float:
    """Mass that the scan holds of a body: by the law well inside, by HU less those farther out in a shell around it."""
    volume, region = body.volume, body.region
    assert volume is not None
    inverse, edges, relation = np.linalg.inv(volume.affine), volume.affine[:3, :3].T, LAW.density

    def at(samples: NDArray[Any], points: Floats) -> Floats:
        index = (points @ inverse[:3, :3].T + inverse[:3, 3])[:, ::-1].T
        return np.asarray(ndimage.map_coordinates(samples, index, np.float64, order=1, mode="nearest"))

    distance, weight = region.distance_mm.astype(np.float64), np.ones(region.mask.shape)
    for axis in range(3):
        np.moveaxis(weight, axis, 0)[[0, -1]] *= 0.5  # the scan ends at the centres of its voxels
    shell = np.abs(distance) < SHELL * np.linalg.norm(edges, axis=1).sum()
    k, j, i = np.nonzero(shell)
    points = volume.to_points(np.stack([i, j, k], axis=1))
    steps = 0.5 * float(region.spacing_mm.min()) * np.eye(3)
    slope = np.stack([at(distance, points + s) - at(distance, points - s) for s in steps], axis=1)
    normal = slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-12)[:, None]
    width, depth = np.abs(normal @ edges.T).sum(axis=1), distance[shell]
    shell[shell] = within = np.abs(depth) < SHELL * width
    points, normal, width, depth = points[within], normal[within], width[within], depth[within]
    deep = (distance < 0) & ~shell
    inner = map_material(volume.hu[deep].astype(np.float32), LAW, device=device).density_g_cm3
    mass = float(np.sum(inner * weight[deep], dtype=np.float64))
    outside = np.clip(0.5 + depth / width, 0, 1)
    beyond = at(volume.hu, points + (SHELL * width - depth)[:, None] * normal)
    slope_g, start_g = relation.slope_g_cm3_per_hu, relation.intercept_g_cm3
    excess = slope_g * volume.hu[shell] + start_g - (slope_g * beyond + start_g) * outside
    return (mass + float(np.sum(excess * weight[shell]))) * volume.voxel_mm3 / 1000


def meshed(body: Body, method: str, device: Device) -> Mesh | None:
    """Mesh a body by a method and its defaults; None where it cannot."""
    sampling, clock = Sampling(LAW), Clock()
    try:
        if method == "tensor":
            assert body.volume is not None
            patch = fit_body(body, Source(""), Shaping(), device, clock).fit.patch
            return sample(patch, patch.shape, device=device)
        choice = choose(body, Meshing(method), Shaping(), sampling, "z", device)
        return mesh_body(body, choice, Meshing(method), sampling, device, clock).mesh
    except InputError:
        return None


def meshed_blocks(body: Body, elements: int, device: Device) -> Mesh:
    """Mesh a body by blocks of about so many hexes."""
    meshing, sampling = Meshing("blocks", elements=elements), Sampling(LAW)
    choice = choose(body, meshing, Shaping(), sampling, "z", device)
    return mesh_body(body, choice, meshing, sampling, device, Clock()).mesh


def rows(folder: Path, device: Device, only: str = "") -> Iterator[str]:
    """Rows of the table: mass of a mesh over that of the body, less 1, by each mapping; of bodies so called."""
    yield "| body | mass, g | method, elements | volume | " + " | ".join(head for head, *_ in COLUMNS) + " |"
    yield "|---" * (4 + len(COLUMNS)) + "|"
    for name, source, scanned in (body for body in bodies(folder) if only in body[0]):
        both = {treatment: body_of(source, scanned, treatment) for treatment in ("none", "fold")}
        true = held_g(both["none"], device) if scanned is None else exact_g(scanned, device)
        for method in ("tensor", "butterfly", "blocks"):
            meshes = {treatment: meshed(body, method, device) for treatment, body in both.items()}
            made = meshes["fold"]
            region = both["none"].region
            if made is None or abs(made.volume_mm3 / region.volume_mm3 - 1) > 0.1:
                continue  # not its kind of body
            width = float(np.mean(region.spacing_mm))
            cells = []
            for _, treatment, how, depth in COLUMNS:
                mapping = Mapping(how, None if depth is None else depth * width, partial_volume=treatment)
                mesh, body = meshes[treatment], both[treatment]
                assert mesh is not None
                _, alarms = assign(mesh, LAW, mapping, volume=body.volume, region=region, device=device)
                assert alarms.mass_mesh_g is not None
                cells.append(f"{100 * (alarms.mass_mesh_g / true - 1):+.1f}")
            size = f"{100 * (made.volume_mm3 / region.volume_mm3 - 1):+.1f}"
            yield f"| {name} | {true:.4g} | {method}, {made.n_elements:,} | {size} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    for row in rows(Path(sys.argv[1]), open_device(), " ".join(sys.argv[2:])):
        print(row, flush=True)


if __name__ == "__main__":
    main()
