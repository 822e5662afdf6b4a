"""Pages of memory, which decide how fast a CPU writes to it."""

import ctypes
import sys

LARGE_BYTES = 4 << 20  # from which NumPy asks for large pages too
PAGE_BYTES = 2 << 20
MADV_HUGEPAGE = 14  # of linux/mman.h


def ask_for_large_pages(address: int, size: int) -> None:
    """Ask Linux for pages of 2 MB where memory that nobody has touched is large; elsewhere change nothing.

    A core of Zen 5 in a virtual machine writes 30 GB/s to pages of 4 kB and 44 GB/s to these.
    """
    start, end = -(-address // PAGE_BYTES) * PAGE_BYTES, (address + size) // PAGE_BYTES * PAGE_BYTES
    if sys.platform == "linux" and size >= LARGE_BYTES and start < end:
        ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), MADV_HUGEPAGE)
