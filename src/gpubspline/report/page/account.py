"""What a report tells, as plain data: any command that has a mesh and figures can fill it in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gpubspline.ct.volume import Volume
from gpubspline.material.laws import Law
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality

PAPER = (
    "Pise, Bhatt, Srivastava, Finite Element Mesh Generation of Human Body Segment in 2-D and 3-D Using B-spline Method"
)
"""What the method is taken from; every report names it."""


@dataclass(frozen=True)
class Setting:
    """One option in force.

    Attributes
    ----------
    panel: the group it stands in, such as ``"Mesh"``.
    name: as it is typed, such as ``"--nodes"``.
    value: its text; never a path, which may hold a patient's name.
    given: whether it was typed, or is the default.
    """

    panel: str
    name: str
    value: str
    given: bool = False


@dataclass(frozen=True)
class Table:
    """A table of a report of its own: a study's runs, a mesh before and after.

    Attributes
    ----------
    title: stands above it.
    columns: heads, with their units.
    rows: texts or numbers, one a column; numbers are shown to four digits.
    note: a sentence below it.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    note: str = ""


@dataclass(frozen=True)
class Curve:
    """A chart of a report of its own: points joined by lines, such as a study's convergence.

    Attributes
    ----------
    title, x_label, y_label: with units.
    series: (x, y) by name, each (n,).
    log_x, log_y: whether an axis is logarithmic.
    note: a sentence below it.
    """

    title: str
    x_label: str
    y_label: str
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    log_x: bool = False
    log_y: bool = False
    note: str = ""


@dataclass(frozen=True, eq=False)
class Account:
    """What a report tells; what is left out has no section.

    Attributes
    ----------
    title: one line, such as ``"Mesh of 5,610 hex8"``; never a name of a patient.
    mesh: with at least one field; ``scaled_jacobian``, ``HU``, ``E_MPa`` and ``von_mises_mpa`` are shown.
    figures: plain numbers, texts, lists and dicts, as in the summary; ``seconds`` become the timings.
    quality: of the mesh.
    volume: the CT that the mesh was made from, in its frame.
    laws: material laws in force.
    command: what was typed, without paths.
    settings: every option in force.
    warnings: what the user was warned of; the page adds what its figures call for.
    sources: citations of further methods and conversions, beside those of the laws.
    tables, curves: sections of the command's own.
    """

    title: str
    mesh: Mesh
    figures: dict[str, Any] = field(default_factory=dict)
    quality: Quality | None = None
    volume: Volume | None = None
    laws: Sequence[Law] = ()
    command: str = ""
    settings: Sequence[Setting] = ()
    warnings: Sequence[str] = ()
    sources: Sequence[str] = (PAPER,)
    tables: Sequence[Table] = ()
    curves: Sequence[Curve] = ()
