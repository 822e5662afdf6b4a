"""VTK's XML unstructured grid (.vtu): binary, with every field.

Sets and surfaces are field data; see ``sets``. Source: VTK file formats, "UnstructuredGrid".
"""

from pathlib import Path

import numpy as np

from gpubspline.export import unstructured
from gpubspline.export.appended import FIELD_DATA, appended_file
from gpubspline.export.deck import Deck
from gpubspline.export.formats import Format
from gpubspline.export.placed import arrays_like
from gpubspline.export.sets import set_arrays
from gpubspline.mesh.elements import MESHABLE


def write(deck: Deck, path: Path) -> None:
    """Write all fields with the precision they have."""
    mesh, sets = deck.with_all_fields, set_arrays(deck)
    sections = unstructured.sections(mesh, np.dtype(np.int32), first_offset=False)
    size = {"NumberOfPoints": str(mesh.n_nodes), "NumberOfCells": str(mesh.n_elements)}
    told = {FIELD_DATA: arrays_like(sets), **sections}, deck.comment_lines(100)
    with appended_file(path, "UnstructuredGrid", size, *told) as file:
        for name, values in sets.items():
            file.put(FIELD_DATA, name, 0, values)
        unstructured.fill(file, mesh, first_offset=False)


FORMATS = (
    Format("vtu", (".vtu",), MESHABLE, write, nodal="field", loads=True, sets=True, fields=True, cell_fields=True),
)
