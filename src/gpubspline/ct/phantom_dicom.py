"""A phantom's scan as a DICOM CT series on disk."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import UID, CTImageStorage, ExplicitVRLittleEndian, generate_uid

from gpubspline.ct.phantom import STORED_HU, Phantom, Progress, phantom
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.files import is_full

INTERCEPT = STORED_HU[0]
DATE, TIME = "20100101", "120000"  # of the paper's year: a phantom is the same whenever it is written


def write_phantom(name: str, folder: Path, progress: Progress | None = None) -> list[Path]:
    """Scan a phantom and write it as CT Image Storage files (PS3.3 A.3), explicit little endian.

    The files are the same each time. The folder appears whole or not at all.

    Arguments
    ---------
    name: as for ``phantom``.
    folder: to be made; its parent must exist. An empty folder will do, too.
    progress: called with the number of slices done and their total.

    Returns: the files, in the order of their position.

    Raises
    ------
    InputError for an unknown name, a folder that holds something or whose parent does not exist or is not writable.
    """
    made, folder = phantom(name), Path(folder).absolute()
    _check_folder(folder)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        temporary.mkdir()
        _write_slices(made, temporary, progress)
        if folder.exists():
            folder.rmdir()
        temporary.rename(folder)
    except OSError as error:
        why = os.strerror(errno.ENOSPC) if is_full(error) else error.strerror or error
        raise InputError(f"cannot write the phantom to {folder}: {why}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return sorted(folder.glob("*.dcm"))


def _check_folder(folder: Path) -> None:
    if not folder.parent.is_dir():
        raise InputError(f"expected an existing folder to make {folder.name} in, got {folder.parent}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"expected a folder to make, got the file {folder}")
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"expected a new or an empty folder, got {folder}, which holds files")


def _write_slices(made: Phantom, folder: Path, progress: Progress | None) -> None:
    volume = made.scan(progress)
    for k in range(len(volume.hu)):
        _dataset(made, volume, k).save_as(folder / f"slice_{k + 1:03d}.dcm", enforce_file_format=True)


def _uid(*names: object) -> UID:
    return generate_uid(entropy_srcs=["gpubspline phantom", *(str(name) for name in names)])


def _dataset(made: Phantom, volume: Volume, k: int) -> Dataset:
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = _uid(made.name, "image", k)
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.ImplementationClassUID = _uid("implementation")
    dataset = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    dataset.SOPClassUID = meta.MediaStorageSOPClassUID
    dataset.SOPInstanceUID = meta.MediaStorageSOPInstanceUID
    _describe_study(dataset, made)
    _describe_image(dataset, made, volume, k)
    return dataset


def _describe_study(dataset: Dataset, made: Phantom) -> None:
    """Patient, study, series, frame of reference and equipment (PS3.3 C.7.1 to C.7.5): nobody's."""
    dataset.PatientName = "Phantom"
    dataset.PatientID = made.name
    dataset.PatientBirthDate = dataset.PatientSex = dataset.PatientPosition = ""
    dataset.StudyInstanceUID = _uid(made.name, "study")
    dataset.SeriesInstanceUID = _uid(made.name, "series")
    dataset.FrameOfReferenceUID = _uid(made.name, "frame")
    dataset.PositionReferenceIndicator = dataset.AccessionNumber = dataset.ReferringPhysicianName = ""
    dataset.StudyDate = dataset.SeriesDate = dataset.AcquisitionDate = dataset.ContentDate = DATE
    dataset.StudyTime = dataset.SeriesTime = dataset.AcquisitionTime = dataset.ContentTime = TIME
    dataset.StudyID = dataset.SeriesNumber = dataset.AcquisitionNumber = "1"
    dataset.Modality = "CT"
    dataset.Manufacturer = "gpubspline"
    dataset.SeriesDescription = f"Analytic phantom {made.name}"
    dataset.PatientPosition = "HFS"


def _describe_image(dataset: Dataset, made: Phantom, volume: Volume, k: int) -> None:
    """Plane, pixels and CT image (PS3.3 C.7.6.2, C.7.6.3, C.8.2.1)."""
    spacing = volume.spacing_mm
    directions = (volume.affine[:3, :2] / spacing[:2]).T.ravel()
    position = volume.to_points([0, 0, k])
    dataset.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    dataset.InstanceNumber = str(k + 1)
    dataset.ImageOrientationPatient = [float(value) for value in directions]
    dataset.ImagePositionPatient = [round(float(value), 4) for value in position]
    dataset.SliceLocation = round(float(position[2]), 4)
    dataset.PixelSpacing = [float(spacing[1]), float(spacing[0])]
    dataset.SliceThickness = float(spacing[2])
    dataset.KVP = "120"
    dataset.SamplesPerPixel = 1
    dataset.PhotometricInterpretation = "MONOCHROME2"
    dataset.Rows, dataset.Columns = volume.hu.shape[1:]
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 12, 11, 0
    dataset.RescaleIntercept, dataset.RescaleSlope, dataset.RescaleType = str(INTERCEPT), "1", "HU"
    dataset.WindowCenter, dataset.WindowWidth = "300", "1500"
    dataset.PixelData = (volume.hu[k] - np.int16(INTERCEPT)).astype("<u2").tobytes()
