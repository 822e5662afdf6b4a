"""One figure after another, each kept when it is whole; then the page and the numbers of all that is there."""

import hashlib
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gpubspline.analysis.convergence import Convergence, converge, write_csv
from gpubspline.analysis.load_case import load_case
from gpubspline.analysis.study import Study, run_study
from gpubspline.clock import Clock
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.files import check_folder, whole_file
from gpubspline.material.registry import law
from gpubspline.pipeline import sample_material
from gpubspline.recipe import Sampling
from gpubspline.report.convergence import write_convergence
from gpubspline.report.histogram import write_histogram
from gpubspline.report.picture import write_picture
from gpubspline.report.summary import write_summary
from gpubspline.reproduce.page import write_page
from gpubspline.reproduce.paper import (
    FIGURES,
    MODELS,
    STUDY,
    STUDY_CASE,
    STUDY_CONTROL,
    STUDY_PHANTOM,
    STUDY_SAMPLES,
    Figure,
)
from gpubspline.reproduce.workshop import Workshop

NAMES = (*(figure.name for figure in FIGURES), STUDY)
"""What may be asked for."""

PAGE, NUMBERS = "reproduce.html", "reproduce.json"


def reproduce(folder: Path, device: Device, clock: Clock, only: Sequence[str] = ()) -> dict[str, Any]:
    """Make the paper's figures on the phantoms, and a page that puts the paper's beside them.

    Arguments
    ---------
    folder: new, or of a run that was stopped: what is whole in it is not made again.
    device: where to compute.
    clock: hears which figure is being made.
    only: of ``NAMES``; all of them unless told. The page shows all that the folder holds.

    Returns
    -------
    The numbers, as ``reproduce.json`` holds them: by name of the figures that are there.

    Raises
    ------
    InputError for an unknown figure, or a folder that cannot be filled.
    """
    unknown = [name for name in only if name not in NAMES]
    if unknown:
        raise InputError(f"expected figures of {', '.join(NAMES)}, got {unknown[0]!r}")
    check_folder(folder)
    folder.mkdir(exist_ok=True)
    workshop = Workshop(folder, device, clock)
    for figure in FIGURES:
        if not only or figure.name in only:
            _make(figure, workshop)
    if not only or STUDY in only:
        _study(workshop)
    found = {name: part for name in NAMES if (part := _part(folder, name)) is not None}
    numbers = {"version": version("gpubspline"), "device": device.label, "figures": found}
    write_summary(numbers, folder / NUMBERS)
    write_page(numbers, folder, folder / PAGE)
    return numbers


def pictures(figure: Figure) -> list[tuple[str, str, str]]:
    """Model, field and file of each picture of a figure; the field is empty for a histogram."""
    fields = figure.field.split() or [""]
    return [
        (name, field, "-".join(filter(None, (figure.name, name, field if len(fields) > 1 else ""))) + ".png")
        for name in figure.models
        for field in fields
    ]


def _make(figure: Figure, workshop: Workshop) -> None:
    files = [file for _, _, file in pictures(figure)]
    if _part(workshop.folder, figure.name) is not None and all((workshop.folder / file).is_file() for file in files):
        return
    with workshop.clock.stage(f"Fig. {figure.number}"):
        for done, (name, field, file) in enumerate(pictures(figure)):
            workshop.clock.advance(done, len(files))
            model = workshop.model(name)
            workshop.clock.tell(f"picture of {MODELS[name].title}")
            heading = f"{MODELS[name].title} · {model.mesh.n_elements:,} elements"
            if field:
                write_picture(model.mesh, workshop.folder / file, field=field, title=heading)
            else:
                write_histogram(model.counted.quality, workshop.folder / file, heading)
        models = [workshop.figures(name) for name in figure.models]
        _keep(workshop.folder, figure.name, {"models": models, "pictures": files})
        workshop.clock.tell("")


def _study(workshop: Workshop) -> None:
    """Fig. 13: the models are kept one by one by the study itself."""
    folder = workshop.folder / "study"
    with workshop.clock.stage("Fig. 13"):
        patch = workshop.fitted(STUDY_PHANTOM, STUDY_CONTROL).fit.patch
    folder.mkdir(exist_ok=True)
    found = run_study(
        Study(load_case(STUDY_CASE)),
        patch,
        lambda samples: sample_material(patch, Sampling(law(), samples), workshop.device),
        STUDY_SAMPLES,
        folder,
        workshop.device,
        workshop.clock,
        made_from=repr(law()),
    )
    together: Convergence = converge(found)
    write_csv(together, folder / "study.csv")
    write_convergence(together, workshop.folder / "fig13-study.png", "Child femur, single-legged stance · 11 meshes")
    _keep(workshop.folder, STUDY, {"study": together.to_dict(), "pictures": ["fig13-study.png"]})


def _key(name: str) -> str:
    """Of what a figure is made by: the version, and what the paper's models are."""
    return hashlib.sha256(repr((version("gpubspline"), name, FIGURES, MODELS, STUDY_SAMPLES)).encode()).hexdigest()


def _part(folder: Path, name: str) -> dict[str, Any] | None:
    """Numbers of a figure that is whole, or None."""
    try:
        found = json.loads((folder / "parts" / f"{name}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found["numbers"] if isinstance(found, dict) and found.get("key") == _key(name) else None


def _keep(folder: Path, name: str, numbers: dict[str, Any]) -> None:
    (folder / "parts").mkdir(exist_ok=True)
    with whole_file(folder / "parts" / f"{name}.json") as temporary:
        temporary.write_text(json.dumps({"key": _key(name), "numbers": numbers}, indent=1) + "\n", encoding="utf-8")
