"""Evaluation, quality and material over the nodes of one mesh, one after another without leaving the device.

Floors, a node: x, y, z and HU, density, modulus, Poisson's ratio and piece, and a scaled Jacobian written, 36 bytes;
nothing has to be read back. Operations: 40 for the place, 80 for the law, 180 for the quality (``bench_quality``), 300
in all. Held against ``writing``.

Operations, not bytes, are what a pass takes, so that the sum stays far above 1.25 times its slowest part: 300 are 1.7
times the 180 of quality. Were edges made once a node and direction, 3 instead of 8 a hex, they would be 250, still 1.4
times; and were all three as fast as memory, 36 bytes beside the 20 of the law would be 1.8 times. On a core of Zen 5 by
PoCL, at 200^3: evaluation 4.5 ms, material 6.6, quality 11.5, where it took 24 when the aim was set, the pass 22.5;
stores alone 7.5. Each part that becomes faster takes the sum down, and quality the ratio up.

The law could go near 3.7 ms, which its stores take, were it not a chain: a core's queues hold one vector and a half of
it. With products and sums fused it takes 5.7, in two steps of eight vectors each 5.2.

One pass was tried: bands of 16 rows that stay in a core's second cache, edges made once, results streamed between the
arithmetic of one loop. Leaving the stores out changed nothing: they are hidden. The rest adds up: 3 ms for the first
two directions of the patch, 6 for its nodes, 7 for the law, 4 for edges and 8 for determinants, which read the edges
from the second cache; 28 ms in all, against 27 of three launches then.

Peers: the slowest of the three alone, and their sum; ``stores alone`` fills as many bytes and does nothing else; VTK's
quality, without nodes and material, on one thread. Quality is held to 25 times VTK, and all three to 1.25 times
quality, which together are 20 times VTK's quality.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.bench_bandwidth import fill
from gpubspline.bench.bench_evaluate import PAPER, random_patch
from gpubspline.bench.bench_quality import by_formula, vtk_quality
from gpubspline.bench.measure import Place, Row, best_of, check, time_peers
from gpubspline.bench.recorder import Recorder
from gpubspline.device import Device
from gpubspline.material.laws import Law
from gpubspline.material.mapping import map_material
from gpubspline.material.registry import law as find_law
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import scaled_jacobian
from gpubspline.spline.hyperpatch import Hyperpatch

SIZES = {"full": 200, "quick": 200, "tiny": 8}
BYTES = 36
Result = tuple[Mesh, NDArray[Any], NDArray[Any]]


def evaluated(patch: Hyperpatch, n: int, device: Device) -> Mesh:
    """Sample a patch at n x n x n nodes."""
    lattice = np.reshape(patch.evaluate_grid([np.linspace(0, 1, n)] * 3, device), (-1, 4), order="F")
    return Mesh(lattice[:, :3], "hex8", structure=(n, n, n), fields={"HU": lattice[:, 3]})


def three_launches(patch: Hyperpatch, n: int, law: Law, device: Device) -> Result:
    """Mesh, scaled Jacobians (m,) and moduli (n,), by the functions that do one thing each."""
    mesh = evaluated(patch, n, device)
    return mesh, scaled_jacobian(mesh, device), map_material(mesh.fields["HU"], law, device=device).modulus_mpa


def stores_alone(n: int, device: Device) -> Callable[[], None]:
    """Write what the pass writes, one array after another, and nothing else."""
    counts = [4 * n**3, *[n**3] * 4, (n - 1) ** 3]
    written = [(device.empty(count), count) for count in counts]

    def run() -> None:
        for buffer, count in written:
            fill(device, buffer, 0.5, count)
        device.wait()

    return run


PASS: Callable[[Hyperpatch, int, Law, Device], Result] = three_launches


def rows(place: Place) -> Iterator[Row]:
    """Time the pass beside its parts, which stand where other rows have peers."""
    patch, n, law, whole = random_patch(PAPER, 3), SIZES[place.scale], find_law(), Recorder(place.device)
    mesh, quality, modulus = PASS(patch, n, law, whole)
    parts = [Recorder(place.device) for _ in range(3)]
    apart = evaluated(patch, n, parts[0])
    scaled_jacobian(apart, parts[1])
    material = map_material(apart.fields["HU"], law, device=parts[2])
    some = np.random.default_rng(9).integers(0, apart.n_elements, 1000)
    check("nodes of the fused pass", mesh.planes, apart.planes, 1e-6)
    check("quality of the fused pass", quality[some], by_formula(apart, some), 1e-4)
    check("modulus of the fused pass", modulus, material.modulus_mpa, 1e-5)
    alone = [best_of(part.replay) for part in parts]
    others: dict[str, float | None] = {"slowest part": max(alone), "all parts": sum(alone)}
    others["stores alone"] = best_of(stores_alone(n, place.device))
    others |= time_peers("quality", None, 0.0, {"VTK, quality alone": partial(vtk_quality, apart, explicit=False)})
    seconds, floor = best_of(whole.replay), BYTES * n**3 / place.writing
    yield Row("fused", f"{n}x{n}x{n} nodes", place.device.name, seconds, n**3, floor / seconds, others)
