"""Meshes of the tensor method and of five patches, optimised: the floor under the worst hex, and the surface kept."""

from functools import cache

import pytest

from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import otsu_threshold, region_from_threshold
from gpubspline.mesh.butterfly.patches import butterfly
from gpubspline.mesh.butterfly.sample import sample_butterfly
from gpubspline.mesh.optimize import optimize
from gpubspline.mesh.sample import sample
from gpubspline.mesh.validity import certify
from gpubspline.spline.fit import fit
from gpubspline.spline.lattice import control_lattice


@cache
def scanned(name):
    """A phantom, as a scan and a region."""
    volume = phantom(name).scan()
    return volume, region_from_threshold(volume, otsu_threshold(volume))


def tensor(name, control, nodes, device):
    """Tensor mesh of a phantom, its patch and the least spacing of the scan."""
    volume, region = scanned(name)
    patch = fit(control_lattice(volume, region, control), device=device).patch
    return sample(patch, nodes, device=device), patch, float(volume.spacing_mm.min())


def check_floor(mesh, patch, voxel_mm, device, least=0.3):
    """No hex below the floor or invalid inside, boundary nodes a tenth of a voxel from the patch at most."""
    made, done = optimize(mesh, device, patch=patch)
    assert done.before < 0.2 and done.after > least
    assert done.boundary_mm < 0.1 * voxel_mm
    assert certify(made, device).certificate.valid
    assert made.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=0.01)
    return made


def test_tensor_meshes_of_the_childs_femur(device):
    """The paper's 11 x 18 x 34 at fewer samples."""
    check_floor(*tensor("child-femur", (11, 18, 34), (8, 12, 24), device), device, least=0.4)


def test_tensor_meshes_of_the_adults_femur(both_devices):
    """The paper's counts."""
    check_floor(*tensor("adult-femur", (14, 24, 46), (14, 24, 46), both_devices[1]), both_devices[1])


def test_tensor_meshes_of_the_head(both_devices):
    """Four corner lines on a smooth skull: they open where their edges are longer. The paper's 20 x 80 x 28, fewer."""
    check_floor(*tensor("head", (20, 80, 28), (9, 28, 12), both_devices[1]), both_devices[1])


@pytest.mark.slow
def test_the_papers_counts_of_the_head(both_devices):
    """40,527 hexes."""
    check_floor(*tensor("head", (20, 80, 28), (20, 80, 28), both_devices[1]), both_devices[1])


def test_five_patches_of_the_shaft(both_devices):
    """Without corners on the smooth contour there is nothing to stop at: 0.6 and more."""
    volume, region = scanned("child-femur")
    device = both_devices[1]
    made = butterfly(region, volume, device=device)
    mesh, done = optimize(sample_butterfly(made, (5, 5, 3, 60), device=device), device)
    assert done.before < 0.3 and done.after > 0.6
    assert done.boundary_mm < 0.15 * float(volume.spacing_mm.min())
    assert certify(mesh, device).certificate.valid
