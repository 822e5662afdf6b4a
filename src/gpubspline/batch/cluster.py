"""The processes that work: a local cluster of dask.distributed, or one that runs already; a device a worker."""

import importlib
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from typing import Any

from gpubspline.batch.guard import check_guard
from gpubspline.errors import BackendUnavailable, InputError

TIMEOUT_S = 10
"""How long a scheduler may take to answer, and its first worker to appear."""

DEAF = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""Run by a worker as it begins: Ctrl-C reaches every process of a terminal, and this one ends the others."""


@contextmanager
def open_client(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Give a ``distributed.Client`` of the scheduler at an address, or of a cluster of processes started for it here.

    Raises
    ------
    BackendUnavailable where dask.distributed is not installed; InputError where no scheduler answers, it has no worker,
    or its workers do not have this package, or where a script starts processes that would run it again.
    """
    distributed = import_distributed()
    _be_quiet()
    if scheduler is None:
        check_guard()
        with _local(distributed, workers) as cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client
        return
    try:
        client = distributed.Client(scheduler, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).strip().splitlines()
        words = reason[0] if reason and not isinstance(error, OSError) else f"no answer within {TIMEOUT_S} s"
        raise InputError(f"expected a dask scheduler at {scheduler}, got {words}") from None
    with client:
        _check_package(client, scheduler)
        yield client


def import_distributed() -> Any:
    """Give dask.distributed; raises BackendUnavailable, which names what to install, where it is missing."""
    try:
        import distributed
    except ImportError:
        raise BackendUnavailable("dask.distributed is not installed: pip install 'gpubspline[cohort]'") from None
    return distributed


def _be_quiet() -> None:
    """Leave it to the records to say what went wrong: a worker that dies is reported there, with its subject."""
    for name in ("distributed", *list(logging.root.manager.loggerDict)):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _local(distributed: Any, workers: int) -> Any:
    """Processes of one thread each for the work, and their share of the cores for the kernels.

    Nothing listens to other machines. No limit of memory: dask would pause or kill workers by rules made for tables.
    """
    threads = str(max(1, (os.cpu_count() or 1) // workers))
    env = {"POCL_MAX_PTHREAD_COUNT": threads, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    dask = importlib.import_module("dask")
    no_limit = {"distributed.scheduler.allowed-failures": 0}  # whom to blame is counted in cohort.py
    with dask.config.set(no_limit), _ended_quietly():
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # None would take port 8787 on every address
            worker_dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs=logging.CRITICAL,
            preload=[DEAF],
            env=env,
        )


@contextmanager
def _ended_quietly() -> Iterator[None]:
    """Close a cluster that was interrupted while it started: dask would at exit, with a traceback of its own."""
    known = importlib.import_module("distributed.deploy.spec").SpecCluster._instances
    others = set(known)
    try:
        yield
    except BaseException:
        for name in ("asyncio", "tornado"):  # what nobody waits for any more is told there
            logging.getLogger(name).setLevel(logging.CRITICAL)
        for begun in set(known) - others:
            with suppress(Exception):
                begun.close(timeout=TIMEOUT_S)
            known.discard(begun)
        raise


def _check_package(client: Any, scheduler: str) -> None:
    """Raise InputError where there is no worker, or one without this version of the package.

    The scheduler reads the work by it, too.
    """

    def installed() -> str | None:  # local, so that it is sent whole: the package may not be there
        from importlib.metadata import PackageNotFoundError, version
        from importlib.util import find_spec

        try:
            return version("gpubspline") if find_spec("gpubspline") else None
        except PackageNotFoundError:  # a copy of its folder on the path
            return "unknown"

    try:
        client.wait_for_workers(1, timeout=TIMEOUT_S)
    except OSError:
        raise InputError(f"expected workers at {scheduler}, got none within {TIMEOUT_S} s") from None
    found = {f"the scheduler {scheduler}": client.run_on_scheduler(installed)}
    found |= {f"the worker {address}": there for address, there in client.run(installed).items()}
    for who, there in found.items():
        if there != version("gpubspline"):
            raise InputError(f"expected gpubspline {version('gpubspline')} for {who}, got {there or 'none there'}")


def gpus() -> tuple[str, ...]:
    """Names of the CUDA devices that this process sees; of a machine without, none."""
    from gpubspline.device import list_devices

    return tuple(name for name, _ in list_devices() if name.startswith("warp:cuda:"))


def deal(client: Any, devices: Sequence[str]) -> dict[str, str]:
    """Device of each worker, by the worker's name: those of a machine in turn.

    Arguments
    ---------
    client: whose workers.
    devices: names for ``open_device``; none are the GPUs that each worker sees, by Warp.

    Workers without a GPU are not among the result, nor are those that join later: ``auto`` is theirs.
    """
    known = client.scheduler_info(n_workers=-1)["workers"]
    seen: Mapping[str, Sequence[str]] = {address: devices for address in known} if devices else client.run(gpus)
    count: dict[str, int] = {}
    dealt = {}
    for address, worker in sorted(known.items(), key=lambda pair: str(pair[1]["name"])):
        if seen.get(address):
            turn = count[worker["host"]] = count.get(worker["host"], -1) + 1
            dealt[str(worker["name"])] = seen[address][turn % len(seen[address])]
    return dealt
