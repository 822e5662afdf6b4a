"""A DICOM CT series, uncompressed, from files to HU in their places.

Floors: the bytes of the files; a multiplication and an addition a voxel. The fraction is of the time in which one
thread reads the same files as bytes, from the page cache as all do here.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom import dcmread
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

from gpubspline.bench.measure import Host, Peer, Row, best_of, peer, time_peers
from gpubspline.ct.image import read_volume

SIZES = {"full": (500, 512, 512), "quick": (500, 512, 512), "tiny": (5, 16, 16)}  # slices, rows, columns
INTERCEPT = -1024


def rows(host: Host) -> Iterator[Row]:
    """Time a series of noise; peers are a plain loop of pydicom's and ITK's reader of series."""
    shape = SIZES[host.scale]
    files = _write_series(host.folder, shape)
    hu = read_volume(host.folder).hu
    peers: dict[str, Peer] = {"pydicom": lambda: _pydicom(files), "SimpleITK": lambda: _itk(files)}
    others = time_peers("read-dicom", hu, 0, peers)
    seconds, plain = best_of(lambda: read_volume(host.folder)), best_of(lambda: [file.read_bytes() for file in files])
    size = f"{shape[0]} slices of {shape[1]}x{shape[2]}"
    yield Row("read-dicom", size, "host", seconds, hu.nbytes, plain / seconds, others)


def _write_series(folder: Path, shape: tuple[int, ...]) -> list[Path]:
    """Write slices with names in no order of theirs; give them in the order of their places."""
    rng, series = np.random.default_rng(12), [generate_uid() for _ in range(3)]
    files = [folder / f"{number:04d}.dcm" for number in rng.permutation(shape[0])]
    for k, file in enumerate(files):
        dataset = _slice(k, series)
        dataset.Rows, dataset.Columns = shape[1:]
        dataset.PixelData = rng.integers(0, 4096, shape[1:], dtype="<u2").tobytes()
        dataset.save_as(file, enforce_file_format=True)
    return files


def _slice(k: int, series: list[Any]) -> Dataset:
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    dataset.SOPClassUID, dataset.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    dataset.StudyInstanceUID, dataset.SeriesInstanceUID, dataset.FrameOfReferenceUID = series
    dataset.Modality, dataset.InstanceNumber = "CT", str(k + 1)
    dataset.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    dataset.ImageOrientationPatient, dataset.ImagePositionPatient = [1, 0, 0, 0, 1, 0], [-180, -180, float(k)]
    dataset.PixelSpacing, dataset.SliceThickness = [0.7, 0.7], 1.0
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 12, 11, 0
    dataset.RescaleIntercept, dataset.RescaleSlope = str(INTERCEPT), "1"
    return dataset


def _pydicom(files: list[Path]) -> tuple[Any, Any]:
    """The loop that everybody writes."""

    def run() -> NDArray[Any]:
        slices = sorted((dcmread(file) for file in files), key=lambda dataset: float(dataset.ImagePositionPatient[2]))
        return np.stack(
            [s.pixel_array.astype(np.int16) * int(s.RescaleSlope) + int(s.RescaleIntercept) for s in slices]
        )

    return run, np.asarray


def _itk(files: list[Path]) -> tuple[Any, Any]:
    itk = peer("SimpleITK")
    reader = itk.ImageSeriesReader()
    reader.SetFileNames([str(file) for file in files])
    return reader.Execute, itk.GetArrayFromImage
