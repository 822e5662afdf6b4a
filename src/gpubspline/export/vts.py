"""VTK's XML structured grid (.vts), written whole or slab by slab: no connectivity, binary, with every field.

Sets and surfaces are field data where the file is written whole; see ``sets``.

Source: VTK file formats, "StructuredGrid".
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from math import prod
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gpubspline.errors import InputError
from gpubspline.export.appended import FIELD_DATA, appended_file
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.placed import Array, PlacedArrays, arrays_like, field_arrays, stored_type
from gpubspline.export.sets import set_arrays
from gpubspline.mesh.slabs import Slab

STRAIGHT = ("quad4", "hex8")

Fields = Mapping[str, NDArray[Any]]


class VtsWriter:
    """A structured grid written layer by layer, in any order, which appears whole or not at all.

        with VtsWriter("big.vts", (480, 480, 450), {"HU": np.float32}) as writer:
            for first, points, hu in slabs:
                writer.write(first, points, {"HU": hu})

    Arguments
    ---------
    path: a file in an existing folder.
    counts: nodes per direction (n_u, n_v[, n_w]); two for a surface of quads.
    point_fields, cell_fields: names and types of the nodal and element fields.
    dtype: of the points.
    field_data: arrays of no point and no cell, (n,) or (n, c) each.
    comments: lines that stand in the header.

    Raises
    ------
    InputError where the folder is not writable, a type is none of VTK's, or the block ends without an error before
    every layer of nodes and elements was written.
    """

    def __init__(
        self,
        path: str | Path,
        counts: tuple[int, ...],
        point_fields: Mapping[str, DTypeLike] | None = None,
        cell_fields: Mapping[str, DTypeLike] | None = None,
        dtype: DTypeLike = np.float32,
        field_data: Fields | None = None,
        comments: Sequence[str] = (),
    ) -> None:
        if len(counts) not in (2, 3) or min(counts) < 2:
            raise InputError(f"expected 2 or 3 node counts of at least 2, got {counts}")
        self._path, self._stack = Path(path), ExitStack()
        self._counts = n_u, n_v, n_w = (*counts, 1)[:3]
        self._cells = n_u - 1, n_v - 1, max(n_w - 1, 1)
        self._field_data, self._comments = dict(field_data or {}), comments
        self._sections = {
            FIELD_DATA: arrays_like(self._field_data),
            "PointData": field_arrays(point_fields or {}, prod(self._counts)),
            "CellData": field_arrays(cell_fields or {}, prod(self._cells)),
            "Points": [Array("Points", stored_type(dtype, "Points"), prod(self._counts), 3)],
        }
        self._layers_missing = np.ones(n_w, dtype=bool)
        self._cell_layers_missing = np.full(self._cells[2], bool(cell_fields))

    def __enter__(self) -> "VtsWriter":
        """Open a temporary file beside the path."""
        extent = " ".join(f"0 {n - 1}" for n in self._counts)
        opened = appended_file(self._path, "StructuredGrid", {"Extent": extent}, self._sections, self._comments)
        self._file: PlacedArrays = self._stack.enter_context(opened)
        self._stack.push(self._check_complete)
        for name, values in self._field_data.items():
            self._file.put(FIELD_DATA, name, 0, values)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put the file in its place, or leave nothing of it after an error."""
        self._stack.__exit__(kind, error, trace)

    def write(
        self,
        first_layer: int,
        points: NDArray[Any],
        fields: Fields | None = None,
        cell_fields: Fields | None = None,
        first_cell_layer: int = 0,
    ) -> None:
        """Write layers of nodes and layers of elements; each once, layers shared between slabs too.

        Arguments
        ---------
        first_layer: of the nodes, along w.
        points: (3, layers, n_v, n_u), mm.
        fields: (layers, n_v, n_u) each, all that were announced.
        cell_fields: (cell layers, n_v - 1, n_u - 1) each, all that were announced; or nothing, for no element yet.
        first_cell_layer: of the elements, along w.

        Raises
        ------
        InputError where the shapes, the names or the layers are not those announced, or values are not finite.
        """
        for name, values in {"Points": points, **(fields or {}), **(cell_fields or {})}.items():
            if not np.isfinite(values).all():
                raise InputError(f"expected finite values in the field {name}, got NaN or infinity")
        self.write_finite(first_layer, points, fields, cell_fields, first_cell_layer)

    def write_finite(
        self,
        first_layer: int,
        points: NDArray[Any],
        fields: Fields | None = None,
        cell_fields: Fields | None = None,
        first_cell_layer: int = 0,
    ) -> None:
        """The same for values that are known to be finite."""
        n_u, n_v, _ = self._counts
        shape = np.shape(points)[1:]
        self._check("Points", first_layer, points, (3, *shape[:1], n_v, n_u), self._layers_missing)
        layer = n_u * n_v
        self._file.put_planes("Points", "Points", first_layer * layer, np.reshape(points, (3, -1)))
        self._write_fields("PointData", fields or {}, first_layer, shape, self._layers_missing)
        if cell_fields:
            n_layers = len(next(iter(cell_fields.values())))
            shape = (n_layers, n_v - 1, n_u - 1)
            self._write_fields("CellData", cell_fields, first_cell_layer, shape, self._cell_layers_missing)
            self._cell_layers_missing[first_cell_layer : first_cell_layer + n_layers] = False
        self._layers_missing[first_layer : first_layer + len(points[0])] = False

    def _write_fields(
        self, section: str, fields: Fields, first: int, shape: tuple[int, ...], missing: NDArray[np.bool_]
    ) -> None:
        announced = [array.name for array in self._sections[section]]
        if set(fields) != set(announced):
            raise InputError(f"expected the fields {', '.join(announced)}, got {', '.join(fields)}")
        for name, values in fields.items():
            self._check(name, first, values, shape, missing)
            self._file.put(section, name, first * shape[1] * shape[2], np.reshape(values, -1))

    def _check(
        self, name: str, first: int, values: NDArray[Any], shape: tuple[int, ...], missing: NDArray[np.bool_]
    ) -> None:
        if np.shape(values) != shape:
            raise InputError(f"expected {name} of shape {shape}, got {np.shape(values)}")
        if not 0 <= first <= first + shape[-3] <= missing.size:
            raise InputError(f"expected layers up to {missing.size} of {name}, got {first} to {first + shape[-3]}")

    def _check_complete(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        missing = np.count_nonzero(self._layers_missing), np.count_nonzero(self._cell_layers_missing)
        if kind is None and any(missing):
            lost = f"{missing[0]} of nodes and {missing[1]} of elements are missing"
            raise InputError(f"expected every layer of {self._path.name} to be written: {lost}")


def write_slab(writer: VtsWriter, slab: Slab) -> None:
    """Write the layers of a slab that the one before it has not."""
    assert slab.mesh.structure is not None
    n_u, n_v, n_layers = slab.mesh.structure
    skip = slab.own_nodes.start // (n_u * n_v)
    nodes = (n_layers - skip, n_v, n_u)
    writer.write(
        slab.first + skip,
        slab.mesh.planes[:, slab.own_nodes].reshape(3, *nodes),
        {name: values[slab.own_nodes].reshape(nodes) for name, values in slab.mesh.fields.items()},
        {name: values.reshape(-1, n_v - 1, n_u - 1) for name, values in slab.mesh.cell_fields.items()},
        slab.first,
    )


def write(deck: Deck, path: Path) -> None:
    """Write all fields with the precision they have.

    Raises
    ------
    InputError for a mesh that is not structured.
    """
    mesh = deck.with_all_fields
    if mesh.structure is None:
        raise InputError("expected a structured mesh for .vts, got one with explicit cells; .vtu holds it")
    nodes = (*mesh.structure, 1)[:3][::-1]
    cells = tuple(max(n - 1, 1) for n in nodes)
    types = {name: values.dtype for name, values in mesh.fields.items()}
    cell_types = {name: values.dtype for name, values in mesh.cell_fields.items()}
    told = set_arrays(deck), deck.comment_lines(100)
    with VtsWriter(path, mesh.structure, types, cell_types, mesh.points.dtype, *told) as writer:
        writer.write_finite(
            0,
            mesh.planes.reshape(3, *nodes),
            {name: values.reshape(nodes) for name, values in mesh.fields.items()},
            {name: values.reshape(cells) for name, values in mesh.cell_fields.items()},
        )


FORMATS = (
    Format("vts", (".vts",), STRAIGHT, write, nodal="field", loads=True, sets=True, fields=True, cell_fields=True),
)
