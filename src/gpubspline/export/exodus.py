"""Exodus II (.exo, .e): element blocks, node, side and element sets, nodal and element variables of one time step.

The file is netCDF's 64-bit-offset form, which every Exodus library reads. Each section is a block, and the element
number map keeps the mesh's labels; without bins there is one block, and the modulus is the nodal variable ``E_MPa``.
What the deck says of itself stands in the information records; the load case is nodal variables.

Source: Schoof and Yarberry, EXODUS II: a finite element data model, SAND92-2137, and its figures of HEX, QUAD and their
side numbers; vtkExodusIIReader for HEX27.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.export.deck import Deck, Section
from gpubspline.export.formats import Format
from gpubspline.files import whole_file

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


def _write_variables(file: Any, deck: Deck, blocks: Sequence[Section]) -> None:
    mesh = deck.with_all_fields
    if mesh.fields:
        _texts(file, "name_nod_var", "num_nod_var", list(mesh.fields))
    for number, values in enumerate(mesh.fields.values(), start=1):
        made = file.createVariable(f"vals_nod_var{number}", "d", ("time_step", "num_nodes"))
        made[0] = values
    if not mesh.cell_fields:
        return
    _texts(file, "name_elem_var", "num_elem_var", list(mesh.cell_fields))
    held = np.ones((len(blocks), len(mesh.cell_fields)), dtype=np.int32)
    _array(file, "elem_var_tab", held, "num_el_blk", "num_elem_var")
    for number, values in enumerate(mesh.cell_fields.values(), start=1):
        for block, section in enumerate(blocks, start=1):
            made = file.createVariable(f"vals_elem_var{number}eb{block}", "d", ("time_step", f"num_el_in_blk{block}"))
            made[0] = values[section.members]


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
        readable=False,
        fields=True,
        cell_fields=True,
    ),
)
