"""PoCL on processors that are newer than the compiler inside its wheel, and on disks that have no room for it.

The PoCL 3.0 of PyPI holds LLVM 14. On an x86-64 processor that LLVM 14 cannot name (AMD Zen 4 and 5, recent Intel) it
asks its own compiler for the target "generic", which that compiler refuses, so that no kernel builds
(pocl/pocl#1049). The name is a string that the device structure points to. Here the pointer is moved to a name that
the compiler knows and the processor is a superset of.
"""

import ctypes
import errno
import os
import platform
import struct
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from gpubspline.errors import BackendUnavailable
from gpubspline.files import reserve, spelled_bytes

UNKNOWN = b"generic\0"
STRUCTURE_BYTES = 1024
ROOM_BYTES = 8 << 20  # ten times its largest file
TARGETS = (  # LLVM's name, and the flags of /proc/cpuinfo it needs, best first
    (b"skylake-avx512", {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl", "avx2", "fma", "bmi2", "adx"}),
    (b"haswell", {"avx2", "fma", "bmi1", "bmi2", "movbe", "f16c"}),
    (b"x86-64", set[str]()),
)
_NAMES = {name: ctypes.create_string_buffer(name) for name, _ in TARGETS}  # must outlive every device


def check_room() -> None:
    """Raise BackendUnavailable where PoCL's compiler could not write its files: it would end the whole process."""
    folder = _cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            reserve(file, ROOM_BYTES)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return  # it does without a folder that it cannot make
        raise BackendUnavailable(
            f"expected room for {spelled_bytes(ROOM_BYTES)} that PoCL's compiler writes in {folder}, got: "
            f"{error.strerror} (POCL_CACHE_DIR names another folder, ulimit -f limits files)"
        ) from None


def no_folder() -> str:
    """Say why PoCL has no folder for what it compiles, without which it has no device either; nothing where it has."""
    folder = _cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return f"PoCL cannot keep what it compiles in {folder}: {error.strerror} (POCL_CACHE_DIR names another folder)"
    return ""


def _cache_folder() -> Path:
    """Where PoCL keeps what it compiled."""
    if named := os.environ.get("POCL_CACHE_DIR"):
        return Path(named)
    shared = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.environ.get("HOME", "/tmp"), ".cache")
    return Path(shared) / "pocl" / "kcache"


def name_processor(device: Any) -> None:
    """Give a PoCL CPU device a target its compiler knows, where it has none; otherwise change nothing."""
    if platform.machine() != "x86_64" or not Path("/proc/self/mem").exists():
        return
    fields = _pointers_to(UNKNOWN, device.int_ptr)
    if fields:
        ctypes.c_void_p.from_address(fields[0]).value = ctypes.addressof(_NAMES[_target()])


def _pointers_to(text: bytes, structure: int) -> list[int]:
    """Addresses of the pointers in a structure that point to ``text``, read without risk of a fault."""
    found = []
    memory = os.open("/proc/self/mem", os.O_RDONLY)
    try:
        for offset in range(0, STRUCTURE_BYTES, 8):
            address = _read(memory, 8, structure + offset)
            if len(address) == 8 and _read(memory, len(text), struct.unpack("=Q", address)[0]) == text:
                found.append(structure + offset)
    finally:
        os.close(memory)
    return found


def _read(memory: int, count: int, address: int) -> bytes:
    if not 4096 <= address < 1 << 47:
        return b""
    try:
        return os.pread(memory, count, address)
    except OSError:  # no such page
        return b""


def has_wide_vectors() -> bool:
    """Whether the processor is known to have registers of 64 bytes."""
    return "avx512f" in _flags()


def _target() -> bytes:
    return next(name for name, needed in TARGETS if needed <= _flags())


@cache
def _flags() -> set[str]:
    """What the processor says it can do; on Linux, else nothing."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    return set(next((line for line in lines if line.startswith("flags")), "").split())
