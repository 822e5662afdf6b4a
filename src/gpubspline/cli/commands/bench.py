"""Work beside its peers."""

from pathlib import Path
from typing import Annotated

import typer

from gpubspline.cli.app import app
from gpubspline.files import check_writable


@app.command()
def bench(
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="may be given again", show_default="all")
    ] = None,
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="see 'gpubspline backends'; may be given again", show_default="all"),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="smaller sizes: minutes")] = False,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="the rows, .json", show_default=False)] = None,
    chart: Annotated[
        Path | None, typer.Option(metavar="FILE", help="time and memory against nodes, .png", show_default=False)
    ] = None,
) -> None:
    """Measure each piece of work beside its peers and the memory bandwidth of this machine."""
    from gpubspline.bench import bench_scale, run
    from gpubspline.bench.measure import Row

    for path in filter(None, (json, chart)):
        check_writable(path)
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
