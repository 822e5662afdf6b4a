"""The figures of a run as one JSON document, without anything that identifies a patient."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.files import whole_file
from gpubspline.material.mapping import Material
from gpubspline.mesh.distance import SurfaceDistance
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality


def summary(
    mesh: Mesh,
    quality: Quality,
    device: Device,
    seconds: dict[str, float],
    *,
    material: Material | None = None,
    region_size: float | None = None,
    distance: SurfaceDistance | None = None,
    threshold_hu: float | None = None,
    fit: str | None = None,
    fit_error_mm: float | None = None,
    fit_error_hu: float | None = None,
) -> dict[str, Any]:
    """Collect the figures of a run.

    Arguments
    ---------
    mesh: the mesh, with its nodal HU and modulus where it has them.
    quality: of its elements.
    device: where the kernels ran.
    seconds: wall time of each stage by name; ``total`` is added where it is missing.
    material: of its nodes.
    region_size: volume of the region, mm3, or the area, mm2, of its section that a quad mesh fills.
    distance: from the mesh's surface to the region's.
    threshold_hu: what separated the region.
    fit, fit_error_mm, fit_error_hu: how the control points were made, and the patch's distance from the data.

    Returns
    -------
    dict of plain numbers, texts, lists and dicts; what is not known is None, as are the volumes of a quad
    mesh and the areas of a hex mesh.
    """
    solid = mesh.element.dimension == 3
    return {
        "nodes": mesh.n_nodes,
        "elements": mesh.n_elements,
        "element_type": mesh.element_type,
        "scaled_jacobian": quality.to_dict(),
        "volume_mm3": _pair(mesh.volume_mm3, region_size) if solid else _pair(None, None),
        "area_mm2": _pair(None, None) if solid else _pair(mesh.area_mm2, region_size),
        "surface_distance_mm": None if distance is None else distance.to_dict(),
        "hu": _spread(mesh.fields.get("HU")),
        "modulus_mpa": _spread(mesh.fields.get("E_MPa")),
        "out_of_range_nodes": None if material is None else material.out_of_range,
        "law": None if material is None else describe_material(material),
        "threshold_hu": threshold_hu,
        "fit": {"method": fit, "error_mm": fit_error_mm, "error_hu": fit_error_hu},
        "backend": device.backend,
        "device": device.label,
        "precision": device.real.name,
        "seconds": {"total": sum(seconds.values()), **seconds},
    }


def describe_material(material: Material) -> dict[str, Any]:
    """Name a law with its pedigree, and the policy for HU outside it."""
    law = material.law
    return {
        "name": law.name,
        "title": law.title,
        "citation": law.citation,
        "density": law.density.kind,
        "density_source": law.density.source,
        "range_hu": list(law.range_hu),
        "unconfirmed": list(law.unconfirmed),
        "out_of_range_policy": material.policy,
    }


def _pair(mesh: float | None, region: float | None) -> dict[str, float | None]:
    return {"mesh": mesh, "region": region}


def _spread(values: NDArray[Any] | None) -> dict[str, float] | None:
    if values is None:
        return None
    return {"min": float(values.min()), "max": float(values.max()), "mean": float(values.mean(dtype=np.float64))}


def write_summary(figures: dict[str, Any], path: str | Path) -> None:
    """Write a summary as JSON, whole or not at all.

    Raises
    ------
    InputError where a figure is not finite or not plain, or the file cannot be written.
    """
    try:
        text = json.dumps(figures, indent=2, allow_nan=False, ensure_ascii=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise InputError(f"expected finite plain figures in the summary, got: {error}") from None
    with whole_file(Path(path)) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's own."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no plain figure")
