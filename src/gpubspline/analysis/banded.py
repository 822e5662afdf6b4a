"""The direct solver of a small structured grid: Cholesky's factor of a band."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Counts = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Banded:
    """Cholesky's factor of a grid's matrix.

    Attributes
    ----------
    factor: (bandwidth, 3 n), LAPACK's lower band, of nodes whose shortest direction runs fastest.
    order: (n,), of each place in it the node.
    """

    factor: NDArray[Any]
    order: NDArray[Any]

    def solve(self, b: NDArray[Any]) -> NDArray[Any]:
        """Solution (3, n) for a right side (3, n)."""
        x = linalg.cho_solve_banded((self.factor, True), b.T[self.order].ravel(), check_finite=False)
        out = np.empty(b.shape, x.dtype)
        out[:, self.order] = x.reshape(-1, 3).T
        return out


def bandwidth(counts: Counts) -> int:
    """Diagonals of the lower half of a grid's matrix."""
    first, second, _ = sorted(counts)
    return 3 * (first * second + first + 1) + 3


def banded(stencil: NDArray[Any], free: NDArray[Any], counts: Counts) -> Banded:
    """Factor the matrix of a grid.

    Arguments
    ---------
    stencil: its blocks, as ``kernels/stencil.py`` has them; free: (3, n), 0 where a direction is not.
    counts: nodes per direction.
    """
    n = int(np.prod(counts))
    axes = np.argsort(counts, kind="stable")  # of u, v, w, the fastest first
    place = np.arange(n).reshape(counts[::-1])
    order = place.transpose([2 - axis for axis in axes[::-1]]).ravel()
    rank = np.empty(n, dtype=np.int64)
    rank[order] = np.arange(n)
    entries = np.asarray(stencil, dtype=np.float64).reshape(-1, 27, 3, 3, 8).transpose(1, 2, 3, 0, 4)
    band = np.zeros((bandwidth(counts), 3 * n))
    index = np.stack(np.unravel_index(np.arange(n), counts[::-1]))
    for o, blocks in enumerate(entries.reshape(27, 3, 3, -1)[..., :n]):
        at = index + np.array([[o // 9 - 1], [o // 3 % 3 - 1], [o % 3 - 1]])
        inside = np.flatnonzero(np.all((at >= 0) & (at < np.array(counts[::-1])[:, None]), axis=0))
        other = np.ravel_multi_index(tuple(at[:, inside]), counts[::-1])
        for row in range(3):
            for column in range(3):
                to, of = 3 * rank[inside] + row, 3 * rank[other] + column
                lower = to >= of
                band[(to - of)[lower], of[lower]] = blocks[row, column, inside[lower]]
    diagonal = band[0].reshape(n, 3)
    diagonal[np.asarray(free).reshape(3, n).T[order] == 0] = 1.0
    return Banded(_factor(band), order)


def _factor(band: NDArray[Any]) -> NDArray[Any]:
    """Cholesky's factor; where rounding has left the matrix indefinite, of one with a little more on its diagonal."""
    diagonal, more = band[0].copy(), 1e-7
    while True:
        try:
            return np.asarray(linalg.cholesky_banded(band, lower=True))
        except linalg.LinAlgError:
            more *= 10
            band[0] = diagonal * (1 + more)
