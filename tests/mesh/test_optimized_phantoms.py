"""Meshes of the tensor method and of five patches, optimised: the floor under the worst hex, and the surface kept."""

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


@pytest.fixture(scope="module")
def femur():
    """The child's femur, as a scan and a region."""
    volume = phantom("child-femur").scan()
    return volume, region_from_threshold(volume, otsu_threshold(volume))


def test_tensor_meshes_of_the_shaft(femur, both_devices):
    """The paper's 11 x 18 x 34 at fewer samples: no hex below 0.3 where the map leaves 0.16, the surface kept."""
    volume, region = femur
    device = both_devices[1]
    patch = fit(control_lattice(volume, region, (11, 18, 34)), device=device).patch
    mesh, done = optimize(sample(patch, (8, 12, 24), device=device), device)
    assert done.before < 0.2 and done.after > 0.3
    assert done.boundary_mm < 0.1 * float(volume.spacing_mm.min())
    assert certify(mesh, device).certificate.valid


def test_five_patches_of_the_shaft(femur, both_devices):
    """Without corners on the smooth contour there is nothing to stop at: 0.6 and more."""
    volume, region = femur
    device = both_devices[1]
    made = butterfly(region, volume, device=device)
    mesh, done = optimize(sample_butterfly(made, (5, 5, 3, 60), device=device), device)
    assert done.before < 0.3 and done.after > 0.6
    assert done.boundary_mm < 0.15 * float(volume.spacing_mm.min())
    assert certify(mesh, device).certificate.valid
