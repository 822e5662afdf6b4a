"""Decks: labels from 1, sets, the table of the nodal material, bins and their stated error."""

import re

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.export import formats, read_mesh, write
from gpubspline.export.deck import Wanted, make_deck
from gpubspline.export.modulus_bins import POISSON_WIDTH, modulus_bins
from gpubspline.export.modulus_table import TOLERANCE, modulus_table
from gpubspline.export.units import UNITS
from gpubspline.material.registry import law
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS
from gpubspline.mesh.mesh import Mesh


def paper_material(hu):
    """Eqs 3.6 and 3.7 of the paper, and HU clamped to their ranges."""
    rho = 1.9 * np.clip(hu, 100, 2000) / 1630
    modulus = np.where(hu < 350, 1904 * rho**1.64, 2065 * rho**3.09)
    return {"HU": hu, "density_g_cm3": rho, "E_MPa": modulus, "nu": np.where(hu < 350, 0.3, 0.36)}


def bar(element_type="hex8", counts=(3, 4, 6), hu=lambda x, y, z: -50 + 2100 * z):
    element = ELEMENTS[element_type]
    counts = counts[: element.dimension]
    axes = [np.linspace(0, 1, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, element.dimension, order="F")
    kept = structure.has_node(element, counts)
    grid = grid if kept is None else grid[kept]
    points = np.zeros((len(grid), 3))
    points[:, : element.dimension] = grid
    mesh = Mesh(points * [2.0, 3, 10], element_type, structure=counts, fields=paper_material(hu(*points.T)))
    sides = {side: np.unique(mesh.boundary(side)) for side in element.sides}
    bare = Mesh(mesh.points, element_type, structure=counts, fields=mesh.fields, node_sets=sides)
    return bare.with_cell_fields({"material": np.zeros(bare.n_elements, dtype=np.int32)})


def section(text, keyword):
    """Numbers of the data lines under a keyword line."""
    block = re.search(rf"^\*{re.escape(keyword)}[^\n]*\n((?:[^*][^\n]*\n)+)", text, re.MULTILINE)
    assert block, keyword
    return np.array([[float(v) for v in line.split(",") if v] for line in block[1].splitlines()])


@pytest.mark.parametrize("element_type", ["quad4", "quad8", "hex8", "hex20"])
def test_meshio_reads_nodes_elements_and_sets(element_type, tmp_path):
    mesh = bar(element_type)
    write(mesh, tmp_path / "bar.inp")
    back = read_mesh(tmp_path / "bar.inp")
    assert back.element_type == element_type
    np.testing.assert_allclose(back.points, mesh.points, atol=1e-11)
    np.testing.assert_array_equal(back.cells, mesh.cells)
    for name, members in mesh.node_sets.items():
        np.testing.assert_array_equal(back.node_sets[name], members)
    np.testing.assert_array_equal(back.element_sets["body"], np.arange(mesh.n_elements))


def test_labels_start_at_one_and_lines_keep_to_sixteen_entries(tmp_path):
    mesh = bar("hex20", (5, 5, 5))
    write(mesh, tmp_path / "bar.inp", law=law())
    text = (tmp_path / "bar.inp").read_text()
    assert section(text, "NODE")[0, 0] == 1
    assert section(text, "NODE")[-1, 0] == mesh.n_nodes
    lines = [line for line in text.splitlines() if line[0] != "*"]
    assert max(len(line.rstrip(",").split(",")) for line in lines) == 16
    assert max(map(len, text.splitlines())) <= 132
    assert all(len(word.strip()) <= 20 for line in lines for word in line.split(","))
    assert "mm, N, MPa" in text
    assert law().name in text


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_table_gives_every_node_its_own_material(real, tmp_path):
    """Of curved elements: along HU, over ten since CalculiX takes no temperature of thousands."""
    mesh = bar("hex20", counts=(14, 14, 3))
    hu = np.random.default_rng(1).uniform(-300, 2300, mesh.n_nodes).astype(real)
    mesh = mesh.with_fields({k: v.astype(real) for k, v in paper_material(hu.astype(float)).items()})
    write(mesh, tmp_path / "bar.inp")
    text = (tmp_path / "bar.inp").read_text()
    elastic, temperature = section(text, "ELASTIC"), section(text, "INITIAL CONDITIONS")
    np.testing.assert_array_equal(temperature[:, 0], np.arange(mesh.n_nodes) + 1)
    np.testing.assert_allclose(10 * temperature[:, 1], mesh.fields["HU"], rtol=2e-7 if real is np.float32 else 1e-11)
    assert "HU over 10" in text
    assert (np.diff(elastic[:, 2]) > 0).all()
    assert len(elastic) < 400
    for column, name in ((0, "E_MPa"), (1, "nu")):
        at_nodes = np.interp(temperature[:, 1], elastic[:, 2], elastic[:, column])
        np.testing.assert_allclose(at_nodes, mesh.fields[name], rtol=1.01 * TOLERANCE)
    density = section(text, "DENSITY")
    at_nodes = np.interp(temperature[:, 1], density[:, 1], density[:, 0])
    np.testing.assert_allclose(at_nodes, mesh.fields["density_g_cm3"] * 1e-9, rtol=1.01 * TOLERANCE)


@pytest.mark.parametrize("rows", [None, 100, 20])
def test_of_straight_elements_the_modulus_is_the_temperature(rows):
    """It is exact at every node and between nodes; where two branches have it, all else is a mean, stated."""
    fields = paper_material(np.random.default_rng(2).uniform(-300, 2300, 5000))
    table = modulus_table(fields, rows, straight=True)
    assert table.carrier == "E_MPa" and table.error == 0 and table.at.size <= (rows or 100)
    np.testing.assert_array_equal(table.at, table.columns["E_MPa"])
    off = {n: np.interp(fields["E_MPa"], table.at, c) - fields[n] for n, c in table.columns.items()}
    assert table.poisson_error == pytest.approx(np.abs(off["nu"]).max()) and table.poisson_error < 0.06
    assert table.density_error == pytest.approx(np.abs(off["density_g_cm3"] / fields["density_g_cm3"]).max())
    density = np.interp(fields["E_MPa"], table.at, table.columns["density_g_cm3"])
    assert table.density_total_error == pytest.approx(abs(density.sum() / fields["density_g_cm3"].sum() - 1))
    far = (np.abs(off["nu"]) > 0.01) | (np.abs(off["density_g_cm3"] / fields["density_g_cm3"]) > 0.01)
    assert table.share_off == np.count_nonzero(far) / far.size and 0.05 < table.share_off < 0.6
    apart = fields["E_MPa"] > 600  # where only one branch is
    assert np.abs(off["nu"][apart]).max() < 0.01
    assert np.abs(off["density_g_cm3"][apart] / fields["density_g_cm3"][apart]).max() < (0.05 if rows == 20 else 0.01)


def test_two_rows_straddle_the_jump():
    table = modulus_table(paper_material(np.linspace(100, 2000, 5000)))
    assert table.carrier == "HU"
    assert table.error <= TOLERANCE
    jump = int(np.searchsorted(table.at, 350))
    assert table.at[jump] - table.at[jump - 1] == pytest.approx(1900 / 4999)
    assert table.columns["nu"][jump - 1 : jump + 1].tolist() == [0.3, 0.36]


@pytest.mark.parametrize("sample", [1, 50, 1000])
def test_nodes_beyond_the_sample_are_held_too(sample, monkeypatch):
    """A jump that no sampled node shows, and nodes in any order."""
    hu = np.random.default_rng(5).uniform(-300, 2300, 5000)
    fields = paper_material(hu)
    monkeypatch.setattr("gpubspline.export.modulus_table._SAMPLE", sample)
    table = modulus_table(fields)
    assert (np.diff(table.at) > 0).all()
    assert np.isin(table.at, hu).all()
    for name, column in table.columns.items():
        np.testing.assert_allclose(np.interp(hu, table.at, column), fields[name], rtol=1.01 * TOLERANCE)
    below, above = hu[hu < 350].max(), hu[hu >= 350].min()
    assert {below, above} <= set(table.at)
    error = [np.abs(np.interp(hu, table.at, c) / fields[name] - 1).max() for name, c in table.columns.items()]
    assert table.error == pytest.approx(max(error), rel=1e-6)


def test_noise_is_no_material(monkeypatch):
    monkeypatch.setattr("gpubspline.export.modulus_table.MOST_ROWS", 500)
    rng = np.random.default_rng(6)
    fields = {"HU": rng.uniform(0, 1, 2000), "E_MPa": rng.uniform(1, 9, 2000), "nu": rng.uniform(0, 0.5, 2000)}
    with pytest.raises(InputError, match="ask for modulus bins"):
        modulus_table(fields)


def test_without_hu_the_modulus_carries_itself():
    fields = {"E_MPa": np.array([5.0, 1, 9, 1]), "nu": np.full(4, 0.3)}
    table = modulus_table(fields)
    assert table.carrier == "E_MPa"
    np.testing.assert_array_equal(table.at, table.columns["E_MPa"])


def test_one_material_is_one_row():
    table = modulus_table({"HU": np.full(9, 40.0), "E_MPa": np.full(9, 7.0), "nu": np.full(9, 0.3)})
    assert table.at.tolist() == [40.0]


def test_materials_that_nothing_tells_apart_are_refused(tmp_path):
    mesh = bar("hex20")
    fields = {"HU": np.zeros(mesh.n_nodes), "E_MPa": np.ones(mesh.n_nodes), "nu": np.arange(mesh.n_nodes) / 3999}
    with pytest.raises(InputError, match="ask for modulus bins"):
        write(mesh.with_fields(fields), tmp_path / "bar.inp")
    assert list(tmp_path.iterdir()) == []
    write(mesh.with_fields(fields), tmp_path / "bar.inp", modulus_bins=3)


@pytest.mark.parametrize("form", [name for name, form in formats().items() if form.binned])
def test_bins_part_poissons_ratios_of_one_modulus(form):
    """The paper's law gives 129 to 436 MPa twice, at 0.30 and at 0.36; one bin is one material all the same."""
    mesh = bar(counts=(3, 3, 61))
    fields = paper_material(np.where(np.arange(240) % 2, 300.0, 478.4)) | {"E_MPa": np.full(240, 340.0)}
    mesh = mesh.with_cell_fields({name: values.astype(np.float32) for name, values in fields.items()})
    for count, parts in ((100, 2), (2, 2), (1, 1)):
        made = make_deck(mesh, formats()[form], Wanted(UNITS["mm-N-MPa"], modulus_bins=count))
        poisson = [s.poisson for s in made.sections]
        assert len(poisson) == made.figures["modulus"]["bins"] == parts
        if parts == 2:
            assert sorted(poisson) == pytest.approx([0.3, 0.36], abs=1e-7)
            assert made.figures["modulus"]["poisson_error"] < 1e-7
            density = {round(s.poisson, 2): s.density for s in made.sections}
            assert density[0.3] == pytest.approx(1.9e-9 * 300 / 1630)  # a mean would be of 389 HU
            for part in made.sections:
                assert set(mesh.cell_fields["nu"][part.members]) == {np.float32(part.poisson)}
        else:
            assert made.figures["modulus"]["poisson_error"] == pytest.approx(0.03, abs=1e-6)


def test_mixed_poissons_ratios_are_off_by_less_than_a_bin():
    """Elements across a boundary of two branches have means of either ratio."""
    mesh = bar(counts=(3, 3, 501))
    rng = np.random.default_rng(0)
    nu, modulus = rng.uniform(0.3, 0.36, 2000), rng.choice([200.0, 3000.0], 2000)
    bins = modulus_bins(mesh.with_cell_fields({"nu": nu, "E_MPa": modulus}), 100)
    assert bins.poisson_error < POISSON_WIDTH and len(bins.members) == 8 and bins.largest_error < 1e-12
    off = [np.abs(nu[m] - p).max() for m, p in zip(bins.members, bins.poisson, strict=True)]
    assert bins.poisson_error == pytest.approx(max(off))


def test_bins_hold_every_element_once_and_state_their_error(tmp_path):
    mesh = bar(counts=(4, 4, 60))
    for count, largest in ((5, 1.2), (20, 0.2), (100, 0.05)):
        bins = modulus_bins(mesh, count)
        np.testing.assert_array_equal(np.sort(np.concatenate(bins.members)), np.arange(mesh.n_elements))
        modulus = mesh.fields["E_MPa"][mesh.cells].mean(axis=1)
        error = [np.abs(e / modulus[m] - 1) for e, m in zip(bins.modulus_mpa, bins.members, strict=True)]
        assert bins.largest_error == pytest.approx(np.concatenate(error).max())
        assert bins.mean_error == pytest.approx(np.concatenate(error).mean())
        assert bins.largest_error < largest
    write(mesh, tmp_path / "bar.inp", modulus_bins=20)
    text = (tmp_path / "bar.inp").read_text()
    bins = modulus_bins(mesh, 20)
    assert f"{100 * bins.largest_error:.3g} % at most" in " ".join(text.replace("\n** ", " ").split())
    assert text.count("*MATERIAL") == text.count("*SOLID SECTION") == len(bins.members)
    assert "*INITIAL CONDITIONS" not in text
    back = read_mesh(tmp_path / "bar.inp")
    for number, members in enumerate(bins.members):
        np.testing.assert_array_equal(back.element_sets[f"modulus_{number + 1}"], members)


def test_a_mesh_without_material_is_a_deck_without_material(tmp_path):
    mesh = bar()
    bare = Mesh(mesh.points, "hex8", structure=mesh.structure)
    write(bare, tmp_path / "bar.inp", step="*STEP\n*STATIC\n*END STEP\n")
    text = (tmp_path / "bar.inp").read_text()
    assert "*MATERIAL" not in text
    assert text.endswith("*STEP\n*STATIC\n*END STEP\n")
    with pytest.raises(InputError, match="E_MPa and nu"):
        write(bare, tmp_path / "bar.inp", modulus_bins=2)


def test_shells_have_the_given_thickness(tmp_path):
    write(bar("quad4", hu=lambda x, y, z: 300 + x), tmp_path / "slice.inp", thickness_mm=2.5)
    assert section((tmp_path / "slice.inp").read_text(), "SHELL SECTION").tolist() == [[2.5]]


@pytest.mark.parametrize("element_type", ["quad9", "hex27"])
def test_elements_that_no_solver_here_knows_are_refused(element_type, tmp_path):
    with pytest.raises(InputError, match=rf"quad4, quad8, hex8, hex20 for \.inp, got {element_type}"):
        write(bar(element_type), tmp_path / "bar.inp")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [0, -3])
def test_no_bins_are_refused(count, tmp_path):
    with pytest.raises(InputError, match="at least 1 modulus bin"):
        write(bar(), tmp_path / "bar.inp", modulus_bins=count)
