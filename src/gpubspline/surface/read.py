"""Surface files: STL, PLY and OFF through meshio, VTP through VTK, OBJ."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from gpubspline.errors import BackendUnavailable, GpubsplineWarning, InputError
from gpubspline.surface.check import closed
from gpubspline.surface.crossings import check_apart
from gpubspline.surface.edges import find_edges
from gpubspline.surface.mend import Mending, mended
from gpubspline.surface.obj import read_obj
from gpubspline.surface.surface import Floats, Integers, Surface, spelled

MESHIO = {".stl": "stl", ".ply": "ply", ".off": "off"}
EXTENSIONS = (".stl", ".obj", ".ply", ".off", ".vtp")

SMALLEST_MM, LARGEST_MM = 1.0, 1e4
"""A surface that is smaller or larger is taken for one in other units."""

FLAT = 1e-6
"""Of the surface's extent: how far points may lie off a plane that they are all in."""

SAME = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Of the surface's extent: points of open edges nearer than the first of these that closes it are one."""


def is_surface(path: str | Path) -> bool:
    """Whether the name is that of a surface file."""
    return Path(path).suffix.lower() in EXTENSIONS


def read_surface(path: str | Path) -> Surface:
    """Read a closed surface; its coordinates are taken for LPS mm.

    Quads and polygons are split into triangles, repeated points joined, triangles without area dropped. Warned of, with
    places: small faults are mended (``mend``), of several bodies the largest is kept, with its cavities, what faces the
    wrong way is turned, and what hardly passes through itself is taken as it is (``crossings``).

    Raises
    ------
    InputError where the file cannot be read, or the surface is open, one-sided or passes through itself; the message
    gives a place and what to try. BackendUnavailable for ``.vtp`` where VTK is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"expected an existing surface file, got {path}")
    if not is_surface(path):
        raise InputError(f"expected a surface of {', '.join(EXTENSIONS)}, got {path.name}")
    points, triangles = {".vtp": _read_vtp, ".obj": read_obj}.get(path.suffix.lower(), _read_meshio)(path)
    if not len(triangles):
        raise InputError(f"expected triangles in {path.name}, got none")
    _check_places(points, triangles, path.name)
    with warnings.catch_warnings(record=True) as heard:  # said of what is taken: of what is refused one line says all
        warnings.simplefilter("always")
        surface, mendings = _mended(_used(points, triangles), path.name)
        if mendings:
            what = "; ".join(map(str, mendings))
            warnings.warn(f"{path.name} was mended: {what}", GpubsplineWarning, stacklevel=2)
        surface = closed(surface, path.name)
        check_apart(surface, path.name)
        _warn_of_units(surface, path.name)
    for warning in heard:
        warnings.warn(warning.message, stacklevel=2)
    return surface


def _check_places(points: Floats, triangles: Integers, name: str) -> None:
    """Refuse triangles with corners that are no places, and those that lie in one plane."""
    if not 0 <= triangles.min() <= triangles.max() < len(points):
        raise InputError(f"cannot read {name}: expected points 0 to {len(points) - 1}, got others in its triangles")
    finite = np.asarray(np.isfinite(points).all(axis=1))
    touched = ~finite[triangles].all(axis=1)
    if touched.any():
        beside = np.flatnonzero(finite & np.isin(np.arange(len(points)), triangles[touched]))
        where = f", the first beside {spelled(points[beside[0]])}" if len(beside) else ""
        count = len(np.setdiff1d(triangles, np.flatnonzero(finite)))
        raise InputError(
            f"expected finite coordinates in {name}, got NaN or infinity in {count:,} of {len(points):,} points{where}"
            ": delete these points and close the holes, for example with MeshLab"
        )
    corners = points[np.unique(triangles)]
    middle, extent = corners.mean(axis=0), np.ptp(corners, axis=0)
    if np.linalg.svd((corners - middle).T @ (corners - middle), compute_uv=False)[2] <= (FLAT * extent.max()) ** 2:
        size = " x ".join(f"{x:.3g}" for x in extent)
        raise InputError(
            f"expected {name} to enclose a volume, got a flat sheet of {size} mm round {spelled(middle)}: give it a "
            "thickness, for example with Solidify of Blender or Offset of Meshmixer"
        )


def _used(points: Floats, triangles: Integers) -> Surface:
    """Only the points of triangles."""
    used, number = np.unique(triangles, return_inverse=True)
    return Surface(points[used], number.reshape(triangles.shape))


def _warn_of_units(surface: Surface, name: str) -> None:
    extent = np.ptp(np.stack(surface.box), axis=0)
    size = " x ".join(f"{x:.3g}" for x in extent)
    if extent.max() < SMALLEST_MM:
        asked = "are its coordinates mm, not metres? Those want to be multiplied by 1,000"
    elif extent.max() > LARGEST_MM:
        asked = "are its coordinates mm, not micrometres? Those want to be divided by 1,000"
    else:
        return
    warnings.warn(f"{name} is {size} mm: {asked}", GpubsplineWarning, stacklevel=3)


def _read_meshio(path: Path) -> tuple[Floats, Integers]:
    import meshio

    try:
        with _silence():
            mesh = meshio.read(path, file_format=MESHIO[path.suffix.lower()])
    except (SystemExit, Exception) as error:  # meshio raises what its parsers happen to raise, and exits
        reason = "its header is of no such file" if isinstance(error, SystemExit) else str(error)
        if isinstance(error, UnicodeDecodeError):
            reason = "it is no text, and no binary file of that form or cut short"
        raise InputError(f"cannot read {path.name} as {path.suffix[1:].upper()}: {reason}") from None
    faces = [_fan(block.data) for block in mesh.cells if block.type.startswith(("triangle", "quad", "polygon"))]
    points = np.asarray(mesh.points, dtype=np.float64)
    return points, np.concatenate(faces) if faces else np.zeros((0, 3), dtype=np.int64)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep what meshio prints and NumPy warns of on files of something else: one error says it."""
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _read_vtp(path: Path) -> tuple[Floats, Integers]:
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkObject
        from vtkmodules.vtkFiltersCore import vtkTriangleFilter
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
    except ImportError:
        raise BackendUnavailable("reading .vtp needs VTK: pip install 'gpubspline[view]'") from None
    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)  # its parser writes to the terminal
    try:
        reader, split = vtkXMLPolyDataReader(), vtkTriangleFilter()
        reader.SetFileName(str(path))
        split.SetInputConnection(reader.GetOutputPort())
        split.PassLinesOff()
        split.PassVertsOff()
        split.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
    found = split.GetOutput()
    if not found.GetNumberOfPolys():
        raise InputError(f"cannot read {path.name} as VTP: no polygons in it")
    points = vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
    return points, vtk_to_numpy(found.GetPolys().GetConnectivityArray()).astype(np.int64).reshape(-1, 3)


def _fan(polygons: NDArray[Any]) -> Integers:
    """Triangles (m (k - 2), 3) of polygons (m, k) from their first vertex."""
    polygons = np.asarray(polygons, dtype=np.int64)
    parts = [polygons[:, [0, n, n + 1]] for n in range(1, polygons.shape[1] - 1)]
    return np.stack(parts, axis=1).reshape(-1, 3)


def _mended(surface: Surface, name: str) -> tuple[Surface, list[Mending]]:
    """Join equal points and mend; where it stays open, join points of open edges that are as near as need be."""
    _, first, number = np.unique(surface.points, axis=0, return_index=True, return_inverse=True)
    exact = _merged(surface.points[first], number.reshape(-1)[surface.triangles], name)
    found, mendings = mended(exact)
    for share in SAME if _is_open(found) else ():
        joined, points = _joined(exact, share * float(np.ptp(exact.points, axis=0).max()), name)
        near, done = mended(joined)
        if not _is_open(near):
            return near, [points, *done]
    return found, mendings


def _joined(surface: Surface, step: float, name: str) -> tuple[Surface, Mending]:
    """Join the points of open edges that are nearer than this, mm."""
    edges = find_edges(surface.triangles)
    border = np.unique(edges.sides[(edges.count == 1)[edges.number]])
    pairs = border[KDTree(surface.points[border]).query_pairs(step, output_type="ndarray")]
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(surface.points),) * 2)
    number = connected_components(graph, directed=False)[1]
    _, first = np.unique(number, return_index=True)
    place = surface.points[pairs.min()] if len(pairs) else surface.points[0]
    what = f"points of open edges closer than {step:.2g} mm joined"
    near = _merged(surface.points[first], number[surface.triangles], name)
    return near, Mending(len(surface.points) - len(first), what, place)


def _is_open(surface: Surface) -> bool:
    return bool((find_edges(surface.triangles).count == 1).any())


def _merged(points: Floats, triangles: Integers, name: str) -> Surface:
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (c != a)
    if not whole.any():
        raise InputError(f"expected triangles of three different points in {name}, got none")
    return Surface(points, triangles[whole])
