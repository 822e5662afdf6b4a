"""Writing and reading meshes and models: one file per format, found by its extension or its name."""

import importlib
import pkgutil
import re
import warnings
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.analysis.load_case import LoadCase, load_case
from gpubspline.errors import GpubsplineWarning, InputError, expect
from gpubspline.export.deck import Wanted, make_deck
from gpubspline.export.formats import Format as Format
from gpubspline.export.read import read_mesh as read_mesh
from gpubspline.export.units import DEFAULT_UNITS, UNITS, find_units
from gpubspline.files import check_writable
from gpubspline.material.laws import Law
from gpubspline.material.orthotropy import is_orthotropic
from gpubspline.mesh.mesh import Mesh

PLUGINS = "gpubspline.formats"


@lru_cache(maxsize=1)
def formats() -> dict[str, Format]:
    """Every format that can be written, by name: the ``FORMATS`` of this folder's modules, and of others' packages.

    Those name theirs, a ``Format`` each, as entry points of the group ``gpubspline.formats``.
    """
    modules = [importlib.import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    own = [form for module in modules for form in getattr(module, "FORMATS", ())]
    return {form.name: form for form in (*(entry.load() for entry in entry_points(group=PLUGINS)), *own)}


@lru_cache(maxsize=1)
def _by_extension() -> dict[str, Format]:
    return {extension: form for form in formats().values() for extension in form.extensions}


def extensions() -> tuple[str, ...]:
    """Extensions of every format that can be written, ``.vtu`` and ``.inp`` first."""
    return tuple(sorted(_by_extension(), key=lambda extension: (extension not in (".vtu", ".inp"), extension)))


def find_format(path: str | Path, name: str | Format | None = None) -> Format:
    """Format by name, or by the extension of a file where that is None; one that is given is taken as it is.

    Raises
    ------
    InputError where there is none, or a package that it needs is not installed.
    """
    if isinstance(name, Format):
        return name
    if name is not None and name not in formats():
        raise InputError(f"expected a format of {', '.join(sorted(formats()))}, got {name!r}")
    extension = Path(path).suffix.lower()
    if name is None and extension not in _by_extension():
        raise InputError(f"expected a mesh file of {', '.join(extensions())}, got {Path(path).name!r}")
    form = _by_extension()[extension] if name is None else formats()[name]
    form.check_needs(extension if name is None else name)
    return form


def check_extension(path: str | Path) -> None:
    """Raise ``InputError`` where no format that can be written has the extension, before any work is done for it."""
    find_format(path)


def check_holds_fields(path: str | Path) -> None:
    """Raise ``InputError`` where no format has the extension, or one that holds no results, as a deck's."""
    if not find_format(path).fields:
        raise InputError(f"expected a file that holds displacement and stress, such as .vtu, got {Path(path).name!r}")


def can_read(path: str | Path) -> bool:
    """Whether ``read_mesh`` knows the extension of ``path``."""
    form = _by_extension().get(Path(path).suffix.lower())
    return form is not None and form.readable


def write(
    model: Any,
    path: str | Path,
    *,
    format: str | Format | None = None,
    units: str = DEFAULT_UNITS,
    load: LoadCase | str | Path | None = None,
    law: Law | Mapping[str, Law] | None = None,
    modulus_bins: int | None = None,
    nodal_modulus: bool = False,
    thickness_mm: float = 1.0,
    step: str = "",
) -> dict[str, Any]:
    """Write a mesh or a model in the format of the extension, whole or not at all.

    Labels start at 1. A deck carries the modulus by node where its solver can, else as element sets binned by modulus,
    the error of which it states.

    Arguments
    ---------
    model: a mesh with all fields and sets that are to be written, or what has one as ``mesh``.
    path: a file in an existing folder.
    format: name of a format, where not the one of the extension, or a format of one's own.
    units: ``"mm-N-MPa"`` or ``"m-N-Pa"``; fields whose names end in a unit are converted and renamed.
    load: a load case, or its name or file as ``load_case`` takes it: its regions become node sets and surfaces, its
        supports, forces, pressures and gravity the deck's.
    law: the material law to cite; or laws by element set, ``""`` that of the rest.
    modulus_bins: element sets by modulus, instead of a modulus by node.
    nodal_modulus: refuse a format that holds no modulus by node.
    thickness_mm: of quads, which are shells in decks.
    step: text that ends an ``.inp`` deck, such as ``*STEP`` to ``*END STEP``.

    Returns
    -------
    What was written, for a summary: format, units, means of the modulus with its error, total load.

    Raises
    ------
    InputError for an unknown format, extension or system of units, a thickness that is none, a folder that is not there
    or not writable, a place or a field that is not finite, or a format that cannot hold the elements or what else was
    asked for. Fields that it cannot hold are warned of.
    """
    mesh = getattr(model, "mesh", model)
    expect(mesh, Mesh, "write takes the mesh first, then its file")
    path = Path(path)
    form = find_format(path, format)
    check_writable(path)
    _check_finite(mesh)
    asked = {"binned": modulus_bins is not None, "nodal": nodal_modulus, "loads": load is not None}
    known = format if isinstance(format, str) else path.suffix.lower()
    form.check_asked(known, **asked)
    if is_orthotropic(mesh):
        form.check_orthotropic(known)
    form.check_elements(known, mesh.element_type)
    if step and (load is not None or form.name != "abaqus"):
        raise InputError(f"expected a step with an .inp deck without a load case, got {path.name!r}")
    if not 0 < thickness_mm < np.inf:
        raise InputError(f"expected a thickness above 0 mm, got {thickness_mm:g}")
    _warn_of_units(mesh)
    case = load if load is None or isinstance(load, LoadCase) else load_case(load)
    laws = {"": law} if isinstance(law, Law) else dict(law or {})
    asked_for = Wanted(find_units(units), laws, modulus_bins, nodal_modulus, case, thickness_mm, step)
    deck = make_deck(mesh, form, asked_for)
    _warn_of_lost(mesh, form, known, case is not None)
    form.write(deck, path)
    return deck.figures


def _warn_of_units(mesh: Mesh) -> None:
    """Warn where a mesh was written in another system of units and read again: files do not tell what a length is."""
    endings = tuple(f"_{unit}" for each in UNITS.values() if each.per_mm != 1 for unit in (each.stress, each.density))
    found = [name for name in (*mesh.fields, *mesh.cell_fields) if name.endswith(endings)]
    if found:
        words = f"the mesh has fields in other units than MPa and g/cm3 ({', '.join(found)}), and its lengths are taken"
        warnings.warn(f"{words} for mm: export the mesh that it was made from", GpubsplineWarning, stacklevel=3)


def _warn_of_lost(mesh: Mesh, form: Format, known: str, loaded: bool) -> None:
    """Warn of fields that a deck has no card for, and of sets beside the sides where a format has none."""
    if form.binned and not form.fields:
        own = (*mesh.fields, *mesh.cell_fields)
        lost = [name for name in own if not (_MATERIAL.match(name) or (loaded and name.startswith(_LOADS)))]
        if lost:
            warnings.warn(f"{known} holds no field {', '.join(lost)}: left out", GpubsplineWarning, stacklevel=3)
    if not form.sets:
        sides = {*mesh.element.sides, "surface", "body"}
        lost = [name for name in (*mesh.node_sets, *mesh.element_sets) if name not in sides]
        if lost:
            warnings.warn(f"{known} holds no set {', '.join(lost)}: left out", GpubsplineWarning, stacklevel=3)


_MATERIAL = re.compile(
    r"(HU|[EG]\d*_MPa(_\d+)?|nu\d*(_\d+)?|density_g_cm3(_\d+)?|material|law|label|scaled_jacobian|axis[12]_[xyz])$"
)
"""Fields that a deck's materials or sets stand for, or that are of the mesh itself."""

_LOADS = ("force_n_", "support_", "prescribed_mm_")
"""Beginnings of the fields that say what acted on a mesh, which the load case of a deck is instead."""


def _check_finite(mesh: Mesh) -> None:
    mesh.check_finite()
    for name, values in {**mesh.fields, **mesh.cell_fields}.items():
        if not np.isfinite(values).all():
            bad = int(np.count_nonzero(~np.isfinite(values)))
            raise InputError(
                f"expected finite values in the field {name}, got NaN or infinity in {bad} of {values.size}"
            )
