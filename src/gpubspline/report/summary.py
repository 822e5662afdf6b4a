"""The figures of a run as one JSON document, without anything that identifies a patient."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.files import check_ending, whole_file
from gpubspline.material.alarms import Alarms
from gpubspline.material.calibration import Calibrated
from gpubspline.material.laws import Law
from gpubspline.material.orthotropy import UNCONFIRMED
from gpubspline.mesh.elements import find_element
from gpubspline.mesh.tally import Spread, Tally
from gpubspline.mesh.validity import Certificate

_HUBER = {"orthotropy_unconfirmed": UNCONFIRMED}


def summary(
    counted: Tally,
    device: Device,
    seconds: dict[str, float],
    *,
    law: Law | None = None,
    law_of_set: Mapping[str, Law] | None = None,
    policy: str | None = None,
    alarms: Alarms | None = None,
    calibrated: Calibrated | None = None,
    transverse: Law | None = None,
    region_size: float | None = None,
    threshold_hu: float | None = None,
    fit: str | None = None,
    fit_error_mm: float | None = None,
    fit_error_hu: float | None = None,
) -> dict[str, Any]:
    """Collect the figures of a run.

    Arguments
    ---------
    counted: the mesh, counted.
    device: where the kernels ran.
    seconds: wall time of each stage by name; ``total`` is added where it is missing.
    law, policy: of the material, and for HU outside it.
    law_of_set: laws of labels, by their element sets.
    alarms: counts of its mapping.
    calibrated: the calibration that the law's density comes from.
    transverse: law across the axis of orthotropic elements.
    region_size: volume of the region, mm3, or the area, mm2, of its section that a quad mesh fills.
    threshold_hu: what separated the region.
    fit, fit_error_mm, fit_error_hu: how the control points were made, and the patch's distance from the data.

    Returns
    -------
    dict of plain numbers, texts, lists and dicts; what is not known is None. A quad mesh has no ``volume_mm3``, a hex
    mesh no ``area_mm2``: both are None there.
    """
    solid = find_element(counted.element_type).dimension == 3
    sizes, none = _pair(counted.size, region_size), _pair(None, None)
    distance = counted.surface_distance
    return {
        "nodes": counted.n_nodes,
        "elements": counted.n_elements,
        "element_type": counted.element_type,
        "method": None,
        "size_mm": None,
        "euler": None,
        "topology": None,
        "off_surface_nodes": None,
        "held_back_nodes": None,
        "lost_features": None,
        "attempts": None,
        "bodies": None,
        "scaled_jacobian": counted.quality.to_dict(),
        **validity_figures(counted.certificate),
        "volume_mm3": sizes if solid else none,
        "area_mm2": none if solid else sizes,
        "mass_g": None if alarms is None else alarms.mass_mesh_g,
        "mass_density": None if alarms is None or alarms.mass_mesh_g is None else alarms.density_kind,
        "surface_distance_mm": None if distance is None else distance.to_dict(),
        "region_distance_mm": None,
        "hu": _spread(counted.spreads.get("HU")),
        "modulus_mpa": _spread(counted.spreads.get("E_MPa")),
        "out_of_range_nodes": counted.out_of_range,
        "law": None if law is None else describe_law(law, policy),
        "law_by_label": _of_sets({"": law, **(law_of_set or {})}, alarms, policy),
        "transverse_law": None if transverse is None else describe_law(transverse, policy) | _HUBER,
        "alarms": None if alarms is None else alarms.to_dict(),
        "calibration": None if calibrated is None else calibrated.to_dict(),
        "threshold_hu": threshold_hu,
        "fit": {"method": fit, "error_mm": fit_error_mm, "error_hu": fit_error_hu},
        "backend": device.backend,
        "device": device.label,
        "precision": device.real.name,
        "seconds": {"total": sum(seconds.values()), **seconds},
    }


def validity_figures(certificate: Certificate | None) -> dict[str, Any]:
    """Whether the determinant is known to be positive throughout every hex; None where it was not asked."""
    if certificate is None:
        return {"certified_valid": None, "jacobian_determinant": None}
    return {"certified_valid": certificate.valid, "jacobian_determinant": certificate.to_dict()}


def _of_sets(laws: Mapping[str, Law | None], alarms: Alarms | None, policy: str | None) -> list[dict[str, Any]] | None:
    """What each label's law makes of its elements, with its pedigree; None of one law. The set ``""`` is the rest."""
    if alarms is None or not alarms.by_label:
        return None
    names = iter(name for name in laws if name)
    found = []
    for share in alarms.by_label:
        name = next(names) if share["label"] else ""
        law = laws[name]
        found.append({"set": name, **share, "law": None if law is None else describe_law(law, policy)})
    return found


def describe_law(law: Law, policy: str | None) -> dict[str, Any]:
    """Name a law with its pedigree, and the policy for HU outside it."""
    return {
        "name": law.name,
        "title": law.title,
        "citation": law.citation,
        "density": law.density.kind,
        "density_source": law.density.source,
        "density_steps": [
            {"name": step.name, "takes": step.takes, "gives": step.gives, "source": step.source}
            | {"slope": step.slope, "intercept": step.intercept}
            for step in law.density.steps
        ],
        "site": law.site,
        "direction": law.direction,
        "strain_rate_per_s": law.strain_rate_per_s,
        "specimens_g_cm3": law.specimens_g_cm3 and list(law.specimens_g_cm3),
        "range_hu": None if law.is_constant else list(law.range_hu),
        "unconfirmed": list(law.all_unconfirmed),
        "out_of_range_policy": policy,
    }


def _pair(mesh: float | None, region: float | None) -> dict[str, float | None]:
    return {"mesh": mesh, "region": region}


def _spread(values: Spread | None) -> dict[str, float] | None:
    return None if values is None else {"min": values.min, "max": values.max, "mean": values.mean}


def check_json(path: Path) -> None:
    """Raise ``InputError`` where ``path`` is not the name of a JSON file."""
    check_ending(path, ".json", "figures")


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
