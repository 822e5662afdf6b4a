"""A writer of small DICOM slices, by pydicom alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

SERIES = "1.2.826.0.1.3680043.8.498.1"
AXIAL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def make_slice(stored, position, *, orientation=AXIAL, bits=12, signed=False, **attributes) -> Dataset:
    """A CT image of given stored values, at a position in LPS mm; attributes replace or add to the usual ones."""
    stored = np.asarray(stored)
    dataset = Dataset()
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = CTImageStorage
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = generate_uid()
    dataset.PatientName, dataset.PatientID = "Secret^Name", "hidden-42"
    dataset.Modality, dataset.StudyInstanceUID, dataset.SeriesInstanceUID = "CT", "1.2.3", SERIES
    dataset.Rows, dataset.Columns = stored.shape[-2:]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit = 16, bits, bits - 1
    dataset.PixelRepresentation = int(signed)
    dataset.PixelSpacing, dataset.SliceThickness = [0.8, 0.7], 2.5
    dataset.ImagePositionPatient = [f"{x:.10g}" for x in position]
    dataset.ImageOrientationPatient = [f"{x:.10g}" for x in orientation]
    dataset.RescaleSlope, dataset.RescaleIntercept = 1, -1024
    for keyword, value in attributes.items():
        if value is None:
            del dataset[keyword]
        else:
            setattr(dataset, keyword, value)
    dataset.PixelData = stored.astype(np.int16 if signed else np.uint16).tobytes()
    dataset["PixelData"].VR = "OW"
    return dataset


@pytest.fixture
def write_slice() -> Callable[..., Path]:
    """Write one slice to a path."""

    def write(path: Path, stored, position, **attributes) -> Path:
        make_slice(stored, position, **attributes).save_as(path, enforce_file_format=True)
        return path

    return write


@pytest.fixture
def write_series(write_slice) -> Callable[..., np.ndarray]:
    """Write slices at heights along z, of reproducible random stored values, which come back as (n, rows, columns)."""

    def write(folder: Path, heights, shape=(9, 7), seed=0, **attributes) -> np.ndarray:
        folder.mkdir(exist_ok=True, parents=True)
        stored = np.random.default_rng(seed).integers(0, 3000, (len(heights), *shape))
        for number, height in enumerate(heights):
            write_slice(folder / f"{number:03d}.dcm", stored[number], (-3.0, 4.0, height), **attributes)
        return stored

    return write
