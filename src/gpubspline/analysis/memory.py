"""The most memory that the process held while a block ran."""

import contextlib
import sys
from pathlib import Path
from types import TracebackType

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class PeakMemory:
    """Measures a block.

    Linux forgets the peak before it when it is asked to; elsewhere ``peak_mb`` is that of the process so far.

    Attributes
    ----------
    peak_mb: resident memory at its greatest, MiB, once the block has ended.
    """

    peak_mb: float = 0.0

    def __enter__(self) -> "PeakMemory":
        """Forget what was before."""
        with contextlib.suppress(OSError):
            _CLEAR.write_text("5")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Read the peak."""
        self.peak_mb = _peak_mb()


def _peak_mb() -> float:
    try:
        lines = _STATUS.read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024
    except (OSError, StopIteration):
        import resource  # not on Windows

        size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return size / (1024 * 1024 if sys.platform == "darwin" else 1024)
