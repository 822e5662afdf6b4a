"""Mapping a material law onto elements, by integration over their volumes, and onto Gauss points.

At quadrature points of each element HU is read from the CT, trilinearly, or interpolated from the mesh's nodes. Then
two orders are possible, which differ because laws are no straight lines: the law of the element's mean HU
(``element-hu``), or the element's mean of the law at every point (``element-e``, the way of Taddei et al., Med Eng Phys
29 (2007) 973-979). For a convex law the second is the stiffer.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.ct.partial_volume import Folding
from gpubspline.ct.sampler import Sampler
from gpubspline.device import Buffer, Device
from gpubspline.material.inset import Inset
from gpubspline.material.mapping import LawOnDevice
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quadrature import Quadrature, nodes_of, quadrature

MOST_POINTS = 8
"""Points per direction that are chosen at the most where none are asked for."""

Floats = NDArray[np.float64]

_OF_ELEMENTS = (
    *("hu", "density_mean", "modulus_mean", "poisson_mean"),
    *("density_of_mean", "modulus_of_mean", "poisson_of_mean"),
)
"""What is kept of each element, in the order of its buffers."""


@dataclass(frozen=True, eq=False)
class ElementMaterial:
    """What a law makes of elements.

    Attributes
    ----------
    hu: (m,) mean HU.
    density_g_cm3, modulus_mpa, poisson: (m,) of the order asked for.
    other_modulus_mpa: (m,) modulus of the other order.
    piece: (m,) int32, of the mean HU: index of the law's piece, or -1 - index of the nearest.
    mm3: (m,) float64 volume; of quads the area, mm2.
    points, points_outside: quadrature points, and how many of them had HU that no range of the law covers.
    mass_g: sum of density times volume over the quadrature points.
    gauss: (points, m) fields ``density_g_cm3``, ``E_MPa`` and ``nu``, where they were asked for.
    """

    hu: NDArray[Any]
    density_g_cm3: NDArray[Any]
    modulus_mpa: NDArray[Any]
    poisson: NDArray[Any]
    other_modulus_mpa: NDArray[Any]
    piece: NDArray[np.int32]
    mm3: Floats
    points: int
    points_outside: int
    mass_g: float
    gauss: dict[str, NDArray[Any]]

    @property
    def order_difference(self) -> tuple[float, float]:
        """Difference of the two orders' moduli, over the greater of them: mean by volume, and greatest."""
        ours, other = self.modulus_mpa.astype(np.float64), self.other_modulus_mpa.astype(np.float64)
        relative = np.abs(ours - other) / np.maximum(ours, other)
        return float(np.average(relative, weights=np.abs(self.mm3))), float(relative.max())


def points_for(mesh: Mesh, spacing_mm: Floats | None) -> int:
    """Quadrature points per direction: one a voxel and one more, between what the element needs and ``MOST_POINTS``.

    ``spacing_mm``: of the voxels; None where HU is interpolated from the nodes.
    """
    least = mesh.element.order + 1
    if spacing_mm is None:
        return least
    corners = mesh.cells_of(np.linspace(0, mesh.n_elements - 1, min(mesh.n_elements, 4096)).astype(int))
    ends = mesh.points[corners[:, : mesh.element.n_corners]].astype(np.float64)
    edge = np.median(np.linalg.norm(np.ptp(ends, axis=1), axis=1)) / np.sqrt(mesh.element.dimension)
    return int(np.clip(np.ceil(edge / float(np.min(spacing_mm))) + 1, least, max(MOST_POINTS, least)))


def integrate(
    mesh: Mesh,
    law: LawOnDevice,
    *,
    order: str,
    sampler: Sampler | None = None,
    inset: Inset | None = None,
    fold: Folding | None = None,
    points: int = 2,
    keep_gauss: bool = False,
    device: Device,
) -> ElementMaterial:
    """Integrate a law over the elements of a mesh.

    Arguments
    ---------
    mesh: with the nodal field ``"HU"`` where there is no sampler.
    law: on the device.
    order: ``"element-hu"``, the law of the mean HU, or ``"element-e"``, the mean of the law.
    sampler: HU of the CT; the nodal field is interpolated where None.
    inset: moves the places where the CT is read away from the surface.
    fold: gives HU near the surface what the scan spread outside.
    points: per direction.
    keep_gauss: keep the fields at the quadrature points, too.
    """
    rule = quadrature(mesh.element, points, device)
    work = AtPoints(mesh, law, rule, sampler, inset, fold)
    parts = [_means(work, elements, keep_gauss) for elements in rule.chunks(mesh.n_elements)]
    joined = {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0] if "mass" not in name}
    first, other = ("mean", "of_mean") if order == "element-e" else ("of_mean", "mean")
    return ElementMaterial(
        hu=joined["hu"],
        density_g_cm3=joined[f"density_{first}"],
        modulus_mpa=joined[f"modulus_{first}"],
        poisson=joined[f"poisson_{first}"],
        other_modulus_mpa=joined[f"modulus_{other}"],
        piece=joined["piece"],
        mm3=joined["mm3"],
        points=rule.n_points * mesh.n_elements,
        points_outside=int(joined["outside"].sum()),
        mass_g=float(sum(part["mass"] for part in parts)) / 1000,
        gauss={name: joined[name] for name in ("density_g_cm3", "E_MPa", "nu") if keep_gauss},
    )


class AtPoints:
    """HU and the law at the quadrature points of some elements after others, in buffers that are used again.

    Attributes
    ----------
    volume, hu, density, modulus, poisson: buffers of (points, m) as of the last ``read``.
    """

    def __init__(
        self,
        mesh: Mesh,
        law: LawOnDevice,
        rule: Quadrature,
        sampler: Sampler | None,
        inset: Inset | None,
        fold: Folding | None,
    ) -> None:
        self.mesh, self.law, self.rule, self.device = mesh, law, rule, rule.device
        self.sampler, self.inset, self.fold, device = sampler, inset, fold, rule.device
        middle = mesh.planes.mean(axis=1, dtype=np.float64) if sampler is None else sampler.middle
        self.nodal = device.put((mesh.planes - middle[:, None]).astype(device.real))
        self.nodal_hu = None if sampler else device.put(mesh.fields["HU"].astype(device.real))
        self.most = next(rule.chunks(mesh.n_elements)).stop
        size = self.most * rule.n_points
        *self.places, self.volume, self._hu, self.density, self.modulus, self.poisson = (
            device.empty(size) for _ in range(8)
        )
        self.hu, self.piece = self._hu, device.empty(size, np.int32)
        self.of_elements = [device.empty(self.most) for _ in range(7)]
        self.piece_of_mean = device.empty(self.most, np.int32)

    def read(self, elements: slice) -> int:
        """Fill the buffers for some elements; gives their number."""
        m, nodes = int(elements.stop - elements.start), nodes_of(self.mesh, elements, self.device)
        self.rule.places(self.nodal, self.mesh.n_nodes, nodes, m, self.places, self.volume)
        self.hu = self._read_hu(nodes, m, self.places, self._hu)
        self.law.launch(self.hu, self.rule.n_points * m, self.density, self.modulus, self.poisson, self.piece)
        return m

    def see(self, buffer: Buffer, m: int) -> NDArray[Any]:
        """Values (points, m) of a buffer, until it is written again."""
        return np.reshape(self._see(buffer, self.rule.n_points * m), (self.rule.n_points, m))

    def points(self, m: int) -> Floats:
        """Places (points m, 3) of the points, LPS mm, by points first; the mesh's own where there is no CT."""
        return self._points(self.places, self.rule.n_points * m)

    def _read_hu(self, nodes: Buffer, m: int, places: list[Buffer], hu: Buffer) -> Buffer:
        """HU at the quadrature points, in ``hu`` or in a buffer of their own."""
        count = self.rule.n_points * m
        if self.sampler is None:
            self.rule.interpolate(self.nodal_hu, nodes, m, hu)
            return hu
        if self.inset is not None:
            moved = self.inset.move(self._points(places, count)) - self.sampler.middle
            places = [self.device.put(plane) for plane in np.ascontiguousarray(moved.T)]
        self.sampler.launch(places[0], places[1], places[2], count, hu)
        if self.fold is None:
            return hu
        whole = self._see(hu, count) + self.fold.correction(self._points(places, count))
        return self.device.put(whole.astype(self.device.real))

    def _points(self, places: list[Buffer], count: int) -> NDArray[np.float64]:
        assert self.sampler is not None
        return np.stack([self._see(place, count) for place in places], axis=1) + self.sampler.middle

    def _see(self, buffer: Buffer, count: int) -> NDArray[Any]:
        """The first values of a buffer, until it is written again."""
        return np.asarray(self.device.get(buffer)[:count])


def _means(work: AtPoints, elements: slice, keep_gauss: bool) -> dict[str, Any]:
    """Means of some elements, and the law of their mean HU."""
    m = work.read(elements)
    mean_hu, mean_density, mean_modulus, mean_poisson, *of_mean = work.of_elements
    pairs = (
        (work.hu, mean_hu),
        (work.density, mean_density),
        (work.modulus, mean_modulus),
        (work.poisson, mean_poisson),
    )
    for values, mean in pairs:
        work.rule.means(values, work.volume, m, mean)
    work.law.launch(mean_hu, m, of_mean[0], of_mean[1], of_mean[2], work.piece_of_mean)
    result = {
        name: np.array(work.device.get(buffer)[:m]) for name, buffer in zip(_OF_ELEMENTS, work.of_elements, strict=True)
    }
    result["piece"] = np.array(work.device.get(work.piece_of_mean)[:m])
    result["outside"] = np.array([np.count_nonzero(work.see(work.piece, m) < 0)])
    parts = work.see(work.volume, m)
    result["mm3"] = parts.sum(axis=0, dtype=np.float64)
    result["mass"] = np.einsum("gm,gm->g", parts, work.see(work.density, m), dtype=np.float64).sum()
    if keep_gauss:
        for name, buffer in (("density_g_cm3", work.density), ("E_MPa", work.modulus), ("nu", work.poisson)):
            result[name] = np.array(work.see(buffer, m))
    return result


def gauss_fields(material: ElementMaterial) -> dict[str, NDArray[Any]]:
    """Element fields of the material at Gauss points: ``E_MPa_1`` to ``E_MPa_8`` (27 of order 2), and so on.

    The points are numbered as ``Element.gauss`` has them, w fastest.
    """
    fields: dict[str, NDArray[Any]] = {}
    for name, values in material.gauss.items():
        fields |= {f"{name}_{number}": plane for number, plane in enumerate(values, start=1)}
    return fields
