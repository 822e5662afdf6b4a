"""The stages of a run as they go: on a terminal or in a notebook, or now and then a line in a log."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from threading import Event, Thread
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from gpubspline.clock import Clock

EVERY_S = 30.0
"""Between lines of a log, which nobody watches; a run of less has none."""


def is_watched() -> bool:
    """Whether somebody sees progress: stderr is a terminal, or this is a notebook with the widgets that it needs."""
    return sys.stderr.isatty() or (Console().is_jupyter and find_spec("ipywidgets") is not None)


class ShownClock(Clock):
    """A clock whose present stage stands on stderr with its time, and a bar where its length is known."""

    def __init__(self, shown: bool) -> None:
        super().__init__()
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description:9}"),
            BarColumn(32),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        self._progress = Progress(
            *columns,
            console=Console(stderr=True),
            transient=True,
            disable=not shown,
            redirect_stdout=sys.stdout.isatty(),  # results go above the bars, or to where they are piped
        )
        self._task: TaskID | None = None
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> "ShownClock":
        """Begin to show."""
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was."""
        self._progress.stop()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Run a block as one stage, shown while it runs."""
        if name not in self._tasks:  # stages of a slab come again with the next slab
            self._tasks[name] = self._progress.add_task(name, total=None)
        self._task = self._tasks[name]
        try:
            with super().stage(name):
                yield
        finally:
            self._progress.update(self._task, total=1, completed=1)
            self._task = None

    def advance(self, done: int, total: int) -> None:
        """Move the bar of the present stage."""
        if self._task is not None:
            self._progress.update(self._task, completed=done, total=total)

    def tell(self, words: str) -> None:
        """Show words beside the name of the present stage."""
        if self._task is not None:
            name = next(name for name, task in self._tasks.items() if task == self._task)
            self._progress.update(self._task, description=f"{name} {words}")

    def building(self, kernel: str) -> None:
        """Show that the present stage waits for a kernel to be compiled, which happens once on a machine."""
        self.tell(f"compiling {kernel}" if kernel else "")


class LoggedClock(Clock):
    """A clock for a stderr that is a pipe or a file: every ``EVERY_S`` a line says what is being done."""

    def __init__(self) -> None:
        super().__init__()
        self._stage, self._words, self._reached, self._since = "", "", "", 0.0
        self._ended = Event()
        self._teller = Thread(target=self._tell_on, daemon=True)

    def __enter__(self) -> "LoggedClock":
        """Begin to tell."""
        self._teller.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Be silent."""
        self._ended.set()
        self._teller.join()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Run a block as one stage."""
        self._stage, self._words, self._reached, self._since = name, "", "", time.monotonic()
        try:
            with super().stage(name):
                yield
        finally:
            self._stage = ""

    def advance(self, done: int, total: int) -> None:
        """Take down how far the present stage is."""
        self._reached = f"{done} of {total}"

    def tell(self, words: str) -> None:
        """Take down what the present stage is at."""
        self._words = words

    def building(self, kernel: str) -> None:
        """Take down that the present stage waits for a kernel to be compiled."""
        self.tell(f"compiling {kernel}" if kernel else "")

    def _tell_on(self) -> None:
        while not self._ended.wait(EVERY_S):
            if self._stage:
                told = ", ".join(filter(None, (self._stage, self._words, self._reached)))
                with suppress(OSError):  # of a pipe that nobody reads any more
                    print(f"gpubspline: {told}: {time.monotonic() - self._since:.0f} s", file=sys.stderr, flush=True)
