"""The multigrid of a hex8 mesh: of its own grids where it is structured, else of aggregates of its nodes."""

from typing import Any, Protocol

from numpy.typing import NDArray

from gpubspline.analysis.aggregation import Flags, aggregation
from gpubspline.analysis.multigrid import multigrid
from gpubspline.analysis.stiffness import FORMULATIONS, Stiffness, stiffness
from gpubspline.device import Device
from gpubspline.mesh.mesh import Mesh


class Multilevel(Protocol):
    """A preconditioner of low precision."""

    def cycle(self, r: NDArray[Any]) -> NDArray[Any]:
        """Give the correction (3, n), mm, of a residual (3, n), N."""
        ...


def multilevel(mesh: Mesh, held: Flags, device: Device, modulus: str, k: Stiffness | None = None) -> Multilevel:
    """Make the multigrid of a hex8 mesh.

    Arguments
    ---------
    held: (n, 3) which directions are.
    device: where grids work; aggregates are the host's.
    modulus: see ``stiffness``; k: the stiffness, of which grids take the formulation, or None for full integration.
    """
    if mesh.structure is None:
        return aggregation(mesh, held, modulus)
    n_u, n_v, n_w = mesh.structure
    if k is None or k.device is not device:
        k = stiffness(mesh, device, modulus, FORMULATIONS[k.formulation if k else 0])
    return multigrid(k, (n_u, n_v, n_w), mesh.points, held)
