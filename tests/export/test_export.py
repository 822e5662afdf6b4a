"""Every format: written, read back by meshio and where it can by VTK, with its fields; whole or not at all."""

import re
import tracemalloc
import warnings
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export import Format, can_read, check_extension, extensions, formats, read_mesh, write
from gpubspline.export.other import FORMATS
from gpubspline.export.placed import PlacedArrays
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS, MESHABLE
from gpubspline.mesh.mesh import Mesh

OTHER = {e: (f.element_types, f.fields, f.cell_fields) for f in FORMATS for e in f.extensions}
WHOLE = {extension: (MESHABLE, True, True) for extension in (".vtu", ".vtkhdf")}
DECKS = {
    ".exo": (MESHABLE, True, True),
    ".med": (("quad4", "quad8", "hex8", "hex20"), True, True),
    ".msh": (MESHABLE, True, True),
    ".bdf": (("quad4", "quad8", "hex8", "hex20"), False, False),
}
HELD = {**WHOLE, ".vts": (("quad4", "hex8"), True, True), **DECKS, **OTHER}
CASES = [(extension, kind) for extension, (kinds, _, _) in HELD.items() for kind in kinds]
REFUSED = [(extension, kind) for extension, (kinds, _, _) in HELD.items() for kind in MESHABLE if kind not in kinds]


def model(element_type, counts=(3, 4, 5), real=np.float32):
    """A bent box with all fields and sets of a model."""
    element = ELEMENTS[element_type]
    counts = counts[: element.dimension]
    axes = [np.linspace(0, 10, n) for n in structure.lattice_counts(element, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, element.dimension, order="F")
    kept = structure.has_node(element, counts)
    grid = grid if kept is None else grid[kept]
    points = np.zeros((len(grid), 3), dtype=real)
    points[:, : element.dimension] = grid
    points[:, 0] += (0.05 * points[:, 1] ** 2 - 61).astype(real)
    hu = (100 + 90 * points[:, 1] + 30 * grid[:, 0]).astype(real)
    fields = {"HU": hu, "density_g_cm3": hu * real(1.9 / 1630), "E_MPa": 3 * hu + 1, "nu": np.full_like(hu, 0.3)}
    mesh = Mesh(points, element_type, structure=counts, fields=fields)
    elements = np.arange(mesh.n_elements, dtype=np.int32)
    quality = np.sqrt(elements / real(99)).astype(real)
    mesh = mesh.with_cell_fields({"scaled_jacobian": quality, "material": elements % 3})
    sides = {side: np.unique(mesh.boundary(side)) for side in element.sides}
    surface = np.unique(np.concatenate(list(sides.values())))
    return replace(mesh, node_sets={**sides, "surface": surface}, element_sets={"body": elements})


def write_quietly(mesh, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)
        write(mesh, path)


def needs(extension):
    package = {extension: form.needs for form in formats().values() for extension in form.extensions}[extension]
    if package:
        pytest.importorskip(package)


@pytest.mark.parametrize(("extension", "element_type"), CASES)
def test_comes_back_as_it_went(extension, element_type, tmp_path):
    needs(extension)
    mesh, path = model(element_type), tmp_path / f"model{extension}"
    write_quietly(mesh, path)
    back = read_mesh(path)
    assert back.element_type == element_type
    np.testing.assert_allclose(back.points, mesh.points, atol=1e-5)
    np.testing.assert_array_equal(back.cells, mesh.cells)
    _, nodal, elemental = HELD[extension]
    if nodal:
        assert set(mesh.fields) <= set(back.fields)
        for name, values in mesh.fields.items():
            np.testing.assert_allclose(back.fields[name], values, rtol=1e-6)
    if elemental:
        assert set(mesh.cell_fields) <= set(back.cell_fields)
        for name, values in mesh.cell_fields.items():
            np.testing.assert_allclose(back.cell_fields[name], values, rtol=1e-6)
    if extension in (".exo", ".med", ".msh", ".vtu", ".vts", ".vtkhdf", ".xdmf"):
        assert mesh.node_sets.keys() <= back.node_sets.keys()
        for name, members in mesh.node_sets.items():
            np.testing.assert_array_equal(back.node_sets[name], members)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(("extension", "element_type"), REFUSED)
def test_elements_that_a_format_cannot_hold_are_refused(extension, element_type, tmp_path):
    with pytest.raises(InputError, match=f"for \\{extension}, got {element_type}"):
        write_quietly(model(element_type), tmp_path / f"model{extension}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extension", [".avs", ".mdpa", ".ply", ".stl"])
def test_fields_that_a_format_cannot_hold_are_named(extension, tmp_path):
    kind = "quad4" if extension in (".ply", ".stl") else "hex8"
    with pytest.warns(GpubsplineWarning, match="scaled_jacobian, material: left out"):
        write(model(kind), tmp_path / f"model{extension}")


@pytest.mark.parametrize("extension", [".vtu", ".vtk", ".vtkhdf"])
@pytest.mark.parametrize("element_type", MESHABLE)
def test_vtk_reads_it_with_its_fields(extension, element_type, tmp_path):
    needs(extension)
    pyvista = pytest.importorskip("pyvista")
    mesh, path = model(element_type), tmp_path / f"model{extension}"
    write(mesh, path)
    grid = pyvista.read(path)
    assert (grid.celltypes == mesh.element.vtk_type).all()
    np.testing.assert_array_equal(grid.points, mesh.points)
    np.testing.assert_array_equal(grid.cells_dict[mesh.element.vtk_type], mesh.cells)
    for name, values in mesh.fields.items():
        np.testing.assert_array_equal(grid.point_data[name], values)
    for name, values in mesh.cell_fields.items():
        np.testing.assert_array_equal(grid.cell_data[name], values)


@pytest.mark.parametrize("extension", [".vtu", ".vts", ".vtkhdf"])
def test_vtk_and_we_read_sets_and_surfaces_as_field_data(extension, tmp_path):
    """Numbers from 0; a surface is rows of an element and a side, u0 to w1."""
    needs(extension)
    pyvista = pytest.importorskip("pyvista")
    mesh = model("hex8")
    mesh = replace(mesh, element_sets={**mesh.element_sets, "head": np.arange(5, 9)})
    write(mesh, tmp_path / f"model{extension}")
    data = pyvista.read(tmp_path / f"model{extension}").field_data
    for name, members in mesh.node_sets.items():
        np.testing.assert_array_equal(data[f"node_set {name}"], members)
        faces = mesh.boundary(None if name == "surface" else name)
        found = [np.array(list(mesh.element.sides.values()))[side] for side in data[f"surface {name}"][:, 1]]
        np.testing.assert_array_equal(
            np.take_along_axis(mesh.cells[data[f"surface {name}"][:, 0]], np.array(found), 1), faces
        )
    np.testing.assert_array_equal(data["element_set head"], np.arange(5, 9))
    back = read_mesh(tmp_path / f"model{extension}")
    assert back.node_sets.keys() == mesh.node_sets.keys() and back.element_sets.keys() == {"head"}
    for name, members in mesh.node_sets.items():
        np.testing.assert_array_equal(back.node_sets[name], members)


@pytest.mark.parametrize("extension", [".exo", ".med", ".inp"])
def test_a_binned_deck_is_read_with_its_labels(extension, tmp_path):
    """Blocks, families and sections part the elements; labels put them back."""
    needs(extension)
    mesh = model("hex8", (5, 4, 6))
    mesh = replace(mesh, element_sets={"some": np.arange(3, 40, 4)})
    write(mesh, tmp_path / f"model{extension}", modulus_bins=4)
    back = read_mesh(tmp_path / f"model{extension}")
    np.testing.assert_array_equal(back.element_sets["some"], mesh.element_sets["some"])
    assert {"modulus_1", "modulus_4"} <= back.element_sets.keys()
    np.testing.assert_array_equal(back.cells, mesh.cells)


@pytest.mark.parametrize("element_type", MESHABLE)
def test_vtk_reads_xdmf(element_type, tmp_path):
    needs(".xdmf")
    vtk = pytest.importorskip("vtk")
    pyvista = pytest.importorskip("pyvista")
    mesh = model(element_type)
    write(mesh, tmp_path / "model.xdmf")
    reader = vtk.vtkXdmfReader()
    reader.SetFileName(str(tmp_path / "model.xdmf"))
    reader.Update()
    grid = pyvista.wrap(reader.GetOutputDataObject(0))
    np.testing.assert_array_equal(grid.cells_dict[mesh.element.vtk_type], mesh.cells)
    np.testing.assert_allclose(grid.points, mesh.points, atol=1e-5)
    np.testing.assert_allclose(grid.point_data["HU"], mesh.fields["HU"], rtol=1e-6)
    np.testing.assert_allclose(grid.cell_data["material"], mesh.cell_fields["material"])


def test_vtk_reads_ply(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = model("quad4")
    write_quietly(mesh, tmp_path / "model.ply")
    grid = pyvista.read(tmp_path / "model.ply")
    np.testing.assert_allclose(grid.points, mesh.points, atol=1e-5)
    np.testing.assert_array_equal(grid.faces.reshape(-1, 5)[:, 1:], mesh.cells)


@pytest.mark.parametrize("element_type", MESHABLE)
@pytest.mark.parametrize("n_fields", range(9))
def test_meshio_reads_vtu_with_any_number_of_fields(element_type, n_fields, tmp_path):
    """meshio finds arrays by offsets that it changes as it goes: none may be taken for another."""
    mesh = model(element_type)
    mesh = replace(mesh, fields={f"f{n}": mesh.points[:, 1] + n for n in range(n_fields)})
    write(mesh, tmp_path / "model.vtu")
    back = meshio.read(tmp_path / "model.vtu")
    np.testing.assert_array_equal(back.points, mesh.points)
    assert [block.type for block in back.cells] == [mesh.element.meshio_name]
    np.testing.assert_array_equal(back.cells[0].data, mesh.cells)
    assert set(back.point_data) == set(mesh.fields)
    for name, values in mesh.fields.items():
        np.testing.assert_array_equal(back.point_data[name], values)
    for name, values in mesh.cell_fields.items():
        np.testing.assert_array_equal(back.cell_data[name][0], values)


def test_vtu_is_written_in_parts(tmp_path, monkeypatch):
    mesh = model("quad4", (9, 7))
    write(mesh, tmp_path / "whole.vtu")
    monkeypatch.setattr("gpubspline.export.placed._CHUNK", 7)
    monkeypatch.setattr("gpubspline.export.rows._CHUNK", 5)
    monkeypatch.setattr("gpubspline.mesh.structure._BLOCK", 10)  # a row of 8 and not two
    asked, put = [], PlacedArrays.put

    def watched(self, section, name, first_row, rows):
        asked.append((name, len(rows)))
        put(self, section, name, first_row, rows)

    monkeypatch.setattr(PlacedArrays, "put", watched)
    write(mesh, tmp_path / "parts.vtu")
    assert (tmp_path / "parts.vtu").read_bytes() == (tmp_path / "whole.vtu").read_bytes()
    assert [count for name, count in asked if name == "connectivity"] == [8] * 6
    assert [count for name, count in asked if name == "types"] == [5] * 9 + [3]


def test_vtu_is_binary_and_keeps_types(tmp_path):
    mesh, path = model("hex8", real=np.float64), tmp_path / "model.vtu"
    write(mesh, path)
    assert path.read_bytes().count(b'format="appended"') == 1 + 3 + len(mesh.fields) + len(mesh.cell_fields) + 14
    back = meshio.read(path)
    assert back.points.dtype == np.float64
    assert back.cell_data["material"][0].dtype == np.int32
    np.testing.assert_array_equal(back.points, mesh.points)


def test_a_field_that_is_not_finite_is_refused(tmp_path):
    mesh = model("hex8")
    broken = mesh.fields["HU"].copy()
    broken[3] = np.nan
    with pytest.raises(InputError, match="field HU, got NaN or infinity in 1 of 60"):
        write(mesh.with_fields({"HU": broken}), tmp_path / "model.vtu")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extension", [".vtu", ".vts", ".inp", ".msh"])
def test_a_node_without_a_place_is_refused(extension, tmp_path):
    """By the writer, and by the reader of what others wrote."""
    mesh, path = model("hex8"), tmp_path / f"model{extension}"
    points = mesh.points.copy()
    points[7, 1] = np.nan
    broken = replace(mesh, points=points)
    with pytest.raises(InputError, match="finite coordinates, got NaN or infinity at 1 of 60 nodes"):
        write(broken, path)
    assert list(tmp_path.iterdir()) == []
    if extension == ".vtu":
        meshio.write_points_cells(path, points, [("hexahedron", mesh.cells)])
        with pytest.raises(InputError, match=r"finite coordinates in model\.vtu, got NaN or infinity at 1 of 60 nodes"):
            read_mesh(path)


def test_a_mesh_in_metres_is_not_taken_for_one_in_millimetres_in_silence(tmp_path):
    mesh = model("hex8").with_fields({"E_MPa": np.full(60, 5e3), "nu": np.full(60, 0.3)})
    write(mesh, tmp_path / "m.vtu", units="m-N-Pa")
    with pytest.warns(GpubsplineWarning, match=r"E_Pa\), and its lengths are taken for mm"):
        write(read_mesh(tmp_path / "m.vtu"), tmp_path / "m.vts")


def test_names_with_spaces_and_slashes(tmp_path):
    """ParaView's names are sentences; VTK's old format ends one at a space, and a slash is HDF5's own."""
    mesh = model("hex8")
    given = mesh.with_fields({"von Mises / MPa": mesh.fields["HU"]}).with_cell_fields({"a b/c": np.arange(24.0)})
    for extension, names in ((".vtk", ("von_Mises_/_MPa", "a_b/c")), (".med", ("von Mises _ MPa", "a b_c"))):
        write(given, tmp_path / f"m{extension}")
        back = read_mesh(tmp_path / f"m{extension}")
        np.testing.assert_allclose(back.fields[names[0]], mesh.fields["HU"])
        np.testing.assert_allclose(back.cell_fields[names[1]], np.arange(24.0))


def test_gmsh_keeps_node_sets_that_are_called_as_its_endings_are(tmp_path):
    """A node set is ``w1_nodes`` where a surface is ``w1``: one that is called so anyway is another."""
    like = {"w1_nodes": np.arange(3), "bare_nodes": np.arange(0, 60, 9)}
    mesh = model("hex8")
    mesh = replace(mesh, node_sets={**mesh.node_sets, **like}, element_sets={})
    write(mesh, tmp_path / "m.msh")
    back = read_mesh(tmp_path / "m.msh")
    assert back.node_sets.keys() == mesh.node_sets.keys()
    for name, members in mesh.node_sets.items():
        np.testing.assert_array_equal(back.node_sets[name], members)


def test_exodus_cuts_names_of_fields_apart(tmp_path):
    """VTK reads 32 characters: two that differ later are two all the same."""
    mesh = model("hex8")
    given = {f"a field of forty characters, the last a {end}": mesh.fields["HU"] * k for k, end in enumerate("xy")}
    path = tmp_path / "m.exo"
    write(replace(mesh, fields=given, cell_fields={}), path)
    cut = ["a field of forty characters, the", "a field of forty characters, t_2"]
    seen = pytest.importorskip("pyvista").read(path)[0][0].point_data
    for name, values in zip(cut, given.values(), strict=True):
        np.testing.assert_allclose(read_mesh(path).fields[name], values)
        np.testing.assert_allclose(np.sort(seen[name]), np.sort(values))  # in an order of VTK's own


def test_components_of_ansys_have_names_of_their_own(tmp_path):
    """One of a name takes the place of another, whatever it is of: nodes, elements or faces, in any case."""
    names = {"a": np.arange(5), "W1_faces": np.arange(3), **model("hex8").node_sets}
    mesh = replace(model("hex8"), node_sets=names, element_sets={"A": np.arange(3), "a_elements": np.arange(7)})
    write_quietly(mesh, tmp_path / "m.cdb")
    lines = (tmp_path / "m.cdb").read_text().splitlines()
    found = [line.split(",")[1] for line in lines if line.startswith("CMBLOCK")]
    assert len(set(found)) == len(found) == len(names) + 3 + 8 and max(map(len, found)) <= 32


SHELLS = {
    ".inp": r"\*SHELL SECTION, ELSET=\w+, MATERIAL=\w+\n(\S+)\n",
    ".cdb": r"SECTYPE,1,SHELL\nSECDATA,(\S+),1\n",
    ".bdf": r"PSHELL\* {16}1 {15}1 *(\S+) {15}1\n\* {38}1\n",
    ".k": r"\*SECTION_SHELL\n {9}1 {8}16\n *(\S+) +\1 +\1 +\1\n",
    ".feb": r"<shell_thickness>(\S+)</shell_thickness>",
}
"""Of a section of one part: Nastran's material stretches, bends and shears it, LS-DYNA's are fully integrated (16)."""


@pytest.mark.parametrize("extension", SHELLS)
@pytest.mark.parametrize(("units", "thickness"), [("mm-N-MPa", 2.5), ("m-N-Pa", 0.0025)])
def test_shells_have_their_thickness_in_every_deck(extension, units, thickness, tmp_path):
    mesh = model("quad4")
    mesh = replace(mesh, fields={name: np.full_like(v, 1 if name != "nu" else 0.3) for name, v in mesh.fields.items()})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GpubsplineWarning)
        write(mesh, tmp_path / f"m{extension}", units=units, thickness_mm=2.5)
    (found,) = re.findall(SHELLS[extension], (tmp_path / f"m{extension}").read_text())
    assert float(found) == pytest.approx(thickness)


def test_solids_of_lsdyna_are_fully_integrated(tmp_path):
    write_quietly(model("hex8"), tmp_path / "m.k")
    assert "*SECTION_SOLID\n         1         2\n" in (tmp_path / "m.k").read_text()


def test_exodus_is_read_at_its_last_step(tmp_path):
    mesh, path = model("hex8"), tmp_path / "m.exo"
    write(mesh, path)
    with pytest.importorskip("netCDF4").Dataset(path, "a") as file:
        file["time_whole"][1] = 1.0
        file["vals_nod_var1"][1] = 2 * file["vals_nod_var1"][0]
    np.testing.assert_allclose(read_mesh(path).fields["HU"], 2 * mesh.fields["HU"])


@pytest.mark.parametrize("thickness", [0.0, -1.0, np.nan, np.inf])
def test_shells_without_a_thickness_are_refused(thickness, tmp_path):
    with pytest.raises(InputError, match="expected a thickness above 0 mm"):
        write(model("quad4"), tmp_path / "m.inp", thickness_mm=thickness)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["model.step", "model", "model.gz", "model.xyz"])
def test_an_unknown_extension_names_the_known(name, tmp_path):
    for refused in (lambda: check_extension(name), lambda: write(model("quad4"), tmp_path / name)):
        with pytest.raises(InputError, match=r"expected a mesh file of \.inp, \.vtu, .*\.vtk.*, got"):
            refused()
    assert not can_read(name)
    check_extension("MODEL.VTU")


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="existing folder"):
        write(model("quad4"), tmp_path / "none" / "model.vtu")


def test_bins_are_an_option_of_decks_only(tmp_path):
    for extension in (".vtu", ".vts", ".vtk", ".vtkhdf"):
        with pytest.raises(InputError, match=rf"modulus bins with a deck.*got \{extension}"):
            write(model("hex8"), tmp_path / f"model{extension}", modulus_bins=3)


@pytest.mark.parametrize(
    ("name", "owner", "step"),
    [("a.vtk", meshio, "write"), ("a.vtu", PlacedArrays, "put"), ("a.inp", Mesh, "cell_blocks")],
)
def test_an_error_while_writing_leaves_nothing(name, owner, step, tmp_path, monkeypatch):
    def fail(*args, **options):
        raise OSError("disk full")

    mesh = model("hex8")
    monkeypatch.setattr(owner, step, fail)
    (tmp_path / name).write_text("what was there")
    with pytest.raises(OSError, match="disk full"):
        write(mesh, tmp_path / name)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["what was there"]


def test_nothing_is_printed(tmp_path, capfd):
    for extension in [e for e in extensions() if e not in (".xdmf", ".xmf", ".vtkhdf", ".med")]:
        kind = "quad4" if extension in (".obj", ".ply") else "hex8"
        write_quietly(model(kind), tmp_path / f"model{extension}")
        if can_read(f"model{extension}"):
            read_mesh(tmp_path / f"model{extension}")
    assert capfd.readouterr() == ("", "")


def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for extension in (".xdmf", ".vtkhdf", ".med"):
        with pytest.raises(InputError, match=f"which {extension} files need, to be installed: pip install h5py"):
            check_extension(tmp_path / f"model{extension}")
    (tmp_path / "model.vtkhdf").touch()
    with pytest.raises(InputError, match="pip install h5py"):
        read_mesh(tmp_path / "model.vtkhdf")


def test_a_format_of_ones_own(tmp_path: Path) -> None:
    seen = []
    form = Format("own", (".own",), ("hex8",), lambda deck, path: seen.append((deck.mesh.n_nodes, path)), fields=True)
    axes = np.stack(np.meshgrid(*[np.arange(2.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    mesh = Mesh(axes, "hex8", structure=(2, 2, 2), fields={"HU": np.zeros(8)})
    write(mesh, tmp_path / "m.own", format=form)
    assert seen == [(8, tmp_path / "m.own")]
    with pytest.raises(InputError, match=r"elements of hex8 for \.own"):
        write(Mesh(axes[:4], "quad4", structure=(2, 2)), tmp_path / "m.own", format=form)


@pytest.mark.parametrize("extension", [".inp", ".vtu", ".vts", ".vtkhdf"])
def test_memory_hardly_grows_with_what_is_written(extension, tmp_path):
    """The table of elements would be 32 bytes a node, four columns of a deck as many; sides grow with the surface."""
    peaks, counts = [], (41, 81)
    for n in counts:
        mesh = structured_block(n)
        write(mesh, tmp_path / f"m{extension}")  # imports
        tracemalloc.start()
        write(mesh, tmp_path / f"m{extension}")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 12 * (counts[1] ** 3 - counts[0] ** 3)


def structured_block(n):
    """A cube of n x n x n nodes with a material."""
    points = np.indices((n, n, n), dtype=np.float32).reshape(3, -1)[::-1].T
    hu = np.random.default_rng(4).uniform(100, 2000, n**3).astype(np.float32)
    return Mesh(points, "hex8", (n, n, n)).with_fields({"HU": hu, "E_MPa": 5 * hu, "nu": np.full_like(hu, 0.3)})
