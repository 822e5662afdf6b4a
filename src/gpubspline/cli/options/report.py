"""The report of a run: one page, for commands that have a mesh and figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from gpubspline.cli.options.groups import option
from gpubspline.files import check_apart, check_writable


@dataclass
class ReportOptions:
    """The report of a run: checked before the work, written after it."""

    report: Annotated[
        Path | None, option("Output", "page that opens offline: mesh, CT, charts, all figures; .html", metavar="FILE")
    ] = None

    @property
    def paths(self) -> list[Path]:
        """The page, if it is asked for."""
        return [self.report] if self.report else []

    def check(self, others: Sequence[Path] = ()) -> None:
        """Raise InputError where the page could not be written, or would replace one of the other files of the run."""
        from gpubspline.report.page import check_page

        for path in self.paths:
            check_page(path)
            check_writable(path)
        check_apart(self.paths, others)

    def write(
        self, context: typer.Context, clock: Any, title: str, mesh: Any, figures: dict[str, Any], **parts: Any
    ) -> None:
        """Write the page, if it is asked for.

        Arguments
        ---------
        context: of the command, which knows the options in force.
        clock: of the run.
        title, mesh, figures, parts: as in ``report.page.Account``.
        """
        if self.report is None:
            return
        from gpubspline.cli import in_force, warned
        from gpubspline.report.page import Account, write_report

        seconds = {name: value for name, value in clock.seconds.items() if name != "total"}
        known: dict[str, Any] = {
            "command": in_force.command(context),
            "settings": in_force.settings(context),
            "warnings": in_force.without_paths(warned.said(), context),
        }
        told = in_force.without_paths(figures, context, folders=False) | {
            "seconds": {**seconds, "total": sum(seconds.values())}
        }
        with clock.stage("report"):
            write_report(
                Account(in_force.without_paths(title, context, folders=False), mesh, told, **known | parts), self.report
            )
