"""The hyperpatch: a tensor-product B-spline solid or surface whose points carry place and material (eqs 3.1, 3.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import comb, prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.device import Buffer, Device
from gpubspline.errors import InputError
from gpubspline.shown import brief
from gpubspline.spline.contract import NO_ORIGIN, Direction, contract_grid, contract_points
from gpubspline.spline.knots import MAX_DEGREE, check_knots, clamped_uniform, inserted

Floats = NDArray[np.float64]
Reals = NDArray[Any]
ENDS = 1e-12


@dataclass(frozen=True, eq=False)
class Hyperpatch:
    """A B-spline over u, v (a surface) or u, v, w (a solid), each running from 0 to 1.

    Attributes
    ----------
    control: (n_u, n_v[, n_w], 3 + C) float64, x, y, z in mm (LPS), then C material channels; kept as component planes,
        u fastest (Fortran order).
    degrees: one for each direction, 1 to 5.
    knots: one clamped vector for each direction.
    weights: None, or (n_u, n_v[, n_w]) positive, which makes it a NURBS.
    channels: names of the material channels; the first of a CT model is "HU".

    Raises
    ------
    InputError where shapes, degrees, knots or weights do not fit together.
    """

    control: Floats
    degrees: tuple[int, ...]
    knots: tuple[Floats, ...]
    weights: Floats | None = None
    channels: tuple[str, ...] = ("HU",)

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check that the parts fit, and settle the memory order."""
        control = np.asfortranarray(self.control, dtype=np.float64)
        if control.ndim not in (3, 4) or control.shape[-1] != 3 + len(self.channels):
            raise InputError(
                f"expected control points of shape (n_u, n_v[, n_w], {3 + len(self.channels)}), got {control.shape}"
            )
        if not np.isfinite(control).all():
            raise InputError("expected finite control points, got NaN or infinity")
        if not len(self.degrees) == len(self.knots) == control.ndim - 1:
            raise InputError(f"expected {control.ndim - 1} degrees and knot vectors, got {self.degrees}")
        for knots, degree, n_control in zip(self.knots, self.degrees, control.shape, strict=False):
            check_knots(knots, degree, n_control)
        if self.weights is not None and not (
            self.weights.shape == control.shape[:-1] and ((self.weights > 0) & (self.weights < np.inf)).all()
        ):
            raise InputError(f"expected positive weights of shape {control.shape[:-1]}, got {self.weights.shape}")
        object.__setattr__(self, "control", control)

    @property
    def shape(self) -> tuple[int, ...]:
        """Control points in each direction."""
        return self.control.shape[:-1]

    @property
    def parametric_dimension(self) -> int:
        """2 for a surface, 3 for a solid."""
        return len(self.degrees)

    def evaluate_grid(
        self, parameters: Sequence[ArrayLike], device: Device, derivatives: Sequence[int] | None = None
    ) -> Reals:
        """Points, or one partial derivative, on the grid of the given parameters.

        Arguments
        ---------
        parameters: one (N,) array in [0, 1] for each direction.
        derivatives: how often to differentiate in each direction; none by default.

        Returns
        -------
        (N_u, N_v[, N_w], 3 + C) of the device's real type, as component planes, u fastest.
        """
        axes = [_checked(values) for values in parameters]
        self._check_directions(len(axes), derivatives)
        planes = self._evaluate(axes, device, tuple(derivatives or (0,) * len(axes)), grid=True)
        counts = [len(axis) for axis in axes]
        return np.asarray(planes.reshape(-1, *counts[::-1]).T)

    def evaluate_points(self, parameters: ArrayLike, device: Device, derivatives: Sequence[int] | None = None) -> Reals:
        """Points, or one partial derivative, at scattered parameters (n, 2 or 3); returns (n, 3 + C)."""
        values = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        self._check_directions(values.shape[-1], derivatives)
        axes = [_checked(values[:, axis]) for axis in range(values.shape[1])]
        return np.asarray(self._evaluate(axes, device, tuple(derivatives or (0,) * len(axes)), grid=False).T)

    def insert_knots(self, direction: int, new: Sequence[float]) -> "Hyperpatch":
        """Add knots in one direction; the patch stays where it is and gains control points."""
        knots, matrix = inserted(self.knots[direction], self.degrees[direction], new)
        homogeneous = np.moveaxis(self._homogeneous(), direction, 0)
        moved = np.moveaxis(np.tensordot(matrix, homogeneous, axes=1), 0, direction)
        all_knots = (*self.knots[:direction], knots, *self.knots[direction + 1 :])
        if self.weights is None:
            return replace(self, control=moved, knots=all_knots)
        weights = moved[..., -1]
        return replace(self, control=moved[..., :-1] / weights[..., None], knots=all_knots, weights=weights)

    def _check_directions(self, count: int, derivatives: Sequence[int] | None) -> None:
        if count != self.parametric_dimension or (derivatives is not None and len(derivatives) != count):
            raise InputError(
                f"expected parameters and derivatives in {self.parametric_dimension} directions, got {count}"
            )

    def _homogeneous(self, middle: Floats | float = 0.0) -> Floats:
        """Control points seen from a middle, or with weights the weighted ones followed by the weight."""
        if self.weights is None:
            return self.control - middle
        weights = self.weights[..., None]
        return np.concatenate([(self.control - middle) * weights, weights], axis=-1)

    def _evaluate(self, axes: list[Floats], device: Device, order: tuple[int, ...], grid: bool) -> Reals:
        """(3 + C, N) planes of the patch, or of one partial derivative.

        Places are worked out from the middle of the patch: float32 has digits to spare there, not at the scanner's.
        """
        middle = np.zeros(self.control.shape[-1])
        if not any(order):  # else it falls out
            middle[:3] = np.round(self.control[..., :3].mean(axis=tuple(range(self.parametric_dimension))))
        return self._derivative(axes, device, order, grid, middle)

    def _derivative(
        self, axes: list[Floats], device: Device, order: tuple[int, ...], grid: bool, middle: Floats
    ) -> Reals:
        """(3 + C, N) planes of one partial derivative; of a NURBS by the quotient rule in each direction."""
        if self.weights is None:
            return device.get(self._planes(axes, device, order, grid, middle)[0])
        if not any(order):
            planes, count = self._planes(axes, device, order, grid, middle)
            n_channels = self.control.shape[-1]
            device.launch("patch.divide_by_weight", count, planes, n_channels, count, *middle[:3].tolist())
            return device.get(planes)[:-1]
        lower = list(product(*(range(n + 1) for n in order)))
        whole = {index: device.get(self._planes(axes, device, index, grid, middle)[0]) for index in lower}
        value: dict[tuple[int, ...], Reals] = {}
        weight = whole[(0,) * len(order)][-1]
        for index in lower:  # Piegl and Tiller, eq. 4.20, carried to any number of directions
            total = whole[index][:-1].copy()
            for part in product(*(range(n + 1) for n in index)):
                if any(part):
                    rest = tuple(n - m for n, m in zip(index, part, strict=True))
                    times = prod(comb(n, m) for n, m in zip(index, part, strict=True))
                    total -= times * whole[part][-1] * value[rest]
            value[index] = total / weight
        return value[order]

    def _planes(
        self, axes: list[Floats], device: Device, order: tuple[int, ...], grid: bool, middle: Floats
    ) -> tuple[Buffer, int]:
        """Buffer (K, N) of the homogeneous components on the device, those of a NURBS from the middle, and N."""
        control = self._homogeneous(middle)
        buffer = device.put(np.asfortranarray(control).T)  # planes, u fastest
        each = zip(self.knots, self.degrees, axes, order, strict=True)
        contract = contract_grid if grid else contract_points
        origin = tuple(middle[:3].tolist()) if self.weights is None else NO_ORIGIN
        return contract(device, buffer, control.shape, [Direction(*way) for way in each], origin)


def hyperpatch(
    control: ArrayLike,
    degree: int | Sequence[int] = 3,
    *,
    knots: Sequence[ArrayLike] | None = None,
    weights: ArrayLike | None = None,
    channels: Sequence[str] = ("HU",),
) -> Hyperpatch:
    """Build a hyperpatch over control points (n_u, n_v[, n_w], 3 + C), with clamped uniform knots unless given."""
    points = np.asarray(control, dtype=np.float64)
    directions = points.ndim - 1
    degrees = (degree,) * directions if isinstance(degree, int) else tuple(int(p) for p in degree)
    if len(degrees) != directions:
        raise InputError(f"expected {directions} degrees for control points of shape {points.shape}, got {degrees}")
    if knots is None:
        vectors = tuple(clamped_uniform(n, p) for n, p in zip(points.shape, degrees, strict=False))
    else:
        vectors = tuple(np.asarray(vector, dtype=np.float64) for vector in knots)
    given = None if weights is None else np.asarray(weights, dtype=np.float64)
    return Hyperpatch(points, degrees, vectors, given, tuple(channels))


def bezier(control: ArrayLike, *, weights: ArrayLike | None = None, channels: Sequence[str] = ("HU",)) -> Hyperpatch:
    """Bezier patch: in each direction the degree is one less than the number of control points (at most 6)."""
    shape = np.shape(control)[:-1]
    if max(shape, default=0) > MAX_DEGREE + 1:
        raise InputError(f"expected at most {MAX_DEGREE + 1} Bezier control points in a direction, got {shape}")
    return hyperpatch(control, [n - 1 for n in shape], weights=weights, channels=channels)


def _checked(parameters: ArrayLike) -> Floats:
    values = np.asarray(parameters, dtype=np.float64).ravel()
    if values.size == 0 or not (values.min() >= -ENDS and values.max() <= 1 + ENDS):
        raise InputError(
            "expected parameters from 0 to 1, got " + (f"{values.min()} to {values.max()}" if values.size else "none")
        )
    return np.clip(values, 0.0, 1.0)
