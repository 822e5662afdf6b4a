"""Structured grids: written whole or by layers, read by VTK and back, whole or not at all."""

import numpy as np
import pytest

from gpubspline.errors import InputError
from gpubspline.export import read_mesh, write
from gpubspline.export.vts import VtsWriter
from gpubspline.mesh.mesh import Mesh

COUNTS = (5, 4, 7)
NODAL = {"HU": np.float32, "E <MPa>": np.float64}
ELEMENTAL = {"scaled_jacobian": np.float32, "material": np.int32}


def lattice():
    """Points (3, n_w, n_v, n_u) of a bent box, with fields, as the writer takes them."""
    rng = np.random.default_rng(4)
    w, v, u = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in COUNTS[::-1]), indexing="ij")
    points = np.stack([u + 0.1 * v * w, v, w - 61])
    fields = {name: rng.normal(size=u.shape).astype(dtype) for name, dtype in NODAL.items()}
    cells = tuple(n - 1 for n in u.shape)
    numbers = np.arange(np.prod(cells)).reshape(cells)
    return (
        points,
        fields,
        {"scaled_jacobian": np.sqrt(numbers).astype(np.float32), "material": numbers.astype(np.int32)},
    )


def slabs(thickness):
    """The lattice in slabs along w; the last layer of one is not repeated by the next, whose elements reach back."""
    points, fields, cell_fields = lattice()
    for first in range(0, COUNTS[2], thickness):
        last = min(first + thickness, COUNTS[2])
        first_cell = max(first - 1, 0)
        yield (
            first,
            points[:, first:last],
            {name: values[first:last] for name, values in fields.items()},
            {name: values[first_cell : last - 1] for name, values in cell_fields.items()} if last > 1 else None,
            first_cell,
        )


def assert_is_the_lattice(points, fields, cell_fields):
    expected = lattice()
    np.testing.assert_array_equal(points, expected[0].reshape(3, -1).T)
    for given, wanted in ((fields, expected[1]), (cell_fields, expected[2])):
        assert set(given) == set(wanted)
        for name, values in wanted.items():
            np.testing.assert_array_equal(given[name], values.ravel())
            assert given[name].dtype == values.dtype


@pytest.mark.parametrize("thickness", [1, 2, 3, 7])
def test_slabs_make_one_grid(thickness, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    with VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer:
        for slab in slabs(thickness):
            writer.write(*slab)
    assert [p.name for p in tmp_path.iterdir()] == ["a.vts"]
    grid = pyvista.read(tmp_path / "a.vts")
    assert grid.dimensions == COUNTS
    assert_is_the_lattice(grid.points, dict(grid.point_data), dict(grid.cell_data))
    back = read_mesh(tmp_path / "a.vts")
    assert back.structure == COUNTS
    assert_is_the_lattice(back.points, back.fields, back.cell_fields)
    np.testing.assert_array_equal(back.cells, grid.cast_to_unstructured_grid().cells_dict[12])


def test_layers_come_in_any_order(tmp_path):
    for name, order in (("up.vts", 1), ("down.vts", -1)):
        with VtsWriter(tmp_path / name, COUNTS, NODAL, ELEMENTAL) as writer:
            for slab in list(slabs(2))[::order]:
                writer.write(*slab)
    assert (tmp_path / "up.vts").read_bytes() == (tmp_path / "down.vts").read_bytes()


def test_rows_longer_than_a_chunk_are_written_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("gpubspline.export.placed._CHUNK", 9)
    with VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer:
        for slab in slabs(3):
            writer.write(*slab)
    back = read_mesh(tmp_path / "a.vts")
    assert_is_the_lattice(back.points, back.fields, back.cell_fields)


def test_a_missing_layer_leaves_no_file(tmp_path):
    for lost in range(3):
        with (
            pytest.raises(InputError, match="of elements are missing"),
            VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer,
        ):
            for number, slab in enumerate(slabs(3)):
                if number != lost:
                    writer.write(*slab)
        assert list(tmp_path.iterdir()) == []


def test_an_error_among_slabs_leaves_what_was_there(tmp_path):
    (tmp_path / "a.vts").write_text("what was there")
    with pytest.raises(ZeroDivisionError), VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer:
        writer.write(*next(slabs(2)))
        raise ZeroDivisionError
    assert [p.read_text() for p in tmp_path.iterdir()] == ["what was there"]


def spoiled(part, name=None):
    first, points, fields, cell_fields, first_cell = next(slabs(3))
    if part == "points":
        return first, points[:, :, :-1], fields, cell_fields, first_cell
    if part == "layer":
        return 5, points, fields, cell_fields, first_cell
    if part == "name":
        return first, points, {"HU": fields["HU"]}, cell_fields, first_cell
    if part == "cells":
        return first, points, fields, {name: values[:, 1:] for name, values in cell_fields.items()}, first_cell
    fields["HU"][0, 0, 0] = np.inf
    return first, points, fields, cell_fields, first_cell


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("points", r"expected Points of shape \(3, 3, 4, 5\), got \(3, 3, 3, 5\)"),
        ("layer", "expected layers up to 7 of Points, got 5 to 8"),
        ("name", "expected the fields HU, E <MPa>, got HU"),
        ("cells", r"expected scaled_jacobian of shape \(2, 3, 4\), got \(2, 2, 4\)"),
        ("value", "finite values in the field HU"),
    ],
)
def test_what_does_not_fit_is_refused(part, words, tmp_path):
    with (
        pytest.raises(InputError, match=words),
        VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer,
    ):
        writer.write(*spoiled(part))
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_vtk_has_not_are_refused(tmp_path):
    with pytest.raises(InputError, match="field HU, got float16"):
        VtsWriter(tmp_path / "a.vts", COUNTS, {"HU": np.float16})
    with pytest.raises(InputError, match="node counts of at least 2"):
        VtsWriter(tmp_path / "a.vts", (5, 1, 4))


def test_explicit_cells_are_refused(tmp_path):
    points, _, _ = lattice()
    structured = Mesh(points.reshape(3, -1).T, "hex8", structure=COUNTS)
    explicit = Mesh(structured.points, "hex8", connectivity=structured.cells)
    with pytest.raises(InputError, match=r"structured mesh for \.vts"):
        write(explicit, tmp_path / "a.vts")
    assert list(tmp_path.iterdir()) == []


def test_another_kind_of_grid_is_refused(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_structured_grid().save(tmp_path / "a.vts")
    with pytest.raises(InputError, match=r"appended raw, got a\.vts"):
        read_mesh(tmp_path / "a.vts")


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9])
def test_a_grid_cut_short_is_refused(share, tmp_path):
    with VtsWriter(tmp_path / "a.vts", COUNTS, NODAL, ELEMENTAL) as writer:
        for slab in slabs(3):
            writer.write(*slab)
    whole = (tmp_path / "a.vts").read_bytes()
    (tmp_path / "a.vts").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"got a\.vts"):
        read_mesh(tmp_path / "a.vts")
