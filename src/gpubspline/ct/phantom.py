"""Phantoms: CT scans of analytic bodies, whose boundary and HU are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from gpubspline.ct.bodies import Body, Floats
from gpubspline.ct.femur import ADULT, CHILD, femur
from gpubspline.ct.head import head
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError

Progress = Callable[[int, int], None]

SUBSLICES = 3  # positions within the slice thickness over which the scanner averages
NOISE_GRAIN = 0.6  # voxels: reconstruction correlates the noise of neighbours
STORED_HU = (-1024, 3071)  # 12 bits


@dataclass(frozen=True, eq=False)
class Phantom:
    """An analytic body and the scan that is made of it.

    Attributes
    ----------
    name: one of ``PHANTOMS``.
    body: its exact boundary and HU.
    affine: (4, 4) float64, from the voxel index (i, j, k) to LPS mm; slices are as thick as they lie apart.
    shape: voxels along i, j, k.
    blur_mm: standard deviation of the scanner's Gaussian point spread within a slice.
    noise_hu: standard deviation of the noise.
    seed: of the noise.
    """

    name: str
    body: Body
    affine: Floats
    shape: tuple[int, int, int]
    blur_mm: float
    noise_hu: float
    seed: int

    def level(self, points: Floats) -> Floats:
        """(...) mm at points (..., 3) in LPS mm, negative inside: zero exactly on the outer boundary."""
        return self.body.level(np.asarray(points, dtype=np.float64))

    def distance_mm(self, points: Floats) -> Floats:
        """Signed distance (...) to the outer boundary at points (..., 3): the level over its slope.

        Exact on the boundary and, to second order, near it.
        """
        points = np.asarray(points, dtype=np.float64)
        steps = 1e-4 * np.eye(3)
        slope = np.stack([self.level(points + step) - self.level(points - step) for step in steps], axis=-1) / 2e-4
        return np.asarray(self.level(points) / np.maximum(np.linalg.norm(slope, axis=-1), 1e-6))

    def hu(self, points: Floats) -> Floats:
        """Exact HU (...) at points (..., 3) in LPS mm, before any scanner."""
        return self.body.hu(np.asarray(points, dtype=np.float64))

    def scan(self, progress: Progress | None = None) -> Volume:
        """Scan the body: partial volume, point spread, noise, whole HU of 12 bits.

        Arguments
        ---------
        progress: called with the number of slices done and their total.

        Returns: int16 HU; the same each time.
        """
        n_i, n_j, n_k = self.shape
        hu = np.empty((n_k, n_j, n_i), np.int16)
        noise = np.random.default_rng(self.seed)
        for k in range(n_k):
            grain = ndimage.gaussian_filter(noise.standard_normal((n_j, n_i)), NOISE_GRAIN)
            image = self._slice(k) + grain * (self.noise_hu / grain.std())
            hu[k] = np.clip(np.rint(image), *STORED_HU)
            if progress:
                progress(k + 1, n_k)
        return Volume(hu, self.affine, f"phantom {self.name}")

    def _slice(self, k: int) -> Floats:
        """(n_j, n_i) HU of a slice without noise."""
        n_i, n_j, _ = self.shape
        pixel_mm = float(np.linalg.norm(self.affine[:3, 0]))
        j, i = np.meshgrid(np.arange(n_j, dtype=np.float64), np.arange(n_i, dtype=np.float64), indexing="ij")
        flat = np.stack([i.ravel(), j.ravel(), np.full(i.size, float(k))], axis=-1)
        points = flat @ self.affine[:3, :3].T + self.affine[:3, 3]
        thickness = self.affine[:3, 2]
        reached = self.level(points) < np.linalg.norm(thickness) + pixel_mm  # the rest is surroundings all through
        image = np.full(i.size, self.body.surrounding_hu)
        parts = (np.arange(SUBSLICES) + 0.5) / SUBSLICES - 0.5
        near = points[reached]
        image[reached] = np.mean([self.body.hu(near + part * thickness, pixel_mm) for part in parts], axis=0)
        return np.asarray(ndimage.gaussian_filter(image.reshape(n_j, n_i), self.blur_mm / pixel_mm, mode="nearest"))


def _axial(spacing_mm: tuple[float, float, float], origin: tuple[float, float, float]) -> Floats:
    affine = np.diag([*spacing_mm, 1.0])
    affine[:3, 3] = origin
    return affine


def _child_femur() -> Phantom:
    affine = _axial((0.45, 0.45, 3.0), (-50.0, -36.0, 0.0))
    return Phantom("child-femur", femur(CHILD), affine, (176, 160, 34), blur_mm=0.45, noise_hu=12.0, seed=4)


def _adult_femur() -> Phantom:
    affine = _axial((0.6, 0.6, 2.0), (-77.0, -48.0, 0.0))
    return Phantom("adult-femur", femur(ADULT), affine, (208, 160, 97), blur_mm=0.6, noise_hu=12.0, seed=5)


def _head() -> Phantom:
    affine = _axial((0.95, 0.95, 3.4), (-121.0, -129.0, 0.0))
    return Phantom("head", head(), affine, (256, 256, 55), blur_mm=0.8, noise_hu=10.0, seed=6)


PHANTOMS: dict[str, Callable[[], Phantom]] = {"child-femur": _child_femur, "adult-femur": _adult_femur, "head": _head}


def phantom(name: str) -> Phantom:
    """Give a phantom by name: ``"child-femur"`` (34 slices), ``"adult-femur"`` (97) or ``"head"`` (55).

    Raises InputError for any other name.
    """
    if name not in PHANTOMS:
        raise InputError(f"expected a phantom of {', '.join(PHANTOMS)}, got {name!r}")
    return PHANTOMS[name]()
