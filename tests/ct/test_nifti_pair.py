"""Pairs of a header and samples, of NIfTI and of Analyze 7.5: as SimpleITK reads them, and what is wrong with them."""

import struct

import numpy as np
import pytest
import SimpleITK as sitk

from gpubspline.ct.image import read_volume
from gpubspline.ct.masks import read_mask
from gpubspline.errors import GpubsplineWarning, InputError

SAMPLES = np.random.default_rng(7).integers(-1000, 2000, (3, 4, 5)).astype(np.int16)


def write_pair(path):
    image = sitk.GetImageFromArray(SAMPLES)
    image.SetSpacing((0.5, 0.75, 2))
    image.SetOrigin((-10, 20, 30))
    image.SetDirection((0, 0, 1, 1, 0, 0, 0, 1, 0))
    sitk.WriteImage(image, str(path))
    return image


def write_analyze(path, samples=SAMPLES, order="<"):
    """A header by hand (Analyze 7.5, dbh.h), whose orientation and patient's number NIfTI would take for its codes."""
    header = bytearray(348)
    kind = {"i2": (4, 16), "f4": (16, 32)}[samples.dtype.str[1:]]
    for form, at, values in (
        ("i", 0, [348]),
        ("8h", 40, [4, *samples.shape[::-1], 1, 1, 1, 1]),
        ("2h", 70, kind),
        ("8f", 76, [0, 0.5, 0.75, 2, 0, 0, 0, 0]),
        ("4h", 252, [1, 1, 2, 3]),
    ):
        struct.pack_into(order + form, header, at, *values)
    path.write_bytes(header)
    path.with_suffix(".img").write_bytes(samples.astype(samples.dtype.newbyteorder(order)).tobytes())


@pytest.mark.parametrize(("head", "body"), [("a.hdr", "a.img"), ("a.hdr.gz", "a.img.gz")])
def test_either_file_of_a_nifti_pair_is_read(tmp_path, head, body):
    image = write_pair(tmp_path / head)
    corners = [(0, 0, 0), (4, 0, 0), (0, 3, 0), (4, 3, 2)]
    for name in (head, body):
        volume = read_volume(tmp_path / name)
        np.testing.assert_array_equal(volume.hu, SAMPLES)
        np.testing.assert_allclose(
            volume.to_points(corners), [image.TransformIndexToPhysicalPoint(c) for c in corners], atol=1e-5
        )
    label = int(SAMPLES[1, 2, 3])
    np.testing.assert_array_equal(read_mask(tmp_path / body, volume, label), label == SAMPLES)


@pytest.mark.parametrize("order", "<>")
def test_analyze_has_sizes_and_no_place(tmp_path, capfd, order):
    write_analyze(tmp_path / "a.hdr", order=order)
    with pytest.warns(GpubsplineWarning, match=r"a\.hdr says nothing of its orientation"):
        volume = read_volume(tmp_path / "a.hdr")
    np.testing.assert_array_equal(volume.hu, SAMPLES)
    image = sitk.ReadImage(str(tmp_path / "a.hdr"))
    assert capfd.readouterr().out == ""
    np.testing.assert_allclose(volume.affine, np.diag([*image.GetSpacing(), 1]))
    assert image.GetDirection() == (1, 0, 0, 0, 1, 0, 0, 0, 1)


def test_what_is_wrong_with_a_pair_is_one_line(tmp_path):
    write_pair(tmp_path / "a.hdr")
    (tmp_path / "a.img").write_bytes(SAMPLES.tobytes()[:-2])
    with pytest.raises(InputError, match=r"cannot read a\.img as NIfTI: expected 120 bytes, got 118"):
        read_volume(tmp_path / "a.hdr")
    wild = SAMPLES.astype(np.float32)
    wild[1, 2, 3] = np.nan
    write_analyze(tmp_path / "b.hdr", wild)
    with pytest.raises(InputError, match=r"finite HU everywhere in b\.img, got NaN or infinity in 1 of 60 voxels"):
        read_volume(tmp_path / "b.img")
    for name, other in (("b.hdr", "b.img"), ("a.img", "a.hdr")):
        (tmp_path / other).unlink()
        with pytest.raises(InputError, match=f"expected {other} beside {name}, as of a pair"):
            read_volume(tmp_path / name)
