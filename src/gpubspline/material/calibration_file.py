"""Reading the file that describes a calibration.

A TOML file holds one of four::

    kind = "QCT"                       # or "ash", "apparent": which density comes out
    source = "phantom of May"          # optional, repeated in outputs

    slope_g_cm3_per_hu = 0.0008        # 1. a line
    intercept_g_cm3 = -0.01

    points = [[0, 0], [200, 0.19], [1200, 0.9]]      # 2. a table, (HU, g/cm3), straight between

    mask = "rods.nii.gz"               # 3. rods, two or more: as labels of a mask beside this file ...
    [[rods]]
    density_g_cm3 = 0.05
    label = 1                          # a number or a name
    [[rods]]
    density_g_cm3 = 0.2
    centre_mm = [12.5, 240.0, -310.0]  # ... or as places, LPS mm
    radius_mm = 4.0                    # of a ball of voxels about it; 3 unless told

    [tissues]                          # 4. air, fat and muscle of the patient, without a phantom; each may be a table:
    air = {}                           # its HU found in the scan's histogram, its density the default
    fat = {density_g_cm3 = -0.08, centre_mm = [10.0, 20.0, 30.0]}   # or read about a place
    muscle = {hu = 55.0}                                            # or given

``phantomless`` instead of a file is the last, with all three found in the histogram.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpubspline.errors import InputError
from gpubspline.material.calibration import RADIUS_MM, TISSUES, Calibration
from gpubspline.material.density import DENSITY_KINDS, DensityRelation, Step
from gpubspline.tables import checked, is_a, pair, parse, read_text

PHANTOMLESS = "phantomless"
"""What stands for a file of air, fat and muscle, all found in the scan's histogram."""


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration file (schema: this module's docstring), or make the one that ``"phantomless"`` stands for.

    Raises
    ------
    InputError, one line that names the key, for what is no TOML or not of the schema; for one rod, too.
    """
    if str(path) == PHANTOMLESS:
        source = "air, fat and muscle of the scan, after Eggermont et al. 2019"
        return Calibration("QCT", source, "tissues", Path(), tissues=tuple((name, {}) for name in TISSUES))
    path = Path(path)
    where = f"the calibration {path.name}"
    table = parse(read_text(path, "calibration"), path.name)
    methods = {"line": "slope_g_cm3_per_hu", "table": "points", "rods": "rods", "tissues": "tissues"}
    fields = checked(
        table,
        where,
        required={"kind": str},
        optional={
            "source": str,
            "slope_g_cm3_per_hu": float,
            "intercept_g_cm3": float,
            "points": list,
            "mask": str,
            "rods": list,
            "tissues": dict,
        },
    )
    chosen = [method for method, key in methods.items() if key in fields]
    if len(chosen) != 1:
        raise InputError(f"expected one of {', '.join(methods.values())} in {where}, got {len(chosen)} of them")
    (method,), kind, source = chosen, fields["kind"], fields.get("source", path.name)
    if kind not in DENSITY_KINDS:
        raise InputError(f"expected a density kind of {', '.join(DENSITY_KINDS)} in {where}, got {kind!r}")
    if ("intercept_g_cm3" in fields and method != "line") or ("mask" in fields and method != "rods"):
        raise InputError(f"expected intercept_g_cm3 with slope_g_cm3_per_hu and mask with rods alone in {where}")
    made = Calibration(kind, source, method, path.parent)
    return _filled(made, fields, where)


def _filled(made: Calibration, fields: dict[str, Any], where: str) -> Calibration:
    if made.method == "line":
        slope, intercept = float(fields["slope_g_cm3_per_hu"]), float(fields.get("intercept_g_cm3", 0.0))
        step = Step("calibration", "HU", made.kind, slope, intercept, made.source)
        relation = DensityRelation(made.kind, slope, intercept, made.source, (step,))
        return replace(made, relation=relation)
    if made.method == "table":
        points = tuple(pair(point, f"a point of {where}") for point in fields["points"])
        return replace(made, relation=DensityRelation.from_points(made.kind, points, made.source))
    if made.method == "rods":
        rods = tuple(_rod(rod, f"rod {number} of {where}") for number, rod in enumerate(fields["rods"], start=1))
        if len(rods) < 2:
            raise InputError(f"expected at least two rods of known density in {where}, got {len(rods)}")
        mask = Path(fields["mask"]) if "mask" in fields else None
        if any("label" in rod for rod in rods) and mask is None:
            raise InputError(f"expected a mask for the rods' labels in {where}, got none")
        return replace(made, rods=rods, mask=mask)
    optional: dict[str, type] = dict.fromkeys(TISSUES, dict)
    tissues = checked(fields["tissues"], f"[tissues] of {where}", required={}, optional=optional)
    if len(tissues) < 2:
        raise InputError(f"expected at least two of {', '.join(TISSUES)} in {where}, got {len(tissues)}")
    return replace(made, tissues=tuple((name, _tissue(table, f"{name} of {where}")) for name, table in tissues.items()))


def _rod(table: Any, where: str) -> dict[str, Any]:
    label = table.pop("label", None) if isinstance(table, dict) else None
    optional = {"centre_mm": list, "radius_mm": float}
    fields = _placed(checked(table, where, required={"density_g_cm3": float}, optional=optional), where)
    if (label is None) == ("centre_mm" not in fields):
        raise InputError(f"expected either a label or a centre_mm for {where}, got both or neither")
    if label is not None and not isinstance(label, int | str):
        raise InputError(f"expected a number or a name as label of {where}, got {label!r}")
    return fields if label is None else {**fields, "label": label}


def _tissue(table: Any, where: str) -> dict[str, Any]:
    optional = {"density_g_cm3": float, "hu": float, "centre_mm": list, "radius_mm": float}
    fields = _placed(checked(table, where, required={}, optional=optional), where)
    if "hu" in fields and "centre_mm" in fields:
        raise InputError(f"expected either hu or centre_mm for {where}, got both")
    return fields


def _placed(fields: dict[str, Any], where: str) -> dict[str, Any]:
    centre, radius = fields.get("centre_mm"), fields.get("radius_mm", RADIUS_MM)
    if centre is not None and not (len(centre) == 3 and all(is_a(value, float) for value in centre)):
        raise InputError(f"expected three numbers, LPS mm, as centre_mm of {where}, got {centre!r}")
    if not 0 < radius < np.inf:
        raise InputError(f"expected a positive radius_mm of {where}, got {radius:g}")
    return fields
