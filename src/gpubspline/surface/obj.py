"""Vertices and faces of Wavefront OBJ files: meshio refuses those whose normals or textures are not one a vertex."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError


def read_obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read points (n, 3) and triangles (m, 3); polygons are split from their first vertex.

    Numbers count from 1, negative ones from the last vertex so far. What follows a slash is texture and normal.

    Raises
    ------
    InputError, with the line, where one cannot be read.
    """
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    with path.open(encoding="utf-8", errors="replace") as lines:
        for count, line in enumerate(lines, 1):
            words = line.split()
            try:
                if words[:1] == ["v"]:
                    points.append([float(word) for word in words[1:4]])
                elif words[:1] == ["f"]:
                    face = [int(word.partition("/")[0]) for word in words[1:]]
                    face = [n - 1 if n > 0 else len(points) + n for n in face]
                    triangles += [(face[0], face[n], face[n + 1]) for n in range(1, len(face) - 1)]
            except ValueError as error:
                raise InputError(f"cannot read {path.name} as OBJ: line {count}: {error}") from None
    if any(len(point) != 3 for point in points):
        raise InputError(f"cannot read {path.name} as OBJ: expected three coordinates a vertex")
    return np.array(points, dtype=np.float64).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)
