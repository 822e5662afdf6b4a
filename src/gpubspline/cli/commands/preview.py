"""What would be meshed, before anything is."""

from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Annotated

from gpubspline.cli.app import LOOK, command
from gpubspline.cli.arguments import InputPaths
from gpubspline.cli.options import ReadOptions, RegionOptions, RunOptions, SamplingOptions, SplineOptions, flattened
from gpubspline.cli.options.groups import option

MESHED = tuple(each.name for each in fields(SamplingOptions) if each.name not in ("law", "calibration"))
"""Options of the sampling that a picture without a mesh has no use for."""


@command(
    LOOK,
    "preview dicom_folder --threshold 250 -o slices.png",
    "preview ct.nii.gz --mask labels.nii.gz --label 22 -o l3.png",
    "preview ct.nii.gz --labels l.nii.gz --law 7=keyak-1998 -o l.png",
)
@partial(flattened, without=("slice_index", *MESHED))  # it draws a body
def preview(
    source: InputPaths,
    output: Annotated[Path, option("Output", "picture, .png", "--output", "-o", metavar="FILE", show_default=False)],
    read: ReadOptions,
    region: RegionOptions,
    material: SamplingOptions,
) -> None:
    """Draw what of a CT would be meshed: its outline over slices, its labels, and what their laws make of them."""
    from gpubspline import pipeline, segment
    from gpubspline.cli import describe
    from gpubspline.cli.describe_material import tissue_lines
    from gpubspline.files import check_apart, check_writable
    from gpubspline.report.preview import write_preview
    from gpubspline.report.sheet import check_png

    check_png(output)
    check_writable(output)
    check_apart([output], [*source, *region.files, *material.files])
    sampling = material.sampling(region.labels)
    with RunOptions().clock() as clock:
        body = segment.find_body(region.source(source, read, SplineOptions()), clock)
        assert body.volume is not None  # of a CT
        with clock.stage("picture"):
            asked = region.labels is not None or material != SamplingOptions()
            labelled = pipeline.label(body, sampling) if asked else None
            lines = [*describe.body_lines(body), *(tissue_lines(labelled.tissues) if labelled else [])]
            write_preview(body.volume, body.region, output, body.threshold_hu, labelled)
    RunOptions().say([*lines, *describe.wrote([output])])
