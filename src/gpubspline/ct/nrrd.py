"""What ITK does not say of an NRRD file: that it does not tell how large its voxels are."""

from pathlib import Path

from gpubspline.errors import InputError

_HEADER = 1 << 16
"""A header is text, and far shorter; an empty line ends it."""


def check_nrrd(path: Path) -> None:
    """Raise InputError where the header of an ``.nrrd`` or ``.nhdr`` file has no size of voxels: ITK takes 1 mm."""
    with path.open("rb") as file:
        lines = file.read(_HEADER).decode("latin-1").splitlines()
    fields: dict[str, str] = {}
    for line in lines if lines[:1] and lines[0].startswith("NRRD") else ():
        if not line.strip():
            break
        name, _, value = line.partition(":")
        fields[name.strip().lower()] = value.strip().lower()
    sizes = " ".join(fields.get(name, "") for name in ("spacings", "space directions")).split()
    if fields and not set(sizes) - {"nan", "none"}:  # as which axes of several values have theirs
        raise InputError(f"expected the size of voxels in {path.name}, got no spacings nor space directions")
