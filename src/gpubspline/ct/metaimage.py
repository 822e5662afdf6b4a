"""What ITK does not say of a MetaImage, or on stderr only: that it has no size, or its samples are not all there."""

from math import prod
from pathlib import Path

from gpubspline.errors import InputError

_HEADER = 1 << 16
"""A header is text, and far shorter; in a ``.mha`` the samples follow its last line, ``ElementDataFile``."""

_BYTES = {
    "MET_CHAR": 1,
    "MET_UCHAR": 1,
    "MET_SHORT": 2,
    "MET_USHORT": 2,
    "MET_INT": 4,
    "MET_UINT": 4,
    "MET_FLOAT": 4,
    "MET_DOUBLE": 8,
}
"""Of one sample (MetaIO's ``metaTypes.h``); of other types, and of samples over several files, ITK is the judge."""


def check_metaimage(path: Path) -> None:
    """Look for the samples that the header of a ``.mha`` or ``.mhd`` file announces, and count their bytes.

    Raises InputError where they are missing or fewer than announced, or it does not say how large its voxels are.
    """
    with path.open("rb") as file:
        start = file.read(_HEADER)
    fields, length = _parse(start)
    name = fields.get("ElementDataFile", "")
    if name and not {"ElementSpacing", "ElementSize"} & fields.keys():
        raise InputError(f"expected the size of voxels in {path.name}, got no ElementSpacing in its header")
    if not name or name == "LIST" or "%" in name:
        return
    data = path if name.upper() == "LOCAL" else path.parent / name
    if not data.is_file():
        raise InputError(f"expected the samples of {path.name} in {name} beside it, got no such file")
    expected = _n_bytes(fields)
    got = data.stat().st_size - (length if data == path else max(int(fields.get("HeaderSize", 0)), 0))
    if got < expected:
        raise InputError(
            f"cannot read {path.name} as MetaImage: expected {expected} bytes of samples, got {max(got, 0)}: copy again"
        )


def _parse(start: bytes) -> tuple[dict[str, str], int]:
    """Header fields by name, and the length of the header: it ends with ``ElementDataFile``."""
    fields, length = {}, 0
    for line in start.splitlines(keepends=True):
        length += len(line)
        name, _, value = line.decode("latin-1").partition("=")
        fields[name.strip()] = value.strip()
        if name.strip() == "ElementDataFile":
            break
    return fields, length


def _n_bytes(fields: dict[str, str]) -> int:
    """Bytes of the samples, 0 where the header does not tell."""
    try:
        if fields.get("CompressedData", "False").upper() == "TRUE":
            return int(fields.get("CompressedDataSize", 0))
        counts = [int(n) for n in fields["DimSize"].split()]
        return prod(counts) * _BYTES.get(fields["ElementType"], 0) * int(fields.get("ElementNumberOfChannels", 1))
    except (KeyError, ValueError):
        return 0
