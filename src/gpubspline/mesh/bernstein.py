"""Matrices between samples, Bernstein coefficients and the coefficients of the two halves of an interval."""

from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def lobatto(degree: int) -> Floats:
    """Points (degree + 1,) in 0..1, ends included, that samples are best taken at (Chebyshev's of the second kind)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree))


def bernstein(degree: int, at: Floats) -> Floats:
    """Bernstein polynomials (points, degree + 1) at points in 0..1."""
    n = np.arange(degree + 1)
    binomial = np.array([comb(degree, int(k)) for k in n], dtype=np.float64)
    return np.asarray(binomial * at[:, None] ** n * (1 - at[:, None]) ** (degree - n))


@cache
def from_samples(degree: int) -> Floats:
    """Matrix (n, n) from samples at the Lobatto points to coefficients; the first and the last are those samples."""
    matrix = np.linalg.inv(bernstein(degree, lobatto(degree)))
    matrix[0], matrix[-1] = np.eye(degree + 1)[[0, -1]]
    return np.asarray(matrix)


@cache
def halves(degree: int) -> Floats:
    """Matrix (2 n, n) from coefficients to those of the lower and then the upper half (de Casteljau at 1/2)."""
    lower = np.array([[comb(i, j) / 2**i if j <= i else 0.0 for j in range(degree + 1)] for i in range(degree + 1)])
    return np.concatenate([lower, lower[::-1, ::-1]])
