"""Exodus II (.exo, .e): element blocks, node, side and element sets, nodal and element variables of one time step.

The file is netCDF's 64-bit-offset form, which every Exodus library reads. Each section is a block, and the element
number map keeps the mesh's labels; without bins there is one block, and the modulus is the nodal variable ``E_MPa``.
What the deck says of itself stands in the information records; the load case is nodal variables.

Source: Schoof and Yarberry, EXODUS II: a finite element data model, SAND92-2137, and its figures of HEX, QUAD and their
side numbers; vtkExodusIIReader for HEX27.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck import Deck
from gpubspline.export.deck_material import Section
from gpubspline.export.formats import Format
from gpubspline.export.names import free
from gpubspline.files import whole_file
from gpubspline.mesh.mesh import Mesh

ELEMENT_TYPES = {
    **{"quad4": "SHELL4", "quad8": "SHELL8", "quad9": "SHELL9"},
    **{"hex8": "HEX8", "hex20": "HEX20", "hex27": "HEX27"},
}
_UPRIGHTS_FIRST = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
ORDER = {"hex20": _UPRIGHTS_FIRST, "hex27": (*_UPRIGHTS_FIRST, 26, 24, 25, 20, 21, 22, 23)}
"""Of the vertices, in VTK's numbers, where it is another: uprights before the top, the centre before the faces."""

SIDES = {"v0": 1, "u1": 2, "v1": 3, "u0": 4, "w0": 5, "w1": 6}
NAME, LINE = 33, 81
"""Characters of a name and of a record, with the zero that ends them."""


def write(deck: Deck, path: Path) -> None:
    """Write a model."""
    from scipy.io import netcdf_file

    with whole_file(path) as temporary, netcdf_file(temporary, "w", version=2) as file:
        for name, value in (("api_version", 5.1), ("version", 5.1)):
            setattr(file, name, np.float32(value))
        file.title, file.floating_point_word_size, file.file_size = "gpubspline", np.int32(8), np.int32(1)
        file.maximum_name_length = np.int32(NAME - 1)
        _write_sizes(file, deck)
        _write_nodes(file, deck)
        blocks = deck.sections or (Section(deck.body, np.arange(deck.mesh.n_elements), 0.0, 0.0, None),)
        _write_blocks(file, deck, blocks)
        _write_sets(file, deck, blocks)
        _write_variables(file, deck, blocks)


def _write_sizes(file: Any, deck: Deck) -> None:
    for name, size in (("time_step", None), ("len_string", NAME), ("len_name", NAME), ("len_line", LINE), ("four", 4)):
        file.createDimension(name, size)
    for name, size in (("num_dim", 3), ("num_nodes", deck.mesh.n_nodes), ("num_elem", deck.mesh.n_elements)):
        file.createDimension(name, size)
    _texts(file, "info_records", "num_info", deck.comment_lines(LINE - 1), "len_line")
    time = file.createVariable("time_whole", "d", ("time_step",))
    time[0] = 0.0


def _texts(file: Any, name: str, dimension: str, texts: Sequence[str], length: str = "len_name") -> None:
    file.createDimension(dimension, len(texts))
    table = np.array([text.encode("ascii", "replace") for text in texts], dtype=f"S{file.dimensions[length]}")
    made = file.createVariable(name, "c", (dimension, length))
    made[:] = table.view("S1").reshape(len(texts), -1)


def _array(file: Any, name: str, values: NDArray[Any], *dimensions: str) -> Any:
    code = {"f": "f", "d": "d"}.get(values.dtype.char, "i")
    made = file.createVariable(name, code, dimensions)
    made[:] = values
    return made


def _write_nodes(file: Any, deck: Deck) -> None:
    _texts(file, "coor_names", "num_coordinates", ["x", "y", "z"])
    for axis, plane in zip("xyz", deck.mesh.planes, strict=True):
        _array(file, f"coord{axis}", plane.astype(np.float64), "num_nodes")


def _write_blocks(file: Any, deck: Deck, blocks: Sequence[Section]) -> None:
    mesh = deck.mesh
    _number(file, "eb", "num_el_blk", [block.name for block in blocks])
    _array(file, "elem_num_map", np.concatenate([block.members for block in blocks]) + 1, "num_elem")
    order = list(ORDER.get(mesh.element_type, range(mesh.element.n_nodes)))
    for number, block in enumerate(blocks, start=1):
        file.createDimension(f"num_el_in_blk{number}", len(block.members))
        file.createDimension(f"num_nod_per_el{number}", mesh.element.n_nodes)
        cells = mesh.cells_of(block.members)[:, order] + 1
        made = _array(file, f"connect{number}", cells, f"num_el_in_blk{number}", f"num_nod_per_el{number}")
        made.elem_type = ELEMENT_TYPES[mesh.element_type]


def _number(file: Any, kind: str, dimension: str, names: Sequence[str]) -> None:
    """Names, numbers from 1 and status of blocks or sets of a kind."""
    _texts(file, f"{kind}_names", dimension, names)
    _array(file, f"{kind}_status", np.ones(len(names), dtype=np.int32), dimension)
    _array(file, f"{kind}_prop1", np.arange(1, 1 + len(names)), dimension).name = "ID"


def _write_sets(file: Any, deck: Deck, blocks: Sequence[Section]) -> None:
    place = np.empty(deck.mesh.n_elements, dtype=np.int64)  # in the order of the blocks, as sets count elements
    place[np.concatenate([block.members for block in blocks])] = np.arange(1, 1 + deck.mesh.n_elements)
    if deck.node_sets:
        _number(file, "ns", "num_node_sets", list(deck.node_sets))
    for number, members in enumerate(deck.node_sets.values(), start=1):
        file.createDimension(f"num_nod_ns{number}", len(members))
        _array(file, f"node_ns{number}", np.asarray(members) + 1, f"num_nod_ns{number}")
    if deck.surfaces:
        _number(file, "ss", "num_side_sets", list(deck.surfaces))
    sides = np.array([SIDES.get(side, 0) for side in deck.mesh.element.sides])
    for number, faces in enumerate(deck.surfaces.values(), start=1):
        file.createDimension(f"num_side_ss{number}", len(faces.elements))
        _array(file, f"elem_ss{number}", place[faces.elements], f"num_side_ss{number}")
        _array(file, f"side_ss{number}", sides[faces.sides], f"num_side_ss{number}")
    if deck.element_sets:
        _number(file, "els", "num_elem_sets", list(deck.element_sets))
    for number, members in enumerate(deck.element_sets.values(), start=1):
        file.createDimension(f"num_ele_els{number}", len(members))
        _array(file, f"elem_els{number}", place[members], f"num_ele_els{number}")


def _cut(names: Iterable[str]) -> list[str]:
    """Names of fields that are no longer than VTK reads them, and differ."""
    cut: list[str] = []
    for name in names:
        cut.append(free(name, cut, NAME - 1))
    return cut


def _write_variables(file: Any, deck: Deck, blocks: Sequence[Section]) -> None:
    mesh = deck.with_all_fields
    if mesh.fields:
        _texts(file, "name_nod_var", "num_nod_var", _cut(mesh.fields))
    for number, values in enumerate(mesh.fields.values(), start=1):
        made = file.createVariable(f"vals_nod_var{number}", "d", ("time_step", "num_nodes"))
        made[0] = values
    if not mesh.cell_fields:
        return
    _texts(file, "name_elem_var", "num_elem_var", _cut(mesh.cell_fields))
    held = np.ones((len(blocks), len(mesh.cell_fields)), dtype=np.int32)
    _array(file, "elem_var_tab", held, "num_el_blk", "num_elem_var")
    for number, values in enumerate(mesh.cell_fields.values(), start=1):
        for block, section in enumerate(blocks, start=1):
            made = file.createVariable(f"vals_elem_var{number}eb{block}", "d", ("time_step", f"num_el_in_blk{block}"))
            made[0] = values[section.members]


def read(path: Path) -> Mesh | None:
    """Read the hexes, or the quads, of a file in netCDF's classic forms; None where it is none of them.

    Raises
    ------
    KeyError, ValueError or IndexError where the file is broken or has other elements.
    """
    from scipy.io import netcdf_file

    with open(path, "rb") as stream:
        if stream.read(3) != b"CDF":
            return None
    with netcdf_file(path, "r", mmap=False) as file:
        blocks = [name for name in file.variables if name.startswith("connect")]
        numbers = sorted(int(name.removeprefix("connect")) for name in blocks)
        stacked = [file.variables[f"connect{number}"][:].astype(np.int64) - 1 for number in numbers]
        kind = _kind(file.variables[f"connect{numbers[0]}"].elem_type.decode(), stacked[0].shape[1])
        count = sum(map(len, stacked))
        given = file.variables["elem_num_map"][:].astype(np.int64) - 1 if "elem_num_map" in file.variables else None
        label = given if given is not None and np.array_equal(np.sort(given), np.arange(count)) else np.arange(count)
        order = np.argsort(ORDER.get(kind, range(stacked[0].shape[1])))
        cells = np.empty((count, order.size), dtype=np.int32)
        cells[label] = np.concatenate(stacked)[:, order]
        return Mesh(
            _points(file),
            kind,
            connectivity=cells,
            fields=_read_variables(file, "nod", lambda number: [f"vals_nod_var{number}"], None),
            cell_fields=_read_variables(
                file, "elem", lambda number: [f"vals_elem_var{number}eb{block}" for block in numbers], label
            ),
            node_sets=_read_sets(file, "ns", "node_ns", None),
            element_sets=_read_sets(file, "els", "elem_els", label)
            | _read_blocks(file, list(map(len, stacked)), label),
        )


def _kind(name: str, n_nodes: int) -> str:
    solid = name.upper().startswith("HEX")
    found = [each for each, ours in ELEMENT_TYPES.items() if ours.startswith("HEX") == solid]
    sizes = {int("".join(filter(str.isdigit, each))): each for each in found}
    if not solid and not name.upper().startswith(("SHELL", "QUAD")):
        raise ValueError(f"elements of the type {name}")
    return sizes[n_nodes]


def _points(file: Any) -> NDArray[np.float64]:
    if "coord" in file.variables:
        return np.asarray(file.variables["coord"][:].T, dtype=np.float64)
    planes = [np.asarray(file.variables[f"coord{axis}"][:], dtype=np.float64) for axis in "xyz"]
    return np.stack(planes, axis=1)


def _read_texts(file: Any, name: str) -> list[str]:
    rows = file.variables[name][:] if name in file.variables else ()
    return [b"".join(row).split(b"\0")[0].decode("ascii", "replace").strip() for row in rows]


def _read_variables(
    file: Any, kind: str, parts: Callable[[int], list[str]], label: NDArray[np.int64] | None
) -> dict[str, NDArray[Any]]:
    """Those of the last step that every block has."""
    found = {}
    for number, name in enumerate(_read_texts(file, f"name_{kind}_var"), start=1):
        if all(part in file.variables for part in parts(number)):
            values = np.concatenate([file.variables[part][-1] for part in parts(number)]).astype(np.float64)
            found[name] = values if label is None else np.empty_like(values)
            if label is not None:
                found[name][label] = values
    return found


def _read_sets(file: Any, kind: str, array: str, label: NDArray[np.int64] | None) -> dict[str, NDArray[np.int32]]:
    found = {}
    for number, name in enumerate(_read_texts(file, f"{kind}_names"), start=1):
        if f"{array}{number}" in file.variables:
            members = file.variables[f"{array}{number}"][:].astype(np.int64) - 1
            found[name or f"{kind}_{number}"] = (members if label is None else label[members]).astype(np.int32)
    return found


def _read_blocks(file: Any, sizes: list[int], label: NDArray[np.int64]) -> dict[str, NDArray[np.int32]]:
    names, ends = _read_texts(file, "eb_names"), np.cumsum([0, *sizes])
    each = zip(names, ends[:-1], ends[1:], strict=False)
    return {name: label[first:last].astype(np.int32) for name, first, last in each if name}


FORMATS = (
    Format(
        "exodus",
        (".exo", ".e", ".ex2"),
        tuple(ELEMENT_TYPES),
        write,
        nodal="field",
        binned=True,
        loads=True,
        sets=True,
        longest_name=NAME - 1,
        fields=True,
        cell_fields=True,
    ),
)
