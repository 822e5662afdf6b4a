"""From CT to a model file."""

from functools import partial
from pathlib import Path
from typing import Annotated

from gpubspline.cli.app import MAKE, command
from gpubspline.cli.arguments import InputPaths
from gpubspline.cli.options import ReadOptions, RegionOptions, RunOptions, SplineOptions, flattened
from gpubspline.cli.options.groups import option

ModelOutput = Annotated[
    Path,
    option("Output", "model file, .npz", "--output", "-o", metavar="FILE", show_default=False),
]


@command(
    MAKE,
    "fit dicom_folder --threshold 250 -o femur.npz",
    "fit ct.nii.gz --mask femur.nii.gz --control 14,24,46 -o femur.npz",
)
@partial(flattened, without=("labels",))  # a model has no elements to be in sets
def fit(
    source: InputPaths,
    output: ModelOutput,
    read: ReadOptions,
    region: RegionOptions,
    spline: SplineOptions,
    run: RunOptions,
) -> None:
    """Make a hyperpatch from CT and keep it, to be sampled at any density later."""
    from gpubspline import pipeline
    from gpubspline.cli import describe
    from gpubspline.spline.model import check_model_path, save_model

    check_model_path(output)
    wanted = region.source(source, read, spline)
    shaping, device = spline.shaping(3 if region.slice_index is None else 2), run.open()
    with run.clock() as clock:
        fitted = pipeline.fit_patch(wanted, shaping, device, clock)
        with clock.stage("write"):
            save_model(fitted.fit.patch, output)
    patch, error = fitted.fit.patch, fitted.fit.error
    run.say([*describe.patch_lines(patch), *describe.fit_lines(error), *describe.wrote([output])])
