"""Named points that somebody set in 3D Slicer: its markups, ``.mrk.json``, and fiducials, ``.fcsv``, in LPS mm.

Both say their frame, RAS or LPS, by name or, of older versions, as 0 or 1; without a word it is RAS.

Source: 3D Slicer 5, Markups module, file formats.
"""

import csv
import json
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from gpubspline.errors import InputError
from gpubspline.tables import is_a, read_text

Point = tuple[float, float, float]
TURNED = {"LPS": (1.0, 1.0), "1": (1.0, 1.0), "RAS": (-1.0, -1.0), "0": (-1.0, -1.0)}
"""Signs of x and y from a frame to LPS."""


def read_landmarks(path: Path) -> dict[str, Point]:
    """Points by name, LPS mm; those that were named but not set are left out.

    Raises
    ------
    InputError where the file is none of the two, or two of its points have one name.
    """
    text = read_text(path, "file of landmarks")
    points: dict[str, Point] = {}
    for name, frame, place in (_of_json if path.suffix.lower() == ".json" else _of_csv)(text, path.name):
        if not all(is_a(mm, float) and isfinite(mm) for mm in place) or len(place) != 3:
            raise InputError(f"expected three finite numbers for the landmark {name!r} in {path.name}, got {place}")
        if frame not in TURNED:
            raise InputError(f"expected the frame RAS or LPS in {path.name}, got {frame!r}")
        if name in points:
            raise InputError(f"expected a name of its own for each landmark of {path.name}, got {name!r} twice")
        x, y = TURNED[frame]
        points[name] = (x * place[0], y * place[1], float(place[2]))
    if not points:
        raise InputError(f"expected landmarks of 3D Slicer (.mrk.json, .fcsv) in {path.name}, got none")
    return points


def _of_json(text: str, name: str) -> Iterator[tuple[str, str, list[Any]]]:
    try:
        for markup in json.loads(text)["markups"]:
            units = markup.get("coordinateUnits", "mm")
            if (units if isinstance(units, str) else units[0]) != "mm":
                raise InputError(f"expected coordinates in mm in {name}, got {units}")
            for point in markup["controlPoints"]:
                if point.get("positionStatus", "defined") == "defined":
                    yield str(point["label"]), str(markup.get("coordinateSystem", "RAS")), list(point["position"])
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        if isinstance(error, InputError):  # which is a ValueError
            raise
        raise InputError(f"expected markups of 3D Slicer in {name}, got something else: {error}") from None


def _of_csv(text: str, name: str) -> Iterator[tuple[str, str, list[Any]]]:
    """Lines of comments, one of them the frame; then ``id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,...``."""
    lines = text.splitlines()
    said = [line.partition("=")[2].strip() for line in lines if line.startswith("# CoordinateSystem")]
    for row in csv.reader(line for line in lines if line.strip() and not line.startswith("#")):
        try:
            yield row[11], said[0] if said else "RAS", [float(mm) for mm in row[1:4]]
        except (IndexError, ValueError):
            raise InputError(f"expected fiducials of 3D Slicer in {name}, got the line {','.join(row)!r}") from None
