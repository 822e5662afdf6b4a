"""Work beside its peers."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.app import KNOW, command
from gpubspline.cli.options import RunOptions
from gpubspline.cli.options.groups import option
from gpubspline.clock import Clock
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
    rows, watch = list[Row](), _Watch()
    measured = run.run(only or (), device or (), "quick" if quick else "full", watch.begun)
    typer.echo(run.heading())
    while row := watch.wait(measured):
        typer.echo(run.line(row, rows))
        rows.append(row)
    if told := run.tally(rows):
        typer.echo(f"\n{told}")
    if json:
        run.write_json(rows, json)
    if chart:
        bench_scale.draw([row for row in rows if row.name == "scale"], chart)


class _Watch:
    """Which bench is on, while its next row is waited for; gone before that is printed, or it would be cut in lines."""

    def __init__(self) -> None:
        self._words, self._clock = "", Clock()

    def begun(self, words: str) -> None:
        """Show what comes next."""
        self._words = words
        self._clock.tell(words)

    def wait(self, rows: Iterator[Any]) -> Any:
        """Give the next row, or None."""
        with RunOptions().clock() as self._clock, self._clock.stage("bench"):
            self._clock.tell(self._words)
            return next(rows, None)
