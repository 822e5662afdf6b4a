"""What is studied, and where its results go."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gpubspline.cli.options.groups import option
from gpubspline.cli.options.solve import Formulation, Load, Modulus, Tolerance
from gpubspline.cli.options.texts import samples_list
from gpubspline.files import check_folder


@dataclass
class StudyOptions:
    """What is studied, and where its results go."""

    load: Load
    output: Annotated[
        Path,
        option(
            "Output",
            "study.json, .csv, .png, and each model; what is there is kept",
            "--output",
            "-o",
            metavar="DIR",
            show_default=False,
        ),
    ]
    nodes_list: Annotated[
        str | None,
        option(
            "Mesh",
            "samples of each mesh (default: 5, each of twice the elements of the one before)",
            metavar="'UxVxW UxVxW ...'",
        ),
    ] = None
    modulus: Modulus = "graded"
    formulation: Formulation = "incompatible"
    tolerance: Tolerance = 1e-8

    @property
    def paths(self) -> list[Path]:
        """The files of the whole study."""
        return [self.output / f"study{extension}" for extension in (".json", ".csv", ".png")]

    def study(self) -> Any:
        """Check the options and the folder, and read the load case."""
        from gpubspline.analysis.load_case import load_case
        from gpubspline.analysis.study import Study

        samples_list(self.nodes_list)
        check_folder(self.output)
        return Study(load_case(self.load), self.modulus, self.formulation, self.tolerance)

    def samples(self, shape: tuple[int, ...]) -> list[tuple[int, int, int]]:
        """Samples of each mesh, those that were asked for or such that their elements grow about those of ``shape``."""
        from gpubspline.analysis.study import growing

        return samples_list(self.nodes_list) or growing(shape)

    def write(self, found: Any, device: Any) -> None:
        """Write table, figures and graph."""
        from gpubspline.analysis.convergence import write_csv
        from gpubspline.report.convergence import write_convergence
        from gpubspline.report.summary import write_summary

        figures, table, graph = self.paths
        write_summary(found.to_dict() | {"backend": device.backend, "device": device.label}, figures)
        write_csv(found, table)
        write_convergence(found, graph)
