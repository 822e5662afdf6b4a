"""What the texts of options mean: counts, numbers, ranges, names of devices."""

from math import isfinite, prod
from pathlib import Path

from gpubspline.errors import InputError


def integers(text: str | None, name: str, counts: tuple[int, ...]) -> tuple[int, ...] | None:
    """Read ``"20,80,26"``; raises InputError unless it has one of the given numbers of integers."""
    if text is None:
        return None
    try:
        values = tuple(int(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise InputError(f"expected {expected} integers with commas for --{name}, got {text!r}")
    return values


def numbers(text: str | None, name: str, count: int) -> tuple[float, ...] | None:
    """Read ``"0.5,0.5,2"``; raises InputError unless it is as many numbers."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(isfinite, values)):
        raise InputError(f"expected {count} numbers with commas for --{name}, got {text!r}")
    return values


def samples_list(text: str | None) -> list[tuple[int, int, int]] | None:
    """Read ``"11x18x34 14x24x46"``; raises InputError unless it is two or more of three numbers each."""
    if text is None:
        return None
    try:
        found = [tuple(int(part) for part in word.lower().split("x")) for word in text.split()]
    except ValueError:
        found = []
    sizes = {prod(n - 1 for n in counts) for counts in found}
    if len(set(found)) < 2 or any(len(counts) != 3 or min(counts) < 2 for counts in found):
        raise InputError(f"expected two or more meshes such as '11x18x34 14x24x46' for --nodes-list, got {text!r}")
    if len(sizes) < len(set(found)):  # what converges with density has one value of each
        raise InputError(f"expected meshes of different numbers of elements for --nodes-list, got {text!r}")
    return [(u, v, w) for u, v, w in found]


def slice_range(text: str | None) -> tuple[int | None, int | None] | None:
    """Read ``"5:20"``, ``":20"`` or ``"-10:"``; raises InputError for anything else."""
    if text is None:
        return None
    try:
        first, last = (int(part) if part.strip() else None for part in text.split(":"))
    except ValueError:
        raise InputError(f"expected A:B for --slices, got {text!r}") from None
    return first, last


def law_of_label(text: str) -> tuple[str | None, str]:
    """Read ``"22=keyak-1998"``: a label, or None, and a law; raises InputError where one of the two is empty."""
    if text.strip().lower().startswith("constant:") or "=" not in text or Path(text).is_file():
        return None, text
    label, _, law = (part.strip() for part in text.partition("="))
    if not label or not law:
        raise InputError(f"expected --law LABEL=LAW, got {text!r}")
    return label, law


def device_name(backend: str, device: str | None) -> str:
    """One name for ``open_device`` from the two options: ``warp`` and ``cuda:0`` give ``warp:cuda:0``."""
    if device is None or device == "auto":
        return backend
    kind = device.partition(":")[0]
    if kind in ("warp", "opencl"):
        if backend not in ("auto", kind):
            raise InputError(f"expected a device of the backend {backend}, got {device}")
        return device
    if backend == "auto":
        backend = "warp" if kind in ("cpu", "cuda") else "opencl"
    return f"{backend}:{device}"
