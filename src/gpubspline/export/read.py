"""Reading a mesh of any format that meshio knows, and VTK's structured grids."""

import struct
import warnings
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export import exodus, med, vtkhdf
from gpubspline.export.density_names import without_kind
from gpubspline.export.formats import Format
from gpubspline.export.gmsh import NODES_END
from gpubspline.export.names import ended
from gpubspline.export.quiet import quiet_meshio
from gpubspline.export.read_appended import StoredGrid, read_appended
from gpubspline.export.sets import ELEMENTS as ELEMENT_SET
from gpubspline.export.sets import NODES as NODE_SET
from gpubspline.export.sets import from_flags, sets_of
from gpubspline.mesh import structure
from gpubspline.mesh.elements import ELEMENTS, MESHABLE
from gpubspline.mesh.mesh import Mesh

_BROKEN = (
    *(ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError, RuntimeError, StopIteration),
    *(EOFError, OSError, ImportError, struct.error, zlib.error, ParseError, SystemExit),
)
"""What meshio's readers raise on files that are cut short or of another format; some end the process."""


def read_mesh(path: str | Path) -> Mesh:
    """Read the hexes of a file, or its quads where it has no hexes.

    Returns
    -------
    Mesh with every scalar nodal and element field, and node and element sets where the format has them. It is
    structured where its nodes and elements are numbered as those of a structured mesh, else its cells are explicit.
    Densities have the one name ``density_g_cm3`` and, where the file tells it, their kind.
    Fields with several components come back as one field each, ``NAME_0`` and on.

    Raises
    ------
    InputError where the file is not there, not readable, has neither hexes nor quads, or hexes of several orders, or
    a node has no place.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"expected a mesh file, got {path}, which is no file")
    extension = path.suffix.lower()
    mesh = _read_grid(path) if extension in (".vts", ".vtu", ".vtkhdf") else _read_binary(path, extension)
    mesh = _read_by_meshio(path) if mesh is None else mesh
    mesh.check_finite(path.name)
    return _recognised(without_kind(mesh))


def _recognised(mesh: Mesh) -> Mesh:
    """Structured where the numbering tells."""
    if mesh.connectivity is None:
        return mesh
    counts = structure.recognise(mesh.element, mesh.connectivity, mesh.n_nodes)
    return mesh if counts is None else replace(mesh, structure=counts, connectivity=None)


def _read_binary(path: Path, extension: str) -> Mesh | None:
    """Mesh of an Exodus or a MED file, which meshio reads in another order; None where meshio is to try."""
    readers: tuple[tuple[Format, Callable[[Path], Mesh | None]], ...] = (
        (exodus.FORMATS[0], exodus.read),
        (med.FORMATS[0], med.read),
    )
    for form, read in readers:
        if extension in form.extensions:
            form.check_needs(extension)
            try:
                return read(path)
            except _BROKEN as error:
                raise InputError(f"expected a whole mesh file, got {path.name}: {error}") from None
    return None


def _read_grid(path: Path) -> Mesh | None:
    """Mesh of a file of VTK's that can be read without meshio; None where meshio is to try."""
    extension = path.suffix.lower()
    if extension == ".vtkhdf":
        vtkhdf.FORMATS[0].check_needs(extension)
    try:
        found = vtkhdf.read(path) if extension == ".vtkhdf" else read_appended(path)
        if found is not None and found.grid == "StructuredGrid":
            return _structured(found)
        if found is not None and found.grid == "UnstructuredGrid":
            return _unstructured(found)
    except _BROKEN as error:
        raise InputError(f"expected a whole mesh file, got {path.name}: {error}") from None
    if extension == ".vts":
        raise InputError(f"expected one structured grid with its arrays appended raw, got {path.name}: another kind")
    return None


def _structured(found: StoredGrid) -> Mesh:
    ends = [int(n) for n in found.piece["Extent"].split()]
    counts = tuple(last - first + 1 for first, last in zip(ends[::2], ends[1::2], strict=True))
    nodes = counts if counts[2] > 1 else counts[:2]
    return Mesh(
        found.arrays["Points"].popitem()[1],
        "hex8" if len(nodes) == 3 else "quad4",
        structure=nodes,
        fields=scalars(found.arrays.get("PointData", {})),
        cell_fields=scalars(found.arrays.get("CellData", {})),
        **_sets(found),
    )


def _sets(found: StoredGrid) -> dict[str, Any]:
    """Keywords of ``Mesh``."""
    nodes, elements = sets_of(found.arrays.get("FieldData", {}))
    return {"node_sets": nodes, "element_sets": elements}


def _unstructured(found: StoredGrid) -> Mesh | None:
    """Mesh of elements of one type; None where there are others."""
    cells, types = found.arrays["Cells"]["connectivity"], found.arrays["Cells"]["types"]
    names = [name for name in MESHABLE if types.size and ELEMENTS[name].vtk_type == types[0]]
    if not names or np.any(types != types[0]):
        return None
    return Mesh(
        found.arrays["Points"].popitem()[1],
        names[0],
        connectivity=cells.reshape(len(types), ELEMENTS[names[0]].n_nodes),
        fields=scalars(found.arrays.get("PointData", {})),
        cell_fields=scalars(found.arrays.get("CellData", {})),
        **_sets(found),
    )


def _read_by_meshio(path: Path) -> Mesh:
    given = _read(path)
    name = _choose_type(path, given)
    kind = ELEMENTS[name].meshio_name
    blocks = [number for number, block in enumerate(given.cells) if block.type == kind]
    grouped = _grouped(given)
    others = sorted(
        {block.type for number, block in enumerate(given.cells) if block.type not in (kind, "vertex")}
        - {given.cells[number].type for number in grouped}
    )
    if others:
        warnings.warn(f"{path.name}: left out cells of {', '.join(others)}", GpubsplineWarning, stacklevel=3)
    points = np.asarray(given.points)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points), dtype=points.dtype)])
    fields = scalars(_own(given.point_data))
    cell_fields = scalars({k: np.concatenate([v[b] for b in blocks]) for k, v in _own(given.cell_data).items()})
    node_sets, element_sets = from_flags(NODE_SET, fields), from_flags(ELEMENT_SET, cell_fields)
    return Mesh(
        points,
        name,
        connectivity=np.concatenate([given.cells[number].data for number in blocks]),
        fields={name: values for name, values in fields.items() if not name.startswith(NODE_SET)},
        cell_fields={name: values for name, values in cell_fields.items() if not name.startswith(ELEMENT_SET)},
        node_sets={**node_sets, **_node_sets(given)},
        element_sets={**element_sets, **_element_sets(given, blocks)},
    )


def _read(path: Path) -> Any:
    import meshio

    with quiet_meshio():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return meshio.read(path)
        except (*_BROKEN, meshio.ReadError) as error:
            words = str(error).strip().splitlines()
            reason = "an empty file" if not path.stat().st_size else "which is none, or damaged"
            reason = words[0] if words and not isinstance(error, SystemExit) else reason
            if reason.startswith("Could not deduce"):
                reason = f"no format that ends in {path.suffix or 'nothing'} is read"
    raise InputError(f"expected a mesh that meshio can read, got {path.name}: {reason}")


def _choose_type(path: Path, given: Any) -> str:
    present = {block.type for block in given.cells if len(block.data)}
    for dimension in (3, 2):
        found = [
            name for name in MESHABLE if ELEMENTS[name].dimension == dimension and ELEMENTS[name].meshio_name in present
        ]
        if len(found) > 1:
            raise InputError(f"expected elements of one type, got {', '.join(found)} in {path.name}")
        if found:
            return found[0]
    raise InputError(f"expected hexes or quads, got {', '.join(sorted(present)) or 'no cells'} in {path.name}")


def scalars(data: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Fields of one component each; those with several are parted into ``NAME_0`` and on."""
    parted = {}
    for name, values in data.items():
        table = np.asarray(values).reshape(len(values), -1)
        names = [name] if table.shape[1] == 1 else [f"{name}_{c}" for c in range(table.shape[1])]
        parted.update({one: np.ascontiguousarray(table[:, c]) for c, one in enumerate(names)})
    return parted


def _own(data: dict[str, Any]) -> dict[str, Any]:
    """Without what meshio says of Gmsh's entities."""
    return {name: values for name, values in data.items() if not name.startswith("gmsh:")}


def _grouped(given: Any) -> set[int]:
    """Blocks of cells that are in a group of a name, as Gmsh has them: surfaces, which are no loss beside the hexes."""
    sets = [members for name, members in given.cell_sets.items() if name in given.field_data]
    return {number for members in sets for number, part in enumerate(members) if part is not None and len(part)}


def _node_sets(given: Any) -> dict[str, NDArray[np.int32]]:
    """Point sets, and groups of vertex cells: Gmsh's way, ours ending in ``_nodes`` where a surface has the name."""
    sets = {name: np.asarray(members, dtype=np.int32) for name, members in given.point_sets.items()}
    solid = [block.type != "vertex" for block in given.cells]
    others = {
        name
        for name, members in given.cell_sets.items()
        if any(part is not None and len(part) and held for part, held in zip(members, solid, strict=False))
    }
    for name, members in given.cell_sets.items():
        parts = [
            block.data[np.asarray(part, dtype=np.int64), 0]
            for block, part in zip(given.cells, members, strict=False)
            if block.type == "vertex" and part is not None and len(part)
        ]
        if parts and name in given.field_data:
            own = name.removesuffix(NODES_END)
            sets[own if ended(own, others, NODES_END) else name] = np.sort(np.concatenate(parts)).astype(np.int32)
    return sets


def _element_sets(given: Any, blocks: list[int]) -> dict[str, NDArray[Any]]:
    first = np.cumsum([0, *(len(given.cells[b].data) for b in blocks)])
    sets = {}
    for name, members in given.cell_sets.items():
        if name.startswith("gmsh:") or all(members[b] is None or not len(members[b]) for b in blocks):
            continue
        parts = [np.asarray(members[b], dtype=np.int32) + start for b, start in zip(blocks, first, strict=False)]
        sets[name] = np.concatenate(parts).astype(np.int32)
    return sets
