"""From CT, or a closed surface, to a mesh with material."""

import typer

from gpubspline.cli.app import MAKE, command
from gpubspline.cli.arguments import SolidPaths
from gpubspline.cli.options import (
    DeckOptions,
    MethodOptions,
    OutputOptions,
    ReadOptions,
    RegionOptions,
    ReportOptions,
    RunOptions,
    SamplingOptions,
    SplineOptions,
    flattened,
)
from gpubspline.cli.solid import find_any_body, make_model
from gpubspline.errors import InputError


@command(
    MAKE,
    "mesh dicom_folder --threshold 250 -o bone.vtu --report bone.html",
    "mesh ct.nii.gz --mask labels.nii.gz --label 22 -o l3.feb",
    "mesh bone.stl --ct dicom_folder --elements 20000 -o bone.inp",
    "mesh ct.nii.gz --threshold -200 --slice 10 -o slice.vtu",
)
@flattened
def mesh(
    context: typer.Context,
    source: SolidPaths,
    read: ReadOptions,
    region: RegionOptions,
    method: MethodOptions,
    spline: SplineOptions,
    sampled: SamplingOptions,
    files: OutputOptions,
    deck: DeckOptions,
    page: ReportOptions,
    run: RunOptions,
) -> None:
    """Make a mesh with material from CT, or from a closed surface."""
    from gpubspline import methods
    from gpubspline.analysis.loads import check_on_body, load_case
    from gpubspline.cautions import warn_of_weight
    from gpubspline.cli import describe
    from gpubspline.material.laws import common_kind
    from gpubspline.surface.read import is_surface

    files.check([*source, *([method.ct] if method.ct else []), *region.files, *sampled.files], deck)
    method.check([*source, *files.paths])
    page.check([*source, *files.paths, *method.paths])
    sliced, wanted = region.slice_index is not None, region.source(source, read, spline, sampled.surface_depth)
    shaping, meshing = spline.shaping(2 if sliced else 3), method.meshing(files.allow_inverted)
    sampling, device = sampled.sampling(region.labels), run.open()
    if sampling.mapping.transverse is not None:
        deck.check_orthotropy(files.output)
    files.check_elements(sampling, 2 if sliced else 3)
    surface = is_surface(source[0])
    if surface and method.ct is None:
        sampled.check_without_material(spline.partial_volume)
        deck.check_material(files.output)
    files.check_field(() if surface and method.ct is None else ("HU",), region.labels is not None)
    structured = files.structured(deck)
    # refuses before any work what does not fit together
    implied = methods.implied(meshing, shaping, sampling, sliced, structured)
    if surface and implied is not None and implied.method == "tensor":
        raise InputError(f"expected a CT for the tensor method ({implied.why}), got a surface: butterfly or blocks")
    with run.clock() as clock:
        body = find_any_body(source, wanted, read, region, method, meshing, device, clock)
        if deck.load is not None and not sliced:
            check_on_body(load_case(deck.load), body.region)
        with clock.stage("method"):
            choice = methods.choose(body, meshing, shaping, sampling, spline.axis, device, sliced, structured)
        how = (choice, wanted, shaping, meshing, sampling, device, clock)
        model, figures = make_model(body, *how, files.make)
        if model.laws and deck.load is not None:
            warn_of_weight(load_case(deck.load).gravity_mm_s2 is not None, common_kind(model.laws.values()))
        files.write(model, figures, clock)
        method.write(body.region, figures, clock)
        known = {"quality": model.counted.quality, "volume": body.volume, "laws": list(model.laws.values())}
        page.write(context, clock, f"Mesh of {describe.kind(model.counted)}", model.mesh, figures, **known)
    written = [*files.paths, *method.paths, *page.paths]
    run.say([*describe.summary_lines(figures), *describe.deck_lines(figures), *describe.wrote(written)])
