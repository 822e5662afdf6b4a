"""The paper's models on the phantoms: element counts, and scaled Jacobians met or beaten (Figs. 3 to 9 and 13)."""

from pathlib import Path

import pytest

from gpubspline.clock import Clock
from gpubspline.ct.phantom_dicom import write_phantom
from gpubspline.device import Device
from gpubspline.material.registry import law
from gpubspline.pipeline import fit_patch, sample_patch
from gpubspline.recipe import Fitted, Model, Sampling, Shaping, Source
from gpubspline.reproduce.paper import THRESHOLD_HU


@pytest.fixture(scope="session")
def series(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Each phantom's DICOM series."""
    root = tmp_path_factory.mktemp("phantoms")
    for name in ("child-femur", "adult-femur", "head"):
        write_phantom(name, root / name)
    return {path.name: path for path in root.iterdir()}


def model(folder: Path, device: Device, nodes: tuple[int, ...], **source: int) -> tuple[Fitted, Model]:
    """A patch of as many control points as samples where the data allow it, else of the default number."""
    limits = {"child-femur": 34, "adult-femur": 97, "head": 55}
    solid = len(nodes) == 3 and nodes[0] <= 20 and nodes[2] <= limits[folder.name]
    shaping = Shaping(control=nodes if solid else None)
    threshold = THRESHOLD_HU.get(folder.name)
    fitted = fit_patch(Source(folder, threshold_hu=threshold, **source), shaping, device, Clock())
    return fitted, sample_patch(fitted.fit.patch, Sampling(law(), nodes), device, Clock())


@pytest.mark.parametrize(
    ("name", "nodes", "elements", "above_half", "below_tenth"),
    [
        ("child-femur", (11, 18, 34), 5610, 0.76, 0.105),  # Figs. 4a and 7
        ("adult-femur", (14, 24, 46), 13455, 0.88, 0.02),  # Figs. 4b and 8
        ("head", (20, 80, 28), 40527, 0.91, 0.02),  # Figs. 4c and 9
        ("adult-femur", (10, 10, 30), 2349, 0.0, 1.0),  # Fig. 5a
        ("adult-femur", (14, 26, 46), 14625, 0.0, 1.0),  # Fig. 5b
        ("adult-femur", (20, 20, 50), 17689, 0.0, 1.0),  # Fig. 5c
        ("child-femur", (10, 11, 16), 1350, 0.0, 1.0),  # Fig. 13, the coarsest
        ("child-femur", (31, 31, 31), 27000, 0.0, 1.0),  # Fig. 13, the finest
    ],
)
def test_solid(
    series: dict[str, Path],
    device: Device,
    name: str,
    nodes: tuple[int, ...],
    elements: int,
    above_half: float,
    below_tenth: float,
) -> None:
    fitted, made = model(series[name], device, nodes)
    quality = made.counted.quality
    assert made.mesh.n_elements == elements
    assert quality.inverted == 0 and quality.min > 0
    assert quality.fraction_above_0_5 >= above_half and quality.fraction_below_0_1 <= below_tenth
    chords = 0.15 if elements < 2000 else 0.1  # straight edges cut the round sections
    assert made.mesh.volume_mm3 == pytest.approx(fitted.region.volume_mm3, rel=chords)


@pytest.mark.parametrize(("nodes", "elements"), [((140, 140), 19321), ((40, 70), 2691)])  # Figs. 3a, 3b and 6
def test_slice(series: dict[str, Path], device: Device, nodes: tuple[int, int], elements: int) -> None:
    _, made = model(series["head"], device, nodes, slice_index=20)
    assert made.mesh.n_elements == elements
    assert made.counted.quality.inverted == 0 and made.counted.quality.fraction_above_0_5 >= 0.95
