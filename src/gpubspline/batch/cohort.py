"""A cohort worked through: what is there is kept, the rest is dealt out to workers, and every subject gets a record."""

import os
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from gpubspline.batch import cluster
from gpubspline.batch.attempt import Order, Task, attempt, count_starts, describe, is_ours
from gpubspline.batch.fingerprint import fingerprint
from gpubspline.batch.manifest import Subject
from gpubspline.batch.record import Record, find_valid
from gpubspline.errors import GpubsplineError, InputError

LOCK = ".lock"
TOPIC = "gpubspline-batch"
"""Of the events by which workers tell what they begin."""

TRIES = 3
"""How often a subject may take its worker with it. Counted by its own starts: dask blames whatever waits there too."""


class Watch:
    """What is told of a cohort while it runs; to be shown, or not."""

    def begun(self, subject: str, worker: str) -> None:
        """Tell that a worker took a subject."""

    def ended(self, record: Record, done: int) -> None:
        """Tell what became of a subject, and how many are through."""


def run_cohort(
    subjects: Sequence[Subject],
    task: Task,
    folder: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    devices: Sequence[str] = (),
    settings: Mapping[str, str] | None = None,
    retry: bool = False,
    watch: Watch | None = None,
    each: Callable[[list[Record]], object] | None = None,
) -> list[Record]:
    """Make the model of every subject that has none yet.

    Arguments
    ---------
    subjects: with names of their own.
    task: makes one model; it is sent to the workers by dask, which must be able to pickle it.
    folder: gets a folder a subject, and their logs.
    scheduler: address of a dask scheduler; a local cluster is started where None.
    workers: processes of a local cluster; a GPU each where None, else one for two cores.
    devices: names for ``open_device``, dealt to the workers of each machine in turn; the GPUs each sees where empty.
    settings: what else decides the results, part of the fingerprint.
    retry: whether subjects whose input had an error are tried again.
    watch: is told what happens.
    each: called with the records so far, in the subjects' order, after each subject.

    Returns
    -------
    A record for each subject, in their order. A subject whose worker dies is given to another one, ``TRIES``
    times in all; what was finished is not done again.

    Raises
    ------
    InputError where the folder cannot be used or no scheduler answers; BackendUnavailable without dask.distributed;
    GpubsplineError where the scheduler is lost on the way.
    """
    watch = watch or Watch()
    cluster.import_distributed()
    with _hold(folder):
        for place in (folder / subject.name for subject in subjects):
            if not is_ours(place):
                raise InputError(f"expected a new folder for each subject, got {place}, which holds other files")
        with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
            prints = list(pool.map(lambda subject: fingerprint(subject, settings or {}), subjects))
        orders = [Order(s, p, folder.absolute(), retry) for s, p in zip(subjects, prints, strict=True)]
        records: dict[str, Record] = {}

        def note(record: Record) -> None:
            records[record.subject] = record
            watch.ended(record, len(records))

        for order in orders:
            if found := find_valid(folder / order.subject.name, order.fingerprint, retry):
                note(found)
        left = [order for order in orders if order.subject.name not in records]
        if left:
            with cluster.open_client(scheduler, _count(workers, devices, len(left))) as client:
                for record in _work(client, left, task, devices, watch):
                    note(record)
                    if each:
                        each([records[s.name] for s in subjects if s.name in records])
        return [records[subject.name] for subject in subjects]


def _count(workers: int | None, devices: Sequence[str], subjects: int) -> int:
    """Processes of a local cluster, never more than there is work for."""
    if workers is None:
        workers = len(devices or cluster.gpus()) or max(1, (os.cpu_count() or 1) // 2)
    return min(workers, subjects)


def _work(client: Any, orders: Sequence[Order], task: Task, devices: Sequence[str], watch: Watch) -> Iterator[Record]:
    """Records as they come. A worker has one subject at a time, so that few are lost with it."""
    from distributed import KilledWorker, as_completed

    dealt = cluster.deal(client, devices)
    with suppress(Exception):  # seen where the scheduler allows it; the work does not depend on it
        client.subscribe_topic(TOPIC, lambda event: watch.begun(*event[1]))
    waiting, running = deque(orders), dict[Any, Order]()
    begun_before = {order.subject.name: count_starts(order) for order in orders}
    pool = as_completed(loop=client.loop)

    def hand_out() -> None:
        for place in _free_places(client, len(waiting), idle=not running):
            order = waiting.popleft()
            future = client.submit(_attempt, order, task, dealt, key=f"{order.subject.name}-{uuid4()}", **place)
            running[future] = order
            pool.add(future)

    hand_out()
    for future in pool:
        order = running.pop(future)
        died = isinstance(future.exception() if future.status == "error" else None, KilledWorker)
        if died and count_starts(order) - begun_before[order.subject.name] < TRIES:
            waiting.append(order)
        else:
            yield _record(future, order)
        hand_out()


def _free_places(client: Any, most: int, idle: bool) -> list[dict[str, Any]]:
    """Keywords of ``Client.submit`` for each thread that has no work; another worker may take it if that one dies.

    Arguments
    ---------
    most: how many are wanted.
    idle: whether nothing runs; then there is one place at least, to be taken when a worker comes.
    """
    busy, threads = client.processing(), client.nthreads()
    free = [address for address, n in threads.items() for _ in range(n - len(busy.get(address, ())))]
    places: list[dict[str, Any]] = [{"workers": [address], "allow_other_workers": True} for address in free]
    return (places or ([{}] if idle else []))[:most]


def _attempt(order: Order, task: Task, dealt: Mapping[str, str]) -> Record:
    """Run on a worker."""
    from distributed import get_worker

    worker = get_worker()
    with suppress(Exception):
        worker.log_event(TOPIC, (order.subject.name, str(worker.name)))
    return attempt(order, task, dealt.get(str(worker.name), "auto"), f"worker {worker.name}, process {os.getpid()}")


def _record(future: Any, order: Order) -> Record:
    """Record of a subject that is through; of one that was given up, why."""
    from distributed import KilledWorker

    try:
        record: Record = future.result()
        return record
    except KilledWorker:
        words = "its worker died each time that it was tried: not enough memory, or a crash"
    except Exception as error:  # whatever the worker raised, or dask for it
        if future.cancelled():
            raise GpubsplineError("the dask scheduler was lost; run the same command again to go on") from None
        words = describe(error)
    return Record(order.subject.name, order.fingerprint, error=words, lasting=False)


@contextmanager
def _hold(folder: Path) -> Iterator[None]:
    """Keep a cohort's folder for this run alone; the system lets go of it even where the process is killed."""
    if not folder.absolute().parent.is_dir():
        raise InputError(f"expected an existing folder to make {folder.name} in, got {folder.absolute().parent}")
    try:
        folder.mkdir(exist_ok=True)
        file = (folder / LOCK).open("w")
    except OSError as error:
        raise InputError(f"cannot write in {folder}: {error.strerror}") from None
    with file:
        if os.name == "posix":
            import fcntl

            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InputError(f"expected a folder that no other run is working in, got {folder}") from None
        try:
            yield
        finally:
            if [path.name for path in folder.iterdir()] == [LOCK]:  # nothing came of it
                shutil.rmtree(folder)
