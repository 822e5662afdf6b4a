"""What the figures are made of: scans of the phantoms, hyperpatches and meshes, each made once."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpubspline.clock import Clock
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.device import Device
from gpubspline.material.registry import law
from gpubspline.pipeline import fit_patch, sample_patch
from gpubspline.recipe import Fitted, Model, Sampling, Shaping, Source
from gpubspline.reproduce.paper import MODELS, THRESHOLD_HU


@dataclass(eq=False)
class Workshop:
    """Makes models for figures.

    Attributes
    ----------
    folder: where everything goes; scans into its ``ct``.
    device, clock: where to compute, and what hears of it.
    """

    folder: Path
    device: Device
    clock: Clock
    _fitted: dict[Any, Fitted] = field(default_factory=dict)
    _models: dict[str, Model] = field(default_factory=dict)

    def scan(self, phantom: str) -> Path:
        """DICOM series of a phantom."""
        series = self.folder / "ct" / phantom
        if not series.is_dir():
            self.clock.tell(f"scan of the {phantom}")
            series.parent.mkdir(parents=True, exist_ok=True)
            write_phantom(phantom, series)
        return series

    def fitted(self, phantom: str, control: tuple[int, ...] | None, slice_index: int | None = None) -> Fitted:
        """Give the hyperpatch of a phantom or of one of its slices, by the paper's method."""
        key = (phantom, control, slice_index)
        if key not in self._fitted:
            source = Source(
                self.scan(phantom),
                threshold_hu=THRESHOLD_HU.get(phantom),
                slice_index=slice_index,
                partial_volume="none",  # as the paper
            )
            self._fitted[key] = fit_patch(source, Shaping(control=control), self.device, Clock())
        return self._fitted[key]

    def model(self, name: str) -> Model:
        """Mesh of a model of the paper, with its material and its quality."""
        if name not in self._models:
            wanted = MODELS[name]
            self.clock.tell(f"mesh of {wanted.title}")
            patch = self.fitted(wanted.phantom, wanted.control, wanted.slice_index).fit.patch
            self._models[name] = sample_patch(patch, Sampling(law(), wanted.samples), self.device, Clock())
        return self._models[name]

    def figures(self, name: str) -> dict[str, Any]:
        """Count a model, beside what the paper counts."""
        wanted, quality = MODELS[name], self.model(name).counted.quality
        return {
            "name": name,
            "title": wanted.title,
            "phantom": wanted.phantom,
            "samples": list(wanted.samples),
            "elements": quality.n_elements,
            "min_scaled_jacobian": quality.min,
            "percent_above_0.5": 100 * quality.fraction_above_0_5,
            "percent_below_0.1": 100 * quality.fraction_below_0_1,
            "inverted": quality.inverted,
            "paper": {
                "elements": wanted.elements,
                "percent_above_0.5": wanted.above_half,
                "percent_below_0.1": wanted.below_tenth,
                "inverted": wanted.inverted,
            },
        }
