"""The histogram as a picture and as text."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from gpubspline.errors import InputError
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import Quality, summarise
from gpubspline.report.histogram import text_histogram, write_histogram

VALUES = np.repeat([-0.2, 0.05, 0.45, 0.85, 0.95], [1, 1, 2, 4, 2])
MESH = Mesh(np.zeros((22, 3)), "quad4", structure=(11, 2))
QUALITY = summarise(MESH, VALUES)


def has_alarm(path: Path) -> bool:
    """Whether some pixels are of the alarm's red."""
    return bool(np.any(np.all(np.abs(imread(path)[..., :3] * 255 - (0xB3, 0x26, 0x1E)) < 4, axis=2)))


def test_text() -> None:
    lines = text_histogram(QUALITY).splitlines()
    assert len(lines) == 12
    assert lines[0] == "0.0 to 0.1  1   10.0 %  " + 10 * "█"
    assert lines[4] == "0.4 to 0.5  2   20.0 %  " + 20 * "█"
    assert lines[8] == "0.8 to 0.9  4   40.0 %  " + 40 * "█"
    assert lines[5] == "0.5 to 0.6  0    0.0 %"
    assert lines[10] == "1 inverted (scaled Jacobian 0 or less)"
    assert lines[11].split("   ·   ") == ["minimum -0.200", "mean 0.605", "above 0.5: 60.0 %", "below 0.1: 20.0 %"]


def test_few_are_not_rounded_to_none() -> None:
    few = replace(QUALITY, fraction_below_0_1=1e-5, fraction_above_0_5=1 - 1e-5)
    assert "above 0.5: > 99.9 %   ·   below 0.1: < 0.1 %" in text_histogram(few)


def test_picture_says_inverted_in_red(tmp_path: Path) -> None:
    good: Quality = replace(QUALITY, inverted=0)
    write_histogram(good, tmp_path / "good.png")
    write_histogram(QUALITY, tmp_path / "bad.png", title="Bad")
    assert not has_alarm(tmp_path / "good.png")
    assert has_alarm(tmp_path / "bad.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.png", "good.png"]


def test_all_inverted(tmp_path: Path) -> None:
    quality = summarise(MESH, np.full(10, -1.0))
    write_histogram(quality, tmp_path / "worst.png")
    assert has_alarm(tmp_path / "worst.png")
    assert "10 inverted" in text_histogram(quality)


def test_bad_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.png, got histogram\.pdf"):
        write_histogram(QUALITY, tmp_path / "histogram.pdf")
    with pytest.raises(InputError, match="does not exist"):
        write_histogram(QUALITY, tmp_path / "none" / "histogram.png")
    assert not list(tmp_path.iterdir())
