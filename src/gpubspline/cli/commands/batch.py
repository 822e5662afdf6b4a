"""A cohort, a row of a manifest a subject."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.app import MANY, command
from gpubspline.cli.options import RunOptions, flattened
from gpubspline.cli.options.groups import option
from gpubspline.cli.options.texts import device_name
from gpubspline.errors import InputError

PRECISIONS = ("float32", "float64")


@command(MANY, "batch cohort.csv -o models", "batch cohort.csv -o models --retry --workers 4")
@flattened
def batch(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST.csv",
            help="columns 'subject', 'input' and options of 'mesh' and 'solve', such as 'threshold' or 'load'",
            show_default=False,
        ),
    ],
    folder: Annotated[
        Path,
        option(
            "Output",
            "a folder a subject, table, page; what is there is kept",
            "--output",
            "-o",
            metavar="DIR",
            show_default=False,
        ),
    ],
    run: RunOptions,
    scheduler: Annotated[
        str | None, option("Run", "of a dask cluster that runs (default: one is started here)", metavar="ADDRESS")
    ] = None,
    workers: Annotated[
        int | None, option("Run", "processes started here (default: one a GPU, or for two cores)", metavar="N")
    ] = None,
    retry: Annotated[bool, option("Run", "try subjects again whose input had an error", "--retry")] = False,
) -> None:
    """Make the models of a cohort: meshes, and responses where a row has a load; run again, it goes on.

    Exit status 1 where a subject failed.
    """
    from gpubspline.batch.cohort import run_cohort
    from gpubspline.batch.manifest import read_manifest
    from gpubspline.batch.watch import ShownCohort, cohort_lines
    from gpubspline.cli import describe, subject

    if scheduler is not None and workers is not None:
        raise InputError("expected --workers or --scheduler, got both: a cluster that runs has its workers")
    if workers is not None and workers < 1:
        raise InputError(f"expected --workers of 1 or more, got {workers}")
    subjects = read_manifest(manifest, subject.columns())
    for row in subjects:
        subject.check(row, manifest)
    devices, settings = _devices(run), {"precision": run.precision}
    with ShownCohort(not run.quiet and sys.stderr.isatty(), len(subjects), lambda line: run.say([line])) as watch:
        records = run_cohort(
            subjects,
            subject.MakeModel(settings),
            folder,
            scheduler=scheduler,
            workers=workers,
            devices=devices,
            settings=settings,
            retry=retry,
            watch=watch,
            each=lambda so_far: _write(so_far, len(subjects), folder),
        )
    run.say([*cohort_lines(records), *describe.wrote(_write(records, len(subjects), folder))])
    if any(record.failed for record in records):
        raise typer.Exit(1)


def _devices(run: RunOptions) -> tuple[str, ...]:
    """Names of the devices that are asked for, with commas between; they may be there on the workers alone."""
    from gpubspline.device import BACKENDS

    if run.backend not in ("auto", *BACKENDS):
        raise InputError(f"expected a backend of {', '.join(BACKENDS)} or auto, got {run.backend!r}")
    if run.precision not in PRECISIONS:
        raise InputError(f"expected the precision {' or '.join(PRECISIONS)}, got {run.precision!r}")
    if run.device is None and run.backend == "auto":
        return ()
    return tuple(device_name(run.backend, name.strip()) for name in (run.device or "auto").split(","))


def _write(records: Sequence[Any], total: int, folder: Path) -> list[Path]:
    from gpubspline.batch.manifest import PAGE, TABLE
    from gpubspline.batch.page import write_page
    from gpubspline.batch.table import write_table

    table, page = folder / TABLE, folder / PAGE
    write_table(records, table)
    write_page(records, total, page)
    return [table, page]
