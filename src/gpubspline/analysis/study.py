"""A convergence study: one hyperpatch, meshes of growing density, each solved under one load case.

A finished model is a file of its own, which appears whole or not at all, with a checksum of all that it depends on:
the hyperpatch, the material, the load case, the options and the version. A study that was stopped goes on where it was.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.load_case import LoadCase
from gpubspline.analysis.memory import PeakMemory
from gpubspline.analysis.response import TOLERANCE, respond
from gpubspline.clock import Clock
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.files import whole_file
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.sample import sample
from gpubspline.spline.hyperpatch import Hyperpatch

Counts = tuple[int, int, int]
"""Samples along u, v and w."""

BODY: Counts = (41, 41, 121)
"""Samples of the mesh that stands for the body: all models are loaded, and their stress averaged, by its measures."""

MODELS, GROWTH = 5, 2.0
"""Of the series that is made where none is given: how many models, and how many times the elements of the one before.
"""


@dataclass(frozen=True)
class Study:
    """What is studied.

    Attributes
    ----------
    case: the load case.
    modulus, formulation, tolerance: as ``respond`` takes them. Incompatible modes, since a bone bends: hex8 without
        them is too stiff by as much as a modulus that is interpolated between nodes is too soft, and while the two
        cancel, nothing converges in a way that tells anything.
    """

    case: LoadCase
    modulus: str = "graded"
    formulation: str = "incompatible"
    tolerance: float = TOLERANCE


def growing(shape: Sequence[int], models: int = MODELS, growth: float = GROWTH) -> list[Counts]:
    """Samples of meshes whose elements grow by a factor from one to the next, with that of ``shape`` in the middle.

    Raises
    ------
    InputError for a shape that is no solid's.
    """
    if len(shape) != 3:
        raise InputError(f"expected a solid to study, got samples along {len(shape)} directions")
    scales = growth ** ((np.arange(models) - models // 2) / 3)
    made = [tuple(1 + max(1, round((n - 1) * s)) for n in shape) for s in scales]
    return [(u, v, w) for u, v, w in dict.fromkeys(made)]


def identity(patch: Hyperpatch, *settings: object, arrays: Sequence[NDArray[Any]] = ()) -> str:
    """SHA-256 of a hyperpatch, of settings whose ``repr`` tells all of them, and of arrays such as those of a CT."""
    whole = hashlib.sha256(repr(settings).encode())
    for part in (patch.control, *patch.knots, patch.weights, *arrays):
        whole.update(repr(None if part is None else part.shape).encode())
        whole.update(b"" if part is None else np.ascontiguousarray(part).tobytes())
    whole.update(repr((patch.degrees, patch.channels)).encode())
    return whole.hexdigest()


def run_study(
    study: Study,
    patch: Hyperpatch,
    make: Callable[[Counts], Mesh],
    counts: Sequence[Counts],
    folder: Path,
    device: Device,
    clock: Clock,
    *,
    made_from: str = "",
) -> list[dict[str, Any]]:
    """Solve the models that are not solved yet.

    Arguments
    ---------
    patch: the body.
    make: gives the mesh of some samples of it, with its material.
    counts: samples of each model, in any order.
    folder: where each finished model is kept, as ``models/UxVxW.json``; it is made when the first one is.
    made_from: of what ``make`` depends on beside the patch, see ``identity``.

    Returns
    -------
    A dict a model, by growing number of elements: what ``Response.figures`` gives, with ``samples``, ``seconds`` of
    making, solving and judging it, and ``peak_memory_mb`` of the process meanwhile.

    Raises
    ------
    InputError for fewer than two models, and as ``respond``; what is finished by then stays.
    """
    ordered = sorted(dict.fromkeys(counts), key=lambda c: (np.prod(np.array(c) - 1), c))
    if len(ordered) < 2 or min(min(c) for c in ordered) < 2:
        raise InputError(f"expected two or more meshes of at least 2 samples a direction, got {spelled(ordered)}")
    known = identity(patch, version("gpubspline"), study, made_from, BODY)
    found: dict[Counts, dict[str, Any]] = {}
    body: Mesh | None = None
    for number, c in enumerate(ordered, start=1):
        path, key = folder / "models" / f"{spelled([c])}.json", hashlib.sha256(f"{known}{c}".encode()).hexdigest()
        kept = _kept(path, key)
        if kept is None:
            body = body or sample(patch, BODY, device=device)
            with clock.stage(f"model {number} of {len(ordered)}"):
                kept = _solved(study, make, c, body, device, clock) | {"key": key}
            _keep(kept, path)
        found[c] = {name: value for name, value in kept.items() if name != "key"}
    return [found[c] for c in ordered]


def spelled(counts: Sequence[Counts]) -> str:
    """Samples as they are typed: ``11x18x34 14x24x46``."""
    return " ".join("x".join(str(n) for n in c) for c in counts)


def _solved(
    study: Study, make: Callable[[Counts], Mesh], counts: Counts, body: Mesh, device: Device, clock: Clock
) -> dict[str, Any]:
    elements = f"{np.prod(np.array(counts) - 1):,} elements"
    within, start = _Within(clock, elements), time.perf_counter()
    with PeakMemory() as memory:
        clock.tell(f"{elements}, mesh")
        mesh = make(counts)
        how: dict[str, Any] = {"modulus": study.modulus, "tolerance": study.tolerance, "body": body}
        how["formulation"] = study.formulation if mesh.element_type == "hex8" else "full"
        response = respond(mesh, study.case, device, within, **how)
    clock.tell(elements)
    seconds = time.perf_counter() - start
    figures = {"samples": list(counts), "seconds": seconds, "peak_memory_mb": memory.peak_mb}
    return response.figures() | figures


class _Within(Clock):
    """The stages of a model as words of one stage of another clock."""

    def __init__(self, outer: Clock, words: str) -> None:
        super().__init__()
        self._outer, self._words, self._stage = outer, words, ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Say the stage beside the model."""
        self._stage = name
        self._outer.tell(f"{self._words}, {name}")
        with super().stage(name):
            yield

    def advance(self, done: int, total: int) -> None:
        """Move the model's bar."""
        self._outer.advance(done, total)

    def tell(self, words: str) -> None:
        """Say the words beside the stage."""
        self._outer.tell(f"{self._words}, {self._stage}, {words}")


def _kept(path: Path, key: str) -> dict[str, Any] | None:
    """Read a finished model; None where there is none of this key, or what is there cannot be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("key") == key else None


def _keep(figures: dict[str, Any], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
