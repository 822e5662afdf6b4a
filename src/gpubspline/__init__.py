"""Patient-specific finite element models from CT: B-spline solids sampled to all-hexahedral meshes with material.

A run, step by step: ``read_volume``, ``region_from_threshold`` or ``region_from_mask``; then ``control_lattice``,
``fit`` and ``sample``, or ``blocks_mesh`` for any shape; ``apply_material`` or ``assign``; ``assess``, ``write``; and
``load_case`` with ``respond`` for its stress. ``read``, ``region`` and ``patch`` do the first of them in one call each.

Public names are imported when first used: ``import gpubspline`` loads no kernel backend and takes no time. What the
result stands in spite of is a ``GpubsplineWarning``, for the module ``warnings``; what it cannot be made from is one of
the errors below ``GpubsplineError``. Nothing is printed.
"""

import importlib
from typing import TYPE_CHECKING, Any

from gpubspline.errors import BackendUnavailable as BackendUnavailable
from gpubspline.errors import GpubsplineError as GpubsplineError
from gpubspline.errors import GpubsplineWarning as GpubsplineWarning
from gpubspline.errors import InputError as InputError
from gpubspline.errors import MeshError as MeshError

if TYPE_CHECKING:
    from gpubspline.analysis.convergence import converge as converge
    from gpubspline.analysis.elasticity import solve as solve
    from gpubspline.analysis.law_comparison import compare_laws as compare_laws
    from gpubspline.analysis.load_case import load_case as load_case
    from gpubspline.analysis.load_case import load_cases as load_cases
    from gpubspline.analysis.loads import assemble as assemble
    from gpubspline.analysis.response import respond as respond
    from gpubspline.analysis.study import Study as Study
    from gpubspline.analysis.study import run_study as run_study
    from gpubspline.clock import Clock as Clock
    from gpubspline.ct.image import read_volume as read_volume
    from gpubspline.ct.masks import open_labels as open_labels
    from gpubspline.ct.masks import read_mask as read_mask
    from gpubspline.ct.phantom import phantom as phantom
    from gpubspline.ct.phantom_dicom import write_phantom as write_phantom
    from gpubspline.ct.region import Region as Region
    from gpubspline.ct.region import otsu_threshold as otsu_threshold
    from gpubspline.ct.region import region_from_mask as region_from_mask
    from gpubspline.ct.region import region_from_threshold as region_from_threshold
    from gpubspline.ct.volume import Volume as Volume
    from gpubspline.device import list_devices as list_devices
    from gpubspline.device import open_device as open_device
    from gpubspline.export import read_mesh as read_mesh
    from gpubspline.export import write as write
    from gpubspline.export.from_pyvista import from_pyvista as from_pyvista
    from gpubspline.material.assign import Mapping as Mapping
    from gpubspline.material.assign import assign as assign
    from gpubspline.material.calibration_file import read_calibration as read_calibration
    from gpubspline.material.laws import Law as Law
    from gpubspline.material.mapping import apply_material as apply_material
    from gpubspline.material.registry import law as law
    from gpubspline.material.registry import laws as laws
    from gpubspline.mesh.blocks.mesher import blocks_mesh as blocks_mesh
    from gpubspline.mesh.blocks.refine import refine as refine
    from gpubspline.mesh.blocks.result import Blocks as Blocks
    from gpubspline.mesh.butterfly.patches import butterfly as butterfly
    from gpubspline.mesh.butterfly.sample import sample_butterfly as sample_butterfly
    from gpubspline.mesh.distance import surface_distance as surface_distance
    from gpubspline.mesh.label_sets import with_label_sets as with_label_sets
    from gpubspline.mesh.mesh import Mesh as Mesh
    from gpubspline.mesh.optimize import optimize as optimize
    from gpubspline.mesh.quality import Quality as Quality
    from gpubspline.mesh.quality import assess as assess
    from gpubspline.mesh.quality import scaled_jacobian as scaled_jacobian
    from gpubspline.mesh.sample import sample as sample
    from gpubspline.mesh.validity import certify as certify
    from gpubspline.report.histogram import write_histogram as write_histogram
    from gpubspline.report.load_picture import write_load_picture as write_load_picture
    from gpubspline.report.page import Account as Account
    from gpubspline.report.page import write_report as write_report
    from gpubspline.report.picture import write_picture as write_picture
    from gpubspline.spline.fit import fit as fit
    from gpubspline.spline.hyperpatch import Hyperpatch as Hyperpatch
    from gpubspline.spline.hyperpatch import bezier as bezier
    from gpubspline.spline.hyperpatch import hyperpatch as hyperpatch
    from gpubspline.spline.lattice import ControlLattice as ControlLattice
    from gpubspline.spline.lattice import control_lattice as control_lattice
    from gpubspline.spline.model import load_model as load_model
    from gpubspline.spline.model import save_model as save_model
    from gpubspline.steps import patch as patch
    from gpubspline.steps import read as read
    from gpubspline.steps import region as region
    from gpubspline.surface.read import read_surface as read_surface
    from gpubspline.surface.region import region_from_surface as region_from_surface
    from gpubspline.surface.surface import Surface as Surface

_HOME = {
    "analysis.convergence": ("converge",),
    "analysis.elasticity": ("solve",),
    "analysis.law_comparison": ("compare_laws",),
    "analysis.load_case": ("load_case", "load_cases"),
    "analysis.loads": ("assemble",),
    "analysis.response": ("respond",),
    "analysis.study": ("Study", "run_study"),
    "clock": ("Clock",),
    "ct.image": ("read_volume",),
    "ct.masks": ("open_labels", "read_mask"),
    "ct.phantom": ("phantom",),
    "ct.phantom_dicom": ("write_phantom",),
    "ct.region": ("Region", "otsu_threshold", "region_from_mask", "region_from_threshold"),
    "ct.volume": ("Volume",),
    "device": ("list_devices", "open_device"),
    "export": ("read_mesh", "write"),
    "export.from_pyvista": ("from_pyvista",),
    "material.assign": ("Mapping", "assign"),
    "material.calibration_file": ("read_calibration",),
    "material.laws": ("Law",),
    "material.mapping": ("apply_material",),
    "material.registry": ("law", "laws"),
    "mesh.blocks.mesher": ("blocks_mesh",),
    "mesh.blocks.refine": ("refine",),
    "mesh.blocks.result": ("Blocks",),
    "mesh.butterfly.patches": ("butterfly",),
    "mesh.butterfly.sample": ("sample_butterfly",),
    "mesh.distance": ("surface_distance",),
    "mesh.label_sets": ("with_label_sets",),
    "mesh.mesh": ("Mesh",),
    "mesh.optimize": ("optimize",),
    "mesh.quality": ("Quality", "assess", "scaled_jacobian"),
    "mesh.sample": ("sample",),
    "mesh.validity": ("certify",),
    "report.histogram": ("write_histogram",),
    "report.page": ("Account", "write_report"),
    "report.load_picture": ("write_load_picture",),
    "report.picture": ("write_picture",),
    "spline.fit": ("fit",),
    "spline.hyperpatch": ("Hyperpatch", "bezier", "hyperpatch"),
    "spline.lattice": ("ControlLattice", "control_lattice"),
    "spline.model": ("load_model", "save_model"),
    "steps": ("patch", "read", "region"),
    "surface.read": ("read_surface",),
    "surface.region": ("region_from_surface",),
    "surface.surface": ("Surface",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


__all__ = sorted(["BackendUnavailable", "GpubsplineError", "GpubsplineWarning", "InputError", "MeshError", *_MODULE_OF])


def __getattr__(name: str) -> Any:
    """Import a public name from its home."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *_MODULE_OF})
