"""What somebody who scripts a cohort meets: help, consoles, threads, processes, progress."""

import copy
import multiprocessing
import os
import pickle
import pydoc
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import gpubspline as gb


def cube(n: int) -> gb.Mesh:
    grid = np.stack([a.ravel(order="F") for a in np.meshgrid(*(np.arange(float(n)),) * 3, indexing="ij")], axis=1)
    grid[:, 0] += 0.1 * np.sin(grid[:, 1] * n)
    return gb.Mesh(grid, "hex8", structure=(n, n, n), fields={"HU": 300 + 10 * grid[:, 2]})


def solvable() -> gb.Mesh:
    mesh = cube(4)
    return gb.Mesh(
        mesh.points, "hex8", structure=(4, 4, 4), fields={"E_MPa": np.full(64, 900.0), "nu": np.full(64, 0.3)}
    )


def test_help_is_of_every_public_name() -> None:
    told = pydoc.plain(pydoc.render_doc(gb))
    assert all(name in told for name in gb.__all__) and "class Mesh(" in told and "respond(" in told
    assert "read_volume" in gb.__doc__ and not [name for name in gb.__all__ if not pydoc.getdoc(getattr(gb, name))]


def test_a_console_tells_arrays_by_their_shapes() -> None:
    mesh, quality = gb.assess(cube(5))
    scan = gb.Volume(np.zeros((3, 4, 5), np.int16), np.eye(4))
    assert repr(scan) == "Volume(hu=<int16 3 x 4 x 5>, affine=<float64 4 x 4>, source='array')"
    assert repr(mesh).startswith(
        "Mesh(points=<float64 125 x 3>, element_type='hex8', structure=(5, 5, 5), fields={'HU'"
    )
    for thing in (mesh, quality, scan, gb.bezier(np.zeros((2, 2, 2, 4))), gb.open_device()):
        assert "\n" not in repr(thing) and "array(" not in repr(thing) and len(repr(thing)) < 900, thing


def test_results_and_devices_go_to_other_processes(device: Any) -> None:
    mesh, quality = gb.assess(cube(5), device)
    for thing in (mesh, quality, gb.load_case("stance"), gb.law("wirtz-2000")):
        assert repr(pickle.loads(pickle.dumps(thing))) == repr(thing)
    opened = gb.open_device(device.name)
    assert pickle.loads(pickle.dumps(opened)) is opened is copy.deepcopy(opened)  # which opens its own elsewhere
    assert opened.name in repr(opened) and opened.label in repr(opened)


def test_threads_share_a_device(device: Any) -> None:
    sizes = [4 + n % 9 for n in range(36)]

    def judged(n: int) -> tuple[float, float]:
        mesh, _ = gb.apply_material(cube(n), device=device)
        return gb.assess(mesh, device)[1].mean, float(mesh.fields["E_MPa"].astype(np.float64).sum())

    alone = [judged(n) for n in sizes]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(judged, sizes)) == alone


@pytest.mark.parametrize(("backend", "guarded"), [("warp:cpu", "_overload"), ("opencl", "_enqueue")])
def test_what_threads_may_not_do_at_once_they_do_in_turn(backend: str, guarded: str) -> None:
    """Compile by Warp, whose modules break; set the arguments of an OpenCL kernel, which keeps those of the last."""
    device: Any = copy.copy(gb.open_device(backend))
    device._commands, at_once, most = {}, [], []
    whole = getattr(device, guarded)

    def slow(*args: Any) -> Any:
        at_once.append(args)
        most.append(len(at_once))
        time.sleep(0.02)
        at_once.pop()
        return whole(*args)

    buffers = [(n, device.put(np.full(n, 3.0)), device.put(np.zeros(n))) for n in range(100, 108)]

    def double(n: int, x: Any, y: Any) -> None:
        device.launch("vectors.combine", n, x, 2.0, 0.0, n, y)

    setattr(device, guarded, slow)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(double, *zip(*buffers, strict=True)))
    assert max(most) == 1 and all(np.all(device.get(y) == 6) for _, _, y in buffers)


def _judged_in_a_child(backend: str) -> str:
    try:
        return f"{gb.assess(cube(4), gb.open_device(backend))[1].min:.3f}"
    except gb.BackendUnavailable as error:
        return str(error)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("backend", ["opencl", "warp:cpu"])
def test_a_forked_process_is_told_to_be_spawned(backend: str) -> None:
    """It lacks the threads of what was opened before: a launch in it never ended."""
    parent = gb.open_device(backend)
    alone = _judged_in_a_child(backend)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        refused = pool.apply_async(_judged_in_a_child, (backend,)).get(60)
        held = pool.apply_async(_launched, ()).get(60)
    assert "multiprocessing.get_context('spawn')" in refused and held == refused
    assert parent is gb.open_device(backend) and _judged_in_a_child(backend) == alone


def _launched() -> str:
    from gpubspline.device import _OPENED

    try:
        _OPENED[-1].put(np.zeros(3))
    except gb.BackendUnavailable as error:
        return str(error)
    return "not refused"


class Heard(gb.Clock):
    """What tells somebody how far a run is."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[Any] = []

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.said.append(name)
        with super().stage(name):
            yield

    def advance(self, done: int, total: int) -> None:
        self.said.append(done / total)


def test_progress_is_heard_and_nothing_is_printed(tmp_path: Any, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "press.toml"
    path.write_text('[[fixed]]\nregion = "w0"\n[[force]]\nregion = "w1"\nforce_n = [0, 0, -1]\n')
    heard, case = Heard(), gb.load_case(path)
    response = gb.respond(solvable(), case, gb.open_device(), heard)
    assert [word for word in heard.said if isinstance(word, str)] == ["load", "solve", "stress"]
    assert set(heard.seconds) == {"load", "solve", "stress"} and 1.0 in heard.said
    again = gb.respond(solvable(), case, gb.open_device())  # a clock is for who wants one
    np.testing.assert_array_equal(again.solution.displacement_mm, response.solution.displacement_mm)
    assert capfd.readouterr() == ("", "") and repr(again).startswith("Response(mesh=Mesh(points=<float64 64 x 3>")


def test_what_is_of_another_kind_is_told_with_what_gives_one(tmp_path: Any) -> None:
    """Slips of somebody who scripts: a path for what it holds, a name for a device, arguments the other way round."""
    volume = gb.Volume(np.pad(np.full((4, 5, 6), 500, np.int16), 2), np.eye(4))
    region = gb.region_from_threshold(volume, 200)
    device = gb.open_device("opencl")
    lattice = gb.control_lattice(volume, region, (4, 4, 4))
    fitted = gb.fit(lattice, device=device)
    mesh = gb.sample(fitted.patch, (4, 4, 4), device=device)
    slips: tuple[tuple[Callable[[], Any], str], ...] = (
        (lambda: gb.read_volume(volume.hu), "path of a CT, or several, got ndarray: Volume"),
        (lambda: gb.region_from_threshold("ct.nii", 200), "a Volume, got str: read_volume"),
        (lambda: gb.otsu_threshold("ct.nii"), "a Volume, got str"),
        (lambda: gb.control_lattice(region, volume, (4, 4, 4)), "a Volume, got Region"),
        (lambda: gb.fit(lattice, device="opencl"), r"its name: open_device\('opencl'\) opens"),
        (lambda: gb.sample(fitted, (4, 4, 4)), "a Hyperpatch, got Fit: the patch of"),
        (lambda: gb.assess("m.vtu"), "a Mesh, got str: .*read_mesh reads"),
        (lambda: gb.assess(mesh, "warp"), "expected a device, got its name"),
        (lambda: gb.optimize("m.vtu", device), "a Mesh, got str"),
        (lambda: gb.write("m.vtu", mesh), "a Mesh, got str: write takes the mesh first"),
        (lambda: gb.open_device(0), "name of a device, such as 'opencl:0:0', got 0"),
    )
    for slip, told in slips:
        with pytest.raises(gb.InputError, match=told):
            slip()
    named, _ = gb.apply_material(mesh, "keyak-1998", device=device)
    found, _ = gb.apply_material(mesh, gb.law("keyak-1998"), device=device)
    np.testing.assert_array_equal(named.fields["E_MPa"], found.fields["E_MPa"])
