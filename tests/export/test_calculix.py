"""CalculiX solves the decks: a bar of graded modulus against its closed form, and the demo's femur in balance."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from gpubspline.analysis.load_case import load_case, read_load_case
from gpubspline.analysis.response import respond
from gpubspline.clock import Clock
from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import Region, region_from_threshold
from gpubspline.device import open_device
from gpubspline.export import read_mesh, write
from gpubspline.export.modulus_bins import element_means
from gpubspline.material.mapping import apply_material
from gpubspline.mesh import structure
from gpubspline.mesh.blocks.curved import curve
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.spline.fit import fit
from gpubspline.spline.lattice import control_lattice

CCX = shutil.which("ccx")
pytestmark = pytest.mark.skipif(CCX is None, reason="CalculiX is not installed: apt-get install calculix-ccx")

LENGTH, WIDTH = 12.0, 2.0


def solve(mesh, folder, step, **options):
    """Reaction forces (n, 3) of the node sets that the step prints."""
    write(mesh, folder / "written.inp", step=step, **options)
    return solve_deck((folder / "written.inp").read_text(), folder)


def solve_deck(text, folder):
    (folder / "model.inp").write_text(text)
    done = subprocess.run([CCX, "-i", "model"], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    forces, printed = {}, (folder / "model.dat").read_text()
    for name, rows in re.findall(r"forces \(fx,fy,fz\) for set (\w+) .*?\n\n((?:\s+\d+\s.*\n)+)", printed):
        forces[name] = np.array([[float(v) for v in row.split()[1:]] for row in rows.splitlines()])
    return forces


def axial_load(loaded):
    """Hold w0 and push the nodes given with 1 N against z."""
    share = "".join(f"{node + 1}, 3, {-1 / len(loaded):.15g}\n" for node in loaded)
    return f"*BOUNDARY\nw0, 1, 3\n*STEP\n*STATIC\n*CLOAD\n{share}*NODE PRINT, NSET=w0\nRF\n*END STEP\n"


def graded_bar(element_type, n_w, modulus):
    """A bar along z, its modulus a function of z; no Poisson's ratio, so that it is one-dimensional."""
    element, counts = ELEMENTS[element_type], (2, 3, n_w)
    sizes, lattice = (WIDTH, WIDTH, LENGTH), structure.lattice_counts(element, counts)
    axes = [np.linspace(0, size, n) for size, n in zip(sizes, lattice, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    kept = structure.has_node(element, counts)
    points = grid if kept is None else grid[kept]
    hu = 100 + 50 * points[:, 2]
    mesh = Mesh(points, element_type, structure=counts, fields={"HU": hu, "E_MPa": modulus(hu), "nu": 0 * hu})
    return replace(mesh, node_sets={side: np.unique(mesh.boundary(side)) for side in element.sides})


def pull(displacement_mm):
    """Hold three sides in their planes and pull the fourth."""
    return (
        "*BOUNDARY\nu0, 1, 1\nv0, 2, 2\nw0, 3, 3\n*STEP\n*STATIC\n"
        f"*BOUNDARY\nw1, 3, 3, {displacement_mm}\n*NODE PRINT, NSET=w0\nRF\n*NODE PRINT, NSET=w1\nRF\n*END STEP\n"
    )


def power(hu):
    return 0.02 * hu**2


def series(mesh):
    """Force that pulls elements in series by 0.1 mm, each of the mean modulus of its nodes."""
    modulus = np.unique(element_means(mesh, "E_MPa").round(9))
    return 0.1 * WIDTH**2 / np.sum(LENGTH / modulus.size / modulus)


@pytest.mark.parametrize("factor", [0.02, 0.4])
def test_straight_elements_have_the_mean_modulus_of_their_nodes(factor, tmp_path):
    """Springs in series; moduli to 196,000 MPa, temperatures beyond CalculiX's range but for their scale."""
    mesh = graded_bar("hex8", 9, lambda hu: factor * hu**2)
    forces = solve(mesh, tmp_path, pull(0.1))
    assert forces["W1"][:, 2].sum() == pytest.approx(series(mesh), rel=1e-6)
    assert forces["W0"][:, 2].sum() == pytest.approx(-series(mesh), rel=1e-6)


def test_small_numbers_are_read_with_their_exponents(tmp_path):
    """The bar a ten-millionth as thick, in float32: numbers such as 2e-7; the force goes with the area."""
    mesh = graded_bar("hex8", 9, power)
    fields = {name: values.astype(np.float32) for name, values in mesh.fields.items()}
    small = replace(mesh, points=(mesh.points * [1e-7, 1e-7, 1e-5]).astype(np.float32), fields=fields)
    forces = solve(small, tmp_path, pull(0.1e-5))
    assert ",2e-7," in (tmp_path / "model.inp").read_text()
    assert forces["W1"][:, 2].sum() == pytest.approx(series(mesh) * 1e-14, rel=1e-5)


def test_curved_elements_keep_to_calculixs_range_of_temperatures(tmp_path):
    """HU to 7,000, as of metal, is a tenth of it in the deck: the same force as a tenth of the HU."""
    mesh = graded_bar("hex20", 9, power)
    expected = solve(mesh, tmp_path, pull(0.1))["W1"][:, 2].sum()
    metal = mesh.with_fields({"HU": 10 * mesh.fields["HU"]})
    assert solve(metal, tmp_path, pull(0.1))["W1"][:, 2].sum() == pytest.approx(expected, rel=1e-6)


def test_curved_elements_reproduce_the_graded_bar(tmp_path):
    """Strain F / (E(z) A): for E = 0.02 HU^2, HU = 100 + 50 z, its integral is F / A (1/100 - 1/700) / (50 * 0.02)."""
    forces = solve(graded_bar("hex20", 41, power), tmp_path, pull(0.1))
    expected = 0.1 * WIDTH**2 / ((1 / 100 - 1 / 700) / (50 * 0.02))
    assert forces["W1"][:, 2].sum() == pytest.approx(expected, rel=1e-3)


def test_bins_solve_as_springs_in_series(tmp_path):
    mesh = graded_bar("hex8", 9, power)
    forces = solve(mesh, tmp_path, pull(0.1), modulus_bins=1000)
    modulus = np.unique(element_means(mesh, "E_MPa").round(9))
    expected = 0.1 * WIDTH**2 / np.sum(LENGTH / 8 / modulus)
    assert forces["W1"][:, 2].sum() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_a_femur_is_in_balance_under_a_unit_axial_load(order, tmp_path, device64):
    """The paper's femur, coarser: held at its cut end, 1 N along its axis on the other; the reaction is 1 N to 1e-6."""
    volume = phantom("child-femur").scan()
    lattice = control_lattice(volume, region_from_threshold(volume, 100.0), (5, 6, 12))
    mesh = sample(fit(lattice, device=device64).patch, (5, 6, 12), order=order, device=device64)
    mesh, material = apply_material(mesh, device=device64)
    forces = solve(mesh, tmp_path, axial_load(mesh.node_sets["w1"]), law=material.law)
    np.testing.assert_allclose(forces["W0"].sum(axis=0), [0, 0, 1], atol=1e-6)


def displacement(mesh, folder, **options):
    """Displacement (n, 3) of a deck with a load case, mm, and what ``write`` said of it."""
    figures = write(mesh, folder / "written.inp", **options)
    asked = "*NODE PRINT, NSET=all_nodes\nU\n*NODE FILE\n"
    solve_deck((folder / "written.inp").read_text().replace("*NODE FILE\n", asked), folder)
    table = re.search(r"displacements .*?\n\n((?:\s+\d+\s.*\n)+)", (folder / "model.dat").read_text())[1]
    return np.array([[float(v) for v in row.split()[1:]] for row in table.splitlines()]), figures


def difference(found, expected):
    """Root mean square over the nodes, of the expected."""
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("units", ["mm-N-MPa", "m-N-Pa"])
@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_a_load_case_moves_the_deck_as_it_moves_our_own_mesh(element_type, units, femur, femur20, all_loads, tmp_path):
    """Force, pressure on whole and on parts of faces, gravity, a moved support; one modulus, so that nothing else."""
    mesh = femur if element_type == "hex8" else femur20
    ones = np.ones(mesh.n_nodes)
    mesh = mesh.with_fields({"HU": 900 * ones, "E_MPa": 700 * ones, "nu": 0.3 * ones, "density_g_cm3": 1.1 * ones})
    ours = respond(mesh, all_loads, open_device("opencl", "float64"), Clock(), tolerance=1e-10)
    found, figures = displacement(mesh, tmp_path, load=all_loads, units=units)
    scale = 1e3 if units == "m-N-Pa" else 1.0
    assert difference(scale * found, ours.solution.displacement_mm) < 2e-6
    np.testing.assert_allclose(figures["load"]["total_n"], ours.loads.applied_n, rtol=1e-12)


RING_LOADS = """
[regions.upper]
cap = { towards = [0, 0, 1], depth_mm = 2 }
[regions.lower]
cap = { towards = [0, 0, -1], depth_mm = 2 }
[regions.ball]
sphere = { centre_mm = [17, 0, 0], radius_mm = 6 }
[[fixed]]
region = "lower"
[[force]]
region = "upper"
force_n = [10, -20, -300]
[[pressure]]
region = "ball"
pressure_mpa = 0.3
[gravity]
acceleration_mm_s2 = [0, 981, -9810]
"""


@pytest.mark.parametrize("element_type", ["hex8", "hex20"])
def test_a_load_file_moves_the_deck_of_blocks_as_our_own_mesh(element_type, tmp_path):
    """Blocks of a ring, straight and curved on to its surface: no structure, and regions found by place alone."""
    lines = [np.arange(-20.0, 21.0), np.arange(-20.0, 21.0), np.arange(-9.0, 10.0)]
    x, y, z = np.meshgrid(*lines, indexing="ij")
    inside = (np.hypot(np.hypot(x, y) - 12, z) - 5).transpose(2, 1, 0).astype(np.float32)
    affine = np.eye(4)
    affine[:3, 3] = [line[0] for line in lines]
    device = open_device("opencl")
    made = blocks_mesh(Region(inside < 0, inside, affine), 3.0, device=device)
    mesh = made.mesh if element_type == "hex8" else curve(made, device=device).sample(1, "hex20")
    ones = np.ones(mesh.n_nodes)
    mesh = mesh.with_fields({"HU": 900 * ones, "E_MPa": 700 * ones, "nu": 0.3 * ones, "density_g_cm3": 1.1 * ones})
    case = read_load_case(RING_LOADS, "ring.toml")
    ours = respond(mesh, case, open_device("opencl", "float64"), Clock(), tolerance=1e-10)
    found, figures = displacement(mesh, tmp_path, load=case)
    assert difference(found, ours.solution.displacement_mm) < 2e-6
    np.testing.assert_allclose(figures["load"]["total_n"], ours.loads.applied_n, rtol=1e-12)


def test_the_error_of_bins_falls_with_their_number(femur, tmp_path):
    """Stance, against our own solve with the mean modulus of each element's nodes: what is left is the binning."""
    case = load_case("stance")
    ours = respond(femur, case, open_device("opencl", "float64"), Clock(), modulus="element", tolerance=1e-10)
    errors, stated = [], []
    for bins in (4, 16, 64, 4096):
        found, figures = displacement(femur, tmp_path, load=case, modulus_bins=bins)
        errors.append(difference(found, ours.solution.displacement_mm))
        stated.append(figures["modulus"]["mean_error"])
    assert (np.diff(stated) < 0).all()
    assert errors[0] > 3 * errors[1] and errors[1] > 3 * errors[2] and errors[3] < 3e-4, errors


@pytest.mark.slow
def test_the_deck_of_the_demo_solves(tmp_path):
    """As ``gpubspline demo`` writes it, with a step appended: 1 N along the axis, its reaction 1 N to 1e-6."""
    command = [sys.executable, "-m", "gpubspline", "demo", "demo", "--quiet"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300)
    deck = tmp_path / "demo" / "femur.inp"
    loaded = read_mesh(deck).node_sets["w1"]
    forces = solve_deck(deck.read_text() + axial_load(loaded), tmp_path)
    np.testing.assert_allclose(forces["W0"].sum(axis=0), [0, 0, 1], atol=1e-6)
