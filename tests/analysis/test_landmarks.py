"""Landmarks of 3D Slicer: names in the place of coordinates in a load case."""

import json
from pathlib import Path

import pytest

from gpubspline.analysis.landmarks import read_landmarks
from gpubspline.analysis.load_case import load_case
from gpubspline.analysis.regions import Patch, Sphere
from gpubspline.errors import InputError

CASE = """landmarks = "F.{ending}"
[regions.tip]
patch = {{ point_mm = "greater trochanter", radius_mm = 8 }}
[regions.head]
sphere = {{ centre_mm = "F-2", radius_mm = 3 }}
[[fixed]]
region = "head"
[[force]]
region = "tip"
force_n = [0, 0, -1]
"""
FCSV = """# Markups fiducial file version = 4.11
# CoordinateSystem = {frame}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,-1.5,-2.5,3.5,0,0,0,1,1,1,0,greater trochanter,,
2,-4,5,6,0,0,0,1,1,1,0,F-2,,
"""


def markups(frame: str | None, **first: object) -> str:
    point = {"label": "greater trochanter", "position": [-1.5, -2.5, 3.5], "positionStatus": "defined", **first}
    unset = {"label": "later", "position": [0, 0, 0], "positionStatus": "undefined"}
    of = {"type": "Fiducial", "coordinateUnits": "mm"} | ({} if frame is None else {"coordinateSystem": frame})
    return json.dumps({"markups": [{**of, "controlPoints": [point, {"label": "F-2", "position": [-4, 5, 6]}, unset]}]})


@pytest.mark.parametrize(("frame", "sign"), [("RAS", -1), ("0", -1), ("LPS", 1), ("1", 1)])
@pytest.mark.parametrize("ending", ["mrk.json", "fcsv"])
def test_names_stand_for_points_in_the_patient(tmp_path: Path, ending: str, frame: str, sign: int) -> None:
    (tmp_path / f"F.{ending}").write_text(FCSV.format(frame=frame) if ending == "fcsv" else markups(frame))
    (tmp_path / "case.toml").write_text(CASE.format(ending=ending))
    case = load_case(tmp_path / "case.toml")
    assert case.forces[0].region.parts == (Patch((-1.5 * sign, -2.5 * sign, 3.5), radius_mm=8.0),)
    assert case.supports[0].region.parts == (Sphere((-4.0 * sign, 5.0 * sign, 6.0), 3.0),)


def test_points_being_placed_are_left_out_and_a_frame_not_told_is_ras(tmp_path: Path) -> None:
    point = {"label": "F-3", "position": [1, 2, 3], "positionStatus": "preview"}
    whole = json.loads(markups(None))
    whole["markups"][0]["controlPoints"].append(point)
    (tmp_path / "F.mrk.json").write_text(json.dumps(whole))
    (tmp_path / "F.fcsv").write_text("".join(FCSV.splitlines(keepends=True)[2:]))
    for ending in ("mrk.json", "fcsv"):
        found = read_landmarks(tmp_path / f"F.{ending}")
        assert found == {"greater trochanter": (1.5, 2.5, 3.5), "F-2": (4.0, -5.0, 6.0)}


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.mrk.json", "{}", "markups of 3D Slicer in a.mrk.json"),
        ("a.mrk.json", markups("XYZ"), "the frame RAS or LPS in a.mrk.json, got 'XYZ'"),
        ("a.mrk.json", markups("LPS", position=[1, 2]), "three finite numbers for the landmark 'greater trochanter'"),
        ("a.mrk.json", markups("LPS", label="F-2"), "got 'F-2' twice"),
        ("a.fcsv", "1,2,3", "got the line '1,2,3'"),
        ("a.fcsv", "# CoordinateSystem = LPS", "got none"),
        ("gone.fcsv", None, "cannot read the file of landmarks"),
    ],
)
def test_what_is_no_landmark_is_one_line(tmp_path: Path, name: str, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words):
        read_landmarks(tmp_path / name)


def test_a_name_that_is_none_of_them_lists_them(tmp_path: Path) -> None:
    (tmp_path / "F.fcsv").write_text(FCSV.format(frame="LPS"))
    (tmp_path / "case.toml").write_text(CASE.format(ending="fcsv").replace("F-2", "F-3"))
    with pytest.raises(InputError, match="one of the landmarks greater trochanter, F-2 for centre_mm, got 'F-3'"):
        load_case(tmp_path / "case.toml")
