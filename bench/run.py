"""Runs the benches and gives the README's table: ``gpubspline bench``, or ``python bench/run.py`` in a clone."""

import json
import platform
import runpy
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from gpubspline.bench import (
    bench_bandwidth,
    bench_elasticity,
    bench_evaluate,
    bench_fused,
    bench_lattice,
    bench_mapping,
    bench_material,
    bench_quality,
    bench_read,
    bench_resample,
    bench_scale,
    bench_scaling,
    bench_stages,
    bench_start_up,
    bench_write,
)
from gpubspline.bench.aims import aims
from gpubspline.bench.measure import Host, Place, Row, cores
from gpubspline.device import Device, list_devices, open_device
from gpubspline.errors import InputError
from gpubspline.files import whole_file

ON_DEVICES: dict[str, Callable[[Place], Iterator[Row]]] = {
    "bandwidth": bench_bandwidth.rows,
    "evaluate": bench_evaluate.rows,
    "quality-structured": bench_quality.structured,
    "quality-explicit": bench_quality.explicit,
    "material": bench_material.rows,
    "mapping": bench_mapping.rows,
    "fused": bench_fused.rows,
    "resample": bench_resample.rows,
    "scaling": bench_scaling.rows,
    "elasticity-operator": bench_elasticity.operator,
    "elasticity-solve": bench_elasticity.solves,
    "elasticity-growth": bench_elasticity.growth,
    "blocks": bench_stages.rows,
    "start-up": bench_start_up.first_kernels,
}
ON_HOST: dict[str, Callable[[Host], Iterator[Row]]] = {
    "lattice": bench_lattice.rows,
    "write-inp": bench_write.inp,
    "write-vtu": bench_write.vtu,
    "write-vts": bench_write.vts,
    "write-vtkhdf": bench_write.vtkhdf,
    "read-dicom": bench_read.rows,
    "start-up": bench_start_up.without_kernels,
    "scale": bench_scale.rows,
}
NAMES = tuple(dict.fromkeys((*ON_DEVICES, *ON_HOST)))


def run(
    only: Sequence[str] = (),
    devices: Sequence[str] = (),
    scale: str = "full",
    begun: Callable[[str], object] = str,
) -> Iterator[Row]:
    """Give the rows as they are measured.

    Arguments
    ---------
    only: names of ``NAMES``; all of them where empty.
    devices: as for ``open_device``; every device of every backend that is present where empty.
    scale: one of ``measure.SCALES``.
    begun: is told which bench comes next, and where.

    Raises
    ------
    InputError for an unknown name; BackendUnavailable for a device that is not there; WrongResult where a result is
    not its peer's.
    """
    wanted = tuple(only) or NAMES
    unknown = [name for name in wanted if name not in NAMES]
    if unknown:
        raise InputError(f"expected a bench of {', '.join(NAMES)}, got {', '.join(unknown)}")
    needed = any(name in ON_DEVICES for name in wanted)
    opened = [open_device(name) for name in tuple(devices) or present()] if needed else []
    return _rows(wanted, opened, scale, begun)


def present() -> tuple[str, ...]:
    """Names of every device of every backend, OpenCL's first, which others are held against."""
    names = [name for name, _ in list_devices() if ":" in name]  # a missing backend's row has no number
    return tuple(sorted(names, key=lambda name: not name.startswith("opencl")))


def _rows(
    wanted: Sequence[str], devices: Sequence[Device], scale: str, begun: Callable[[str], object]
) -> Iterator[Row]:
    on_devices = {name: bench for name, bench in ON_DEVICES.items() if name in wanted}
    begun("bandwidth of memory")
    places = [bench_bandwidth.measure(device, scale) for device in devices if on_devices]
    for name, bench in on_devices.items():
        for place in places:
            begun(f"{name} on {place.device.backend}")
            yield from (replace(row, gpu=place.device.cores == 0) for row in bench(place))
    for name, host_bench in ON_HOST.items():
        if name in wanted:
            begun(name)
            with tempfile.TemporaryDirectory() as folder:
                yield from host_bench(Host(Path(folder), scale))


def heading() -> str:
    """The machine, what a column means, and the head of the table, Markdown."""
    machine = f"{platform.machine()}, {cores()} cores, {platform.system()}, Python {platform.python_version()}"
    labels = [f"`{name}` {label}" for name, label in list_devices() if ":" in name]
    return "\n".join(
        [
            "; ".join([machine, *labels]) + ".",
            "Of bandwidth: the time that the bytes which must move (of elasticity, or operations) would take alone, "
            "over the time taken; of files, by plain writing or reading. Aim: what two cores or a GPU should reach.",
            "",
            "| work | size | device | time | rate | of bandwidth | times faster than | aim |",
            "|---|---|---|---|---|---|---|---|",
        ]
    )


def line(row: Row, before: Sequence[Row] = ()) -> str:
    """One line of the table, with its aims, of which some are beside rows ``before`` it."""
    size = row.size if row.peak_bytes is None else f"{row.size}, peak {row.peak_bytes / 1e9:.2f} GB"
    rate = "" if row.items == 1 else f"{_short(row.items / row.seconds)}/s"
    share = "" if row.bandwidth_fraction is None else f"{100 * row.bandwidth_fraction:.0f} %"
    peers = ", ".join(_against(name, ratio, row.bandwidth_fraction) for name, ratio in row.ratio.items())
    aim = ", ".join(map(str, aims(row, before)))
    return f"| {row.name} | {size} | {row.device} | {_time(row.seconds)} | {rate} | {share} | {peers} | {aim} |"


def tally(rows: Sequence[Row]) -> str:
    """How many of the aims of all rows are reached, in words; nothing where there are none."""
    found = [aim.reached for place, row in enumerate(rows) for aim in aims(row, rows[:place])]
    return f"{sum(found)} of {len(found)} aims are reached." if found else ""


def _against(name: str, ratio: float | None, bandwidth_fraction: float | None) -> str:
    """How many times faster than a peer, and how many times any program could be that moves the bytes."""
    if ratio is None:
        return f"{name} absent"
    return f"{name} {ratio:.3g}" + ("" if bandwidth_fraction is None else f" of {ratio / bandwidth_fraction:.3g}")


def _short(value: float) -> str:
    for size, letter in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:.3g} {letter}"
    return f"{value:.3g} "


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1000 * seconds:.3g} ms"


def write_json(rows: Sequence[Row], path: Path) -> None:
    """Write the rows as a list, ``null`` for what is absent."""
    told = [{**row.to_dict(), "aims": [vars(aim) for aim in aims(row, rows[:place])]} for place, row in enumerate(rows)]
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    sys.argv.insert(1, "bench")
    runpy.run_module("gpubspline", run_name="__main__")
