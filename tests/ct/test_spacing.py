"""Which gaps are missing slices and which are the way the series was made."""

import numpy as np
import pytest

from gpubspline.ct.spacing import describe_spacings, is_uniform, missing_slices, resample_slices, uniform_positions


def along(*gaps):
    return np.concatenate([[0.0], np.cumsum(gaps)])


@pytest.mark.parametrize(
    ("gaps", "holes"),
    [
        ([1] * 9, []),
        ([1, 1, 2, 1, 1], [2]),
        ([1, 2, 1], [1]),
        ([1, 2], [1]),
        ([1, 1, 1, 2], [3]),
        ([2, 1, 1, 1], [0]),
        ([1, 1, 2, 2, 1, 1], [2, 3]),
        ([1, 1, 2, 3, 1, 1], [2, 3]),
        ([4, 4, 8, 4, 4, 1.08, 7, 7, 7, 14, 7], [2, 9]),
    ],
)
def test_missing_slices(gaps, holes):
    assert missing_slices(along(*gaps)) == holes


@pytest.mark.parametrize(
    "gaps",
    [
        [4.002] * 13 + [1.081] + [6.999] * 13,  # a real head: two scans of different thickness that overlap
        [4.002] * 4 + [1.081] + [6.999] * 2,
        [2.5] * 6 + [5] * 8,  # skull base fine, vault coarse
        [1] * 5 + [3] * 10 + [1] * 5,  # joints fine, shaft coarse
        [1, 1.2, 0.9, 1.1, 1.3, 1],
    ],
)
def test_uneven_series_have_no_missing_slice(gaps):
    assert missing_slices(along(*gaps)) == []
    assert not is_uniform(along(*gaps))


@pytest.mark.parametrize(("step", "digits"), [(0.625, 2), (1.25, 1), (3.0, 1)])
def test_positions_rounded_in_the_file_are_even(step, digits):
    assert is_uniform(np.round(np.arange(200) * step, digits))


def test_resampled_positions_keep_the_ends_and_the_finer_spacing():
    positions = uniform_positions(along(*[4.002] * 13, 1.081, *[6.999] * 13))
    assert positions[0] == 0
    np.testing.assert_allclose(positions[-1], 13 * 4.002 + 1.081 + 13 * 6.999)
    np.testing.assert_allclose(np.diff(positions), 4.002, rtol=1e-3)


def test_resampling_is_linear_and_keeps_the_type():
    places = along(1, 2, 0.5)
    hu = np.multiply.outer(places, np.arange(6).reshape(2, 3)).astype(np.float32)
    target = np.linspace(0, 3.5, 8)
    np.testing.assert_allclose(resample_slices(hu, places, target)[:, 1, 2], 5 * target, rtol=1e-6)
    assert resample_slices(hu.astype(np.int16), places, target).dtype == np.int16


def test_spacings_in_words():
    assert describe_spacings(along(4, 4, 1, 7)) == "2 x 4, 1 x 1, 1 x 7 mm"
    assert describe_spacings(along(*range(1, 10))).endswith("and so on mm")
