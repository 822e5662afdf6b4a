"""The seam between host code and kernel backends: a device of five verbs."""

import importlib
import os
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import BackendUnavailable, InputError

BACKENDS = ("warp", "opencl")
KERNELS = "gpubspline.kernels"
Buffer = Any
"""An array that lives on a device; only its device can look inside."""


class Device(Protocol):
    """Where kernels run.

    Attributes
    ----------
    backend: ``"warp"`` or ``"opencl"``.
    name: what ``open_device`` was asked for, spelled out (``"opencl:0:0"``).
    label: the hardware in words.
    real: float32 or float64, the type of every floating-point buffer and argument.
    cores: processor cores that share the work items, each with a cache of its own; 0 for a GPU.
    on_build: called with a kernel's name before its first launch, which compiles it where no earlier process has, and
        with ``""`` after it.
    """

    backend: str
    name: str
    label: str
    real: "np.dtype[Any]"
    cores: int
    on_build: Callable[[str], None]

    def put(self, array: Any) -> Buffer:
        """Upload an array, flattened with its last index fastest; floats become ``real``, integers int32.

        An array whose first index is to run fastest is put as its transpose, which costs nothing where it lies in
        memory that way. What already lives on this device comes back as it is.
        """

    def empty(self, shape: int | tuple[int, ...], dtype: Any = None) -> Buffer:
        """Reserve an uninitialised buffer, of ``real`` unless ``dtype`` says otherwise."""

    def get(self, buffer: Buffer) -> NDArray[Any]:
        """Download a buffer with the shape it was made with."""

    def copy(self, source: Buffer, target: Buffer) -> None:
        """Copy a buffer to one of the same shape and type on the device, as its driver does."""
        ...

    def launch(self, kernel: str, dim: int | tuple[int, ...], *args: Any) -> None:
        """Run ``"file.kernel"`` over ``dim`` work items, the last dimension fastest.

        A kernel of another package is ``"package.file.kernel"``; its twins are ``package/file.py`` and
        ``package/file.cl``.

        Python integers are passed as int32, Python floats as ``real``.
        """

    def wait(self) -> None:
        """Return when everything launched has finished."""


class Named:
    """How a device is told, and sent to another process: by its name, by which that one opens its own."""

    name: str
    label: str
    real: "np.dtype[Any]"

    def __repr__(self) -> str:
        """Name, hardware and precision."""
        return f"<{self.name}, {self.label}, {self.real}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Open the device of this name and precision where it is unpickled."""
        return open_device, (self.name, str(self.real))

    def __copy__(self) -> "Named":
        """Give another of what is open, whose attributes can be changed apart."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin


def buffer_type(values: NDArray[Any], real: "np.dtype[Any]") -> "np.dtype[Any]":
    """Type of the buffer that an array is put in.

    Raises InputError where its integers are none of 32 bits.
    """
    if values.dtype.kind == "f":
        return real
    whole = np.iinfo(np.int32)
    wide = values.dtype.kind in "iu" and values.dtype.itemsize >= 4 and values.dtype != np.int32
    if wide and values.size and not whole.min <= values.min() <= values.max() <= whole.max:
        raise InputError(f"expected integers of 32 bits, got {values.min()} to {values.max()}")
    return np.dtype(np.int32)


def quietly(kernel: str) -> None:
    """Say nothing of a kernel that is built: ``on_build`` of a device that nobody watches."""


def find_kernel(kernel: str) -> tuple[str, str]:
    """Module and name of ``"file.kernel"``, which is of ``gpubspline.kernels``, or ``"package.file.kernel"``."""
    module, _, name = kernel.rpartition(".")
    return (module if "." in module else f"{KERNELS}.{module}"), name


def open_device(name: str = "auto", precision: str = "float32") -> Device:
    """Open a device by name; the same name gives the same device again.

    Threads may share it. Processes may not: one that is forked after a device was opened is refused all of them.

    Arguments
    ---------
    name: ``"auto"`` (CUDA by Warp, else OpenCL, else Warp on the CPU), ``"warp"``, ``"warp:cpu"``, ``"warp:cuda:0"``,
        ``"opencl"`` or ``"opencl:PLATFORM:DEVICE"``.
    precision: ``"float32"`` or ``"float64"``.

    Raises
    ------
    BackendUnavailable where the backend or the device is not present, or this process was forked from one that had
    opened a device; InputError for a name of no backend.
    """
    if not isinstance(name, str):
        raise InputError(f"expected the name of a device, such as 'opencl:0:0', got {name!r}")
    if precision not in ("float32", "float64"):
        raise InputError(f"expected the precision float32 or float64, got {precision!r}")
    return _open(name, precision)


def check_device(device: object) -> None:
    """Raise InputError where a name is given for a device, which ``open_device`` would open; None is none."""
    if isinstance(device, str):
        raise InputError(f"expected a device, got its name: open_device({device!r}) opens it")


@cache
def _open(name: str, precision: str) -> Device:
    if name == "auto":
        return _open_first(("warp:cuda:0", "opencl", "warp:cpu"), precision)
    backend, _, rest = name.partition(":")
    if backend not in BACKENDS:
        raise InputError(f"expected a backend of {', '.join(BACKENDS)} or auto, got {backend!r}")
    module = importlib.import_module(f"gpubspline.device.{backend}")
    if _FORKED:
        _refuse()
    device: Device = module.open_device(rest, np.dtype(precision))
    _OPENED.append(device)
    return device


_OPENED: list[Device] = []
_FORKED: list[Device] = []
"""Devices that this process has opened, and those of the process that it was forked from."""


def _refuse(*_: Any, **__: Any) -> Any:
    raise BackendUnavailable(
        "expected a process of its own for its devices, got one forked from another that had opened some, whose "
        "threads it lacks: start it by multiprocessing.get_context('spawn')"
    )


def _forked() -> None:
    """Let the devices of the process that this one was forked from refuse: a launch on them would wait for ever."""
    _FORKED.extend(_OPENED)
    for device in _OPENED:
        for verb in ("put", "empty", "get", "copy", "launch", "wait"):
            setattr(device, verb, _refuse)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def _open_first(names: tuple[str, ...], precision: str) -> Device:
    missing = []
    for name in names:
        try:
            return open_device(name, precision)
        except BackendUnavailable as error:
            missing.append(f"{name}: {error}")
    raise BackendUnavailable("no kernel backend is available: " + "; ".join(missing))


def list_devices() -> list[tuple[str, str]]:
    """Name and description of every device of every backend; a missing backend gives one row that says what to do."""
    rows: list[tuple[str, str]] = []
    for backend in BACKENDS:
        try:
            rows += importlib.import_module(f"gpubspline.device.{backend}").list_devices()
        except BackendUnavailable as error:
            rows.append((backend, str(error)))
    return rows
