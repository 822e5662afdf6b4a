"""The stages of the blocks method against hexes: seconds, share of the whole, how near to the floor, how they grow.

The body is the three arms of ``bench_blocks``, meshed on one place of the lattice. The library's functions are timed
where the mesher calls them; then its mesh is certified and written. ``rest`` is what is done between them.

Growth: the exponent of processor seconds in hexes, fitted to all meshes of a run by least squares of logarithms, of the
whole and of each stage; 1 is linear. What a process does once (imports, kernels compiled, a first small mesh) comes
before and is not counted, nor is the file, whose writing waits for a disk.

Floors, the bytes that the algorithm has to move, at ``triad``; where arithmetic takes longer, its operations. Samples
near the surface, within 3 elements of it in whole bricks, are counted apart: what is farther is only filled in.

* level set: a sample near is written once, then read and written by three passes of a distance transform of two bytes
  (closing), three of each of two Gaussians, one that gives back volume: 76 bytes; of all samples four are written and
  read to tell bodies apart: 8.
* core: a 27th of the samples is read, four bytes, and a byte written for each cell, 27 samples: 5/27 bytes a sample.
* repair: in each of at least one round a byte is read and one pattern written for a cell: 2/27 bytes a sample.
* topology: the core at samples, a byte written, compared with the level set's inside, two bytes read, each time.
* pillow: 32 bytes of vertices a hex, 24 of a place a node, written.
* reach: of samples near, three passes of a distance transform of two bytes, three of a Gaussian, three means: 60 bytes;
  each clamp reads two fields and writes one, 12 bytes near, and copies all samples, 8.
* start: 20 rounds read 6 neighbours' numbers, weights and places of a node and write it: 20 x (6 x 20 + 12) bytes.
* settle, lift (stages A and B): an evaluation reads 8 numbers of nodes and 3 lengths of a hex, writes 24 shares and its
  energy, 144 bytes; by node 24 shares and 8 slots are read, a place twice, what holds it, and normal and gradient
  written, 200 bytes: 344. Its operations: 12 edges of 24, 8 corners of 77, 72 sums: 976. A step reads 25 rows of memory
  twice and 5 vectors, and writes 4, each 12 bytes a node: 708.
* features: what the reach leaves out is told from two fields, 8 bytes a sample, each time.
* sag: second differences read and written near, 8 bytes; all samples copied, 8, and read for the volume inside, 4.
* even: small parts of the mesh, or nothing: no floor.
* certify: 32 bytes of vertices and a node's 12 read, 5 written: 49 bytes a hex.
* write: the file's bytes, by plain writing.

Small meshes lie in the caches, which are faster than ``triad``.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

from gpubspline.bench.bench_blocks import three_arms
from gpubspline.bench.bench_elasticity import arithmetic
from gpubspline.bench.measure import Place, Row, check
from gpubspline.bench.recorder import Recorder
from gpubspline.ct.region import Region
from gpubspline.export import write
from gpubspline.mesh.blocks import grow, lay, mesher, place
from gpubspline.mesh.blocks.bricks import EDGE, bricks_round
from gpubspline.mesh.blocks.level_set import CLIP
from gpubspline.mesh.blocks.result import Blocks
from gpubspline.mesh.element_size import size_of
from gpubspline.mesh.validity import certify

HEXES = {"full": (10_000, 100_000, 1_000_000), "quick": (10_000, 50_000, 200_000), "tiny": (500, 1_000)}
"""About so many are asked for."""

STAGES: tuple[tuple[str, Any, str], ...] = (
    ("level set", lay, "level_set"),
    ("core", grow, "core_cells"),
    ("core", lay, "core_cells"),
    ("repair", grow, "repair"),
    ("repair", lay, "repair"),
    ("pillow", grow, "pillow"),
    ("topology", grow, "differences"),
    ("topology", lay, "differences"),
    ("reach", grow, "core_distance"),
    ("reach", lay, "within_reach"),
    ("reach", place, "within_reach"),
    ("features", lay, "lost_features"),
    ("features", grow, "lost_features"),
    ("sag", place, "bulged"),
    ("sag", place, "volume_inside"),
    ("sag", place, "measure_chords"),
    ("start", place, "start"),
    ("settle", place, "settle"),
    ("lift", place, "lift"),
    ("even", place, "even_out"),
)
"""Where the mesher finds what is timed."""

LARGE_STAGE = 0.02
"""Share of the whole, in the largest mesh, from which a stage's growth is printed."""

EVALUATION_BYTES, EVALUATION_OPERATIONS, STEP_BYTES = 344, 976, 708


class Counted(Recorder):
    """A device that counts launches and keeps nothing."""

    def __init__(self, place: Place) -> None:
        super().__init__(place.device)
        self.counts: dict[str, int] = {}

    def launch(self, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        self.counts[kernel] = self.counts.get(kernel, 0) + 1
        self._device.launch(kernel, dim, *args)


class Stopwatch:
    """Seconds, launches and calls of stages, none of which is within another."""

    def __init__(self, device: Counted) -> None:
        self.device = device
        self.seconds: dict[str, float] = {}
        self.processor: dict[str, float] = {}
        self.launches: dict[str, dict[str, int]] = {}
        self.calls: dict[str, int] = {}

    def timed(self, name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Do the same work as a stage."""

        def run(*args: Any, **options: Any) -> Any:
            self.device.wait()
            self.device.counts, start, worked = {}, time.perf_counter(), time.process_time()
            made = work(*args, **options)
            self.device.wait()
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
            self.processor[name] = self.processor.get(name, 0.0) + time.process_time() - worked
            before = self.launches.setdefault(name, {})
            for kernel, count in self.device.counts.items():
                before[kernel] = before.get(kernel, 0) + count
            self.calls[name] = self.calls.get(name, 0) + 1
            return made

        return run


def rows(place: Place) -> Iterator[Row]:
    """Time the stages of meshes of more and more hexes, then say how they grow."""
    region = three_arms()
    mesher.blocks_mesh(region, 6.0, device=place.device, attempts=1)  # compiles the kernels
    counts, worked = list[int](), list[dict[str, float]]()
    for count in HEXES[place.scale]:
        watch, made = _meshed(region, count, place)
        mesh, device = made.mesh, watch.device
        check("the worst scaled Jacobian by its formula", made.report.min_scaled_jacobian, least(made), 1e-4)
        watch.timed("certify", certify)(mesh, device)
        counts.append(mesh.n_elements)
        worked.append(dict(watch.processor))
        with TemporaryDirectory() as folder:
            path = Path(folder) / "mesh.vtu"
            watch.timed("write", write)(mesh, path)
            floors = floors_of(watch, made, place) | {"write": plainly_written(path)}
        total = sum(watch.seconds.values())
        size, name = f"{mesh.n_elements:,} hex8", place.device.name
        each = f"{1e6 * sum(worked[-1].values()) / mesh.n_elements:.0f} us of a core a hex"
        yield Row("blocks", f"{size}, {each}", name, total, mesh.n_elements, sum(floors.values()) / total)
        for stage, seconds in watch.seconds.items():
            share = floors[stage] / seconds if stage in floors else None
            yield Row("blocks-stage", f"{size}, {stage} {seconds / total:.1%}", name, seconds, mesh.n_elements, share)
    yield from _growth(counts, worked, place.device.name)


def _meshed(region: Region, count: int, place: Place) -> tuple[Stopwatch, Blocks]:
    watch = Stopwatch(Counted(place))
    start, worked = time.perf_counter(), time.process_time()
    with ExitStack() as stack:
        for name, home, function in STAGES:
            stack.enter_context(patch.object(home, function, watch.timed(name, getattr(home, function))))
        made = mesher.blocks_mesh(region, size_of(region, count), device=watch.device, attempts=1)
    whole, worked = time.perf_counter() - start, time.process_time() - worked
    watch.seconds["rest"] = max(whole - sum(watch.seconds.values()), 1e-9)
    watch.processor["rest"] = max(worked - sum(watch.processor.values()), 1e-9)
    return watch, made


def _growth(counts: list[int], worked: list[dict[str, float]], name: str) -> Iterator[Row]:
    """Exponents of processor seconds in hexes, of the whole and of each stage."""
    wholes = [sum(stages.values()) for stages in worked]
    span = f"{counts[0]:,} to {counts[-1]:,} hex8"
    yield _grown(span, counts, wholes, name)
    for stage, seconds in worked[-1].items():
        if seconds > LARGE_STAGE * wholes[-1]:
            yield _grown(f"{span}, {stage}", counts, [stages[stage] for stages in worked], name)


def _grown(what: str, counts: list[int], seconds: list[float], name: str) -> Row:
    exponent = float(np.polyfit(np.log(counts), np.log(np.maximum(seconds, 1e-6)), 1)[0])
    return Row("blocks-growth", f"{what}, exponent {exponent:.2f}", name, seconds[-1], counts[-1])


def least(made: Blocks) -> float:
    """Worst scaled Jacobian, in float64 on the host, from the unit edges at each corner."""
    points, cells, found = made.mesh.points.astype(np.float64), made.mesh.cells, np.inf
    for corner, (u, v, w) in enumerate(
        ((1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3))
    ):
        edges = points[cells[:, (u, v, w)]] - points[cells[:, corner]][:, None]
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        found = min(found, float(np.linalg.det(edges).min()))
    return found


def floors_of(watch: Stopwatch, made: Blocks, place: Place) -> dict[str, float]:
    """Least seconds of each stage."""
    samples, hexes, nodes, calls = made.level.phi.size, made.mesh.n_elements, made.mesh.n_nodes, watch.calls
    near = bricks_round(made.level.phi, CLIP).count * EDGE**3
    moved = {
        "level set": 76.0 * near + 8.0 * samples,
        "core": samples * 5 / 27,
        "repair": samples * 2 / 27,
        "topology": 3.0 * samples * calls["topology"],
        "pillow": 32.0 * hexes + 24.0 * nodes,
        "reach": 60.0 * near + (12.0 * near + 8.0 * samples) * (calls["reach"] - 1),
        "start": 20 * (6 * 20 + 12.0) * nodes,
        "features": 8.0 * samples * calls["features"],
        "sag": 8.0 * near + 12.0 * samples,
        "certify": 49.0 * hexes,
    }
    floors = {name: count / place.triad for name, count in moved.items()}
    rate = arithmetic(place.device.name, "float32", 1 << 16 if place.scale != "tiny" else 1 << 8)
    for name in ("settle", "lift"):
        launches = watch.launches[name]
        evaluations, steps = launches.get("energy.hex_energy", 0), launches.get("quasi_newton.remember", 0)
        bytes_moved = evaluations * EVALUATION_BYTES * hexes + steps * STEP_BYTES * nodes
        floors[name] = max(bytes_moved / place.triad, evaluations * EVALUATION_OPERATIONS * hexes / rate)
    return floors


def plainly_written(path: Path) -> float:
    """Seconds in which a file's bytes go into another."""
    content, other = path.read_bytes(), path.with_suffix(".raw")
    start = time.perf_counter()
    other.write_bytes(content)
    return time.perf_counter() - start
