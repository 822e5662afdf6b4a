"""Several bodies that touch: conforming, each with its volume, interfaces where their boundary is."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk
from scipy.ndimage import map_coordinates

from gpubspline.ct.labels import Labels, Segment
from gpubspline.ct.region import Region, region_from_mask
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import InputError, MeshError
from gpubspline.export import read_mesh
from gpubspline.mesh.blocks.contacts import find_contacts
from gpubspline.mesh.blocks.core import Cells
from gpubspline.mesh.blocks.curved import curve
from gpubspline.mesh.blocks.grow import find_core
from gpubspline.mesh.blocks.level_set import Field, LevelSet, Part
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.blocks.parts import parts_of
from gpubspline.mesh.blocks.pillow import pillow
from gpubspline.mesh.blocks.repair import SOUND, patterns, repair_owners
from gpubspline.mesh.blocks.result import Blocks, sets_carried_to
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import assess
from gpubspline.mesh.validity import certify

RADIUS, SLOPE, HEIGHT, ACROSS, CORE = 15.0, 0.3, 2.2137, 1.337, 8.03

LINE = np.arange(-20.0, 21.0)
Z, Y, X = np.meshgrid(LINE, LINE, LINE, indexing="ij")
BALL = np.sqrt(X**2 + Y**2 + Z**2) - RADIUS
PLANE = (Z - SLOPE * X - HEIGHT) / np.hypot(1, SLOPE)
INNER = np.sqrt(X**2 + Y**2 + Z**2) - CORE

DEPTH = RADIUS - np.sqrt((X - 0.4) ** 2 + (Y + 0.3) ** 2 + (Z - 0.2) ** 2) - 2.25
"""Of a sphere some 2 mm, 0.8 to 1.1 elements, under the ball's surface."""

PARTS = {
    "halves": {"lower": PLANE, "upper": -PLANE},
    "shell": {"core": INNER, "shell": -INNER},
    "thin": {"core": -DEPTH, "shell": DEPTH},
    "four": {
        "left": np.maximum(PLANE, X - ACROSS),
        "right": np.maximum(PLANE, ACROSS - X),
        "near": np.maximum(-PLANE, Y + 0.2 * X - 0.31),
        "far": np.maximum(-PLANE, 0.31 - Y - 0.2 * X),
    },
    "quarters": {  # two and two touch along a line alone
        "left back": np.maximum(X - ACROSS, Y - 0.7),
        "right back": np.maximum(ACROSS - X, Y - 0.7),
        "left front": np.maximum(X - ACROSS, 0.7 - Y),
        "right front": np.maximum(ACROSS - X, 0.7 - Y),
    },
    "three": {"lower": PLANE, "left": np.maximum(-PLANE, X - ACROSS), "right": np.maximum(-PLANE, ACROSS - X)},
}


def region(distance: np.ndarray) -> Region:
    affine = np.eye(4)
    affine[:3, 3] = LINE[0]
    return Region(distance < 0, distance.astype(np.float32), affine)


@cache
def made(name: str, device: Device) -> Blocks:
    parts = {part: region(np.maximum(BALL, distance)) for part, distance in PARTS[name].items()}
    return blocks_mesh(region(BALL), 2.5, parts=parts, attempts=1, device=device)


@pytest.mark.parametrize(
    ("name", "floor"),
    [("halves", 0.65), ("shell", 0.7), ("thin", 0.6), ("three", 0.6), ("four", 0.55), ("quarters", 0.65)],
)
def test_bodies_share_their_interface(name: str, floor: float, device: Device) -> None:
    mesh = made(name, device).mesh
    assert assess(mesh, device)[1].min > floor
    sets = [mesh.element_sets[part] for part in PARTS[name]]
    assert np.array_equal(np.sort(np.concatenate(sets)), np.arange(mesh.n_elements))
    ball = 4 / 3 * np.pi * RADIUS**3
    assert mesh.volume_mm3 == pytest.approx(ball, rel=0.03)
    one, other = list(PARTS[name])[:2]
    shared = np.intersect1d(*(mesh.cells[mesh.element_sets[part]] for part in (one, other)))
    assert np.array_equal(shared, mesh.node_sets[f"{one}_to_{other}"])
    assert np.array_equal(np.unique(mesh.boundary()), mesh.node_sets["surface"])


def test_each_body_has_its_volume(device: Device) -> None:
    """A core within a shell thinner than an element: chords of the surface between them would cost it 5 %."""
    mesh = made("thin", device).mesh
    core = replace(mesh, connectivity=mesh.cells[mesh.element_sets["core"]], element_sets={})
    assert core.volume_mm3 == pytest.approx(4 / 3 * np.pi * (RADIUS - 2.25) ** 3, rel=0.01)


def test_an_interface_lies_on_the_boundary_of_its_bodies(device: Device) -> None:
    halves = made("halves", device).mesh
    x, _, z = halves.points[halves.node_sets["lower_to_upper"]].T
    assert np.abs((z - SLOPE * x - HEIGHT) / np.hypot(1, SLOPE)).max() < 0.05 * 2.5
    shell = made("shell", device).mesh
    at = np.linalg.norm(shell.points[shell.node_sets["core_to_shell"]], axis=1)
    assert np.abs(at - CORE).max() < 0.1 * 2.5


def faces_between(mesh: Mesh, one: str, other: str) -> np.ndarray:
    """Points (f, 16, 3) at Gauss points of the faces that two bodies share, by the elements' own shape functions."""
    there, at = set(mesh.node_sets[f"{one}_to_{other}"]), (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
    cells, found = mesh.cells[mesh.element_sets[one]], []
    for axis, side in ((axis, side) for axis in range(3) for side in (0, 1)):
        on = [v for v, place in enumerate(mesh.element.vertices) if place[axis] == 2 * side]
        u, w = (index.ravel() for index in np.meshgrid(at, at))
        shape = mesh.element.shape(np.insert(np.stack([u, w], axis=1), axis, side, axis=1))
        shared = np.array([set(row) <= there for row in cells[:, on].tolist()])
        found.append(np.einsum("pk,fkx->fpx", shape, mesh.points[cells[shared]]))
    return np.concatenate(found)


@pytest.mark.parametrize("element_type", ["hex20", "hex27"])
def test_curved_faces_between_bodies_follow_their_boundary(element_type: str, device: Device) -> None:
    """A ball in a ball: rounder, and its volume by scikit-fem that of what the samples, 1 mm apart, say of it.

    Linear between samples, a distance from a ball is greater than it is by a twelfth of its Laplacian, 2 / r.
    """
    blocks = curve(made("shell", device), device=device)
    straight, sampled = made("shell", device).mesh, blocks.sample(1, element_type)
    mesh = replace(sampled, node_sets=sets_carried_to(sampled, straight))
    off = [np.linalg.norm(faces_between(each, "core", "shell"), axis=2) - CORE for each in (straight, mesh)]
    bias = -2 / CORE / 12
    assert off[1].std() < off[0].std() / 4 and abs(off[1].mean() - bias) < 0.005
    inner = replace(mesh, connectivity=mesh.cells[mesh.element_sets["core"]], element_sets={})
    if element_type == "hex27":
        assert volume_by_scikit_fem(inner) == pytest.approx(4 / 3 * np.pi * (CORE + bias) ** 3, rel=2e-3)
    assert blocks.held_back["count"] == 0 and certify(mesh, device).certificate.valid
    assert assess(mesh, device)[1].min > assess(straight, device)[1].min - 0.05


def volume_by_scikit_fem(mesh: Mesh) -> float:
    """Of hex27: their corners, then their other nodes where scikit-fem numbers them."""
    skfem = pytest.importorskip("skfem")
    used, corners = np.unique(mesh.cells[:, [0, 1, 3, 4, 2, 5, 7, 6]], return_inverse=True)
    straight = skfem.MeshHex(mesh.points[used].astype(np.float64).T.copy(), corners.reshape(-1, 8).T.copy())
    dofs = skfem.CellBasis(straight, skfem.ElementHex2()).dofs.element_dofs
    local = 2 - (2 * skfem.ElementHex2().doflocs[:, ::-1]).astype(int)  # its first axis is VTK's last one, backward
    order = [mesh.element.vertices.index(tuple(place)) for place in local.tolist()]
    places = np.empty((3, dofs.max() + 1))
    places[:, dofs] = mesh.points[mesh.cells[:, order]].T
    curved = skfem.MeshHex2(places, straight.t)
    basis = skfem.CellBasis(curved, skfem.ElementHex2(), intorder=8)
    return float(skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis))


def test_corners_of_junctions_stay_and_no_hex_folds(device: Device) -> None:
    blocks = made("four", device)
    straight, mesh = blocks.mesh, curve(blocks, device=device).sample(1, "hex27")
    assert certify(mesh, device).certificate.valid
    near, far = (straight.node_sets[f"{part}_to_{other}"] for part, other in (("left", "near"), ("left", "right")))
    inner = np.setdiff1d(np.intersect1d(near, far), straight.node_sets["surface"])
    assert len(inner) > 2 and np.allclose(
        mesh.points[mesh.cells[:, :8]][np.isin(straight.cells, inner)],
        straight.points[straight.cells][np.isin(straight.cells, inner)],
    )


def test_one_body_is_the_same_by_number_or_by_mask() -> None:
    cells = np.zeros((5, 6, 7), dtype=bool)
    cells[1:4, 1:5, 1:6] = True
    one, other = pillow(cells), pillow(cells.astype(np.int8))
    assert np.array_equal(one.cells, other.cells) and not len(one.interfaces)


def touching(seed: int) -> Cells:
    """Three bodies of noise in a block."""
    rng = np.random.default_rng(seed)
    owners = np.zeros((12, 12, 12), dtype=np.int8)
    coarse = rng.integers(1, 4, (4, 4, 4)).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    owners[2:10, 2:10, 2:10] = coarse
    return owners


@pytest.mark.parametrize("seed", range(4))
def test_bodies_are_sound_each_and_together(seed: int) -> None:
    owners = touching(seed)
    costs = np.random.default_rng(seed).random((4, *owners.shape)).astype(np.float32)
    repaired, _, unsound = repair_owners(owners, costs)
    assert not len(unsound)
    for body in (repaired > 0, *(repaired == number for number in (1, 2, 3))):
        assert SOUND[patterns(body)].all()
    hexes = pillow(repaired)
    assert all(len(set(row)) == 8 for row in hexes.colours[hexes.cells])
    faces = np.sort(
        hexes.cells[:, [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]]
    )
    _, count = np.unique(faces.reshape(-1, 4), axis=0, return_counts=True)
    assert count.max() == 2 and np.count_nonzero(count == 1) == len(hexes.quads)


def test_parts_must_fill_the_region(device: Device) -> None:
    with pytest.raises(InputError, match="fill the region without overlap"):
        blocks_mesh(region(BALL), 2.5, parts={"lower": region(np.maximum(BALL, PLANE))}, device=device)


def test_a_thin_body_keeps_what_it_parts_apart() -> None:
    """Cells of a shell thinner than they are: none is missing between the core and the outside."""
    shell, core = level(np.maximum(BALL, DEPTH)), level(np.maximum(BALL, -DEPTH))
    whole = LevelSet(level(BALL), 2.5, np.eye(4))
    cells = find_core(whole, {"shell": Part(shell, shell), "core": Part(core, core)}).cells
    assert (cells == 1).any() and (cells == 2).any()
    assert not len(find_contacts(whole.phi, [shell, core]).strangers(cells))
    for axis in range(3):
        line = np.moveaxis(cells, axis, 0)
        assert not np.any((line[:-1] == 0) & (line[1:] == 2)) and not np.any((line[:-1] == 2) & (line[1:] == 0))


def test_a_body_without_a_cell_is_refused_with_its_place() -> None:
    speck = np.sqrt((X - 3.2) ** 2 + (Y + 4.1) ** 2 + (Z - 5.3) ** 2) - 0.9
    whole = LevelSet(level(BALL), 2.5, np.diag([2.5, 2.5, 2.5, 1.0]))
    parts = {"rest": level(np.maximum(BALL, -speck)), "speck": level(speck)}
    with pytest.raises(MeshError, match=r"no cell of 2.5 mm lies in speck at \(\d"):
        find_core(whole, {name: Part(phi, phi) for name, phi in parts.items()})


def level(distance: np.ndarray) -> Field:
    """Samples a third of an element of 2.5 mm apart, in elements."""
    at = np.mgrid[0:55, 0:55, 0:55] * (2.5 / 3) + 0.5  # in voxels, from -19.5 mm to 25.5 mm
    return np.asarray(map_coordinates(distance, at, order=1, mode="nearest") / 2.5, dtype=np.float32)


def labels(values: np.ndarray) -> Labels:
    numbers = [int(number) for number in np.unique(values) if number]
    return Labels("labels.nii", {number: "" for number in numbers}, lambda number: Segment(values == number))


def test_labels_part_a_region_and_what_is_none_goes_to_the_nearest() -> None:
    shape, affine = (12, 14, 16), np.diag([1.5, 1.5, 2.0, 1.0])
    affine[:3, 3] = (10, -20, 30)
    values = np.zeros(shape, dtype=np.int16)
    values[3:9, 3:11, 3:8], values[3:9, 3:11, 8:13] = 4, 7
    whole = Volume(np.zeros(shape, dtype=np.float32), affine)
    inside = values > 0
    values[5, 5, 3:6], values[3, 3, 3:5] = 0, 9  # a gap of three voxels, and a label too small to be a body
    window = (slice(2, 11), slice(1, 13), slice(2, 15))
    moved = affine.copy()
    moved[:3, 3] = affine[:3, :3] @ (2, 1, 2) + affine[:3, 3]
    volume = Volume(whole.hu[window], moved)
    region = region_from_mask(volume, inside[window])
    parts, numbers = parts_of(region, volume, labels(values), whole)
    assert numbers == {"label_4": 4, "label_7": 7}
    count = np.sum([part.mask for part in parts.values()], axis=0)
    assert np.array_equal(count, region.mask.astype(int))
    assert parts["label_4"].mask.sum() == 6 * 8 * 5
    with pytest.raises(InputError, match="within the region, got none there"):
        parts_of(region, volume, labels(np.where(inside, 0, values)), whole)


def test_labels_of_a_vertebra_from_the_command_line(data: Path, run: Any, tmp_path: Path) -> None:
    """Body and arch: hexes of both meet at their boundary, none poor."""
    folder = data / "vertebra"
    vertebra, parts = (sitk.ReadImage(str(next(folder.glob(f"*{kind}*")))) for kind in ("vert_label", "subreg"))
    inside, values = sitk.GetArrayFromImage(vertebra) == 22, sitk.GetArrayFromImage(parts)
    image = sitk.GetImageFromArray(np.where(inside, np.where(np.isin(values, (49, 50)), 2, 1), 0).astype(np.uint8))
    image.CopyInformation(parts)
    sitk.WriteImage(image, str(tmp_path / "two.nii.gz"))
    mask, ct = next(folder.glob("*vert_label*")), next(folder.glob("*_ct.nii.gz"))
    words = ["--mask", mask, "--label", 22, "--labels", tmp_path / "two.nii.gz", "--method", "blocks", "--size", 2.5]
    status, out, error = run("mesh", ct, *words, "-o", tmp_path / "two.vtu")
    assert status == 0, error
    mesh = read_mesh(tmp_path / "two.vtu")
    assert len(mesh.element_sets["label_1"]) + len(mesh.element_sets["label_2"]) == mesh.n_elements
    assert mesh.cell_fields["scaled_jacobian"].min() > 0.5
    assert set(np.unique(mesh.cell_fields["label"])) == {1, 2} and "certified valid" in out
