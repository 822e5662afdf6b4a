"""Evaluation, quality and material over the nodes of one mesh, one after another without leaving the device.

Floors, a node: x, y, z and HU, density, modulus, Poisson's ratio and piece, and a scaled Jacobian written, 36 bytes;
nothing has to be read back. Operations: the sum of the parts', about 350. Held against ``fill``.

What one pass over the nodes could save is reading the four planes back, 16 of 52 bytes a node, while the time is that
of arithmetic: on Zen 5 by PoCL, at 200^3, evaluation takes 5 ms of a core, material 7.5 and quality 26, most of it
square roots and divisions, and reading the planes 1 to 3. The sum is 1.5 times its slowest part. Evaluation and
material write 256 MB, and a core writes 25 GB a second: 10 ms of a core, were their arithmetic free. With nothing read
back that is 1.3 times the slowest part, so that 1.25 is out of reach of any pass that does not write while it computes,
node by node; two cores that write at once share the memory's 27 GB a second, and the sum comes to 1.7 or 1.8.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.bench.bench_evaluate import PAPER, random_patch
from gpubspline.bench.bench_quality import by_formula
from gpubspline.bench.measure import Place, Row, best_of, check
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
    seconds, floor = best_of(whole.replay), BYTES * n**3 / place.fill
    yield Row("fused", f"{n}x{n}x{n} nodes", place.device.name, seconds, n**3, floor / seconds, others)
