"""What the choice of a material law does to a model: its mean modulus and its stiffness, law by law."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.elasticity import solve
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.laws import Law
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import integral

END = 0.06
"""Part of the length along the long axis whose nodes are held at each end."""

TOLERANCE = 1e-4
"""Of the solves, which is 1e-6 of the stiffness, an energy: the laws differ by tens of percent."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LawOutcome:
    """A model under one law.

    Attributes
    ----------
    law: the law.
    mean_modulus_mpa: mean over the volume.
    outside: part of the nodes whose HU the law does not cover.
    stiffness_n_mm: force along the long axis for a millimetre between the ends, which are held; None where not solved.
    """

    law: Law
    mean_modulus_mpa: float
    outside: float
    stiffness_n_mm: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "law": self.law.name,
            "mean_modulus_mpa": self.mean_modulus_mpa,
            "outside_law": self.outside,
            "stiffness_n_mm": self.stiffness_n_mm,
            "unconfirmed": list(self.law.all_unconfirmed),
        }


def compare_laws(
    mesh: Mesh,
    laws: Sequence[Law],
    device: Device,
    *,
    stiffness: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> list[LawOutcome]:
    """Map each law onto a mesh's nodes and load the mesh along its long axis.

    Arguments
    ---------
    mesh: hexes with the nodal field ``"HU"``; HU outside a law is moved to its nearest range.
    stiffness: solve for the stiffness; a solve for each law.
    progress: called with the number of laws done and their total.

    Raises
    ------
    InputError where the mesh is not of hexes or has no HU.
    """
    if mesh.element.dimension != 3 or "HU" not in mesh.fields:
        fields = ", ".join(mesh.fields) or "none"
        raise InputError(
            f"expected hexes with the nodal field HU to compare laws on, got {mesh.element_type} with fields {fields}"
        )
    held, pulled = _ends(mesh)
    if not np.isfinite(mesh.fields["HU"]).all():
        raise InputError("expected finite HU to compare laws on, got NaN or infinity")
    bare = replace(mesh, fields={"HU": mesh.fields["HU"]}, cell_fields={})
    outcomes = []
    for number, law in enumerate(laws, start=1):
        mapped, material = apply_material(bare, law, device=device)
        mean = integral(mapped, "E_MPa", device) / mesh.volume_mm3
        k = _stiffness(mapped, held, pulled, device) if stiffness else None
        outcomes.append(LawOutcome(law, mean, material.out_of_range / mesh.n_nodes, k))
        if progress:
            progress(number, len(laws))
    return outcomes


def long_axis(mesh: Mesh) -> Floats:
    """(3,) unit vector along which the nodes spread most."""
    points = mesh.points.astype(np.float64)
    return np.asarray(np.linalg.eigh(np.cov(points.T))[1][:, -1])


def _ends(mesh: Mesh) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Nodes that are held (n, 3), and where to, mm: a millimetre apart along the long axis."""
    axis = long_axis(mesh)
    along = mesh.points.astype(np.float64) @ axis
    low, high = along.min(), along.max()
    first, last = along <= low + END * (high - low), along >= high - END * (high - low)
    held = np.repeat((first | last)[:, None], 3, axis=1)
    return held, np.where(last[:, None], axis, 0.0)


def _stiffness(mesh: Mesh, held: NDArray[np.bool_], moved_mm: Floats, device: Device) -> float:
    """Twice the strain energy of a millimetre, N/mm."""
    solution = solve(
        mesh, held, np.zeros((mesh.n_nodes, 3)), prescribed_mm=moved_mm, tolerance=TOLERANCE, device=device
    )
    return 2 * solution.strain_energy_nmm
