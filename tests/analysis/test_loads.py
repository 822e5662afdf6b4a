"""Supports and loads on regions: totals, moments, the patch condition, the shipped stance, and what is refused."""

import numpy as np
import pytest

from gpubspline.analysis.load_case import AXES, Force, LoadCase, Pressure, Support, read_load_case
from gpubspline.analysis.loads import assemble, check_on_body, load_case, load_cases, patient_axes
from gpubspline.analysis.regions import Box, Cap, HalfSpace, Patch, Region, Side, Sphere, width_mm
from gpubspline.ct.femur import ADULT, CHILD, femur
from gpubspline.ct.region import Region as BodyRegion
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh

HEXES = ("hex8", "hex20", "hex27")
HELD = Support(Region("w0", (Side("w0"),)))


def box(element_type="hex8", counts=(4, 3, 5), place=None, explicit=False):
    """A structured mesh of the unit box, its points moved by ``place``."""
    element = ELEMENTS[element_type]
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    grid = grid if kept is None else grid[kept]
    mesh = Mesh(grid if place is None else place(grid), element_type, structure=counts)
    return Mesh(mesh.points, element_type, connectivity=mesh.cells) if explicit else mesh


def twisted(p):
    """Smooth and one to one on the unit box, with no flat side."""
    x, y, z = p.T
    return np.stack([x + 0.1 * y * y * z, y + 0.1 * x * z, z * (1 + 0.2 * x)], axis=1) * 30


def stirred(p):
    """Straight box, its inner points moved; midway points of curved elements, too."""
    inner = np.prod(p * (1 - p), axis=1)[:, None]
    return p + inner * np.sin(9 * p[:, [1, 2, 0]] + 1)


def ball(p):
    """Unit box to a ball of radius 20 mm about (5, -3, 40): each cube goes to a sphere."""
    q = 2 * p - 1
    size, length = np.abs(q).max(axis=1), np.linalg.norm(q, axis=1)
    return 20 * q * (size / np.where(length > 0, length, 1))[:, None] + [5, -3, 40]


def loaded(mesh, *loads, **more):
    """A load case of forces and pressures on a mesh, held at w0."""
    forces = tuple(load for load in loads if isinstance(load, Force))
    pressures = tuple(load for load in loads if isinstance(load, Pressure))
    held = Support(Region("all", (HalfSpace((0, 0, -1e3), (0, 0, 1)),)))
    return assemble(LoadCase("test", (held,), forces, pressures, **more), mesh)


def region(*parts):
    return Region("here", parts)


def stress_forces(mesh, stress):
    """Nodal forces of a constant stress (3, 3) inside the elements, by 5 Gauss points per parameter."""
    points, weights = np.polynomial.legendre.leggauss(5)
    at = np.stack(np.meshgrid(points, points, points, indexing="ij"), axis=-1).reshape(-1, 3) / 2 + 0.5
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8
    gradient = mesh.element.gradient(at)
    jacobian = np.einsum("dgk,mkc->mgcd", gradient, mesh.points[mesh.cells])
    slope = np.einsum("dgk,mgdc->mgkc", gradient, np.linalg.inv(jacobian))
    forces = np.zeros((mesh.n_nodes, 3))
    each = np.einsum("mg,mgkc,cb->mkb", np.linalg.det(jacobian) * weight, slope, stress)
    np.add.at(forces, mesh.cells, each)
    return forces


@pytest.mark.parametrize("explicit", [False, True])
@pytest.mark.parametrize("element_type", HEXES)
def test_total_force_and_moment_of_a_spread_force_are_exact(element_type, explicit):
    """On a flat side the resultant passes through the middle of the side, however uneven its faces are."""
    uneven = box(element_type, place=lambda p: p**1.7 * [30, 20, 50], explicit=explicit)
    force, middle = np.array([3.0, -40, 7]), np.array([15.0, 10, 50])
    made = loaded(uneven, Force(region(HalfSpace((0, 0, 50), (0, 0, 1)), Cap((0, 0, 1), 1e-3)), tuple(force)))
    np.testing.assert_allclose(made.applied_n, force, rtol=1e-13)
    np.testing.assert_allclose(made.moment_nmm(uneven), np.cross(middle, force), rtol=1e-12)
    np.testing.assert_allclose(made.moment_nmm(uneven, middle), 0, atol=1e-9)
    applied = made.report[-1]
    assert applied.area_mm2 == pytest.approx(600, rel=1e-12)
    np.testing.assert_allclose(applied.centre_mm, middle, rtol=1e-12)


def test_a_force_is_spread_by_area_and_not_by_nodes():
    mesh = box("hex8", (3, 3, 2), lambda p: np.stack([p[:, 0] ** 2 * 8, p[:, 1] * 2, p[:, 2]], axis=1))
    made = loaded(mesh, Force(region(Side("w1")), (0, 0, 16)))  # 1 N/mm2 on faces 2 and 6 mm wide, 1 mm deep
    share = made.forces_n[mesh.points[:, 2] == 1, 2].reshape(3, 3)
    np.testing.assert_allclose(share, np.outer([0.5, 1, 0.5], [1, 4, 3]), rtol=1e-13)


@pytest.mark.parametrize("element_type", HEXES)
def test_pressure_on_a_closed_surface_sums_to_nothing(element_type):
    mesh = box(element_type, place=twisted)
    made = loaded(mesh, Pressure(region(Side("surface")), 2.5))
    size = np.abs(made.forces_n).sum()
    assert size > 1000
    np.testing.assert_allclose(made.applied_n, 0, atol=1e-13 * size)
    np.testing.assert_allclose(made.moment_nmm(mesh), 0, atol=1e-12 * size * 30)
    np.testing.assert_array_equal(made.report[1].force_n, 0)  # a table shows no rounding


@pytest.mark.parametrize("element_type", HEXES)
def test_pressure_all_round_is_what_an_even_stress_bears(element_type):
    """The patch condition on curved, distorted elements: no node, inside or outside, is left with a force."""
    mesh = box(element_type, place=twisted)
    made = loaded(mesh, Pressure(region(Side("surface")), 2.5))
    inside = stress_forces(mesh, -2.5 * np.eye(3))
    np.testing.assert_allclose(made.forces_n, inside, atol=1e-12 * np.abs(inside).max())


@pytest.mark.parametrize("element_type", HEXES)
def test_pulled_ends_are_what_a_uniaxial_stress_bears(element_type):
    mesh = box(element_type, place=stirred)
    pulled = [Force(region(Side(side)), (0, 0, sign * 2.0)) for side, sign in (("w0", -1), ("w1", 1))]
    inside = stress_forces(mesh, np.diag([0, 0, 2.0]))
    np.testing.assert_allclose(loaded(mesh, *pulled).forces_n, inside, atol=1e-13)


def test_scikit_fem_solves_the_uniaxial_patch_with_these_forces():
    """Independent stiffness: strain 1/E along the pull and -nu/E across it, to rounding, on distorted hexes."""
    skfem = pytest.importorskip("skfem")
    from skfem.io import from_meshio
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    modulus, nu, pull = 1000.0, 0.3, 5.0
    mesh = box("hex8", place=stirred)
    made = loaded(mesh, Force(region(Side("w1")), (0, 0, pull)))
    given = mesh.to_meshio()
    given.point_sets, given.cell_sets = {}, {}
    basis = skfem.Basis(from_meshio(given), skfem.ElementVector(skfem.ElementHex1()), intorder=6)
    stiffness = linear_elasticity(*lame_parameters(modulus, nu)).assemble(basis)
    dofs, load = basis.nodal_dofs, np.zeros(basis.N)
    np.testing.assert_allclose(basis.doflocs[:, dofs[0]].T, mesh.points)
    load[dofs.ravel()] = made.forces_n.T.ravel()
    held = np.concatenate([dofs[c][mesh.points[:, c] == 0] for c in range(3)])
    u = skfem.solve(*skfem.condense(stiffness, load, D=held))
    expected = mesh.points * np.array([-nu, -nu, 1]) * pull / modulus
    np.testing.assert_allclose(u[dofs].T, expected, atol=1e-13)


@pytest.mark.parametrize("element_type", HEXES)
def test_gravity_is_mass_times_acceleration_at_the_centre_of_mass(element_type):
    """Density linear in x on a box: mass and moment in closed form; 9810 mm/s2 on 1 g/cm3 is 9.81e-6 N/mm3."""
    size = np.array([30.0, 20, 50])
    mesh = box(element_type, place=lambda p: stirred(p) * size)
    mesh = mesh.with_fields({"density_g_cm3": 1 + mesh.points[:, 0] / 30})
    made = loaded(mesh, gravity_mm_s2=(0, 0, -9810))
    mass = size.prod() * 1.5e-9
    np.testing.assert_allclose(made.applied_n, [0, 0, -9810 * mass], rtol=1e-12, atol=1e-15)
    centre = size * [(1 / 2 + 1 / 3) / 1.5, 1 / 2, 1 / 2]
    np.testing.assert_allclose(made.report[-1].centre_mm, centre, rtol=1e-9)  # curved elements: by quadrature
    np.testing.assert_allclose(made.moment_nmm(mesh), np.cross(centre, made.applied_n), rtol=1e-9, atol=1e-12)


def test_a_box_cuts_off_the_same_as_half_spaces():
    mesh = box("hex20", (7, 7, 7), ball)
    sides = [HalfSpace((0, 0, 52), (0, 0, 1)), HalfSpace((2, 0, 0), (1, 0, 0)), HalfSpace((9, 0, 0), (-1, 0, 0))]
    made = loaded(mesh, Force(region(Box((2, -90, 52), (9, 90, 90))), (0, 0, -1)))
    same = loaded(mesh, Force(region(*sides), (0, 0, -1)))
    np.testing.assert_array_equal(made.forces_n, same.forces_n)
    assert 100 < made.report[-1].area_mm2 < 0.1 * 4 * np.pi * 400


@pytest.mark.parametrize("counts", [(9, 9, 9), (25, 25, 25)])
def test_regions_of_a_ball_have_the_areas_of_caps(counts):
    """A cap of depth h has the area 2 pi r h; what a sphere or a patch cuts out of the surface is a cap, too."""
    mesh, r, centre = box("hex20", counts, ball), 20.0, np.array([5.0, -3, 40])
    towards = np.array([1.0, 2, 2]) / 3
    top = tuple(centre + r * towards)
    chord = np.sqrt(2 * r * 4.0)  # from the top to the rim of a cap 4 mm deep
    outside = tuple(centre + (r + 10) * towards)
    reach = np.hypot(10, chord * np.sqrt(1 + 10 / r))  # the law of cosines, from 10 mm above
    parts = {
        "cap": Cap(tuple(towards), 4.0),
        "share": Cap(tuple(towards), 0.1, of_width=True),
        "half-space": HalfSpace(tuple(centre + (r - 4) * towards), tuple(towards * 7)),
        "sphere": Sphere(top, chord),
        "patch on": Patch(top, radius_mm=chord),
        "patch above": Patch(outside, radius_mm=np.sqrt(reach**2 - 100)),
        "area": Patch(outside, area_mm2=2 * np.pi * r * 4),
    }
    for name, part in parts.items():
        applied = loaded(mesh, Force(region(part), (0, 0, -1))).report[-1]
        assert applied.area_mm2 == pytest.approx(2 * np.pi * r * 4, rel=0.02 if counts[0] > 9 else 0.06), name
        on_axis = centre + (r - 2) * towards  # Archimedes: the height of a cap's area is even
        np.testing.assert_allclose(applied.centre_mm, on_axis, atol=0.1 if counts[0] > 9 else 0.4, err_msg=name)


def test_a_patch_far_outside_the_mesh_is_asked_about():
    mesh = box("hex8", (7, 7, 7), ball)  # of radius 20 about (5, -3, 40)
    with pytest.warns(GpubsplineWarning, match=r"point of the region 'r' lies 47 mm outside the mesh's box, LPS"):
        made = loaded(mesh, Force(Region("r", (Patch((5, -70, 40), area_mm2=100),)), (0, 0, -1)))
    assert made.report[-1].centre_mm[1] < -20  # the nearest there is


def test_parts_of_a_region_hold_together_and_a_normal_chooses():
    mesh = box("hex8", (5, 5, 5), lambda p: p * 10)
    half = loaded(mesh, Force(region(Side("w1"), HalfSpace((5, 0, 0), (1, 0, 0))), (1, 0, 0))).report[-1]
    assert half.area_mm2 == pytest.approx(50)
    np.testing.assert_allclose(half.centre_mm, [7.5, 5, 10])
    slab = loaded(mesh, Force(region(Cap((0, 0, 1), 5.0)), (1, 0, 0))).report[-1]
    faced = loaded(mesh, Force(region(Cap((0, 0, 1), 5.0, within_deg=45)), (1, 0, 0))).report[-1]
    assert (slab.area_mm2, faced.area_mm2) == pytest.approx((300, 100))


def test_supports_hold_the_nodes_and_components_that_are_asked_for():
    mesh = box("hex20", (3, 3, 3), lambda p: p * 10)
    edge = np.flatnonzero((mesh.points[:, 0] == 0) & (mesh.points[:, 2] == 5))
    mesh = Mesh(mesh.points, "hex20", structure=(3, 3, 3), node_sets={"edge": edge})
    supports = (
        Support(region(Side("u0")), (True, False, False)),
        Support(region(Side("edge")), (False, False, True), (9, 9, 0.25)),
        Support(region(Sphere((10, 10, 10), 4.0)), displacement_mm=(0.5, 0, 0)),
    )
    made = assemble(LoadCase("test", supports), mesh)
    on_side, near = mesh.points[:, 0] == 0, np.linalg.norm(mesh.points - 10, axis=1) <= 4
    np.testing.assert_array_equal(made.fixed[:, 0], on_side | near)
    np.testing.assert_array_equal(np.flatnonzero(made.fixed[:, 2] & ~near), edge)
    assert near.sum() == 4 and set(made.prescribed_mm[near, 0]) == {0.5}
    assert set(made.prescribed_mm[edge, 2]) == {0.25} and not made.prescribed_mm[edge, :2].any()
    np.testing.assert_array_equal(made.gripped, on_side | near)
    assert made.report[0].area_mm2 == pytest.approx(100) and made.report[1].area_mm2 == 0


def test_only_supports_and_forces_grip():
    mesh = box("hex8", (4, 4, 4), lambda p: p * 10)
    mesh = mesh.with_fields({"density_g_cm3": np.ones(mesh.n_nodes)})
    case = LoadCase("test", (HELD,), (), (Pressure(region(Side("w1")), 1.0),), (0, 0, -1), away=0.2, away_of_width=True)
    made = assemble(case, mesh)
    np.testing.assert_array_equal(made.gripped, mesh.points[:, 2] == 0)
    assert made.away_mm == pytest.approx(2)


def bone_mesh(bone, counts=(9, 9, 25), mirror=False):
    """Section by section of an analytic femur along z: discs between the outer points of its level."""
    body = femur(bone)
    grid = np.stack(np.meshgrid(np.linspace(-100, 60, 321), np.linspace(-40, 40, 161), indexing="ij"), axis=-1)
    sections = []
    for z in np.linspace(0.5, bone.length - 0.5, counts[2]):
        inside = grid[body.level(np.concatenate([grid, np.full((*grid.shape[:2], 1), z)], axis=-1)) < 0]
        sections.append(_section(inside, counts[0], counts[1], z))
    points = np.concatenate(sections)
    if mirror:
        points = points.reshape(counts[2], counts[1], counts[0], 3)[:, :, ::-1].reshape(-1, 3) * [-1, 1, 1]
    return Mesh(points, "hex8", structure=counts)


def _section(inside, n_u, n_v, z):
    """Rows along x between the ends of the section, n_v of them evenly along y."""
    rows = np.unique(inside[:, 1])
    ends = np.array([[x.min(), x.max()] for x in (inside[inside[:, 1] == y, 0] for y in rows)])
    at = np.linspace(rows[0], rows[-1], n_v)
    first, last = (np.interp(at, rows, ends[:, c]) for c in range(2))
    x = first[:, None] + (last - first)[:, None] * np.linspace(0, 1, n_u)
    return np.stack([x, np.broadcast_to(at[:, None], x.shape), np.full(x.shape, z)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("bone", [ADULT, CHILD], ids=["adult", "child"])
def test_stance_finds_head_trochanter_and_cut_of_either_femur(bone, mirror):
    mesh = bone_mesh(bone, mirror=mirror)
    made, side = assemble(load_case("stance"), mesh), -1 if mirror else 1
    distal, head, trochanter = made.report
    np.testing.assert_allclose(head.force_n, [203 * side, 210, -1135], rtol=1e-12)  # lateral, to the back, down
    np.testing.assert_allclose(trochanter.force_n, [-203 * side, -210, 807], rtol=1e-12)
    np.testing.assert_allclose(made.applied_n, [0, 0, -328], atol=1e-10)
    centre = np.array(bone.head_centre) * [side, 1, 1]
    assert np.linalg.norm(head.centre_mm - centre) == pytest.approx(bone.head_radius, rel=0.15)
    assert head.centre_mm[2] > centre[2] and side * trochanter.centre_mm[0] > 0.5 * bone.shaft[0]
    assert bone.root - 10 < trochanter.centre_mm[2] < bone.root + 40
    held = np.flatnonzero(made.fixed[:, 0])
    np.testing.assert_array_equal(held, np.flatnonzero(mesh.points[:, 2] == mesh.points[:, 2].min()))
    np.testing.assert_array_equal(made.fixed, made.fixed[:, :1].repeat(3, axis=1))
    assert distal.area_mm2 == pytest.approx(np.pi * bone.shaft[0] * bone.shaft[1], rel=0.1)
    assert made.away_mm == pytest.approx(0.1 * width_mm(mesh.points))


def voxels(level, low, high, step=2.0):
    """Region of a level on a grid of voxels between two corners."""
    i, j, k = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    at = np.stack(np.meshgrid(i, j, k, indexing="ij"), axis=-1).transpose(2, 1, 0, 3)
    affine = np.diag([step, step, step, 1.0])
    affine[:3, 3] = low
    distance = level(at).astype(np.float32)
    return BodyRegion(distance < 0, distance, affine)


def test_a_body_is_judged_before_it_is_meshed(monkeypatch):
    """A femur tells its side by its voxels, all or some of them, a ball does not; what is far from them is missed."""
    bone, stance = voxels(femur(CHILD).level, (-60, -30, -2), (60, 30, CHILD.length + 2)), load_case("stance")
    check_on_body(stance, bone)
    monkeypatch.setattr("gpubspline.analysis.loads._VOXELS", 1000)
    check_on_body(stance, bone)
    round_one = voxels(lambda at: np.linalg.norm(at, axis=-1) - 20, (-24, -24, -24), (25, 25, 25))
    with pytest.raises(InputError, match="top lies in the middle: say axes"):
        check_on_body(stance, round_one)
    for part, caught in (
        (Sphere((26, 0, 0), 1), True),  # what the mesh has beyond the voxels is not known yet
        (Sphere((0, 60, 0), 20), False),
        (Box((-5, -5, 40), (5, 5, 50)), False),
        (Box((-5, -5, 15), (5, 5, 50)), True),
        (HalfSpace((0, 0, 50), (0, 0, 1)), False),
        (HalfSpace((0, 0, 10), (0, 0, 1)), True),
        (Cap((0, 0, 1), 2.0), True),
        (Patch((90, 0, 0), 5.0), True),  # which is asked about where it is meshed
        (Side("w0"), True),
    ):
        case = LoadCase("test", (HELD,), (Force(region(part), (0, 0, 1)),))
        if caught:
            check_on_body(case, round_one)
        else:
            with pytest.raises(
                InputError, match="'here' to catch a part of the body's surface, got none: the body spans x"
            ):
                check_on_body(case, round_one)


def test_a_load_on_nothing_but_its_support_is_warned_of():
    mesh, held = box(counts=(4, 4, 4)), Support(Region("w0", (Side("w0"),)), (True, False, True))
    for push, warned in (
        (Force(region(Side("w0")), (3, 0, -5)), True),
        (Force(region(Side("w0")), (3, 1, -5)), False),  # y is free
        (Force(region(Side("w1")), (3, 0, -5)), False),
        (Pressure(region(Side("w0")), 2.0), True),
        (Pressure(region(Side("surface")), 2.0), False),
    ):
        forces, pressures = ((push,), ()) if isinstance(push, Force) else ((), (push,))
        made = assemble(LoadCase("test", (held,), forces, pressures), mesh)
        assert [applied.held for applied in made.report] == [False, warned]
        if warned:
            with pytest.warns(GpubsplineWarning, match="on 'here' pushes nothing but nodes that are held"):
                made.warn_of_held()
        else:
            made.warn_of_held()


def test_stance_hardly_depends_on_the_mesh():
    coarse, fine = (assemble(load_case("stance"), bone_mesh(CHILD, counts)) for counts in ((9, 9, 25), (17, 17, 49)))
    for one, other in zip(coarse.report, fine.report, strict=True):
        assert one.area_mm2 == pytest.approx(other.area_mm2, rel=0.15)
        np.testing.assert_allclose(one.centre_mm, other.centre_mm, atol=1.2)


def test_meshes_of_one_body_are_loaded_at_the_same_places():
    """Measured by one body, caps differ only by how well the meshes follow it, and come nearer with each."""
    case, body = load_case("stance"), bone_mesh(CHILD, (21, 21, 61))
    fine = assemble(case, body)
    off = []
    for counts in ((9, 9, 25), (13, 14, 37), (17, 17, 49)):
        made = assemble(case, bone_mesh(CHILD, counts), body)
        assert made.away_mm == fine.away_mm
        off.append(
            [abs(one.area_mm2 / other.area_mm2 - 1) for one, other in zip(made.report, fine.report, strict=True)]
        )
        for one, other in zip(made.report, fine.report, strict=True):
            np.testing.assert_allclose(one.centre_mm, other.centre_mm, atol=0.25)
    for of_head_or_trochanter in np.array(off).T[1:]:
        assert np.all(np.diff(of_head_or_trochanter) < 0) and of_head_or_trochanter[-1] < 0.02


def test_axes_of_a_femur_are_right_handed_or_mirrored():
    mesh = bone_mesh(CHILD)
    np.testing.assert_array_equal(patient_axes("femur", mesh.points), patient_axes("left femur", mesh.points))
    np.testing.assert_array_equal(patient_axes("right femur", mesh.points), [1, -1, 1])
    np.testing.assert_array_equal(patient_axes("left femur", mesh.points), [-1, -1, 1])
    with pytest.raises(InputError, match="top lies in the middle: say axes"):
        patient_axes("femur", box().points)


CASE = """
title = "A block pulled and pressed"
source = "here"
axes = "right femur"
away_mm = 5.0
averaged_mm = 2
[regions.tip]
side = "w1"
sphere = { centre_mm = [0, 0, 90], radius_mm = 20 }
box = { low_mm = [-9, -8, 80], high_mm = [9, 8, 95] }
halfspace = { point_mm = [0, 0, 80], normal = [0, 0, 1] }
patch = { point_mm = [0, 9, 90], area_mm2 = 8 }
cap = { towards = [0, 0, 1], depth_of_width = 0.1, within_deg = 45 }
[[fixed]]
region = "w0"
components = "xz"
displacement_mm = [0, 0, 0.5]
[[force]]
region = "tip"
force_n = [0, 0, -100]
[[pressure]]
region = "u1"
pressure_mpa = 0.5
[gravity]
acceleration_mm_s2 = [0, 0, -9810]
"""


def test_a_file_says_all_that_a_load_case_holds(tmp_path):
    path = tmp_path / "pull.toml"
    path.write_text(CASE)
    tip = Region(
        "tip",
        (
            Side("w1"),
            Sphere((0, 0, 90), 20),
            Box((-9, -8, 80), (9, 8, 95)),
            HalfSpace((0, 0, 80), (0, 0, 1)),
            Patch((0, 9, 90), area_mm2=8),
            Cap((0, 0, 1), 0.1, True, 45),
        ),
    )
    assert (
        load_case(path)
        == load_case(str(path))
        == LoadCase(
            "pull.toml",
            (Support(Region("w0", (Side("w0"),)), (True, False, True), (0, 0, 0.5)),),
            (Force(tip, (0, 0, -100)),),
            (Pressure(Region("u1", (Side("u1"),)), 0.5),),
            (0, 0, -9810),
            axes="right femur",
            away=5.0,
            averaged_mm=2.0,
            title="A block pulled and pressed",
            source="here",
        )
    )


def test_shipped_cases_can_be_read():
    assert "stance" in load_cases()
    for name in load_cases():
        case = load_case(name)
        assert case.name == name and case.title and case.source


REFUSED = {
    "key": ('colour = "red"\n' + CASE, "'colour' which is unknown"),
    "region key": (
        CASE.replace("radius_mm = 20", "radius = 20"),
        r"sphere of \[regions.tip\], got 'radius_mm' missing",
    ),
    "region kind": (CASE.replace("sphere =", "globe ="), r"\[regions.tip\], got 'globe' which is unknown"),
    "empty region": (CASE + "[regions.none]\n", "none.*got nothing"),
    "axes": (CASE.replace("right femur", "bone"), f"axes of {', '.join(AXES)}, got 'bone'"),
    "support key": (CASE.replace("components", "directions"), r"\[\[fixed\]\] 1, got 'directions' which is unknown"),
    "components": (CASE.replace('"xz"', '"xw"'), "letters of xyz for components"),
    "vector": (CASE.replace("[0, 0, -100]", "[0, -100]"), r"three finite numbers for force_n of \[\[force\]\] 1"),
    "zero": (CASE.replace("[0, 0, -100]", "[0, 0, 0]"), "not zero for force_n"),
    "infinite": (CASE.replace("[0, 0, -100]", "[0, 0, inf]"), "three finite numbers for force_n"),
    "radius": (CASE.replace("radius_mm = 20", "radius_mm = -1"), "above 0 for radius_mm in sphere"),
    "box": (CASE.replace("[9, 8, 95]", "[9, 8, 75]"), r"low_mm up to high_mm in box of \[regions.tip\], got .*75.0\]"),
    "mean": (CASE.replace("averaged_mm = 2", "averaged_mm = 0"), "a number above 0 for averaged_mm of the file, got 0"),
    "both": (CASE.replace("away_mm = 5.0", "away_mm = 5.0\naway_of_width = 1"), "away_mm or away_of_width.*got both"),
    "neither": (CASE.replace(", area_mm2 = 8", ""), "radius_mm or area_mm2 in patch.*got neither"),
    "number": (CASE.replace("pressure_mpa = 0.5", 'pressure_mpa = "much"'), "a number for pressure_mpa"),
    "angle": (CASE.replace("within_deg = 45", "within_deg = 270"), r"at most 180 for within_deg in cap of .*, got 270"),
    "list": ("force = 3\n", "a list for force"),
    "unheld": ('[[force]]\nregion = "w1"\nforce_n = [0, 0, 1]\n', r"at least one support \(\[\[fixed\]\]\)"),
    "unloaded": ('[[fixed]]\nregion = "w0"\n', "got supports only"),
    "not TOML": ("[[fixed]\n", "expected TOML"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_does_not_follow_the_schema_is_refused(name):
    text, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as refused:
        read_load_case(text, "pull.toml")
    assert "pull.toml" in str(refused.value) and "\n" not in str(refused.value)


def test_unknown_names_and_missing_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"load case of stance, or a .*file, got 'jump'"):
        load_case("jump")
    with pytest.raises(InputError, match=r"cannot read the load case .*none\.toml: No such file"):
        load_case(tmp_path / "none.toml")


def test_regions_that_catch_nothing_are_refused_by_name():
    mesh = box("hex8", place=lambda p: p * 10)
    for part in (Sphere((99, 0, 0), 1.0), HalfSpace((0, 0, 11), (0, 0, 1)), Box((0, 0, 11), (10, 10, 12))):
        with pytest.raises(InputError, match=r"region 'here' to catch a part.*spans x 0.0 to 10.0"):
            loaded(mesh, Force(region(part), (1, 0, 0)))
        with pytest.raises(InputError, match="region 'here'"):
            assemble(LoadCase("test", (Support(region(part)),), (Force(region(Side("w1")), (1, 0, 0)),)), mesh)
    with pytest.raises(InputError, match="surface, u0, u1, v0, v1, w0, w1, got 'lid'"):
        loaded(mesh, Force(region(Side("lid")), (1, 0, 0)))
    explicit = box("hex8", explicit=True)
    with pytest.raises(InputError, match="one of surface, got 'w0'"):
        assemble(LoadCase("test", (HELD,), (Force(region(Side("w0")), (1, 0, 0)),)), explicit)


def test_quads_and_missing_density_are_refused():
    quad = Mesh(np.eye(4, 3), "quad4", structure=(2, 2))
    with pytest.raises(InputError, match="expected hexes to load, got quad4"):
        loaded(quad, Force(region(Side("surface")), (1, 0, 0)))
    with pytest.raises(InputError, match="density_g_cm3 for gravity"):
        loaded(box(), gravity_mm_s2=(0, 0, -9810))
