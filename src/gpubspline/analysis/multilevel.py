"""The multigrid of a hex8 mesh: of its own grids where it is structured, else of aggregates of its nodes."""

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.aggregation import Flags, aggregation
from gpubspline.analysis.multigrid import multigrid
from gpubspline.analysis.stiffness import Stiffness, stiffness
from gpubspline.device import Buffer, Device
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
    modulus: see ``stiffness``; k: the stiffness of the mesh, or None for that of full integration.
    """
    if mesh.structure is None:
        return aggregation(mesh, held, modulus)
    n_u, n_v, n_w = mesh.structure
    k = stiffness(mesh, device, modulus) if k is None or k.clusters is not None else _copied(k, device)
    return multigrid(k, (n_u, n_v, n_w), mesh.points, held)


def _copied(k: Stiffness, device: Device) -> Stiffness:
    """K of isotropic elements on another device."""
    if k.device is device:
        return k

    def copy(buffer: Buffer) -> Buffer:
        return device.put(k.device.get(buffer))

    names = ("points", "nodes", "slopes", "weights", "start", "slots")
    return replace(
        k,
        device=device,
        **{name: copy(getattr(k, name)) for name in names},
        lame=(copy(k.lame[0]), copy(k.lame[1])),
        inverse_modes=copy(k.inverse_modes) if k.inverse_modes.size > 1 else device.empty(1),
        forces=device.empty(k.forces.size),
        fluxes=device.empty(k.fluxes.size),
        partial=None if k.partial is None else device.put(np.zeros(k.partial.size, device.real)),
    )
