"""A femur for the tests of decks: coarse, with material, and a load case that uses all there is."""

from dataclasses import replace
from functools import cache

import numpy as np

from gpubspline.analysis.load_case import LoadCase, read_load_case
from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import region_from_threshold
from gpubspline.device import open_device
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.spline.fit import fit
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.spline.lattice import control_lattice

ALL_LOADS = """
title = "Pulled, pressed and heavy"
[regions."the top"]
cap = {{ towards = [0, 0, 1], depth_mm = 9 }}
[regions.ball]
sphere = {{ centre_mm = [{0}, {1}, {2}], radius_mm = 14 }}
[[fixed]]
region = "w0"
[[fixed]]
region = "ball"
components = "x"
displacement_mm = [0.25, 0, 0]
[[force]]
region = "the top"
force_n = [10, -20, -300]
[[pressure]]
region = "u1"
pressure_mpa = 0.05
[[pressure]]
region = "ball"
pressure_mpa = 0.3
[gravity]
acceleration_mm_s2 = [0, 981, -9810]
"""


@cache
def patch() -> Hyperpatch:
    volume, device = phantom("child-femur").scan(), open_device("opencl", "float64")
    lattice = control_lattice(volume, region_from_threshold(volume, 100.0), (5, 6, 12))
    return fit(lattice, device=device).patch


@cache
def femur(order: int = 1) -> Mesh:
    """The child femur of the phantoms as 220 hexes, with material and a set of some elements."""
    device = open_device("opencl", "float64")
    mesh, _ = apply_material(sample(patch(), (5, 6, 12), order=order, device=device), device=device)
    mesh = mesh.with_cell_fields({"material": np.arange(mesh.n_elements) % 3})
    return replace(mesh, element_sets={**mesh.element_sets, "some elements": np.arange(3, 40, 4)})


@cache
def all_loads() -> LoadCase:
    """A force, a pressure on whole faces and one on parts of faces, gravity, and a support that moves."""
    faces = femur().boundary("v1")
    return read_load_case(ALL_LOADS.format(*femur().points[faces[len(faces) // 2, 0]]), "all")
