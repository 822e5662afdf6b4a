"""By which method a body is meshed, and how fine."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_writable

MOST_REFINED = 8
"""Parts of a hex in each direction; more are better made by a smaller size."""


@dataclass
class MethodOptions:
    """By which method a body is meshed, and how fine."""

    method: Annotated[
        str,
        option(
            "Mesh",
            "tensor: rows of one patch, as in the paper; butterfly: five patches a section; blocks: any shape; "
            "auto: the first that fits",
            metavar="auto|tensor|butterfly|blocks",
        ),
    ] = "auto"
    size: Annotated[
        float | None,
        option("Mesh", "element size of butterfly, blocks (default: by the thinnest feature)", metavar="MM"),
    ] = None
    elements: Annotated[int | None, option("Mesh", "number of elements, about (default: by --size)", metavar="N")] = (
        None
    )
    conforming: Annotated[
        bool,
        option("Mesh", "blocks: faces follow the boundary between --labels", "--conforming/--no-conforming"),
    ] = True
    refine: Annotated[
        int, option("Mesh", "blocks: divide each hex into N in each direction, on the same surface", metavar="N")
    ] = 1
    features: Annotated[
        Path | None, option("Output", "picture of thin features and of what the mesh leaves out, .png", metavar="FILE")
    ] = None
    ct: Annotated[
        Path | None, option("Input", "CT for the material of a surface (default: none)", metavar="FILE|DIR")
    ] = None

    def check(self, others: Sequence[Path]) -> None:
        """Raise InputError where the picture of features could not be written, or would replace another file."""
        from gpubspline.report.sheet import check_png

        if self.features is not None:
            check_png(self.features)
            check_writable(self.features)
            check_apart([self.features], others)

    @property
    def paths(self) -> list[Path]:
        """The picture of features, if it is asked for."""
        return [self.features] if self.features else []

    def write(self, region: Any, figures: dict[str, Any], clock: Any) -> None:
        """Write the picture of features, if it is asked for."""
        if self.features is not None:
            from gpubspline.report.features import write_features

            with clock.stage("picture"):
                write_features(region, figures, self.features)

    def meshing(self, allow_inverted: bool = False) -> Any:
        """What the pipeline meshes by."""
        from gpubspline.recipe import Meshing

        if self.size is not None and not 0 < self.size < float("inf"):
            raise InputError(f"expected --size above 0 mm, got {self.size:g}")
        if self.elements is not None and self.elements < 1:
            raise InputError(f"expected --elements of 1 or more, got {self.elements}")
        if self.size is not None and self.elements is not None:
            raise InputError("expected --size or --elements, got both")
        if not 1 <= self.refine <= MOST_REFINED:
            raise InputError(f"expected --refine of 1 to {MOST_REFINED}, got {self.refine}")
        return Meshing(self.method, self.size, self.elements, self.conforming, self.refine, allow_inverted)
