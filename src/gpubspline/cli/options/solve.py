"""What acts on a mesh, how it is solved, and the files of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.files import check_apart, check_writable

LOAD = "load case: stance, or a file (docs/loads.md)"

Load = Annotated[str, option("Load", LOAD, metavar="NAME|FILE.toml", show_default=False)]
Modulus = Annotated[
    str, option("Solve", "interpolated inside the elements, or one mean each", metavar="graded|element")
]
Formulation = Annotated[str, option("Solve", "of hex8; 'incompatible' bends freely", metavar="full|incompatible|bbar")]
Tolerance = Annotated[float, option("Solve", "forces out of balance, as a part of the loads", metavar="PART")]


@dataclass
class SolveOptions:
    """What acts on a mesh, how it is solved, and the files of it."""

    load: Load
    output: Annotated[
        Path,
        option(
            "Output",
            "mesh with displacement and stress: .vtu or what meshio writes",
            "--output",
            "-o",
            metavar="FILE",
            show_default=False,
        ),
    ]
    summary: Annotated[Path | None, option("Output", "figures of the run, .json", metavar="FILE")] = None
    modulus: Modulus = "graded"
    formulation: Formulation = "full"
    tolerance: Tolerance = 1e-8

    @property
    def paths(self) -> list[Path]:
        """Every file that is asked for."""
        return [path for path in (self.output, self.summary) if path]

    def case(self, inputs: Sequence[Path]) -> Any:
        """Read the load case; raises InputError, too, where a file could not be written or would replace an input."""
        from gpubspline.analysis.load_case import load_case
        from gpubspline.export import check_holds_fields
        from gpubspline.report.summary import check_json

        check_holds_fields(self.output)
        for path in self.paths:
            check_writable(path)
        check_apart(self.paths, [*inputs, Path(self.load)])
        if self.summary:
            check_json(self.summary)
        return load_case(self.load)

    def how(self) -> dict[str, Any]:
        """Keywords of ``respond``."""
        return {"modulus": self.modulus, "formulation": self.formulation, "tolerance": self.tolerance}

    def write(self, response: Any, figures: dict[str, Any], clock: Any) -> None:
        """Write the mesh and the figures."""
        from gpubspline.export import write
        from gpubspline.report.summary import write_summary

        with clock.stage("write"):
            write(response.mesh, self.output)
        figures["seconds"] = {**clock.seconds, "total": sum(clock.seconds.values())}
        if self.summary:
            write_summary(figures, self.summary)
