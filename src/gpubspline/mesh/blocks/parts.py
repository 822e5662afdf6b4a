"""The bodies that the labels of a segmentation part a region into."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from gpubspline.ct.labels import Labels
from gpubspline.ct.region import Region, region_from_mask
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.mesh.label_sets import UNLABELLED, labels_in, set_name

LEAST_VOXELS = 8
"""A label of fewer in the region is no body: its voxels go to the nearest one."""

REST = 0.05
"""Share of the region from which voxels without label are a body; fewer go to the nearest label."""


def parts_of(region: Region, volume: Volume, labels: Labels, whole: Volume) -> tuple[dict[str, Region], dict[str, int]]:
    """Part a region by labels.

    Arguments
    ---------
    region, volume: on one grid, which is a window of that of ``whole``.
    labels: on the grid of ``whole``.

    Returns
    -------
    the bodies by the names of their sets, which fill the region without overlap; the label number of each, 0 for what
    has none.

    Raises
    ------
    InputError where no label has voxels in the region.
    """
    numbers = list(labels.names)
    owner = _settled(np.where(region.mask, labels_in(volume, labels, whole), 0), region.mask)
    found: dict[str, Region] = {}
    number_of: dict[str, int] = {}
    for index in np.unique(owner[region.mask]):
        number = numbers[index - 1] if index > 0 else 0
        name = set_name(labels, number, found) if index > 0 else UNLABELLED
        found[name] = region_from_mask(volume, region.mask & (owner == index), largest=False)
        number_of[name] = number
    if list(number_of.values()) == [0]:
        raise InputError(f"expected labels of {labels.source} within the region, got none there")
    return found, number_of


def _settled(owner: NDArray[Any], inside: NDArray[np.bool_]) -> NDArray[Any]:
    """Give the voxels of labels that are no bodies, and few voxels without label, to the nearest body."""
    counts = np.bincount(owner[inside])
    small = np.flatnonzero(counts < LEAST_VOXELS)
    owner = np.where(np.isin(owner, small), 0, owner)
    without = inside & (owner == 0)
    if not owner.any() or np.count_nonzero(without) > REST * np.count_nonzero(inside):
        return owner
    nearest = distance_transform_edt(owner == 0, return_distances=False, return_indices=True)
    return np.asarray(np.where(inside, owner[tuple(nearest)], 0))
