"""Files of a finished hex mesh with all its fields.

Floors: the bytes of the file, which its text or its binary blocks come to; ASCII has some 30 operations a digit group
beside. The fraction is of the time in which as many random bytes are written at once into the same folder, in turn with
ours, each in place of a file of the same size. Of binary files both wait for the disk, so that it is the disk's speed;
the seconds and the peers' are of what all leave in the page cache, and so is ``plain, page cache`` beside them. A deck
is held against the page cache, too.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline import pipeline
from gpubspline.bench.bench_evaluate import PAPER, random_patch
from gpubspline.bench.measure import Host, Peer, Row, Run, best_in_turn, check, peer, time_peers
from gpubspline.clock import Clock
from gpubspline.device import open_device
from gpubspline.export import write
from gpubspline.material.registry import law as find_law
from gpubspline.mesh.mesh import Mesh
from gpubspline.recipe import Model, Sampling

SIZES = {"full": [110, 220], "quick": [110], "tiny": [4]}  # hexes a direction: 1.33 and 10.6 million
DECKS = {"full": [110, 220], "quick": [110, 220], "tiny": [4]}  # peers take minutes of what is not in SIZES
BLOCK = 1 << 26


def inp(host: Host) -> Iterator[Row]:
    """Time the deck; meshio's has nodes and elements alone."""
    yield from _rows(host, ".inp", DECKS)


def vtu(host: Host) -> Iterator[Row]:
    """Time VTK's unstructured file; peers write without compression."""
    yield from _rows(host, ".vtu")


def vts(host: Host) -> Iterator[Row]:
    """Time VTK's structured file, which has no connectivity."""
    yield from _rows(host, ".vts")


def vtkhdf(host: Host) -> Iterator[Row]:
    """Time VTK's HDF5 file of an unstructured grid, where h5py is installed; no peer for it is known."""
    if find_spec("h5py") is not None:
        yield from _rows(host, ".vtkhdf")


def _rows(host: Host, extension: str, sizes: Mapping[str, Sequence[int]] = SIZES) -> Iterator[Row]:
    _check_file(host.folder / f"small{extension}")
    for n in sizes[host.scale]:
        made, path = _model(n), host.folder / f"mesh{extension}"
        run = partial(write, made.mesh, path, law=made.sampling.law)
        run()
        written = path.stat().st_size
        plain = host.folder / "plain"
        as_plainly = _plain_write(plain, written)
        seconds, floor = best_in_turn(run, as_plainly, rounds=10)
        fraction, peers = floor / seconds, _peers(extension, made.mesh, path) if n in SIZES[host.scale] else {}
        others = time_peers(f"write-{extension[1:]}", None, 0, peers)
        if extension != ".inp":
            ours, disk = best_in_turn(_on_disk(run, path), _on_disk(as_plainly, plain), rounds=10)
            fraction, others = disk / ours, {**others, "plain, page cache": floor}
        plain.unlink()
        size = f"{made.mesh.n_elements:,} hexes, {written / 1e6:,.0f} MB"
        yield Row(f"write-{extension[1:]}", size, "host", seconds, written, fraction, others)


def _model(n: int) -> Model:
    sampling = Sampling(find_law(), (n + 1,) * 3)
    return pipeline.sample_patch(random_patch(PAPER, 3), sampling, open_device(), Clock())


def _check_file(path: Path) -> None:
    """Write a small mesh and have it read by other code than ours, where there is any for the format."""
    mesh = _model(3).mesh
    write(mesh, path)
    try:
        points, cells = _read(path)
    except ImportError:
        return
    check(f"nodes of {path.name}", points.T, mesh.points.T, 1e-6)
    check(f"elements of {path.name}", cells.T, mesh.cells.T, 0)


def _read(path: Path) -> tuple[Any, Any]:
    if path.suffix in (".vts", ".vtkhdf"):
        grid = peer("pyvista").read(path).cast_to_unstructured_grid()
        return np.asarray(grid.points), grid.cells.reshape(-1, 9)[:, 1:]
    import meshio

    found = meshio.read(path)
    return found.points, found.cells[0].data


def _plain_write(path: Path, count: int) -> Run:
    """Give what writes as many random bytes."""
    block = memoryview(np.random.default_rng(11).bytes(min(BLOCK, count)))

    def run() -> None:
        with open(path, "wb", buffering=0) as file:
            for left in range(count, 0, -len(block)):
                file.write(block[:left])

    return run


def _on_disk(run: Run, path: Path) -> Run:
    """Give what writes a file and waits until the disk has it."""

    def wait() -> None:
        run()
        with open(path, "rb") as file:
            os.fsync(file.fileno())

    return wait


def _peers(extension: str, mesh: Mesh, path: Path) -> dict[str, Peer]:
    if extension == ".vtkhdf":
        return {}
    if extension == ".inp":
        return {"meshio": lambda: _meshio(mesh, path, file_format="abaqus")}
    meshio: dict[str, Peer] = {"meshio": lambda: _meshio(mesh, path, file_format="vtu", compression=None)}
    return {**(meshio if extension == ".vtu" else {}), "VTK": lambda: _vtk(mesh, path)}


def _meshio(mesh: Mesh, path: Path, **options: Any) -> tuple[Any, Any]:
    meshio, form = peer("meshio"), mesh.to_meshio()
    form.point_sets, form.cell_sets = {}, {}
    return lambda: meshio.write(path, form, **options), lambda _: None


def _vtk(mesh: Mesh, path: Path) -> tuple[Any, Any]:
    """Write appended raw blocks without compression, the fastest that VTK's own writers have."""
    vtk, grid = peer("vtkmodules.vtkIOXML"), _grid(mesh, path.suffix == ".vts")
    writer = vtk.vtkXMLStructuredGridWriter() if path.suffix == ".vts" else vtk.vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToNone()
    return writer.Write, lambda _: None


def _grid(mesh: Mesh, structured: bool) -> Any:
    pyvista = peer("pyvista")
    if not structured:
        return mesh.to_pyvista()
    grid = pyvista.StructuredGrid()
    grid.points, grid.dimensions = np.ascontiguousarray(mesh.points), mesh.structure
    for name, values in mesh.fields.items():
        grid.point_data[name] = values
    for name, values in mesh.cell_fields.items():
        grid.cell_data[name] = values
    return grid
