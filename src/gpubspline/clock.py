"""Wall time of the stages of a run."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Clock:
    """Times the stages of a run; the command line shows them as they go.

    A class of one's own that overrides ``stage``, ``advance`` and ``tell`` hears of them wherever a ``clock`` is taken.

    Attributes
    ----------
    seconds: wall time of each stage so far.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Run a block as one stage."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def advance(self, done: int, total: int) -> None:
        """Tell how far the present stage is."""

    def tell(self, words: str) -> None:
        """Say something of the present stage in a few words."""
