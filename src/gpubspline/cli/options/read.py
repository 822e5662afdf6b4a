"""How a CT is read."""

from dataclasses import dataclass
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.cli.options.texts import numbers


@dataclass
class ReadOptions:
    """How a CT is read."""

    series: Annotated[
        str | None,
        option("Input", "SeriesInstanceUID, or kernel=B30f (default: the largest CT series)", metavar="UID|NAME=VALUE"),
    ] = None
    allow_gaps: Annotated[bool, option("Input", "fill missing slices by interpolation", "--allow-gaps")] = False
    spacing: Annotated[
        str | None, option("Input", "voxel spacing of a .npy file, mm, which has none of its own", metavar="DI,DJ,DK")
    ] = None

    def reading(self) -> dict[str, Any]:
        """Keywords of ``read_volume``."""
        spacing = numbers(self.spacing, "spacing", 3)
        return {"series": self.series, "allow_gaps": self.allow_gaps, "spacing_mm": spacing}
