"""A cohort on a terminal, as it goes."""

import sys
from collections.abc import Callable, Sequence
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from gpubspline.batch.cohort import Watch
from gpubspline.batch.outliers import LIMIT, QUANTITIES, outliers
from gpubspline.batch.record import Record


class ShownCohort(Watch):
    """How many subjects are through, and below it each that is worked on, with its time; on stderr.

    Arguments
    ---------
    shown: whether that is a terminal that is to be used.
    total: number of subjects.
    say: gets a line for each subject that is through.
    """

    def __init__(self, shown: bool, total: int, say: Callable[[str], None]) -> None:
        self._say = say
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(32),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        self._progress = Progress(
            *columns,
            console=Console(stderr=True),
            transient=True,
            disable=not shown,
            redirect_stdout=sys.stdout.isatty(),  # lines of results go above the bars, or to where they are piped
        )
        self._whole = self._progress.add_task("subjects", total=total)
        self._running: dict[str, TaskID] = {}
        self._failed = 0

    def __enter__(self) -> "ShownCohort":
        """Begin to show."""
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was."""
        self._progress.stop()

    def begun(self, subject: str, worker: str) -> None:
        """Show a subject below the others; one that comes again is with another worker."""
        self._drop(subject)
        self._running[subject] = self._progress.add_task(f"  {subject} (worker {worker})", total=None)

    def ended(self, record: Record, done: int) -> None:
        """Move the bar of the whole, and say what became of the subject."""
        self._drop(record.subject)
        if record.failed or not record.kept:
            self._say(record_line(record))
        self._failed += record.failed
        words = f"subjects, {self._failed} failed" if self._failed else "subjects"
        self._progress.update(self._whole, completed=done, description=words)

    def _drop(self, subject: str) -> None:
        task = self._running.pop(subject, None)
        if task is not None:
            self._progress.remove_task(task)


def record_line(record: Record) -> str:
    """What became of a subject, in one line."""
    if record.failed:
        return f"{record.subject:16} failed   {record.error}"
    known = {quantity.name: quantity.of(record) for quantity in QUANTITIES}
    mesh = record.figures.get("mesh", {})
    parts = [f"{mesh['elements']:,} {mesh['element_type']}"] if mesh else []
    for name, words in (("scaled_jacobian_min", "scaled Jacobian from {:.3f}"), ("stiffness_n_per_mm", "{:.4g} N/mm")):
        parts += [words.format(known[name])] if known[name] is not None else []
    count = len(record.warnings)
    warned = f", {count} warning{'' if count == 1 else 's'}" if count else ""
    return f"{record.subject:16} done     {', '.join(parts)}; {record.seconds:.1f} s{warned}"


def cohort_lines(records: Sequence[Record]) -> list[str]:
    """How many models there are, and which stand apart."""
    failed, kept = sum(record.failed for record in records), sum(record.kept for record in records)
    apart = outliers(records)
    models = len(records) - failed
    made = f"{models} model{'' if models == 1 else 's'}, {failed} failed"
    lines = [f"{made}; {kept} of {len(records)} kept from an earlier run"]
    lines += [f"outlier    {subject}: {', '.join(names)}" for subject, names in apart.items()]
    return [*lines, f"           (modified z-score above {LIMIT})"] if apart else lines
