"""Work beside its peers."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options.groups import option
from gpubspline.errors import InputError
from gpubspline.files import check_apart, check_ending, check_writable


@command(KNOW, "bench --quick", "bench --only material --device opencl:0:0 --json rows.json")
def bench(
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="may be given again", show_default="all")
    ] = None,
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="see 'gpubspline backends'; may be given again", show_default="all"),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="smaller sizes: minutes")] = False,
    json: Annotated[Path | None, option("Output", "the rows, .json", metavar="FILE")] = None,
    chart: Annotated[Path | None, option("Output", "time and memory against nodes, .png", metavar="FILE")] = None,
) -> None:
    """Measure each piece of work beside its peers and the memory bandwidth of this machine."""
    from gpubspline.bench import bench_scale, run
    from gpubspline.bench.measure import Row

    for path, ending in ((json, ".json"), (chart, ".png")):
        if path:
            check_ending(path, ending, "the bench")
            check_writable(path)
    check_apart([path for path in (json, chart) if path])
    if chart and only and "scale" not in only:
        raise InputError(f"expected the bench 'scale' with --chart, which draws it, got {', '.join(only)}")
    rows: list[Row] = []
    measured = run.run(only or (), device or (), "quick" if quick else "full")
    typer.echo(run.heading())
    for row in measured:
        typer.echo(run.line(row, rows))
        rows.append(row)
    if told := run.tally(rows):
        typer.echo(f"\n{told}")
    if json:
        run.write_json(rows, json)
    if chart:
        bench_scale.draw([row for row in rows if row.name == "scale"], chart)
