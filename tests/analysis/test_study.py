"""The study of a bar: it converges to its closed form, goes on where it stopped, and solves again what has changed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpubspline.analysis.convergence import converge, write_csv
from gpubspline.analysis.load_case import read_load_case
from gpubspline.analysis.study import Study, growing, identity, run_study, spelled
from gpubspline.cli.describe_study import study_lines
from gpubspline.clock import Clock
from gpubspline.device import Device, open_device
from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.report.convergence import write_convergence
from gpubspline.spline.hyperpatch import hyperpatch

LENGTH, WIDTH, HEIGHT = 40.0, 8.0, 10.0
BEND = """
averaged_mm = 1.5
away_mm = 8
[[fixed]]
region = "w0"
[[force]]
region = "w1"
force_n = [0, 50, 0]
"""
CASE = read_load_case(BEND, "bend")
COUNTS = [(2, 3, 5), (3, 4, 9), (3, 6, 13)]


@pytest.fixture(scope="module")
def bar():
    """A straight bar along z as a hyperpatch."""
    axes = [np.linspace(0, size, 3) for size in (WIDTH, HEIGHT, LENGTH)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return hyperpatch(np.concatenate([points, np.full((3, 3, 3, 1), 500.0)], axis=-1), 2)


@pytest.fixture(scope="module")
def any_one():
    """One device: what is kept and what is made again does not depend on it."""
    return open_device()


class Maker:
    """Makes meshes of the bar, and counts them; one may be told to fail."""

    def __init__(self, patch, device: Device, fails=None) -> None:
        self.patch, self.device, self.fails, self.made = patch, device, fails, []

    def __call__(self, counts) -> Mesh:
        if counts == self.fails:
            raise KeyboardInterrupt
        self.made.append(counts)
        mesh = sample(self.patch, counts, device=self.device)
        return mesh.with_fields({"E_MPa": np.full(mesh.n_nodes, 1000.0), "nu": np.full(mesh.n_nodes, 0.25)})


def studied(patch, device, folder, case=CASE, maker=None, clock=None, counts=COUNTS, **how):
    maker = maker or Maker(patch, device)
    return run_study(Study(case), patch, maker, counts, folder, device, clock or Clock(), **how), maker


def test_a_bent_bar_converges_to_its_closed_form(bar, device, tmp_path):
    """Timoshenko's cantilever, whose support the solid's clamped end stiffens by less than a per cent."""
    models, _ = studied(bar, device, tmp_path, counts=[*COUNTS, (5, 9, 25)])
    inertia, area, shear = WIDTH * HEIGHT**3 / 12, WIDTH * HEIGHT, 1000 / 2.5
    deflection = 50 * (LENGTH**3 / (3 * 1000 * inertia) + LENGTH / (5 / 6 * area * shear))
    found = converge(models)
    values = [model["max_displacement_mm"] for model in found.models]
    assert values == sorted(values) and values[-1] == pytest.approx(deflection, rel=0.02)
    assert [model["elements"] for model in models] == [8, 48, 120, 768]
    assert found.models[-1]["strain_energy_nmm"] == pytest.approx(25 * deflection, rel=0.02)
    assert all(model["formulation"] == "incompatible" and model["seconds"] > 0 for model in models)
    assert all(model["peak_memory_mb"] > 50 for model in models)
    limit = found.limits["strain_energy_nmm"]
    assert limit.order is not None and limit.limit == pytest.approx(found.models[-1]["strain_energy_nmm"], rel=0.02)


def test_a_study_that_was_stopped_goes_on(bar, any_one, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        studied(bar, any_one, tmp_path, maker=Maker(bar, any_one, fails=COUNTS[2]))
    assert sorted(path.name for path in (tmp_path / "models").iterdir()) == ["2x3x5.json", "3x4x9.json"]
    models, maker = studied(bar, any_one, tmp_path)
    assert maker.made == [COUNTS[2]]
    again, maker = studied(bar, any_one, tmp_path)
    assert maker.made == [] and again == models
    whole, maker = studied(bar, any_one, tmp_path / "whole")
    assert maker.made == COUNTS
    timed = {"seconds", "peak_memory_mb"}
    for one, other in zip(models, whole, strict=True):
        assert {k: v for k, v in one.items() if k not in timed} == {k: v for k, v in other.items() if k not in timed}


def test_what_has_changed_is_solved_again(bar, any_one, tmp_path):
    first, _ = studied(bar, any_one, tmp_path)
    doubled = read_load_case(BEND.replace("50", "100"), "bend")
    second, maker = studied(bar, any_one, tmp_path, case=doubled)
    assert maker.made == COUNTS
    ratio = [b["strain_energy_nmm"] / a["strain_energy_nmm"] for a, b in zip(first, second, strict=True)]
    assert ratio == pytest.approx([4, 4, 4], rel=1e-6)
    wider = replace(bar, control=bar.control * [2, 1, 1, 1])
    for patch, how in ((wider, {}), (bar, {"made_from": "another law"})):
        _, maker = studied(patch, any_one, tmp_path, case=doubled, **how)
        assert maker.made == COUNTS


@pytest.mark.parametrize("text", ["", "{", "[]", '{"key": "another"}'])
def test_a_damaged_model_is_solved_again(bar, any_one, tmp_path, text):
    models, _ = studied(bar, any_one, tmp_path, counts=COUNTS[:2])
    (tmp_path / "models" / "2x3x5.json").write_text(text)
    again, maker = studied(bar, any_one, tmp_path, counts=COUNTS[:2])
    assert maker.made == COUNTS[:1] and again[0]["strain_energy_nmm"] == models[0]["strain_energy_nmm"]


def test_the_clock_hears_which_model_of_how_many_and_the_residual(bar, any_one, tmp_path):
    class Heard(Clock):
        def __init__(self):
            super().__init__()
            self.words = []

        def tell(self, words):
            self.words.append(words)

    heard = Heard()
    studied(bar, any_one, tmp_path, clock=heard)
    assert list(heard.seconds) == ["model 1 of 3", "model 2 of 3", "model 3 of 3"]
    assert any(words.startswith("120 elements, solve, residual ") for words in heard.words)
    assert {"8 elements, mesh", "48 elements, load", "120 elements, stress"} <= set(heard.words)


@pytest.mark.parametrize("counts", [[], [(3, 3, 3)], [(3, 3, 3), (3, 3, 3)], [(1, 3, 3), (3, 3, 3)]])
def test_too_few_meshes_are_refused_before_anything_is_written(bar, any_one, tmp_path, counts):
    with pytest.raises(InputError, match="two or more meshes"):
        studied(bar, any_one, tmp_path / "new", counts=counts)
    assert not (tmp_path / "new").exists()


def test_growing_meshes_double_their_elements_about_the_given_one():
    made = growing((11, 18, 34))
    elements = np.array([np.prod(np.array(counts) - 1) for counts in made])
    assert (11, 18, 34) in made and made[2] == (11, 18, 34)
    np.testing.assert_allclose(elements[1:] / elements[:-1], 2, rtol=0.25)
    with pytest.raises(InputError, match="a solid"):
        growing((11, 18))


def test_an_identity_is_of_all_that_a_patch_is(bar):
    same = identity(bar, "law")
    assert same == identity(replace(bar), "law") and spelled([(2, 3, 4), (5, 6, 7)]) == "2x3x4 5x6x7"
    moved = bar.control.copy()
    moved[0, 0, 0, 0] += 1e-9
    weights = np.ones(bar.shape)
    others = [replace(bar, control=moved), replace(bar, weights=weights), replace(bar, channels=("T",))]
    assert len({same, identity(bar, "other"), *(identity(other, "law") for other in others)}) == 5
    scan = np.arange(6, dtype=np.int16)
    scans = [identity(bar, "law", arrays=[array]) for array in (scan, scan + 1, scan.reshape(2, 3))]
    assert len({same, *scans}) == 4


def row(elements, stress):
    names = ("p99_von_mises_mpa", "max_displacement_mm", "strain_energy_nmm", "max_von_mises_at_point_mpa")
    case = {"name": "case", "title": "A case", "source": ""}
    plain = {"unknowns": 3 * elements, "iterations": 9, "seconds": 1.0, "peak_memory_mb": 100.0, "samples": [2, 3, 4]}
    text = dict.fromkeys(("element_type", "modulus", "formulation", "max_von_mises_is", "p99_von_mises_is"), "text")
    known = dict.fromkeys(names, float(stress)) | {"max_von_mises_mpa": float(stress), "load_case": case}
    return {"elements": elements} | plain | text | known


def test_changes_are_against_the_finest_and_turns_are_found():
    found = converge([row(n, s) for n, s in ((4000, 80), (1000, 120), (2000, 90), (8000, 84), (16000, 85))])
    assert found.changes["max_von_mises_mpa"] == pytest.approx((120 / 85 - 1, 90 / 85 - 1, 80 / 85 - 1, 84 / 85 - 1, 0))
    assert found.monotone_from() == 4000 and found.last_change == pytest.approx(1 / 85)
    assert converge([row(1000, 3), row(2000, 2)]).monotone_from() == 1000


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        ([120, 90, 85], "falls with every refinement"),
        ([70, 90, 80, 84, 85], "goes up and down at first, rises with every refinement from 3,000 elements on"),
        ([80, 90, 85], "goes up and down, last it falls"),
    ],
)
def test_the_course_of_the_stress_is_told_in_words(stress: list[float], words: str) -> None:
    found = converge([row(1000 * n, s) for n, s in enumerate(stress, start=1)])
    assert any(line.startswith(f"stress     {words}; the last refinement") for line in study_lines(found))


def test_the_table_and_the_graph_hold_every_model(tmp_path):
    found = converge([row(n, 100 + 1e5 / n) for n in (1000, 2000, 4000)])
    write_csv(found, tmp_path / "study.csv")
    write_convergence(found, tmp_path / "study.png")
    lines = (tmp_path / "study.csv").read_text().splitlines()
    assert len(lines) == 4 and all(line.count(",") == lines[0].count(",") for line in lines)
    assert lines[0].startswith("samples_u,samples_v,samples_w,elements,unknowns,max_von_mises_mpa")
    assert (tmp_path / "study.png").read_bytes()[:4] == b"\x89PNG"
    told = json.loads(json.dumps(found.to_dict()))
    assert told["models"][0]["change_of_max_von_mises_mpa"] == pytest.approx(200 / 125 - 1)
    assert told["limits"]["max_von_mises_mpa"]["limit"] == pytest.approx(100, rel=1e-6)
    assert told["limits"]["max_von_mises_mpa"]["order"] == pytest.approx(3, abs=1e-4)  # 1 / n is h cubed


def test_only_the_models_are_kept_in_the_folder(bar, any_one, tmp_path):
    studied(bar, any_one, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["models"]
    assert all(not path.name.startswith(".") for path in Path(tmp_path / "models").iterdir())
