"""The response of a mesh to a load case: loads assembled, displacement solved, stress recovered, figures collected."""

from dataclasses import dataclass, replace
from math import log10
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.analysis.elasticity import Solution, solve
from gpubspline.analysis.load_case import LoadCase, load_case
from gpubspline.analysis.loads import AssembledLoads, assemble
from gpubspline.analysis.stress import PERCENTILE, Stress, recover
from gpubspline.clock import Clock
from gpubspline.device import Device, check_device
from gpubspline.errors import expect
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

TOLERANCE = 1e-8
"""Of the residual: the forces out of balance against the loads."""


@dataclass(frozen=True, eq=False)
class Response:
    """A solved mesh.

    Attributes
    ----------
    mesh: with the nodal fields ``displacement_mm_x`` to ``_z``, and those of ``Stress.fields``.
    case, loads: what was put on it.
    solution: displacement and reactions.
    stress: at its nodes, and the figures.
    modulus, formulation: how the elements were taken.
    """

    mesh: Mesh
    case: LoadCase
    loads: AssembledLoads
    solution: Solution
    stress: Stress
    modulus: str
    formulation: str

    __repr__ = brief

    def figures(self) -> dict[str, Any]:
        """Plain numbers, texts, lists and dicts, for JSON; vectors are along the patient's axes, LPS."""
        solution, found = self.solution, self.stress.figures
        return {
            "load_case": {"name": self.case.name, "title": self.case.title, "source": self.case.source},
            "nodes": self.mesh.n_nodes,
            "elements": self.mesh.n_elements,
            "element_type": self.mesh.element_type,
            "modulus": self.modulus,
            "formulation": self.formulation,
            "unknowns": int(np.count_nonzero(~self.loads.fixed)),
            "iterations": solution.iterations,
            "residual": solution.residual,
            "max_displacement_mm": float(np.linalg.norm(solution.displacement_mm, axis=1).max()),
            "max_von_mises_mpa": found.max_von_mises_mpa,
            "max_von_mises_is": found.definition,
            "max_von_mises_at_mm": found.max_at_mm.tolist(),
            "max_von_mises_at_point_mpa": found.max_at_point_mpa,
            "max_von_mises_anywhere_mpa": found.max_anywhere_mpa,
            "p99_von_mises_mpa": found.p99_von_mises_mpa,
            "p99_von_mises_is": PERCENTILE,
            "strain_energy_nmm": solution.strain_energy_nmm,
            "applied_n": self.loads.applied_n.tolist(),
            "reaction_n": solution.reactions_n.sum(axis=0).tolist(),
            "regions": [applied.to_dict() for applied in self.loads.report],
        }


def respond(
    mesh: Mesh,
    case: LoadCase | str | Path,
    device: Device,
    clock: Clock | None = None,
    *,
    modulus: str = "graded",
    formulation: str = "full",
    tolerance: float = TOLERANCE,
    body: Mesh | None = None,
) -> Response:
    """Solve a mesh of hexes with the nodal fields ``E_MPa`` and ``nu`` under a load case.

    ``case`` may be what ``load_case`` takes, too: a name or a file. ``clock`` is told of the stages ``load``, ``solve``
    and ``stress`` as they go. ``body`` is the mesh that ``assemble`` measures regions by, and about whose nodes stress
    is averaged; it is ``mesh`` itself unless given.

    Raises
    ------
    InputError where the load case does not fit the mesh, or the mesh cannot be solved.
    SolveError where the residual does not reach the tolerance.
    """
    expect(mesh, Mesh, "sample makes one, read_mesh reads one")
    check_device(device)
    case = case if isinstance(case, LoadCase) else load_case(case)
    clock = Clock() if clock is None else clock
    with clock.stage("load"):
        loads = assemble(case, mesh, body)
        loads.warn_of_held()
    with clock.stage("solve"):

        def show(_iterations: int, residual: float) -> None:
            clock.tell(f"residual {residual:.0e}")
            reached = min(max(log10(max(residual, tolerance)) / log10(tolerance), 0.0), 1.0) if tolerance < 1 else 1.0
            clock.advance(round(100 * reached), 100)

        how: dict[str, Any] = {"modulus": modulus, "formulation": formulation}
        given: dict[str, Any] = {"prescribed_mm": loads.prescribed_mm, "tolerance": tolerance}
        solution = solve(mesh, loads.fixed, loads.forces_n, **given, **how, device=device, progress=show)
    with clock.stage("stress"):
        where: dict[str, Any] = {"gripped": loads.gripped, "away_mm": loads.away_mm, "averaged_mm": case.averaged_mm}
        where["centres_mm"] = None if body is None else body.points
        stress = recover(mesh, solution.displacement_mm, **how, **where)
        moved = zip("xyz", solution.displacement_mm.T, strict=True)
        fields = {f"displacement_mm_{axis}": np.ascontiguousarray(values) for axis, values in moved}
        made = replace(mesh, fields={**mesh.fields, **fields, **stress.fields()})
    return Response(made, case, loads, solution, stress, modulus, formulation)
