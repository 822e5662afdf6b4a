"""Every deck under a load case that uses all there is, read back by readers nobody here wrote, and compared."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foreign import table
from foreign.nastran import interpreter
from gpubspline.export import formats, write
from gpubspline.export.deck import Wanted, make_deck
from gpubspline.export.deck_material import DEFAULT_BINS
from gpubspline.export.modulus_table import LOOSEST
from gpubspline.export.units import UNITS

DECKS = tuple(table.READERS)
NEEDS = {
    "ansys": "mapdl_archive",
    "exodus": "netCDF4",
    "febio": "pyfebio",
    "lsdyna": "dynakw",
    "med": "medcoupling",
    "vtu": "pyvista",
    "vts": "pyvista",
    "vtkhdf": "h5py",
    "xdmf": "h5py",
}
WIDTH = {"lsdyna": 3e-5}
"""Relative error of reals where fields are narrow: ten characters hold five digits of the smallest."""


def means(name):
    form = formats()[name]
    return [kind for kind, held in (("node", form.nodal), ("bins", form.binned)) if held]


CASES = [(name, kind, 1) for name in DECKS for kind in means(name)]
CASES += [(name, means(name)[0], 2) for name in DECKS if "hex20" in formats()[name].element_types]


def reader(name):
    """Reader of a format; where it is missing a skip, and in CI a failure."""
    if name == "nastran" and interpreter() is None:
        if os.environ.get("CI"):
            pytest.fail("GPUBSPLINE_PYNASTRAN names no interpreter")
        pytest.skip("GPUBSPLINE_PYNASTRAN names no interpreter that has pyNastran")
    if name in NEEDS and not os.environ.get("CI"):
        pytest.importorskip(NEEDS[name])
    return lambda path: table.read(name, path)


@pytest.mark.parametrize(("name", "kind", "order"), CASES)
def test_a_deck_is_read_back_as_it_was_meant(name, kind, order, femur, femur20, all_loads, tmp_path):
    mesh = femur if order == 1 else femur20
    bins = None if kind == "node" else DEFAULT_BINS
    path = tmp_path / f"deck{formats()[name].extensions[0]}"
    figures = write(mesh, path, load=all_loads, modulus_bins=bins)
    deck = make_deck(mesh, formats()[name], Wanted(UNITS["mm-N-MPa"], modulus_bins=bins, load=all_loads))
    found = reader(name)(path)
    check_mesh(found, deck)
    check_sets(found, deck)
    check_material(found, deck, mesh, figures)
    check_loads(found, deck, WIDTH.get(name, 1e-8))
    for fields, back in ((mesh.fields, found.fields), (mesh.cell_fields, found.cell_fields)):
        for name in back.keys() & fields.keys():
            np.testing.assert_allclose(back[name], fields[name], rtol=1e-6)
    assert "mm, N, MPa" in found.comment


@pytest.mark.parametrize("name", DECKS)
def test_long_names_are_cut_only_where_the_format_wants_it(name, femur, tmp_path):
    """Two of 200 characters that differ in the last, beside one that no format need cut."""
    form = formats()[name]
    sets = {"a" * 199 + end: np.arange(first, 30) for first, end in enumerate("xy")} | {
        "of_seventeen_char": np.array([3, 5])
    }
    mesh = replace(femur, node_sets=sets, element_sets={"e" * 200: np.arange(7)})
    path = tmp_path / f"deck{form.extensions[0]}"
    write(mesh, path)
    deck = make_deck(mesh, form, Wanted(UNITS["mm-N-MPa"]))
    longest = form.longest_name or 200
    for names, count in ((deck.node_sets.keys() - set(mesh.element.sides) - {"surface"}, 3), (deck.element_sets, 1)):
        assert len(names) == count and max(map(len, names)) == min(longest, 200)
    assert "of_seventeen_char" in deck.node_sets
    found = reader(name)(path)
    assert found.node_sets.keys() == deck.node_sets.keys()
    for name, members in deck.node_sets.items():
        np.testing.assert_array_equal(np.sort(found.node_sets[name]), np.sort(members))
    assert deck.element_sets.keys() <= found.element_sets.keys()


def check_mesh(found, deck):
    np.testing.assert_allclose(found.points, deck.mesh.points, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(found.cells, deck.mesh.cells)


def check_sets(found, deck):
    assert found.node_sets.keys() == deck.node_sets.keys()
    for name, members in deck.node_sets.items():
        np.testing.assert_array_equal(np.sort(found.node_sets[name]), np.sort(members))
    own = {**deck.element_sets, **{section.name: section.members for section in deck.sections}}
    assert deck.element_sets.keys() == {"some_elements"} <= found.element_sets.keys()
    for name in own.keys() & found.element_sets.keys():
        np.testing.assert_array_equal(np.sort(found.element_sets[name]), own[name])
    if found.surfaces is not None:
        assert found.surfaces.keys() == deck.surfaces.keys()
        for name, faces in deck.surfaces.items():
            assert found.surfaces[name] == {frozenset(face) for face in faces.nodes[:, :4].tolist()}


def check_material(found, deck, mesh, figures):
    if found.modulus is None:
        return
    given = ("E_MPa", 1.0), ("nu", 1.0), ("density_g_cm3", 1e-9)
    keys = ("modulus", "poisson", "density")
    for key, (field, scale) in zip(keys, given, strict=True):
        back, at_nodes = getattr(found, key), scale * mesh.fields[field]
        if deck.sections:
            expected = np.empty(mesh.n_elements)
            for section in deck.sections:
                expected[section.members] = getattr(section, key)
            np.testing.assert_allclose(back, expected, rtol=3e-5)
        else:
            expected = at_nodes if back.ndim == 1 else at_nodes[mesh.cells]
            stated = figures["modulus"]
            error = stated["error"] if key == "modulus" else stated.get(f"{key}_error", 0.0)
            assert stated["error"] <= LOOSEST / 10
            as_ratio = 1 if key == "poisson" else np.abs(expected)
            assert np.abs((back - expected) / as_ratio).max() <= 1.01 * error + 1e-8
    if deck.sections:
        means = mesh.fields["E_MPa"][mesh.cells].mean(axis=1)
        assert np.abs(found.modulus / means - 1).max() == pytest.approx(figures["modulus"]["largest_error"], rel=0.01)


def check_loads(found, deck, width):
    loads = deck.loads
    if found.internal is not None:  # by CalculiX: nodal forces, pressure on faces, gravity on the deck's density
        free = ~loads.fixed
        solved, expected = np.where(free, found.internal, 0), np.where(free, loads.all_forces, 0)
        np.testing.assert_allclose(solved, expected, atol=2e-3 * np.abs(expected).max())
        np.testing.assert_allclose(solved.sum(axis=0), expected.sum(axis=0), rtol=2e-3)
    if found.fixed is None:
        return
    np.testing.assert_array_equal(found.fixed, loads.fixed)
    np.testing.assert_allclose(found.prescribed, loads.prescribed, rtol=width)
    as_cards = found.pressed is not None
    expected = loads.forces if as_cards else loads.all_forces
    np.testing.assert_allclose(found.forces, expected, rtol=width, atol=width * np.abs(expected).max())
    np.testing.assert_allclose(found.forces.sum(axis=0), expected.sum(axis=0), rtol=width)
    if as_cards:
        np.testing.assert_allclose(found.gravity, loads.gravity, rtol=width, atol=1e-9)
        (faces, pressure), ((surface, wanted),) = *found.pressed, loads.pressures
        assert pressure == pytest.approx(wanted, rel=width)
        assert faces == {frozenset(face) for face in deck.surfaces[surface].nodes[:, :4].tolist()}


def test_the_page_of_formats_is_what_the_readers_find():
    """``PYTHONPATH=tests python -m foreign docs/formats.md`` makes it."""
    for name in DECKS:
        reader(name)
    page = Path(__file__).resolve().parents[2] / "docs" / "formats.md"
    assert page.read_text(encoding="utf-8") == table.page()
