"""The summary: its keys, its figures, and that it is plain finite JSON."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.mapping import apply_material
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import assess
from gpubspline.mesh.tally import tally
from gpubspline.mesh.validity import certify
from gpubspline.report.summary import summary, write_summary


def cube(device: Device) -> dict[str, Any]:
    """Summary of 2 x 2 x 2 elements of 1 x 1 x 1 mm, HU 0 to 2600 by 100, with everything known."""
    grid = np.meshgrid(*(np.arange(3.0),) * 3, indexing="ij")
    points = np.stack([a.ravel(order="F") for a in grid], axis=1)
    mesh = Mesh(points, "hex8", structure=(3, 3, 3), fields={"HU": 100.0 * np.arange(27)})
    mesh, material = apply_material(mesh, device=device)
    mesh, quality = assess(mesh, device)
    certificate = certify(mesh, device).certificate
    off = np.array([0.0, 0.1, 0.3]), np.array([1.0, 94.0, 5.0])
    return summary(
        tally(mesh, quality, out_of_range=material.out_of_range, distances=off, certificate=certificate),
        device,
        {"read": 0.5, "mesh": 1.5},
        law=material.law,
        policy=material.policy,
        region_size=8.5,
        threshold_hu=-200.0,
        fit="control",
        fit_error_mm=0.25,
        fit_error_hu=12.0,
    )


def test_what_the_summary_holds(device: Device, tmp_path: Path) -> None:
    write_summary(cube(device), tmp_path / "s.json")
    read = json.loads((tmp_path / "s.json").read_text())
    assert (read["nodes"], read["elements"], read["element_type"]) == (27, 8, "hex8")
    jacobian = read["scaled_jacobian"]
    assert (jacobian["min"], jacobian["mean"]) == (pytest.approx(1.0), pytest.approx(1.0))
    assert (jacobian["fraction_above_0.5"], jacobian["fraction_below_0.1"], jacobian["inverted"]) == (1.0, 0.0, 0)
    assert jacobian["histogram"]["edges"] == pytest.approx(np.linspace(0, 1, 11))
    assert jacobian["histogram"]["counts"] == [0] * 9 + [8]
    assert read["certified_valid"] is True
    assert read["jacobian_determinant"] == {
        "certified": 8,
        "negative": 0,
        "undecided": 0,
        "least_ratio": pytest.approx(1.0),
    }
    assert read["volume_mm3"] == {"mesh": pytest.approx(8.0), "region": 8.5}
    assert read["surface_distance_mm"] == {"mean": pytest.approx(0.109), "p95": 0.1, "max": 0.3}
    assert read["hu"] == {"min": 0.0, "max": 2600.0, "mean": 1300.0}
    # 0 HU is clamped to 100 HU, all above to 2000 HU
    assert read["modulus_mpa"]["min"] == pytest.approx(1904 * (190 / 1630) ** 1.64, rel=1e-5)
    assert read["modulus_mpa"]["max"] == pytest.approx(2065 * (3800 / 1630) ** 3.09, rel=1e-5)
    assert read["out_of_range_nodes"] == 7  # 0 HU, and 2100 to 2600 HU
    assert read["law"]["name"] == "wirtz-2000" and "Wirtz" in read["law"]["citation"]
    assert read["law"]["unconfirmed"] == [] and read["law"]["out_of_range_policy"] == "clamp"
    assert read["threshold_hu"] == -200.0
    assert read["fit"] == {"method": "control", "error_mm": 0.25, "error_hu": 12.0}
    assert (read["backend"], read["precision"]) == (device.backend, "float32")
    assert read["device"] == device.label
    assert read["seconds"] == {"total": 2.0, "read": 0.5, "mesh": 1.5}


def test_quads_have_an_area(device: Device) -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [2, 3, 0]])
    mesh, quality = assess(Mesh(points, "quad4", structure=(2, 2)), device)
    figures = summary(tally(mesh, quality), device, {"total": 3.0, "read": 1.0}, region_size=6.5)
    assert figures["area_mm2"] == {"mesh": pytest.approx(6.0), "region": 6.5}
    assert figures["volume_mm3"] == {"mesh": None, "region": None}
    assert figures["hu"] is None and figures["law"] is None
    assert figures["seconds"]["total"] == 3.0
    json.dumps(figures, allow_nan=False)


@pytest.mark.parametrize("bad", [math.nan, np.float64(np.inf), np.array([1.0, np.nan]), object()])
def test_only_finite_plain_figures_are_written(tmp_path: Path, bad: object) -> None:
    with pytest.raises(InputError, match="finite plain figures"):
        write_summary({"nodes": 3, "bad": bad}, tmp_path / "s.json")
    assert not list(tmp_path.iterdir())
    write_summary({"nodes": np.int32(3), "edges": np.linspace(0, 1, 3)}, tmp_path / "s.json")
    assert json.loads((tmp_path / "s.json").read_text()) == {"nodes": 3, "edges": [0.0, 0.5, 1.0]}


def test_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        write_summary({}, tmp_path / "none" / "s.json")
