"""Mapping the CT onto elements: HU read at 2 x 2 x 2 Gauss points of each hex, the law at each, means over the element.

Timed is all of ``integrate``, on the host too: the nodes of each chunk of elements, places, gathers from the volume,
powers, sums, and what comes back, seven values an element. Chunks stay near the caches, so that no bandwidth of the
memory bounds it: none is given.

The rate to beat is that of a published mapper in Python, 1,648 elements a second (its authors' figure, on their machine
and their quadrature); beside it an obvious one by NumPy and SciPy on this machine.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gpubspline.bench.measure import Place, Row, best_of, time_peers
from gpubspline.ct.sampler import hu_sampler
from gpubspline.ct.volume import Volume
from gpubspline.material.integration import integrate
from gpubspline.material.mapping import law_on_device
from gpubspline.material.registry import law as find_law
from gpubspline.mesh.mesh import Mesh

SIZES = {"full": (100, 256), "quick": (64, 128), "tiny": (5, 12)}  # elements and voxels along a side
PUBLISHED = 1648  # elements a second


def _block(n: int, voxels: int) -> tuple[Mesh, Volume]:
    """A twisted block of n x n x n hexes inside a volume of smooth HU with noise."""
    t = np.linspace(-0.6, 0.6, n + 1)
    u, v, w = (a.ravel(order="F") for a in np.meshgrid(t, t, t, indexing="ij"))
    turned = np.stack([u * np.cos(w / 2) - v * np.sin(w / 2), u * np.sin(w / 2) + v * np.cos(w / 2), w], axis=1)
    k, j, i = np.meshgrid(*[np.arange(voxels, dtype=np.float32)] * 3, indexing="ij", sparse=True)
    hu = 900 + 300 * np.sin(i / 7) * np.cos(j / 9) + 200 * np.sin(k / 11)
    hu = hu + np.random.default_rng(3).normal(0, 20, hu.shape).astype(np.float32)
    affine = np.diag([0.7, 0.7, 0.7, 1.0])
    affine[:3, 3] = -0.7 * (voxels - 1) / 2
    points = (turned * 0.7 * voxels / 2).astype(np.float32)
    return Mesh(points, "hex8", structure=(n + 1,) * 3), Volume(hu.astype(np.float32), affine)


def rows(place: Place) -> Iterator[Row]:
    """Time the mean of the law over each element."""
    n, voxels = SIZES[place.scale]
    mesh, volume = _block(n, voxels)
    device, law = place.device, find_law("morgan-2003-femoral-neck")
    there = law_on_device(law, device)

    def run() -> Any:
        sampler = hu_sampler(volume, mesh.points, device)
        return integrate(mesh, there, order="element-e", sampler=sampler, points=2, device=device)

    made = run()
    ours = np.stack([made.hu, made.modulus_mpa])
    others = time_peers("mapping", ours, 2e-4, {"numpy and scipy": partial(_numpy, mesh, volume)})
    others["published, Python"] = mesh.n_elements / PUBLISHED
    size = f"{mesh.n_elements:,} hexes, 8 points each, {voxels}x{voxels}x{voxels} voxels"
    yield Row("mapping", size, device.name, best_of(run), mesh.n_elements, None, others)


def _numpy(mesh: Mesh, volume: Volume) -> tuple[Any, Any]:
    at, weights = mesh.element.gauss()
    shape, slopes = mesh.element.shape(at).astype(np.float32), mesh.element.gradient(at).astype(np.float32)
    power = find_law("morgan-2003-femoral-neck").pieces[0]
    slope = find_law("morgan-2003-femoral-neck").density.slope_g_cm3_per_hu

    def run() -> NDArray[Any]:
        nodes = mesh.points[mesh.cells]
        places = np.einsum("gk,mkc->gmc", shape, nodes, optimize=True)
        tangents = np.einsum("dgk,mkc->gmdc", slopes, nodes, optimize=True)
        weight = np.linalg.det(tangents) * weights[:, None]
        index = volume.to_indices(places)[..., ::-1].reshape(-1, 3).T
        hu = ndimage.map_coordinates(volume.hu, index, np.float32, order=1, mode="nearest").reshape(weight.shape)
        held = np.clip(hu, power.lower_hu, power.upper_hu)
        modulus = power.factor_mpa * (slope * held) ** power.exponent
        return np.stack([(values * weight).sum(axis=0) / weight.sum(axis=0) for values in (hu, modulus)])

    return run, lambda values: values
