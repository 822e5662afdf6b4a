"""What would be meshed, before anything is."""

from functools import partial
from pathlib import Path
from typing import Annotated

from gpubspline.cli.app import LOOK, command
from gpubspline.cli.arguments import InputPaths
from gpubspline.cli.options import ReadOptions, RegionOptions, RunOptions, SplineOptions, flattened
from gpubspline.cli.options.groups import option


@command(
    LOOK,
    "preview dicom_folder --threshold 250 -o slices.png",
    "preview ct.nii.gz --mask labels.nii.gz --label 22 -o l3.png",
)
@partial(flattened, without=("labels", "slice_index"))  # it draws a body
def preview(
    source: InputPaths,
    output: Annotated[Path, option("Output", "picture, .png", "--output", "-o", metavar="FILE", show_default=False)],
    read: ReadOptions,
    region: RegionOptions,
) -> None:
    """Draw what of a CT would be meshed: its outline over slices, to find a threshold or check a mask."""
    from gpubspline import segment
    from gpubspline.cli import describe
    from gpubspline.files import check_apart, check_writable
    from gpubspline.report.preview import write_preview
    from gpubspline.report.sheet import check_png

    check_png(output)
    check_writable(output)
    check_apart([output], [*source, *region.files])
    with RunOptions().clock() as clock:
        body = segment.find_body(region.source(source, read, SplineOptions()), clock)
        assert body.volume is not None  # of a CT
        with clock.stage("picture"):
            lines = describe.body_lines(body)
            write_preview(body.volume, body.region, output, body.threshold_hu)
    RunOptions().say([*lines, *describe.wrote([output])])
