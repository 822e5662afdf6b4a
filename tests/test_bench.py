"""The bench: rows of each kind in a tiny size, peers that are absent, results that are wrong."""

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import BSpline, RegularGridInterpolator

from gpubspline.bench import bench_scale, bench_stages, gpu_peers, run
from gpubspline.bench.aims import GPU_SHARES, PEAK_BYTES, SECONDS, SECONDS_A_HEX, SHARES, TIMES, aims
from gpubspline.bench.bench_evaluate import random_patch
from gpubspline.bench.measure import Place, Row, WrongResult, best_of, check, time_peers
from gpubspline.bench.recorder import Recorder
from gpubspline.device import Device, open_device
from gpubspline.errors import BackendUnavailable, InputError

UNHARMED = ("bandwidth", "start-up", "scaling", "elasticity-solve", "elasticity-growth")
"""Without results, or solves, which mend what their preconditioner gets wrong; scaling repeats what others check."""

RESULTS = [name for name in run.ON_DEVICES if name not in UNHARMED]


class Wrong(Recorder):
    """A device one of whose results is off by a thousandth."""

    def get(self, buffer: Any) -> Any:
        values = np.array(super().get(buffer))
        if values.dtype.kind == "f":
            values *= 1.001
        return values


def tiny(device: Device) -> Place:
    return Place(device, fill=1e10, triad=1e10, scale="tiny")


def well_formed(row: Row) -> bool:
    """What anybody who reads the list of rows may count on."""
    found = row.to_dict()
    assert found.keys() >= {"name", "size", "device", "seconds", "bandwidth_fraction", "peers", "ratio"}
    assert found["seconds"] > 0 and found["items"] > 0 and found["size"]
    for name, seconds in found["peers"].items():
        assert (seconds is None) == (found["ratio"][name] is None)
        assert seconds is None or found["ratio"][name] == pytest.approx(seconds / found["seconds"])
    return bool(found["bandwidth_fraction"] is None or found["bandwidth_fraction"] > 0)


@pytest.mark.parametrize("name", run.ON_DEVICES)
def test_rows_of_a_device(name: str, device: Device) -> None:
    rows = list(run.ON_DEVICES[name](tiny(device)))
    if name == "scaling" and not device.cores:
        assert not rows
        return
    assert rows and all(well_formed(row) and row.device == device.name for row in rows)
    assert TIMES.get(name, {}).keys() <= {peer for row in rows for peer in row.peers}


def test_growth_is_the_slope_of_logarithms():
    counts, stages = [100, 1000, 10_000], [{"one": n**1.2, "other": 1e-9 * n} for n in (100, 1000, 10_000)]
    rows = list(bench_stages._growth(counts, stages, "warp:cpu"))
    assert [row.size for row in rows] == [f"100 to 10,000 hex8{stage}, exponent 1.20" for stage in ("", ", one")]


@pytest.mark.parametrize("name", [name for name in run.ON_HOST if name not in ("start-up", "scale")])
def test_rows_of_the_host(name: str) -> None:
    rows = list(run.run([name], scale="tiny"))
    assert rows and all(well_formed(row) and row.name == name and row.device == "host" for row in rows)


def test_scale_watches_memory_and_draws(tmp_path: Path) -> None:
    (row,) = run.run(["scale"], scale="tiny")
    assert well_formed(row)
    if sys.platform != "win32":
        assert row.peak_bytes is not None and 5e7 < row.peak_bytes < 5e9  # Python with NumPy takes 30 MB
    bench_scale.draw([row], tmp_path / "scale.png")
    assert (tmp_path / "scale.png").read_bytes().startswith(b"\x89PNG")


def test_bandwidth_is_measured_where_asked(device: Device) -> None:
    begun: list[str] = []
    fill, triad, *of_a_gpu = run.run(["bandwidth"], [device.name], "tiny", begun.append)
    assert begun == ["bandwidth of memory", f"bandwidth on {device.backend}"]
    assert [row.name for row in of_a_gpu] == ([] if device.cores else ["copy", "gather"])
    assert (fill.name, triad.name) == ("fill", "triad") and fill.device == triad.device == device.name
    assert fill.items / fill.seconds == pytest.approx(1e9 / fill.seconds)


@pytest.mark.parametrize("name", RESULTS)
def test_a_wrong_result_stops_it(name: str, device: Device) -> None:
    with pytest.raises(WrongResult, match="expected"):
        list(run.ON_DEVICES[name](tiny(Wrong(device))))


def test_a_peer_that_does_not_import_is_absent(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("splipy", "splinepy", "pyvista"):
        monkeypatch.setitem(sys.modules, module, None)
    row = next(run.ON_DEVICES["evaluate"](tiny(device)))
    assert row.peers["splinepy"] is row.peers["splipy"] is row.ratio["splipy"] is None
    assert row.peers["scipy"] is not None
    assert "splinepy absent" in run.line(row)
    (row,) = run.ON_DEVICES["quality-explicit"](tiny(device))
    assert row.peers == {"VTK": None}


def test_peers_of_a_gpu_compute_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy and SciPy stand in for CuPy, which has their functions."""
    cupy = ModuleType("cupy")
    vars(cupy).update(vars(np) | {"asnumpy": np.asarray, "cuda": MagicMock(), "get_default_memory_pool": MagicMock()})
    for name, module in (("cupy", cupy), ("cupyx.scipy.ndimage", ndimage), ("torch", None)):
        monkeypatch.setitem(sys.modules, name, module)
    rng, patch, axes = np.random.default_rng(0), random_patch((4, 5, 6), 3), [np.linspace(0, 1, n) for n in (7, 8, 9)]
    matrices = [BSpline.design_matrix(t, k, 3).tocsr() for t, k in zip(axes, patch.knots, strict=True)]
    run_it, view = gpu_peers.contractions(patch.control, matrices)["CuPy"]()
    wanted = patch.evaluate_grid(axes, open_device("warp:cpu")).T
    check("a patch", view(run_it()), wanted, 1e-5)
    volume, places = rng.random((4, 5, 6), dtype=np.float32), rng.random((50, 3)) * (3, 4, 5)
    peers = gpu_peers.samples(volume, places)
    run_it, view = peers["CuPy"]()
    wanted = RegularGridInterpolator([range(n) for n in volume.shape], volume)(places)
    check("samples", view(run_it()), wanted, 1e-5)
    with pytest.raises(ImportError):
        peers["PyTorch"]()


def test_recorder_repeats_what_was_launched(device: Device) -> None:
    recorder, axes = Recorder(device), [np.linspace(0, 1, 5)] * 3
    patch = random_patch((4, 5, 6), 3)
    before = patch.evaluate_grid(axes, recorder).copy()
    recorder.replay()
    assert np.array_equal(patch.evaluate_grid(axes, device), before)


def test_recorder_replays_into_the_same_buffers(device: Device) -> None:
    recorder = Recorder(device)
    out = recorder.empty(10)
    recorder.launch("bandwidth.fill", 10, out, 2.0, 10, 10)
    device.launch("bandwidth.fill", 10, out, 3.0, 10, 10)
    recorder.replay()
    assert np.array_equal(device.get(out), np.full(10, 2.0))


def test_bandwidth_kernels(any_device: Device) -> None:
    rng = np.random.default_rng(0)
    for n in (1, 7, 8, 1003):  # one lane, less than a vector, a vector, many with a rest
        a, b, value = rng.random(n), rng.random(n), float(any_device.real.type(rng.random()))
        out = any_device.put(np.full(n + 3, -1.0))
        for items in (n, -(-n // 4)):
            any_device.launch("bandwidth.fill", items, out, value, n, items)
            assert np.array_equal(any_device.get(out), [value] * n + [-1] * 3)
            any_device.launch("bandwidth.triad", items, any_device.put(a), any_device.put(b), value, n, items, out)
            assert np.allclose(any_device.get(out)[:n], a + value * b, rtol=1e-6)
            assert np.array_equal(any_device.get(out)[n:], [-1] * 3)
            index, source = rng.integers(0, n, n, dtype=np.int32), any_device.put(a)
            any_device.launch("bandwidth.gather", items, source, any_device.put(index), n, items, out)
            assert np.allclose(any_device.get(out)[:n], a[index], rtol=1e-6)
            any_device.copy(source, out := any_device.put(np.full(n, -1.0)))
            assert np.allclose(any_device.get(out), a, rtol=1e-6)
            out = any_device.put(np.full(n + 3, -1.0))


def test_best_of_is_the_least() -> None:
    calls: list[int] = []
    assert best_of(lambda: calls.append(0), budget=0.0) >= 0
    assert len(calls) == 4  # a warm-up and three


def test_check_compares_planes_by_their_own_size() -> None:
    large, small = np.full(4, 1e6), np.full(4, 1.0)
    check("planes", np.stack([large + 1, small]), np.stack([large, small]), 1e-5)
    with pytest.raises(WrongResult, match=r"got a difference of 0\.01"):
        check("planes", np.stack([large, small + 0.01]), np.stack([large, small]), 1e-5)
    with pytest.raises(WrongResult, match="nan"):
        check("planes", np.array([np.nan]), np.array([1.0]), 1e-5)
    with pytest.raises(WrongResult, match="shape"):
        check("planes", small, small[:3], 1e-5)


def test_a_peer_is_compared_before_it_is_timed() -> None:
    with pytest.raises(WrongResult, match="as other has it"):
        time_peers("work", np.ones(3), 0, {"other": lambda: (lambda: np.zeros(3), lambda values: values)})


def test_unknown_bench_is_refused() -> None:
    with pytest.raises(InputError, match="expected a bench of bandwidth, evaluate"):
        run.run(["no-such"])
    with pytest.raises(BackendUnavailable):  # at once, before a heading is printed
        run.run(["material"], ["opencl:9:9"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--json", "rows.txt"], "a file of the bench that ends in .json, got rows.txt"),
        (["--chart", "c.png", "--only", "material"], "the bench 'scale' with --chart, which draws it, got material"),
        (["--device", "opencl:9:9", "--only", "material"], "opencl:9:9"),
    ],
)
def test_bench_refuses_before_it_says_anything(request, words: list[str], said: str) -> None:
    status, out, err = request.getfixturevalue("run")("bench", *words)
    assert status == 2 and said in err and not out


def test_table_is_markdown(tmp_path: Path) -> None:
    rows = [Row("evaluate", "8 nodes", "opencl:0:0", 0.25, 8, 0.5, {"scipy float64": 5.0, "splipy": None})]
    text = [*run.heading().splitlines(), run.line(rows[0])]
    aim = "55 % of bandwidth missed, 20 x scipy float64 reached"
    told = f"250 ms | 32 /s | 50 % | scipy float64 20 of 40, splipy absent | {aim} |"
    assert text[-1] == f"| evaluate | 8 nodes | opencl:0:0 | {told}"
    assert len({row.count("|") for row in text[-3:]}) == 1
    assert run.tally(rows) == "1 of 2 aims are reached."
    run.write_json(rows, tmp_path / "rows.json")
    (found,) = json.loads((tmp_path / "rows.json").read_text())
    assert found["ratio"] == {"scipy float64": 20.0, "splipy": None}
    assert found["peers"] == {"scipy float64": 5.0, "splipy": None}
    assert [aim["reached"] for aim in found["aims"]] == [False, True]


def words(row: Row, *before: Row) -> list[str]:
    return [str(aim) for aim in aims(row, before)]


def test_aims_of_files_grow_with_them() -> None:
    assert words(Row("write-inp", "1,331,000 hexes, 159 MB", "host", 0.9, 1)) == ["1 s reached"]
    assert words(Row("write-inp", "10,648,000 hexes, 1,300 MB", "host", 8.1, 1)) == ["8 s missed"]
    assert words(Row("write-vtu", "1,331,000 hexes, 98 MB", "host", 1.0, 1, 0.51)) == ["50 % of bandwidth reached"]
    for exponent, told in (("1.05", "reached"), ("1.06", "missed")):
        row = Row("blocks-growth", f"9,968 to 995,406 hex8, exponent {exponent}", "opencl:0:0", 60.0, 1)
        assert words(row) == [f"linear, 1.05 {told}"]
    assert words(Row("blocks-growth", "9,968 to 995,406 hex8, lift, exponent 1.2", "opencl:0:0", 60.0, 1)) == []
    big = Row("scale", "103,680,000 nodes to .vts", "opencl:0:0", 91.0, 1, peak_bytes=2 * 10**9)
    assert words(big) == ["90 s missed", "6 GB reached"]
    assert words(Row("scale", "1,000,000 nodes to .vts", "opencl:0:0", 91.0, 1, peak_bytes=10**9)) == []


def test_aims_of_a_gpu_are_shares_of_its_bandwidth_by_either_backend() -> None:
    size, times, enough = "degree 3, control 20x24x46, 700x700x700 nodes", {"scipy float64": 2.0}, 700**3
    for name in ("opencl:1:0", "warp:cuda:0"):
        assert words(Row("evaluate", size, name, 1.0, enough, 0.71, times, gpu=True)) == ["70 % of bandwidth reached"]
        assert words(Row("evaluate", size, name, 1.0, 200**3, 0.71, times, gpu=True)) == []  # launches weigh there
    for order, said in (("random", ["70 % of bandwidth missed"]), ("mesh", [])):
        row = Row("resample", f"{enough:,} points in {order} order", "warp:cuda:0", 1.0, enough, 0.6, gpu=True)
        assert words(row) == said
    assert words(Row("fused", size, "opencl:1:0", 1.0, 1, 0.71, {"slowest part": 1.0}, gpu=True)) == []


def test_what_scales_with_cores_is_warp() -> None:
    for seconds, told in ((1.5, "reached"), (1.4, "missed")):
        row = Row("scaling", "evaluate", "warp:cpu", 1.0, 1, None, {"one core": seconds})
        assert words(row) == [f"1.5 x one core {told}"]


def test_aims_beside_other_rows() -> None:
    first = Row("evaluate", "degree 3, control 20x24x46, 9x9x9 nodes", "opencl:0:0", 1.0, 1, 0.6)
    size, paper = "degree 5, control 64x64x64, 9x9x9 nodes", {"scipy float64": 9.0, "cubic 20x24x46": 1.0}
    same, slow = (Row("evaluate", size, first.device, seconds, 1, 0.9, paper) for seconds in (1.5, 1.7))
    warp = Row("evaluate", first.size, "warp:cpu", 4.9, 1, 0.1, {"scipy": 1.0})
    other = Row("evaluate", "degree 3, control 20x24x46, 7x7x7 nodes", "opencl:0:0", 0.1, 1)
    assert words(first) == ["55 % of bandwidth reached"]
    assert words(same) == ["1.6 x the time of cubic 20x24x46 reached"]
    assert words(slow) == ["1.6 x the time of cubic 20x24x46 missed"]
    assert words(warp, other, first) == ["5 x the time of OpenCL reached"]
    assert words(warp, other) == []


def test_every_aim_is_of_a_bench() -> None:
    known = {*run.NAMES}
    for table in (TIMES, SHARES, GPU_SHARES, SECONDS, SECONDS_A_HEX, PEAK_BYTES):
        assert known >= table.keys()
