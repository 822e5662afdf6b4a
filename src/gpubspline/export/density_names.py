"""The kind of a mesh's density, in the names of a file's fields.

Apparent, ash and QCT density are no one quantity, so that a file has ``density_apparent_g_cm3``, ``density_ash_g_cm3``
or ``density_QCT_g_cm3``, at Gauss points with their number behind. A mesh has ``density_g_cm3`` and its kind beside it,
whatever it is; one of unknown kind, as of files of 0.7 and before, keeps that name.
"""

import re
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from gpubspline.material.density import DENSITY_KINDS
from gpubspline.mesh.mesh import Mesh

Fields = dict[str, NDArray[Any]]

_PLAIN = re.compile(r"^density_(g_cm3(?:_\d+)?)$")
_TOLD = re.compile(rf"^density_({'|'.join(DENSITY_KINDS)})_(g_cm3(?:_\d+)?)$")


def with_kind(mesh: Mesh) -> Mesh:
    """Rename densities to tell their kind, where the mesh knows it."""
    if mesh.density_kind is None:
        return mesh

    def told(fields: Fields) -> Fields:
        return {_PLAIN.sub(rf"density_{mesh.density_kind}_\1", name): values for name, values in fields.items()}

    return replace(mesh, fields=told(mesh.fields), cell_fields=told(mesh.cell_fields))


def without_kind(mesh: Mesh) -> Mesh:
    """Give a mesh that was read its kind of density by the names of its fields, which become plain.

    Fields of several kinds, which nothing here writes, stay what they are.
    """
    names = (*mesh.fields, *mesh.cell_fields)
    kinds = {found[1] for name in names if (found := _TOLD.fullmatch(name))}
    if len(kinds) != 1 or any(_PLAIN.fullmatch(name) for name in names):
        return mesh

    def plain(fields: Fields) -> Fields:
        return {_TOLD.sub(r"density_\2", name): values for name, values in fields.items()}

    return replace(mesh, fields=plain(mesh.fields), cell_fields=plain(mesh.cell_fields), density_kind=kinds.pop())
