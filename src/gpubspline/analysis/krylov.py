"""Preconditioned conjugate gradients on a device."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpubspline.device import Buffer, Device
from gpubspline.device.vectors import inner_product
from gpubspline.errors import SolveError

Progress = Callable[[int, float], None]
Operator = Callable[[Buffer, Buffer], None]
"""Writes the product with its first argument into its second."""


@dataclass(frozen=True, eq=False)
class Vectors:
    """Arithmetic of vectors of n numbers on a device."""

    device: Device
    n: int

    def zeros(self) -> Buffer:
        """A vector of zeros."""
        return self.device.put(np.zeros(self.n, dtype=self.device.real))

    def combine(self, x: Buffer, a: float, b: float, y: Buffer) -> None:
        """Y = a x + b y."""
        self.device.launch("vectors.combine", self.n, x, float(a), float(b), self.n, y)

    def dot(self, x: Buffer, y: Buffer) -> float:
        """Product of two vectors, the same each time."""
        return inner_product(self.device, x, y, self.n)


def conjugate_gradients(
    apply: Operator,
    precondition: Operator,
    b: Buffer,
    vectors: Vectors,
    *,
    tolerance: float,
    limit: int,
    progress: Progress | None = None,
) -> tuple[Buffer, int, float]:
    """Solve A x = b for a symmetric positive definite A.

    When the recurrence says that the residual is small enough, the residual itself is taken, and where it is not, the
    iteration starts again from it. What it finds is a correction, added at once: a step added to x rounds all of x, and
    hundreds of them leave ten times what one rounding does. What x loses even so is kept beside it and counts in the
    residual: of a slender body of many elements the last digit of x alone leaves more than 1e-8 of the loads. The
    flexible form lets the preconditioner be of lower precision than the vectors.

    Returns
    -------
    x, the number of iterations, and the residual |b - A x| / |b|, x as it was before its last digit was rounded.

    Raises
    ------
    SolveError where the residual does not reach the tolerance.

    Source: Golub and Ye 1999 (the flexible form); van der Vorst and Ye 2000 (corrections in groups).
    """
    x, size = vectors.zeros(), float(np.sqrt(vectors.dot(b, b)))
    if size == 0.0:
        return x, 0, 0.0
    rest, r, product = vectors.zeros(), vectors.zeros(), vectors.zeros()
    vectors.combine(b, 1.0, 0.0, r)
    iterations, residual, before, wanted = 0, 1.0, np.inf, tolerance
    while residual > tolerance:
        if not residual < 0.5 * before or iterations >= limit:
            raise SolveError(
                f"the solve did not converge: a residual of {residual:.2g} after {iterations} iterations, "
                f"expected {tolerance:g}" + _limit(residual, _rounding(apply, x, vectors, size))
            )
        before = residual
        correction, iterations = _descend(apply, precondition, r, vectors, size, wanted, iterations, limit, progress)
        _add(correction, x, rest, vectors)
        wanted *= 0.25  # where rounding keeps it just above, another iteration or two must show
        apply(x, product)
        vectors.combine(b, 1.0, 0.0, r)
        vectors.combine(product, -1.0, 1.0, r)
        apply(rest, product)
        vectors.combine(product, -1.0, 1.0, r)
        residual = float(np.sqrt(vectors.dot(r, r))) / size
    return x, iterations, residual


def _add(correction: Buffer, x: Buffer, rest: Buffer, vectors: Vectors) -> None:
    """Add a correction to x, and to the rest what x loses of it to rounding."""
    before = vectors.zeros()
    vectors.combine(x, 1.0, 0.0, before)
    vectors.combine(correction, 1.0, 1.0, x)
    vectors.combine(x, 1.0, -1.0, before)  # what x has gained
    vectors.combine(before, -1.0, 1.0, correction)
    vectors.combine(correction, 1.0, 1.0, rest)


def _rounding(apply: Operator, x: Buffer, vectors: Vectors, size: float) -> float:
    """Residual that rounding within A leaves: its product with x, less those with the two halves of x's digits."""
    values = np.array(vectors.device.get(x))
    scaled = values * (2.0 ** (np.finfo(values.dtype).nmant // 2 + 1) + 1)
    upper = scaled - (scaled - values)  # Veltkamp 1968
    product, total = vectors.zeros(), vectors.zeros()
    for sign, part in ((1.0, values), (-1.0, upper), (-1.0, values - upper)):
        apply(vectors.device.put(part), product)
        vectors.combine(product, sign, 1.0, total)
    return float(np.sqrt(vectors.dot(total, total))) / size


def _limit(residual: float, rounding: float) -> str:
    """Whether rounding is why a residual falls no further, in words."""
    if not residual < 30 * rounding:
        return ""
    return f"; rounding alone leaves {rounding:.1g}: ask for a tolerance well above that"


def _descend(
    apply: Operator,
    precondition: Operator,
    r: Buffer,
    vectors: Vectors,
    size: float,
    tolerance: float,
    iterations: int,
    limit: int,
    progress: Progress | None,
) -> tuple[Buffer, int]:
    """Solve A x = r until the residual of the recurrence is small enough; gives x and the number of iterations."""
    x, z, p, product = vectors.zeros(), vectors.zeros(), vectors.zeros(), vectors.zeros()
    precondition(r, z)
    vectors.combine(z, 1.0, 0.0, p)
    rho = vectors.dot(r, z)
    while iterations < limit:
        apply(p, product)
        curvature = vectors.dot(p, product)
        if not (curvature > 0 and np.isfinite(rho)):
            raise SolveError(f"the stiffness is not positive definite, found after {iterations} iterations")
        alpha = rho / curvature
        vectors.combine(p, alpha, 1.0, x)
        vectors.combine(product, -alpha, 1.0, r)
        iterations += 1
        residual = float(np.sqrt(vectors.dot(r, r))) / size
        if progress is not None:
            progress(iterations, residual)
        if residual <= tolerance:
            break
        precondition(r, z)
        beta = -alpha * vectors.dot(z, product) / rho
        rho = vectors.dot(r, z)
        vectors.combine(z, 1.0, beta, p)
    return x, iterations
