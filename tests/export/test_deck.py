"""A model as plain data: names, surfaces, units, loads as cards and as nodal forces, what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gpubspline.analysis.load_case import load_case, read_load_case
from gpubspline.analysis.loads import assemble
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export import find_format, formats, write
from gpubspline.export.deck import Wanted, make_deck
from gpubspline.export.deck_loads import DeckLoads
from gpubspline.export.units import UNITS, find_units
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh


def deck(mesh, name="abaqus", **wanted):
    return make_deck(mesh, formats()[name], Wanted(**{"units": UNITS["mm-N-MPa"], **wanted}))


@pytest.mark.parametrize("structured", [True, False])
def test_surfaces_are_the_sides_and_the_regions(structured, femur, all_loads):
    given = femur if structured else replace(femur, structure=None, connectivity=femur.cells)
    found = deck(given, load=all_loads)
    for side in femur.element.sides:
        faces = found.surfaces[side]
        assert {tuple(sorted(f)) for f in faces.nodes.tolist()} == {
            tuple(sorted(f)) for f in femur.boundary(side).tolist()
        }
        vertices = np.array(list(femur.element.sides.values()))[faces.sides]
        np.testing.assert_array_equal(np.take_along_axis(femur.cells[faces.elements], vertices, axis=1), faces.nodes)
    assert set(found.surfaces) == {*femur.element.sides, "surface", "the_top", "ball"}
    assert set(found.mesh.node_sets) == {*femur.node_sets, "the_top", "ball"}
    assert len(found.surfaces["surface"].elements) == len(femur.boundary())


def test_names_are_letters_digits_and_underscores_and_differ(femur):
    sets = {"a b": np.arange(3), "A_B": np.arange(4), "2nd": np.arange(5)}
    explicit = replace(femur, structure=None, connectivity=femur.cells, node_sets=sets)
    found = deck(explicit).mesh.node_sets
    assert [(name, len(members)) for name, members in found.items()] == [("a_b", 3), ("A_B_2", 4), ("set_2nd", 5)]


def test_sets_are_not_taken_for_the_decks_own(femur, tmp_path):
    """Abaqus and CalculiX do not tell Modulus_1 from the section modulus_1; what a deck gave itself comes back so."""
    n, sets = femur.n_elements, {"Modulus_1": np.arange(3), "BODY": np.arange(5), "modulus_2": np.arange(2)}
    mesh = replace(femur, element_sets=sets, node_sets={**femur.node_sets, "All nodes": np.arange(4)})
    write(mesh, tmp_path / "a.inp", modulus_bins=3)
    keys = re.findall(r"^\*(?:NODE|ELEMENT|NSET|ELSET).*, (NSET|ELSET)=(\w+)", (tmp_path / "a.inp").read_text(), re.M)
    assert len({(kind, name.lower()) for kind, name in keys}) == len(keys)
    found = deck(mesh, modulus_bins=3)
    assert found.body == "body" and {k: len(v) for k, v in found.element_sets.items()} == {
        "Modulus_1_2": 3,
        "BODY_2": 5,
    }
    assert len(found.node_sets["All_nodes_2"]) == 4 and sum(len(s.members) for s in found.sections) == n
    assert set(deck(mesh, "vtu").mesh.element_sets) == set(sets)


@pytest.mark.parametrize(
    "name", ["u1", "w1", "W1", "my load!", "a region of a name that no solver would take as long as it is"]
)
@pytest.mark.parametrize("form", ["abaqus", "nastran", "ansys", "lsdyna"])
def test_a_pressure_is_on_the_faces_of_its_region_whatever_its_name(femur, name, form, tmp_path):
    """Also where the mesh has another side of that name, but for the case of letters perhaps."""
    text = f'[regions."{name}"]\nside = "u1"\n[[fixed]]\nregion = "w0"\n'
    case = read_load_case(text + f'[[pressure]]\nregion = "{name}"\npressure_mpa = 0.5\n', "case")
    found = deck(femur, form, load=case)
    ((surface, pressure),) = found.loads.pressures
    assert pressure == 0.5 and not found.loads.forces.any()
    np.testing.assert_array_equal(found.surfaces[surface].nodes, found.surfaces["u1"].nodes)
    assert len({known.lower() for known in found.surfaces}) == len(found.surfaces)
    assert name == "u1" or len(found.surfaces["w1"].elements) != len(found.surfaces["u1"].elements)
    assert (surface == "u1") == (name == "u1")
    write(femur, tmp_path / "a.dat", format=form, load=case)
    assert surface.lower() in (tmp_path / "a.dat").read_text().lower()


def test_cards_and_nodal_forces_are_the_load_case(femur, all_loads):
    """Forces and the pressure on parts of faces are nodal; pressure on whole faces and gravity are cards as well."""
    loads, whole = deck(femur, load=all_loads).loads, assemble(all_loads, femur)
    np.testing.assert_array_equal(loads.all_forces, whole.forces_n)
    assert loads.pressures == (("u1", 0.05),)
    np.testing.assert_array_equal(loads.gravity, [0, 981, -9810])
    alone = assemble(replace(all_loads, pressures=all_loads.pressures[:1]), femur).forces_n
    alone = alone - assemble(replace(all_loads, pressures=(), gravity_mm_s2=None), femur).forces_n
    partial = assemble(replace(all_loads, pressures=all_loads.pressures[1:], gravity_mm_s2=None), femur).forces_n
    np.testing.assert_allclose(loads.forces, partial, atol=1e-12)
    np.testing.assert_allclose(loads.forces + alone, whole.forces_n, atol=1e-9)
    held = np.zeros_like(loads.fixed)
    for nodes, components, at in loads.supports():
        held[np.ix_(nodes, components)] = True
        np.testing.assert_array_equal(loads.prescribed[nodes], np.broadcast_to(at, (nodes.size, 3)))
    np.testing.assert_array_equal(held, whole.fixed)


def test_a_total_is_nothing_where_rounding_is_all_of_it():
    forces = np.array([[1.0, 1.0, 1.0], [-0.999, -1 + 1e-12, 1.0]])
    nothing = np.zeros((2, 3))
    np.testing.assert_allclose(DeckLoads("", nothing > 0, nothing, forces, forces).total_n, [0.001, 0, 2], rtol=1e-12)


def test_a_load_of_cards_alone_has_no_nodal_forces(femur):
    case = read_load_case('[[fixed]]\nregion="w0"\n[gravity]\nacceleration_mm_s2=[0,0,-9810]', "heavy")
    loads = deck(femur, load=case).loads
    assert not loads.forces.any() and loads.all_forces[:, 2].sum() < 0


def test_metres_and_pascals(femur, all_loads):
    """The same model: lengths by 1e-3, moduli and pressures by 1e6, densities to kg/m3, forces as they are."""
    plain, metres = (deck(femur, load=all_loads, modulus_bins=5, units=find_units(name)) for name in UNITS)
    np.testing.assert_allclose(metres.mesh.points, 1e-3 * plain.mesh.points)
    for a, b in zip(plain.sections, metres.sections, strict=True):
        np.testing.assert_array_equal(a.members, b.members)
        assert (b.modulus, b.poisson) == pytest.approx((1e6 * a.modulus, a.poisson))
        assert b.density == pytest.approx(1e12 * a.density)  # tonne/mm3 to kg/m3
    np.testing.assert_array_equal(metres.loads.all_forces, plain.loads.all_forces)
    np.testing.assert_allclose(metres.loads.prescribed, 1e-3 * plain.loads.prescribed)
    np.testing.assert_allclose(metres.loads.gravity, [0, 0.981, -9.81])
    assert dict(metres.loads.pressures)["u1"] == pytest.approx(5e4)
    assert {"E_Pa", "density_apparent_kg_m3", "HU", "nu"} <= metres.mesh.fields.keys()
    np.testing.assert_allclose(metres.mesh.fields["E_Pa"], 1e6 * femur.fields["E_MPa"], rtol=1e-6)
    np.testing.assert_allclose(
        metres.mesh.fields["density_apparent_kg_m3"], 1e3 * femur.fields["density_g_cm3"], rtol=1e-6
    )
    assert any("m, N, Pa, kg" in words for words in metres.comments)


@pytest.mark.parametrize(
    ("name", "there", "factor"),
    [
        ("E_MPa", "E_Pa", 1e6),
        ("E_MPa_27", "E_Pa_27", 1e6),
        ("G12_MPa", "G12_Pa", 1e6),
        ("stress_xy_mpa", "stress_xy_pa", 1e6),
        ("density_g_cm3_8", "density_kg_m3_8", 1e3),
        ("displacement_mm_x", "displacement_m_x", 1e-3),
        ("strain_energy_density", "strain_energy_density", 1e6),
        ("nu_3", "nu_3", 1.0),
        ("HU", "HU", 1.0),
        ("axis1_x", "axis1_x", 1.0),
        ("force_n_x", "force_n_x", 1.0),
    ],
)
def test_every_field_is_in_the_systems_units(name, there, factor):
    """Those at Gauss points and of components, too."""
    values = np.array([1.5, 2.0], dtype=np.float32)
    ((found, scaled),) = find_units("m-N-Pa").fields({name: values}).items()
    assert found == there and scaled.dtype == np.float32
    np.testing.assert_allclose(scaled, values * factor, rtol=1e-6)
    assert find_units("mm-N-MPa").fields({name: values})[name] is values


def test_the_figures_state_the_error_and_the_total_load(femur):
    made = deck(femur, load=load_case("stance"), modulus_bins=7)
    figures = made.figures
    assert figures["modulus"]["means"] == "bins" and 0 < figures["modulus"]["mean_error"] < 1
    np.testing.assert_allclose(figures["load"]["total_n"], [0, 0, -328], rtol=1e-9)  # rounding is no force
    small = replace(made.loads, all_forces=1e-12 * made.loads.all_forces)
    np.testing.assert_allclose(small.total_n, [0, 0, -328e-12], rtol=1e-9)  # a small one is
    assert deck(femur).figures["modulus"]["error"] <= 1e-4


def test_element_moduli_are_what_bins_gather(femur):
    own = np.linspace(100, 900, femur.n_elements)
    found = deck(femur.with_cell_fields({"E_MPa": own, "nu": np.full_like(own, 0.3)}), modulus_bins=4)
    moduli = np.empty(femur.n_elements)
    for section in found.sections:
        moduli[section.members] = section.modulus
    np.testing.assert_allclose(moduli, own, rtol=0.8)
    assert np.all(np.diff(moduli) >= 0) and "the modulus of each" in " ".join(found.comments)


REFUSED = [
    ({"units": "inch"}, "a.inp", "units of mm-N-MPa, m-N-Pa, got 'inch'"),
    ({"format": "patran"}, "a.inp", "expected a format of .*abaqus.*, got 'patran'"),
    ({"load": "stance"}, "a.su2", r"holds a load case, got \.su2"),
    ({"modulus_bins": 3}, "a.vtu", r"modulus bins with a deck.*got \.vtu"),
    ({"nodal_modulus": True}, "a.su2", r"holds a modulus by node, got \.su2"),
    ({"step": "*STEP", "load": "stance"}, "a.inp", "a step with an .inp deck without a load case"),
    ({"load": "dance"}, "a.inp", "load case of .*stance.*got 'dance'"),
]


@pytest.mark.parametrize(("asked", "name", "words"), REFUSED)
def test_what_a_format_cannot_hold_is_refused_in_one_line(asked, name, words, tmp_path, femur):
    with pytest.raises(InputError, match=words) as error:
        write(femur, tmp_path / name, **asked)
    assert len(str(error.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_quads_have_no_load_case(tmp_path):
    flat = Mesh(np.array(ELEMENTS["quad4"].vertices, dtype=float) @ [[1, 0, 0], [0, 1, 0]], "quad4", structure=(2, 2))
    with pytest.raises(InputError, match="expected hexes to load, got quad4"):
        write(flat, tmp_path / "a.inp", load=read_load_case('[[fixed]]\nregion="u0"\ndisplacement_mm=[1,0,0]', "moved"))
    assert list(tmp_path.iterdir()) == []


def test_a_format_by_name_writes_any_extension(tmp_path, femur):
    write(femur, tmp_path / "deck.txt", format="abaqus")
    assert (tmp_path / "deck.txt").read_text().startswith("*HEADING")
    assert find_format("a.anything", "vtu").name == "vtu"


def test_what_a_deck_has_no_card_for_is_warned_of(femur, tmp_path):
    """Results and measures; not what its materials stand for."""
    moved = femur.with_fields({"displacement_mm_x": femur.fields["HU"], "von_mises_mpa": femur.fields["HU"]})
    with pytest.warns(GpubsplineWarning, match=r"\.feb holds no field displacement_mm_x, von_mises_mpa: left out"):
        write(moved, tmp_path / "a.feb")
    with pytest.warns(GpubsplineWarning, match=r"\.su2 holds no set some elements: left out"):
        write(replace(femur, fields={}, cell_fields={}), tmp_path / "a.su2")
    write(femur, tmp_path / "a.bdf")
    pulled = femur.with_fields({"force_n_x": femur.fields["HU"]})  # of a load case, which a deck's own is instead
    case = read_load_case('[[fixed]]\nregion="w0"\n[[force]]\nregion="w1"\nforce_n=[1,0,0]', "pulled")
    write(pulled, tmp_path / "b.bdf", load=case)
    with pytest.warns(GpubsplineWarning, match=r"\.bdf holds no field force_n_x: left out"):
        write(pulled, tmp_path / "b.bdf")
