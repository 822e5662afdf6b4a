"""The flow, as code: files, volume, region, control lattice, hyperpatch, mesh, material, summary."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.clock import Clock
from gpubspline.device import Device
from gpubspline.errors import InputError
from gpubspline.material.alarms import Alarms
from gpubspline.material.assign import assign
from gpubspline.material.calibration import Calibrated
from gpubspline.material.laws import Law
from gpubspline.mesh.coverage import cover
from gpubspline.mesh.distance import distances
from gpubspline.mesh.label_sets import labels_in, labels_round, set_of_label, with_label_sets
from gpubspline.mesh.lost import list_lost
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.optimize import optimize
from gpubspline.mesh.quality import assess
from gpubspline.mesh.sample import sample
from gpubspline.mesh.tally import tally
from gpubspline.mesh.validity import certify
from gpubspline.methods import Choice, Meshed
from gpubspline.recipe import Body, Fitted, Model, Sampling, Shaping, Source
from gpubspline.report.summary import summary
from gpubspline.report.tissues import Labelled, find_tissues
from gpubspline.segment import find_body
from gpubspline.spline.fit import fit
from gpubspline.spline.hyperpatch import Hyperpatch
from gpubspline.spline.lattice import control_lattice, data_shape, default_shape


def fit_patch(source: Source, shaping: Shaping, device: Device, clock: Clock) -> Fitted:
    """Read the CT, find the body, lay the control lattice through it and make the hyperpatch."""
    return fit_body(find_body(source, clock), source, shaping, device, clock)


def fit_body(body: Body, source: Source, shaping: Shaping, device: Device, clock: Clock) -> Fitted:
    """Lay the control lattice through a body and make the hyperpatch."""
    volume, region = body.volume, body.region
    if volume is None or not body.one_grid:
        raise InputError("expected a CT with its own region for the tensor method, got a surface: butterfly or blocks")
    only = None if source.slice_index is None else 0  # the volume is cropped to the slice
    with clock.stage("lattice"):
        shape = shaping.control or default_shape(region, source.axis, only)
        laid = data_shape(region, source.axis, only) if shaping.fit == "least-squares" else shape
        options: dict[str, Any] = {"axis": source.axis, "slice_index": only, "interpolation": shaping.interpolation}
        options["partial_volume"] = body.partial_volume
        lattice = control_lattice(volume, region, laid, smoothing=shaping.row_smoothing, **options)
    with clock.stage("fit"):
        degree = shaping.degree * len(shape) if len(shaping.degree) == 1 else shaping.degree
        made = fit(lattice, shaping.fit, degree=degree, control=shape, device=device)
    return Fitted(body, made, shaping.fit)


def sample_patch(
    patch: Hyperpatch, sampling: Sampling, device: Device, clock: Clock, body: Body | None = None
) -> Model:
    """Sample a hyperpatch, and finish the mesh."""
    nodes = sampling.nodes or patch.shape
    with clock.stage("sample"):
        mesh = sample(patch, nodes, order=sampling.order, element_type=sampling.element_type, device=device)
    return finish(mesh, sampling, device, clock, body, patch)


def finish(
    mesh: Mesh,
    sampling: Sampling,
    device: Device,
    clock: Clock,
    body: Body | None = None,
    patch: Hyperpatch | None = None,
    least_mm: float | None = None,
) -> Model:
    """Map the material onto a mesh, judge its elements and its distance from the body; without HU no material.

    ``least_mm``: distance from the mesh from which parts of the body are left out, as ``cover`` takes it.
    """
    law, calibrated, alarms, optimized, of_set = None, None, None, None, {}
    if sampling.optimize:
        with clock.stage("optimize"):
            mesh, optimized = optimize(mesh, device, patch=patch)
    with clock.stage("material"):
        mesh = _labelled(mesh, body, device)
        if "HU" in mesh.fields:
            sampling, calibrated = calibrate(sampling, body)
            law, scan = sampling.law, _scan(sampling, body)
            mesh, alarms = assign(mesh, law, device=device, **scan)
            of_set = _law_of_set(scan["by_label"], alarms, mesh)
    with clock.stage("quality"):
        mesh, quality = assess(mesh, device)
        certificate = certify(mesh, device).certificate if mesh.element.dimension == 3 else None
    with clock.stage("distance"):
        off = None if body is None else distances(mesh, body.region, device)
        outside = alarms.outside if alarms is not None and alarms.of == "nodes" else None
        known: dict[str, Any] = {"out_of_range": outside, "distances": off, "certificate": certificate}
        counted = tally(mesh, quality, **known)
        covered = None
        if body is not None and mesh.element.dimension == 3:
            covered = cover(mesh, body.region, device, least_mm)
    return Model(mesh, counted, sampling, law, alarms, calibrated, covered, optimized, of_set)


def sample_material(patch: Hyperpatch, sampling: Sampling, device: Device, body: Body | None = None) -> Mesh:
    """Sample a hyperpatch and map the material onto it, and no more: what a solve needs."""
    sampling, _ = calibrate(sampling, body)
    nodes = sampling.nodes or patch.shape
    mesh = sample(patch, nodes, order=sampling.order, element_type=sampling.element_type, device=device)
    mesh = _labelled(mesh, body, device) if sampling.law_by_label else mesh
    return assign(mesh, sampling.law, device=device, **_scan(sampling, body))[0]


def _labelled(mesh: Mesh, body: Body | None, device: Device) -> Mesh:
    """Gather elements by the body's labels, unless the mesher has, along their boundaries."""
    if body is None or body.labels is None or body.whole is None or "label" in mesh.cell_fields:
        return mesh
    return with_label_sets(mesh, body.labels, body.whole, device)


def _scan(sampling: Sampling, body: Body | None) -> dict[str, Any]:
    """Keywords of ``assign``: mapping, laws by label, what is read near the surface, what the mass is compared with."""
    by_label = sampling.laws_of(None if body is None else body.labels)
    if body is None:
        return {"mapping": sampling.mapping, "by_label": by_label}
    mapping = replace(sampling.mapping, partial_volume=body.partial_volume)
    known: dict[str, Any] = {"mapping": mapping, "by_label": by_label, "volume": body.volume, "region": body.region}
    return known | dict(zip(["labels"], label_arrays(sampling, body), strict=False))


def label_arrays(sampling: Sampling, body: Body) -> list[NDArray[np.int32]]:
    """The label (n_k, n_j, n_i) of each of the body's voxels, where laws go by it; raises InputError for no such label.

    A list of one or none, of what a study's models depend on beside the CT.
    """
    if not sampling.laws_of(body.labels) or body.labels is None or body.volume is None or body.whole is None:
        return []
    return [labels_round(body.region.mask, body.volume, body.labels, body.whole)]


def label(body: Body, sampling: Sampling) -> Labelled:
    """Say of each of a body's labels, and of what has none, what it would be meshed as; needs a CT on its grid."""
    assert body.volume is not None
    sampling, _ = calibrate(sampling, body)
    laws, names = {0: sampling.law, **sampling.laws_of(body.labels)}, {}
    numbers: NDArray[np.integer] = np.zeros(body.region.mask.shape, dtype=np.int32)
    if body.labels is not None and body.whole is not None:
        names = {number: body.labels.title(number) for number in body.labels.names}
        numbers = np.array([0, *names], dtype=np.int32)[labels_in(body.volume, body.labels, body.whole)]
    return find_tissues(body.volume, body.region, numbers, names, laws)


def _law_of_set(by_label: dict[int, Law], alarms: Alarms, mesh: Mesh) -> dict[str, Law]:
    """Laws of labels that elements have, by their element sets."""
    met = [share["label"] for share in alarms.by_label if share["label"]]
    return {set_of_label(mesh, number): by_label[number] for number in met}


def check_calibration(sampling: Sampling, body: Body) -> None:
    """Raise InputError where a scan has not what a calibration wants, before the body is meshed.

    What the calibration asks about is asked where it is carried out.
    """
    if sampling.calibration is not None and body.whole is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            calibrate(sampling, body)


def calibrate(sampling: Sampling, body: Body | None) -> tuple[Sampling, Calibrated | None]:
    """Carry out the calibration, where one is asked for, and let the laws take its density."""
    if sampling.calibration is None:
        return sampling, None
    calibrated = sampling.calibration.carry_out(None if body is None else body.whole)
    law, mapping = sampling.law.calibrated(calibrated.relation), sampling.mapping
    others = {label: each.calibrated(calibrated.relation) for label, each in sampling.law_by_label.items()}
    if mapping.transverse is not None:
        mapping = replace(mapping, transverse=mapping.transverse.calibrated(calibrated.relation))
    return replace(sampling, law=law, law_by_label=others, mapping=mapping, calibration=None), calibrated


def summarise(
    model: Model,
    device: Device,
    clock: Clock,
    fitted: Fitted | None = None,
    *,
    body: Body | None = None,
    choice: Choice | None = None,
    meshed: Meshed | None = None,
) -> dict[str, Any]:
    """Collect the figures of a run; those that need the CT are None where the model came from a file."""
    body = fitted.body if fitted is not None else body
    known: dict[str, Any] = {"law": model.law, "policy": model.sampling.mapping.policy.get("policy", "clamp")}
    known |= {"law_of_set": model.law_of_set, "transverse": model.sampling.mapping.transverse}
    known |= {"alarms": model.alarms, "calibrated": model.calibrated}
    if body is not None:
        flat = model.mesh.element.dimension == 2
        known["region_size"] = body.region.section_mm2 if flat else body.region.volume_mm3
        known["threshold_hu"] = body.threshold_hu
    if fitted is not None:
        error = fitted.fit.error
        known |= {"fit": fitted.method, "fit_error_mm": error.mean_mm, "fit_error_hu": error.mean_hu}
    figures = summary(model.counted, device, clock.seconds, **known)
    figures |= {} if model.coverage is None else model.coverage.to_dict()
    figures["optimized"] = None if model.optimized is None else model.optimized.to_dict()
    if choice is not None:
        figures["method"] = {"name": choice.method, "why": choice.why}
    found = {} if meshed is None else meshed.figures
    if body is not None and figures["lost_features"] is not None:
        lost = list_lost(found.get("lost_features", ()), figures["lost_features"], body.region)
        found = found | {"lost_features": lost}
    return figures | found
