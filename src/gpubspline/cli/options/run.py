"""Where kernels run, and what is said meanwhile."""

import sys
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from gpubspline.cli.options.groups import complete_device, option
from gpubspline.cli.options.texts import device_name


@dataclass
class RunOptions:
    """Where kernels run, and what is said meanwhile."""

    backend: Annotated[str, option("Run", "kernel backend", metavar="auto|warp|opencl")] = "auto"
    device: Annotated[
        str | None,
        option("Run", "see 'gpubspline backends' (default: the first)", metavar="NAME", complete=complete_device),
    ] = None
    precision: Annotated[str, option("Run", "of the kernels", metavar="float32|float64")] = "float32"
    quiet: Annotated[bool, option("Run", "print warnings and errors only", "--quiet", "-q")] = False

    _device = None  # what was opened

    def open(self) -> Any:
        """Open the device."""
        from gpubspline.device import open_device

        self._device = open_device(device_name(self.backend, self.device), self.precision)
        return self._device

    def clock(self) -> Any:
        """Progress on stderr, of the kernels of the device that was opened, too: live on a terminal, else in lines."""
        from gpubspline.progress import LoggedClock, ShownClock

        watched = sys.stderr.isatty()
        clock = ShownClock(shown=watched and not self.quiet) if watched or self.quiet else LoggedClock()
        if self._device is not None:
            self._device.on_build = clock.building
        return clock

    def say(self, lines: list[str]) -> None:
        """Print the result, unless quiet."""
        if not self.quiet:
            typer.echo("\n".join(lines))
