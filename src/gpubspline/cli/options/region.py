"""Which part of a CT is meshed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.cli.options.read import ReadOptions
from gpubspline.cli.options.spline import SplineOptions
from gpubspline.cli.options.texts import numbers, slice_range


@dataclass
class RegionOptions:
    """Which part of a CT is meshed."""

    box: Annotated[str | None, option("Input", "crop to a box, LPS mm (default: all)", metavar="X0,X1,Y0,Y1,Z0,Z1")] = (
        None
    )
    slices: Annotated[
        str | None,
        option(
            "Input", "crop to slices A to B - 1 along k, from 0, negative from the last (default: all)", metavar="A:B"
        ),
    ] = None
    slice_index: Annotated[
        int | None,
        option("Input", "mesh slice K with quads, -1 for the last (default: a solid of all)", "--slice", metavar="K"),
    ] = None
    threshold: Annotated[
        float | None, option("Region", "what lies above is body (default: Otsu's threshold)", metavar="HU")
    ] = None
    mask: Annotated[
        Path | None,
        option("Region", "label image on the CT's grid, DICOM SEG or RTSTRUCT (default: --threshold)", metavar="FILE"),
    ] = None
    label: Annotated[
        str | None, option("Region", "label in it, as 'info' lists them (default: all but 0)", metavar="NAME|N")
    ] = None
    labels: Annotated[
        Path | None,
        option("Region", "segmentation whose labels become element sets (default: one body)", metavar="FILE"),
    ] = None
    fill: Annotated[
        str | None,
        option("Region", "where holes are filled (default: slice, none for masks)", metavar="slice|volume|none"),
    ] = None
    smooth: Annotated[
        float | None, option("Region", "Gaussian on HU, or on a mask's boundary (default: 0; a voxel)", metavar="MM")
    ] = None

    @property
    def files(self) -> list[Path]:
        """Files that are read."""
        return [path for path in (self.mask, self.labels) if path]

    def source(
        self, paths: list[Path], read: ReadOptions, spline: SplineOptions, surface_depth_mm: float | None = None
    ) -> Any:
        """What the pipeline reads; where HU near the surface are read at a depth, it is told."""
        from gpubspline.recipe import Source

        return Source(
            paths,
            threshold_hu=self.threshold,
            mask=self.mask,
            label=self.label,
            labels=self.labels,
            box_mm=numbers(self.box, "box", 6),
            slices=slice_range(self.slices),
            slice_index=self.slice_index,
            axis=spline.axis,
            fill=self.fill,
            smoothing_mm=self.smooth,
            partial_volume=spline.treatment(surface_depth_mm),
            reading=read.reading(),
        )
