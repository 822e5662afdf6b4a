"""Clusters of elements: every element once, forces as element by element, whatever the order of the table."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gpubspline.analysis.clusters import LANES, clusters, in_space
from gpubspline.analysis.stiffness import stiffness
from gpubspline.bench.bench_elasticity import nodal_forces, without_structure
from gpubspline.bench.bench_quality import jittered
from gpubspline.device import open_device


def graded(n):
    """A grid with a material, its table of elements in disorder."""
    mesh = jittered(n)
    fields = {"E_MPa": 100 + mesh.points[:, 0] ** 2, "nu": np.linspace(0.1, 0.4, mesh.n_nodes)}
    return without_structure(replace(mesh, fields=fields))


def test_the_curve_takes_every_element_and_fills_the_last_vector():
    mesh = graded(8)
    order = in_space(mesh.points, mesh.cells)
    assert len(order) % LANES == 0 and np.array_equal(np.unique(order), np.arange(mesh.n_elements))
    assert np.array_equal(np.sort(order[: mesh.n_elements]), np.arange(mesh.n_elements))
    middle = mesh.points[mesh.cells[order]].mean(axis=1)
    assert np.median(np.linalg.norm(np.diff(middle, axis=0), axis=1)) < 2  # mm; in disorder they lie 4 mm apart
    whole = graded(5)  # 64 elements, which want no more
    assert len(in_space(whole.points, whole.cells)) == 64


def test_clusters_copy_each_node_once_for_each_of_their_own():
    mesh = graded(14)
    cells = mesh.cells[in_space(mesh.points, mesh.cells)]
    device = open_device("auto", "float64")
    found = clusters(mesh.planes, cells, device)
    of, starts, table = (device.get(buffer) for buffer in (found.of, found.starts, found.cells))
    assert np.array_equal(of[table.reshape(8, -1)].T, cells[:, [0, 1, 3, 2, 4, 5, 7, 6]])
    for first, last in pairwise(starts):
        assert len(np.unique(of[first:last])) == last - first
    assert found.n_copies < 1.9 * mesh.n_nodes < found.n_clusters * mesh.n_nodes


@pytest.mark.parametrize("n", [2, 3, 14])
def test_forces_by_clusters(n, any_device):
    """One element, fewer than a vector holds, and clusters of 1,024 of which the last is cut; 0 where held.

    A GPU, which has no caches to fit clusters to, gives the same forces without.
    """
    mesh = graded(n)
    rng = np.random.default_rng(4)
    u, free = rng.standard_normal((3, mesh.n_nodes)), rng.random((3, mesh.n_nodes)) < 0.8
    k, out = stiffness(mesh, any_device), any_device.empty(3 * mesh.n_nodes)
    assert (k.clusters is None) == (any_device.cores == 0)
    found = []
    for _ in range(2):  # what is left of the first time must not count
        k.apply(any_device.put(u), any_device.put(free.astype(float)), out)
        found.append(np.reshape(any_device.get(out), (3, -1)).copy())
    wanted = nodal_forces(mesh, u) * free
    assert np.array_equal(*found)
    assert np.abs(found[0] - wanted).max() < 20 * np.finfo(any_device.real).eps * np.abs(wanted).max()
