"""Cohorts on real worker processes: nothing is lost where one is killed, and nothing is done twice."""

import ast
import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from gpubspline.batch import cluster
from gpubspline.batch.attempt import Order, attempt
from gpubspline.batch.cohort import TRIES, Watch, run_cohort
from gpubspline.batch.fingerprint import fingerprint
from gpubspline.batch.guard import _is_guarded
from gpubspline.batch.manifest import Subject
from gpubspline.batch.record import Record, find_valid, read_record
from gpubspline.errors import BackendUnavailable, InputError

Cohort = Callable[..., list[Subject]]


@pytest.fixture
def cohort(tmp_path: Path) -> Cohort:
    """Makes subjects with a small input each."""

    def make(*names: str, **options: str) -> list[Subject]:
        made = []
        for line, name in enumerate(names, start=2):
            path = tmp_path / f"{name}.npy"
            path.write_text(name)
            made.append(Subject(name, line, (path,), dict(options), (path,)))
        return made

    return make


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with two worker processes, as one that runs elsewhere."""
    with cluster.open_client(None, 2) as client:
        yield client.scheduler.address


def counts(folder: Path, name: str) -> tuple[int, int]:
    """How often the work on a subject was started and finished, by its log."""
    log = (folder / "logs" / f"{name}.txt").read_text()
    return len(re.findall(r"^\S+ \S+ started", log, re.M)), len(re.findall(r"^\S+ \S+ (?:finished|failed)", log, re.M))


def test_a_killed_worker_loses_nothing_and_does_nothing_twice(cohort: Cohort, tmp_path: Path) -> None:
    signs = tmp_path / "signs"
    signs.mkdir()

    def task(subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        if subject.name == "crash":
            os.kill(os.getpid(), signal.SIGKILL)
        sign = signs / subject.name
        if subject.name == "victim" and not sign.exists():
            (folder / "half.vtu").write_text("half")
            sign.write_text(str(os.getpid()))
            time.sleep(120)  # it is killed here
        time.sleep(0.05)
        (folder / "mesh.vtu").write_text(f"made of {subject.inputs[0].read_text()}")
        return {"process": os.getpid()}

    def kill() -> None:
        for _ in range(1200):
            if (signs / "victim").exists() and (text := (signs / "victim").read_text()):
                os.kill(int(text), signal.SIGKILL)
                return
            time.sleep(0.05)

    killer = threading.Thread(target=kill)
    killer.start()
    subjects = cohort("first", "victim", "crash", *(f"more-{n}" for n in range(6)))
    out = tmp_path / "out"
    records = run_cohort(subjects, task, out, workers=2)
    killer.join()
    by_name = {record.subject: record for record in records}
    assert [record.subject for record in records] == [subject.name for subject in subjects]
    assert [name for name, record in by_name.items() if record.failed] == ["crash"]
    assert "its worker died" in by_name["crash"].error and not by_name["crash"].lasting
    for name in by_name.keys() - {"crash"}:
        assert (out / name / "mesh.vtu").read_text() == f"made of {name}"
        assert by_name[name].files == ("mesh.vtu",)
        assert counts(out, name) == (2 if name == "victim" else 1, 1)
    assert counts(out, "crash") == (TRIES, 0)
    assert by_name["victim"].figures["process"] != int((signs / "victim").read_text())
    assert len({record.figures["process"] for record in records if not record.failed}) >= 2


def test_second_run_does_nothing_and_a_change_redoes_one(cohort: Cohort, tmp_path: Path, scheduler: str) -> None:
    def task(subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        import warnings

        from gpubspline.errors import GpubsplineWarning, InputError

        if subject.name == "bad":
            raise InputError("expected something else")
        if subject.name == "unlucky":
            raise OSError("disk full")
        warnings.warn("look\nhere", GpubsplineWarning, stacklevel=1)
        (folder / "mesh.vtu").write_text(subject.options.get("word", ""))
        return {"device": device}

    def work(subjects: list[Subject], **options: Any) -> list[Record]:
        return run_cohort(subjects, task, tmp_path / "out", scheduler=scheduler, devices=["x:0", "x:1"], **options)

    subjects = cohort("a", "b", "bad", "unlucky")
    first = work(subjects)
    assert [record.error for record in first] == ["", "", "expected something else", "OSError: disk full"]
    assert not any(record.kept for record in first) and first[0].warnings == ("look here",)
    assert {record.figures["device"] for record in first[:2]} <= {"x:0", "x:1"}
    second = work(subjects)
    assert [record.kept for record in second] == [True, True, True, False]  # the disk may have room now
    assert [counts(tmp_path / "out", s.name)[0] for s in subjects] == [1, 1, 1, 2]
    third = work(subjects[:3], retry=True)
    assert [record.kept for record in third] == [True, True, False]
    subjects[0].inputs[0].write_text("other content")
    (tmp_path / "out" / "b" / "mesh.vtu").unlink()
    assert [record.kept for record in work(subjects[:3])] == [False, False, True]
    assert [record.kept for record in work(cohort("a", "b", "bad", word="other"))] == [False, False, False]
    assert (tmp_path / "out" / "a" / "mesh.vtu").read_text() == "other"


def test_records_come_as_they_are_made(cohort: Cohort, tmp_path: Path, scheduler: str) -> None:
    seen: list[Any] = []

    class Seen(Watch):
        def ended(self, record: Record, done: int) -> None:
            seen.append((record.subject, done))

    lengths: list[int] = []
    subjects = cohort("a", "b", "c")
    run_cohort(
        subjects,
        lambda subject, folder, device: {},
        tmp_path / "out",
        scheduler=scheduler,
        watch=Seen(),
        each=lambda records: lengths.append(len(records)),
    )
    assert sorted(name for name, _ in seen) == ["a", "b", "c"] and [done for _, done in seen] == [1, 2, 3]
    assert lengths == [1, 2, 3]


@pytest.mark.parametrize("header", ["ElementDataFile = {}\n", "ElementDataFile = {}\r\n"])
def test_fingerprint_of_a_header_is_of_its_samples_too(tmp_path: Path, header: str) -> None:
    path, samples = tmp_path / "scan [1].mhd", tmp_path / "other.raw"
    path.write_bytes(header.format("other.raw").encode())
    samples.write_text("a")
    subject = Subject("s", 2, (path,), {}, (path,))
    first = fingerprint(subject, {})
    samples.write_text("b")
    second = fingerprint(subject, {})
    path.write_bytes(b"NDims = 3\n" + path.read_bytes())
    assert len({first, second, fingerprint(subject, {})}) == 3


def test_work_that_was_done_but_not_told_is_not_done_again(cohort: Cohort, tmp_path: Path) -> None:
    """A worker may die between the end of the work and its answer: dask then gives the subject to another."""
    runs: list[str] = []

    def task(subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        runs.append(subject.name)
        (folder / "mesh.vtu").write_text("")
        return {"answer": 42}

    (subject,) = cohort("a")
    order = Order(subject, fingerprint(subject, {}), tmp_path / "out")
    (tmp_path / "out").mkdir()
    first, second = (attempt(order, task, "auto", "worker") for _ in range(2))
    assert runs == ["a"] and second.kept and second.figures == first.figures == {"answer": 42}
    assert [path.name for path in (tmp_path / "out").glob(".*")] == []


def test_of_a_failure_nothing_is_kept(cohort: Cohort, tmp_path: Path) -> None:
    def task(subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        (folder / "mesh.vtu").write_text("half")
        raise MemoryError

    (subject,) = cohort("a")
    out = tmp_path / "out"
    out.mkdir()
    order = Order(subject, fingerprint(subject, {}), out)
    record = attempt(order, task, "auto", "worker")
    assert "not enough memory" in record.error and not record.lasting
    assert [path.name for path in (out / "a").iterdir()] == ["record.json"]
    assert find_valid(out / "a", order.fingerprint) is None and read_record(out / "a") is not None
    assert "MemoryError" in (out / "logs" / "a.txt").read_text()


def test_names_of_files_stay_in_the_log(cohort: Cohort, tmp_path: Path) -> None:
    """A file's name may be its patient's; the record, the table and the page are passed on."""
    from gpubspline.errors import GpubsplineWarning, InputError

    def task(subject: Subject, folder: Path, device: str) -> dict[str, Any]:
        warnings.warn("left out 1 of 12 slices beside DOE^JANE.0001.dcm", GpubsplineWarning, stacklevel=1)
        raise InputError(f"cannot read Doe, Jane.nii.gz and {subject.inputs[1]} of 12 in 1.2.840.113.7.42")

    series, image, out = tmp_path / "Doe", tmp_path / "Doe, Jane.nii.gz", tmp_path / "out"
    for folder in (series, out):
        folder.mkdir()
    for path in (image, series / "DOE^JANE.0001.dcm", series / "12"):
        path.write_text("")
    subject = Subject("a", 2, (image, series), {}, (image, series))
    record = attempt(Order(subject, "print", out), task, "auto", "worker")
    assert record.error == "cannot read FILE.nii.gz and DIR of 12 in UID"
    assert record.warnings == ("left out 1 of 12 slices beside FILE.dcm",)
    assert "Doe" not in (out / "a" / "record.json").read_text()
    log = (out / "logs" / "a.txt").read_text()
    assert "Doe, Jane.nii.gz" in log and "DOE^JANE.0001.dcm" in log and str(series) in log


def test_fingerprint_is_of_content(cohort: Cohort, tmp_path: Path) -> None:
    (subject,) = cohort("a", mask=str(tmp_path / "a.npy"), fit="control")
    first = fingerprint(subject, {})
    moved = tmp_path / "moved.npy"
    subject.inputs[0].rename(moved)
    same = Subject("other", 9, (moved,), {"fit": "control", "mask": str(moved)}, (moved,))
    assert fingerprint(same, {}) == first
    assert fingerprint(same, {"precision": "float64"}) != first
    folder = tmp_path / "series"
    folder.mkdir()
    for n in range(3):
        (folder / f"{n}.dcm").write_text(str(n))
    series = Subject("s", 2, (folder,), {}, (folder,))
    whole = fingerprint(series, {})
    (folder / ".DS_Store").write_text("of the file manager")
    assert fingerprint(series, {}) == whole
    (folder / "1.dcm").rename(folder / "7.dcm")
    assert fingerprint(series, {}) != whole


@pytest.mark.parametrize(
    ("file", "text", "other"),
    [
        ("a.mhd", "NDims = 3\nElementDataFile = b.raw\n", "b.raw"),
        ("a.mhd", "NDims = 3\nElementDataFile = LIST\nb.raw\nc.raw\n", "c.raw"),
        ("a.mhd", "NDims = 3\nElementDataFile = s%03d.raw 1 2 1\n", "s002.raw"),
        ("a.nhdr", "NRRD0004\ndata file: b.raw\n", "b.raw"),
        ("a.nhdr", "NRRD0004\ndata file: LIST 2\nb.raw\nc.raw\n", "c.raw"),
        ("a.hdr", "", "a.img"),
        ("a.img.gz", "", "a.hdr.gz"),
        ("a.toml", "kind = 'ash'\nmask = 'rods.nii.gz'\n", "rods.nii.gz"),
    ],
)
def test_fingerprint_is_of_the_files_that_a_file_names(tmp_path: Path, file: str, text: str, other: str) -> None:
    (tmp_path / file).write_text(text)
    (tmp_path / other).write_text("one")
    subject = Subject("s", 2, (tmp_path / file,), {}, (tmp_path / file,))
    first = fingerprint(subject, {})
    (tmp_path / "beside.raw").write_text("no part of it")
    assert fingerprint(subject, {}) == first
    (tmp_path / other).write_text("two")
    assert fingerprint(subject, {}) != first


class _Client:
    """Two machines: one of three workers, one of one."""

    def __init__(self, seen: Sequence[str]) -> None:
        self._seen = seen

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        hosts = {"tcp://m:1": "m", "tcp://m:2": "m", "tcp://m:3": "m", "tcp://n:1": "n"}
        return {"workers": {a: {"name": n, "host": h} for n, (a, h) in enumerate(hosts.items())}}

    def run(self, _: Any) -> dict[str, Any]:
        return {address: self._seen for address in self.scheduler_info(-1)["workers"]}


def test_devices_are_dealt_in_turn_on_each_machine() -> None:
    both = ["cuda:0", "cuda:1"]
    assert cluster.deal(_Client(()), both) == {"0": "cuda:0", "1": "cuda:1", "2": "cuda:0", "3": "cuda:0"}
    assert cluster.deal(_Client(both), ()) == cluster.deal(_Client(()), both)
    assert cluster.deal(_Client(()), ()) == {}


SCRIPT = """
from pathlib import Path
from gpubspline.batch.cohort import run_cohort
from gpubspline.batch.manifest import Subject

def work():
    scan = Path("scan.npy").absolute()
    run_cohort([Subject("a", 2, (scan,), {}, (scan,))], dict, Path("out"), workers=1)

"""


def test_a_script_without_a_guard_starts_no_processes(tmp_path: Path) -> None:
    """It had each of them run it again, and ended in a traceback of dask's."""
    (tmp_path / "scan.npy").write_text("scan")
    (tmp_path / "work.py").write_text(SCRIPT + "work()\n")
    done = subprocess.run([sys.executable, "work.py"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "bootstrapping" not in done.stderr and not (tmp_path / "out").exists()
    last = done.stderr.splitlines()[-1]
    assert last.endswith('below if __name__ == "__main__":, got line 10 of work.py, which each of them would run again')


def test_guards_are_known() -> None:
    tree = ast.parse("work = 1\nif __name__ == '__main__' and work:\n    work += 1\nelse:\n    work = 3\nwork = 2\n")
    assert [_is_guarded(tree, line) for line in (1, 2, 3, 5, 6)] == [False, True, True, True, True]


def test_folders_that_are_not_ours_stay(cohort: Cohort, tmp_path: Path) -> None:
    (tmp_path / "out" / "a").mkdir(parents=True)
    (tmp_path / "out" / "a" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="holds other files"):
        run_cohort(cohort("a"), lambda *_: {}, tmp_path / "out")
    assert (tmp_path / "out" / "a" / "thesis.txt").exists()
    with pytest.raises(InputError, match="existing folder"):
        run_cohort(cohort("a"), lambda *_: {}, tmp_path / "no" / "out")


def test_two_runs_in_one_folder(cohort: Cohort, tmp_path: Path) -> None:
    from gpubspline.batch.cohort import _hold

    with _hold(tmp_path / "out"), pytest.raises(InputError, match="no other run"):
        run_cohort(cohort("a"), lambda *_: {}, tmp_path / "out")


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "TIMEOUT_S", 1)
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "127.0.0.1:1"):
        with (
            pytest.raises(InputError, match=f"expected a dask scheduler at {address}"),
            cluster.open_client(address, 1),
        ):
            pass


def test_workers_of_another_version_are_refused(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They would not understand the work, or do it in another way."""
    monkeypatch.setattr(cluster, "version", lambda _: "99.0")
    expected = f"expected gpubspline 99.0 for the scheduler {scheduler}, got {version('gpubspline')}"
    with pytest.raises(InputError, match=expected), cluster.open_client(scheduler, 1):
        pass


def test_without_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(BackendUnavailable, match=r"gpubspline\[cohort\]"), cluster.open_client(None, 1):
        pass
