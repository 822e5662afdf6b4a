"""Whether the Jacobian determinant is positive throughout every element, not only at its corners: a certificate.

The determinant of a trilinear hex has degree 2 along each parameter, that of a quadratic one degree 5. Its Bernstein
coefficients bound it: it is nowhere less than the least of them, and at the corners it is what theirs are. An element
whose least coefficient is not positive, but whose corners are, is cut in eight, which draws the coefficients nearer to
the determinant, until each part is certified or a place with a negative determinant is found.

Source: Johnen, Remacle, Geuzaine 2013, Geometrical validity of curvilinear finite elements, J. Comput. Phys. 233.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Buffer, Device, open_device
from gpubspline.errors import BackendUnavailable, InputError
from gpubspline.mesh.bernstein import from_samples, halves, lobatto
from gpubspline.mesh.elements import Element
from gpubspline.mesh.mesh import Mesh
from gpubspline.shown import brief

Floats = NDArray[np.float64]

DEPTH = 8
"""Times that an element is cut; 2^8 parts along each edge decide all but determinants that touch 0 inside."""

_CHUNK = 1 << 22  # coefficients held at a time, of a GPU
_CACHED = 1 << 19  # of a CPU: half the time, in its caches and in memory that need not be asked for anew
_MOST = 1 << 24  # coefficients of parts of undecided elements, beyond which they are left so


@dataclass(frozen=True)
class Certificate:
    """How many elements are known to be valid throughout.

    Attributes
    ----------
    certified: elements whose determinant is positive throughout.
    negative: elements with a place where it is 0 or less, as far as rounding lets tell.
    undecided: the others.
    least_ratio: no element's determinant is anywhere less than this part of its mean.
    """

    certified: int
    negative: int
    undecided: int
    least_ratio: float

    @property
    def valid(self) -> bool:
        """Whether every element is certified."""
        return self.negative == self.undecided == 0

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return {
            "certified": self.certified,
            "negative": self.negative,
            "undecided": self.undecided,
            "least_ratio": self.least_ratio,
        }


@dataclass(frozen=True, eq=False)
class Validity:
    """What is known of the determinants inside the elements of a mesh.

    Attributes
    ----------
    lower, upper: (m,) bounds of each element's least determinant over its mean one: 1 for a parallelepiped, -1 or 0
        where the mean is not positive.
    verdict: (m,) int8: 1 where it is certified, -1 where a place of 0 or less is known, 0 where it is not decided.
    """

    lower: Floats
    upper: Floats
    verdict: NDArray[np.int8]

    __repr__ = brief

    @property
    def certificate(self) -> Certificate:
        """The counts."""
        certified, negative, undecided = (int(np.count_nonzero(self.verdict == value)) for value in (1, -1, 0))
        return Certificate(certified, negative, undecided, float(self.lower.min()))


def certify(mesh: Mesh, device: Device) -> Validity:
    """Bound the Jacobian determinant throughout each hex, in float64 where the device has it.

    Raises
    ------
    InputError for a mesh of quads, or where a node is nowhere: NaN or infinity.
    """
    if mesh.element.dimension != 3:
        raise InputError(f"expected hexes to certify, got {mesh.element_type}")
    mesh.check_finite()
    device = _in_float64(device)
    planes, rounding = _put(mesh, device)
    step = max(1, (_CACHED if device.cores else _CHUNK) // _order(mesh.element) ** 3)
    parts = []
    for first in range(0, mesh.n_elements, step):
        cells = mesh.cells_of(np.arange(first, min(first + step, mesh.n_elements)))
        parts.append(_bounds_of(mesh, cells, planes, rounding, device))
    return Validity(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _order(element: Element) -> int:
    """Coefficients along each parameter: one more than the determinant's degree."""
    return 3 * element.order


def _in_float64(device: Device) -> Device:
    try:
        return open_device(device.name, "float64")
    except BackendUnavailable:
        return device


def _put(mesh: Mesh, device: Device) -> tuple[list[Buffer], float]:
    """Coordinates on the device, and what rounding them may have moved, mm."""
    if device.real.itemsize >= mesh.points.dtype.itemsize:
        return [device.put(plane) for plane in mesh.planes], 0.0
    centred = mesh.planes - mesh.planes.mean(axis=1, keepdims=True)
    return [device.put(plane) for plane in centred], float(np.finfo(device.real).eps * np.abs(centred).max())


def _bounds_of(
    mesh: Mesh, cells: NDArray[np.int32], planes: list[Buffer], moved_mm: float, device: Device
) -> tuple[Floats, Floats, NDArray[np.int8]]:
    """Bounds over the mean, and 1, -1, 0 for certified, negative and undecided, of some elements."""
    n = _order(mesh.element)
    coefficients = _coefficients(mesh.element, cells, planes, device)
    low, high = _least(coefficients, n, 1, len(cells), device)
    held = np.asarray(device.get(coefficients)).reshape(n, n, n, len(cells))
    margin = _margin(mesh, cells, moved_mm, device)
    lower, upper = _refined(low[0], high[0], margin, held, device)
    verdict = np.where(lower > margin, 1, np.where(upper <= margin, -1, 0)).astype(np.int8)
    mean = held.mean(axis=(0, 1, 2), dtype=np.float64)  # of Bernstein polynomials all integrals are alike
    scale = np.where(mean > margin, mean, np.nan)
    worse = np.minimum(np.sign(upper), 0.0)  # inverted on the whole: no ratio
    lower, upper = (np.where(mean > margin, value / scale, worse) for value in (lower, upper))
    return lower, upper, verdict


def _coefficients(element: Element, cells: NDArray[np.int32], planes: list[Buffer], device: Device) -> Buffer:
    """(n, n, n, m) Bernstein coefficients of the determinants, along u, v, w."""
    n, count = _order(element), len(cells)
    at = np.array(list(product(lobatto(n - 1), repeat=3)))
    samples = device.empty(n**3 * count)
    device.launch(
        "validity.determinants",
        (n**3, count),
        *planes,
        device.put(cells),
        count,
        element.n_nodes,
        device.put(element.gradient(at)),
        n**3,
        samples,
    )
    return _apply(from_samples(n - 1), samples, n, count, device)


def _apply(matrix: Floats, values: Buffer, n: int, count: int, device: Device) -> Buffer:
    """Apply a matrix (rows, n) along each of the first three axes of values (n, n, n, count)."""
    rows, put = len(matrix), device.put(np.ascontiguousarray(matrix))
    for before, after in ((1, n * n * count), (rows, n * count), (rows * rows, count)):
        result = device.empty(before * rows * after)
        device.launch("validity.along", (before * rows, after), values, n, after, put, rows, result)
        values = result
    return values


def _least(coefficients: Buffer, n: int, parts: int, count: int, device: Device) -> tuple[Floats, Floats]:
    """Least coefficient and least corner (parts^3, count) of the parts along each parameter."""
    low, high = device.empty((parts**3, count)), device.empty((parts**3, count))
    device.launch("validity.bounds", (parts**3, count), coefficients, n, parts, count, low, high)
    return np.array(device.get(low), dtype=np.float64), np.array(device.get(high), dtype=np.float64)


def _margin(mesh: Mesh, cells: NDArray[np.int32], moved_mm: float, device: Device) -> Floats:
    """How far rounding may have moved a coefficient (m,), mm3: the sum of the terms' first-order errors.

    With g the greatest absolute sum of gradients, tangents are at most g times the element's extent; a determinant of
    three moves by 3 t^2 for each 1 that they move; the change of basis multiplies by its norm along each parameter.
    """
    n, k = _order(mesh.element), mesh.element.n_nodes
    at = np.array(list(product(lobatto(n - 1), repeat=3)))
    greatest = float(np.abs(mesh.element.gradient(at)).sum(axis=2).max())
    extent = _extent_mm(mesh, cells)
    norm = float(np.abs(from_samples(n - 1)).sum(axis=1).max()) ** 3
    terms = 3 * (k + 2) + 8 + 10 * n
    rounding = float(np.finfo(device.real).eps) * terms
    return np.asarray(norm * greatest**3 * extent**2 * (rounding * extent + 6 * moved_mm))


def _extent_mm(mesh: Mesh, cells: NDArray[np.int32]) -> Floats:
    """Greatest distance (m,) of a node of each element from its first one."""
    squared, nodes = np.zeros(cells.shape[::-1]), np.ascontiguousarray(cells.T)
    for plane in mesh.planes:
        along = plane[nodes].astype(np.float64)
        along -= along[0].copy()
        squared += np.square(along, out=along)
    return np.asarray(np.sqrt(squared.max(axis=0)))


def _refined(lower: Floats, upper: Floats, margin: Floats, held: NDArray[Any], device: Device) -> tuple[Floats, Floats]:
    """Bounds after elements that are not decided were cut until they are."""
    undecided = (lower <= margin) & (upper > margin)
    owner, parts = np.flatnonzero(undecided), np.ascontiguousarray(held[..., undecided])
    closed, rest = np.where(undecided, np.inf, lower), lower[undecided]
    for _ in range(DEPTH):
        if not 0 < parts.size < _MOST:
            break
        low, high, pieces = _cut(parts, device)
        owner = np.tile(owner, 8)
        np.minimum.at(upper, owner, high)
        still = (low <= margin[owner]) & (upper[owner] > margin[owner])
        np.minimum.at(closed, owner[~still], low[~still])
        owner, rest, parts = owner[still], low[still], np.ascontiguousarray(pieces[..., still])
    np.minimum.at(closed, owner, rest)
    return np.where(upper > margin, closed, lower), upper


def _cut(parts: NDArray[Any], device: Device) -> tuple[Floats, Floats, NDArray[Any]]:
    """Least coefficient (8 q,), least corner and coefficients (n, n, n, 8 q) of the eight parts of each of q."""
    n, count = len(parts), parts.shape[-1]
    halved = _apply(halves(n - 1), device.put(parts), n, count, device)
    low, high = _least(halved, n, 2, count, device)
    pieces = np.asarray(device.get(halved)).reshape(2, n, 2, n, 2, n, count).transpose(1, 3, 5, 0, 2, 4, 6)
    return low.ravel(), high.ravel(), pieces.reshape(n, n, n, 8 * count)
