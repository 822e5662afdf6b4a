"""Samples on a regular grid, kept on a device to be read at many points."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpubspline.ct.volume import Volume
from gpubspline.device import Buffer, Device

TILE = 256  # of a GPU, as in its kernel
RUN = 8  # points that a work item of a GPU takes

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sampler:
    """A grid of samples on a device, interpolated trilinearly; outside it the nearest border value goes on.

    Attributes
    ----------
    device: where it lives.
    middle: (3,) LPS mm; places on the device are given from here, which keeps the digits of float32.
    samples: the grid, i fastest.
    shape: samples along i, j, k.
    to_index: row-major 3 x 4 from mm to the index (i, j, k).
    """

    device: Device
    middle: Floats
    samples: Buffer
    shape: tuple[int, int, int]
    to_index: Buffer

    def launch(self, x: Buffer, y: Buffer, z: Buffer, n: int, out: Buffer) -> None:
        """Write the values (n) at places that are on the device, mm from ``middle``."""
        run = 1 if self.device.cores else RUN
        items = n if self.device.cores else -(-n // (TILE * RUN)) * TILE
        sampled = (self.samples, *self.shape, self.to_index, x, y, z)
        self.device.launch("resample.trilinear", items, *sampled, 0.0, 1, run, n, out)

    def at(self, points: ArrayLike) -> Floats:
        """Values (s,) at points (s, 3), LPS mm."""
        planes = np.ascontiguousarray((np.asarray(points, dtype=np.float64) - self.middle).T)
        out = self.device.empty(planes.shape[1])
        x, y, z = (self.device.put(plane) for plane in planes)
        self.launch(x, y, z, planes.shape[1], out)
        return np.array(self.device.get(out), dtype=np.float64)


def sampler(samples: NDArray[Any], affine: Floats, points: NDArray[Any], device: Device) -> Sampler:
    """Bring the part of a grid that holds some points to a device.

    Arguments
    ---------
    samples: (n_k, n_j, n_i) values.
    affine: (4, 4), index (i, j, k) to LPS mm.
    points: (s, 3), LPS mm; two samples around their box are kept, so that points may be moved a little.
    """
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    middle = (low + high) / 2
    inverse = np.linalg.inv(affine)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    at = corners @ inverse[:3, :3].T + inverse[:3, 3]
    last = np.array(samples.shape[::-1]) - 1
    first = np.clip(np.floor(at.min(axis=0)).astype(int) - 2, 0, last)
    end = np.clip(np.ceil(at.max(axis=0)).astype(int) + 2, 0, last) + 1
    part = samples[tuple(slice(int(a), int(b)) for a, b in zip(first[::-1], end[::-1], strict=True))]
    to_index = inverse[:3].copy()
    to_index[:, 3] += to_index[:, :3] @ middle - first
    n_k, n_j, n_i = part.shape
    values = np.ascontiguousarray(part, dtype=device.real)
    return Sampler(device, middle, device.put(values), (n_i, n_j, n_k), device.put(to_index))


def hu_sampler(volume: Volume, points: NDArray[Any], device: Device) -> Sampler:
    """Bring the HU around some points (s, 3), LPS mm, to a device."""
    return sampler(volume.hu, volume.affine, points, device)
