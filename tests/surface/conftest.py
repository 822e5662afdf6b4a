"""Surfaces of known bodies, made from nothing but their formulas."""

import numpy as np
import pytest

from gpubspline.surface.surface import Surface


def sphere(radius=10.0, centre=(3.0, -7.0, 40.0), n=24, stretch=(1.0, 1.0, 1.0)):
    """Points on a sphere in rings from pole to pole."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n + 1)[1:-1], np.arange(2 * n) * np.pi / n, indexing="ij")
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    points = np.concatenate([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    number = np.arange((n - 1) * 2 * n).reshape(n - 1, 2 * n)
    after = np.roll(number, -1, axis=1)
    a, b, c, d = (x.ravel() for x in (number[:-1], number[1:], after[1:], after[:-1]))
    top, bottom = len(points) - 2, len(points) - 1
    north = np.stack([np.full(2 * n, top), number[0], after[0]], axis=1)
    south = np.stack([np.full(2 * n, bottom), after[-1], number[-1]], axis=1)
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), north, south])
    return Surface(radius * points * stretch + np.asarray(centre), triangles)


def box(size=(4.0, 3.0, 2.0), low=(0.0, 0.0, 0.0)):
    """Twelve triangles."""
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    return Surface(corners * size + np.asarray(low), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def join(*parts):
    """Several surfaces as one, in the order given."""
    first = np.cumsum([0] + [len(part.points) for part in parts])
    triangles = [part.triangles + n for part, n in zip(parts, first, strict=False)]
    return Surface(np.concatenate([part.points for part in parts]), np.concatenate(triangles))


def turn(surface):
    """The same surface inside out."""
    return Surface(surface.points, surface.triangles[:, ::-1])


class Shapes:
    sphere, box, join, turn = staticmethod(sphere), staticmethod(box), staticmethod(join), staticmethod(turn)


@pytest.fixture(scope="session")
def shapes():
    """Makers of surfaces."""
    return Shapes
