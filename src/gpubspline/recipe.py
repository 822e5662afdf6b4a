"""What a run is asked for, and what it gives: the parts that pass between the stages of the flow."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpubspline.ct.labels import Labels
from gpubspline.ct.region import Region
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.material.alarms import Alarms
from gpubspline.material.assign import Mapping
from gpubspline.material.calibration import Calibrated, Calibration
from gpubspline.material.laws import Law
from gpubspline.mesh.coverage import Coverage
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.optimize import Optimized
from gpubspline.mesh.tally import Tally
from gpubspline.spline.fit import Fit
from gpubspline.spline.lattice import SMOOTHING


@dataclass(frozen=True)
class Source:
    """Where the CT is, which part of it, what in it is the body, and how HU near its surface is read."""

    path: str | Path | Sequence[str | Path]
    threshold_hu: float | None = None
    mask: Path | None = None
    label: int | str | None = None
    labels: Path | None = None
    box_mm: tuple[float, ...] | None = None
    slices: tuple[int | None, int | None] | None = None
    slice_index: int | None = None
    axis: str = "z"
    fill: str | None = None
    smoothing_mm: float | None = None
    partial_volume: str = "fold"
    reading: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Shaping:
    """How the hyperpatch is made: control counts and degrees for each direction, the fit, and how data are taken."""

    control: tuple[int, ...] | None = None
    degree: tuple[int, ...] = (3,)
    fit: str = "control"
    interpolation: str = "linear"
    row_smoothing: float = SMOOTHING


@dataclass(frozen=True)
class Meshing:
    """By which method a body is meshed, and how fine where that is told by the elements.

    Attributes
    ----------
    method: ``"auto"``, ``"tensor"``, ``"butterfly"`` or ``"blocks"``.
    size_mm, elements: of an element, or how many; for butterfly and blocks.
    conforming: whether faces of blocks follow the boundary between labels.
    refine: parts that each hex of blocks is divided into, in each direction, on the surface that they follow.
    allow_inverted: whether blocks may keep inverted hexes where no place of the lattice gives a mesh without.
    """

    method: str = "auto"
    size_mm: float | None = None
    elements: int | None = None
    conforming: bool = True
    refine: int = 1
    allow_inverted: bool = False


@dataclass(frozen=True)
class Sampling:
    """How the mesh is made from the patch.

    ``law_by_label``: laws of labels of the body's segmentation, by number or name; ``law`` is that of the rest.
    """

    law: Law
    nodes: tuple[int, ...] | None = None
    order: int = 1
    element_type: str | None = None
    mapping: Mapping = field(default_factory=Mapping)
    calibration: Calibration | None = None
    optimize: bool = False
    law_by_label: dict[int | str, Law] = field(default_factory=dict)

    def laws_of(self, labels: Labels | None) -> dict[int, Law]:
        """Laws by the numbers of labels; raises InputError where there is no such label, or one has two laws."""
        if not self.law_by_label:
            return {}
        if labels is None:
            raise InputError(
                f"expected a segmentation (--labels) with a law by label, {next(iter(self.law_by_label))}, got none"
            )
        numbers = {name: labels.number(name) for name in self.law_by_label}
        for name, number in numbers.items():
            if list(numbers.values()).count(number) > 1:
                raise InputError(f"expected one law for the label {name} of {labels.source}, got several")
        return {numbers[name]: law for name, law in self.law_by_label.items()}


@dataclass(frozen=True, eq=False)
class Body:
    """What was found in the CT, or within a surface.

    Attributes
    ----------
    whole: the scan as it was read, in which a calibration looks for its rods or tissues; None of a surface without CT.
    volume: the scan, cropped as it was asked for, on the region's grid; of a surface the whole scan, on its own.
    region: the body.
    threshold_hu: what separated it; None where a mask or a surface did.
    labels: of a segmentation on the grid of ``whole``, by which elements are gathered in sets; or None.
    partial_volume: how HU near the surface is read, one of ``ct.partial_volume.TREATMENTS``.
    """

    whole: Volume | None
    volume: Volume | None
    region: Region
    threshold_hu: float | None
    labels: Labels | None = None
    partial_volume: str = "fold"

    @property
    def one_grid(self) -> bool:
        """Whether the scan and the region lie on one grid."""
        return self.volume is not None and self.region.is_on(self.volume)


@dataclass(frozen=True, eq=False)
class Fitted:
    """The body found in the CT and the hyperpatch through it."""

    body: Body
    fit: Fit
    method: str

    @property
    def region(self) -> Region:
        """The body's region."""
        return self.body.region

    @property
    def threshold_hu(self) -> float | None:
        """What separated the body."""
        return self.body.threshold_hu

    @property
    def volume(self) -> Volume | None:
        """The CT, cropped as it was asked for."""
        return self.body.volume


@dataclass(frozen=True, eq=False)
class Model:
    """A mesh whose every node has place, HU, density and stiffness, and what was counted of it.

    Where the mesh was written in slabs, ``mesh`` is a coarser one of the same patch, to look at. ``law`` is that of the
    sampling, calibrated where a calibration was asked for; None, as are the alarms, where there is no CT.
    ``law_of_set`` are the laws of labels, by their element sets.
    """

    mesh: Mesh
    counted: Tally
    sampling: Sampling
    law: Law | None
    alarms: Alarms | None
    calibrated: Calibrated | None = None
    coverage: Coverage | None = None
    optimized: Optimized | None = None
    law_of_set: dict[str, Law] = field(default_factory=dict)

    @property
    def laws(self) -> dict[str, Law]:
        """Laws that elements have, by element set; ``""`` is that of the rest, or of all."""
        rest = self.alarms is None or not self.alarms.by_label or self.alarms.by_label[0]["label"] == 0
        return ({"": self.law} if self.law is not None and rest else {}) | self.law_of_set
