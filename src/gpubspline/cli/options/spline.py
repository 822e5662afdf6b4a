"""How the hyperpatch is made."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.cli.options.texts import integers
from gpubspline.errors import InputError


@dataclass
class SplineOptions:
    """How the hyperpatch is made."""

    axis: Annotated[str, option("Spline", "stack slices along this axis", metavar="x|y|z|long")] = "z"
    control: Annotated[
        str | None, option("Spline", "control points (default: by the data)", metavar="NU,NV[,[NR,]NW]")
    ] = None
    degree: Annotated[str, option("Spline", "degrees, 1 to 5", metavar="P[,Q[,R]]")] = "3"
    fit: Annotated[
        str,
        option("Spline", "data as control points, through or near them", metavar="control|interpolate|least-squares"),
    ] = "control"
    interpolation: Annotated[str, option("Spline", "resampling of HU", metavar="linear|cubic")] = "linear"
    partial_volume: Annotated[
        str | None,
        option(
            "Material",
            "what the scan spread over the surface: folded back in, or HU as they lie, as in the paper "
            "(default: fold; none with --surface-depth)",
            metavar="fold|none",
        ),
    ] = None
    smooth_rows: Annotated[
        float | None, option("Spline", "Gaussian on row ends, in rows; 0 is the paper (default: 1.5)", metavar="ROWS")
    ] = None

    def shaping(self, directions: int) -> Any:
        """What the pipeline fits."""
        from gpubspline.recipe import Shaping
        from gpubspline.spline.knots import MAX_DEGREE
        from gpubspline.spline.lattice import MOST_SMOOTHING

        degree = integers(self.degree, "degree", (1, directions)) or (3,)
        if not 1 <= min(degree) <= max(degree) <= MAX_DEGREE:
            raise InputError(f"expected --degree of 1 to {MAX_DEGREE}, got {self.degree}")
        control = integers(self.control, "control", (2,) if directions == 2 else (3, 4))
        shaping = Shaping(control, degree, self.fit, self.interpolation)
        if self.smooth_rows is None:
            return shaping
        if not 0 <= self.smooth_rows <= MOST_SMOOTHING:
            raise InputError(f"expected --smooth-rows of 0 to {MOST_SMOOTHING:g}, got {self.smooth_rows:g}")
        return replace(shaping, row_smoothing=self.smooth_rows)

    def treatment(self, surface_depth_mm: float | None = None) -> str:
        """How HU near the surface are read: a depth to read them at leaves nothing to fold.

        Raises InputError for what is unknown, or does not go with a depth.
        """
        from gpubspline.ct.partial_volume import check_treatment

        if self.partial_volume is not None:
            check_treatment(self.partial_volume)
        if self.partial_volume == "fold" and surface_depth_mm is not None:
            raise InputError("expected --partial-volume fold or --surface-depth, got both")
        return self.partial_volume or ("fold" if surface_depth_mm is None else "none")
