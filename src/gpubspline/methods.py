"""By which of three methods a body is meshed: rows of one patch, five patches a section, or blocks of any topology."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from gpubspline.cautions import foretell, warn_of_bodies, warn_of_topology
from gpubspline.clock import Clock
from gpubspline.ct.region import Region
from gpubspline.device import Device
from gpubspline.errors import GpubsplineWarning, InputError, MeshError, NoSectionsError
from gpubspline.mesh.blocks.curved import curve
from gpubspline.mesh.blocks.mesher import blocks_mesh, size_that_keeps_topology
from gpubspline.mesh.blocks.parts import parts_of
from gpubspline.mesh.blocks.reach import MOST_LOST
from gpubspline.mesh.blocks.refine import refine
from gpubspline.mesh.blocks.result import Blocks, measured, sets_carried_to
from gpubspline.mesh.butterfly.patches import SMOOTHING as BUTTERFLY_SMOOTHING
from gpubspline.mesh.butterfly.patches import Butterfly, butterfly
from gpubspline.mesh.butterfly.sample import nodes_for, sample_butterfly
from gpubspline.mesh.element_size import default_size, size_for
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.thickness import thinnest
from gpubspline.recipe import Body, Meshing, Sampling, Shaping
from gpubspline.spline.lattice import SMOOTHING, surface_hu
from gpubspline.spline.reformat import stack

METHODS = ("auto", "tensor", "butterfly", "blocks")

REMNANT = 0.5
"""Of the region: a mesh of blocks that holds less is none of it."""

MOST_OFF_COUNT = 0.1
"""Of the number of hexes asked for, beyond which they are made again in another size."""

MOST_BLOCKS = 1 << 26
"""Hexes of a mesh of blocks: the grid that they are cut from has SAMPLES^3 points each, numbered by 32 bits."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A method, why it was chosen, and what was made on the way."""

    method: str
    why: str
    patches: Butterfly | None = None


@dataclass(frozen=True, eq=False)
class Meshed:
    """A mesh with HU at nodes where there is a CT, and what its method reports: figures for the summary.

    ``least_mm``: distance from the mesh from which parts of the region are left out, by the size of its elements.
    """

    mesh: Mesh
    figures: dict[str, Any] = field(default_factory=dict)
    least_mm: float | None = None


def implied(
    meshing: Meshing, shaping: Shaping, sampling: Sampling, sliced: bool = False, structured: bool = False
) -> Choice | None:
    """Method that is asked for by name, or that options of one method alone imply; None where it is free.

    ``sliced`` is whether one slice is meshed, ``structured`` whether the output holds structured meshes only.

    Raises
    ------
    InputError where options of different methods are mixed.
    """
    if meshing.method not in METHODS:
        raise InputError(f"expected the method {', '.join(METHODS)}, got {meshing.method!r}")
    sized = meshing.size_mm is not None or meshing.elements is not None
    asked = {
        "tensor": _tensor_options(shaping, sampling, sliced, structured),
        "butterfly": [
            f"--{name} of four counts"
            for name, counts in (("control", shaping.control), ("nodes", sampling.nodes))
            if counts is not None and len(counts) == 4
        ],
        "blocks": ["--refine"] if meshing.refine > 1 else [],
    }
    if sized and (asked["tensor"] or meshing.method == "tensor"):
        raise InputError(
            f"expected --size or --elements for butterfly or blocks, got {' and '.join(asked['tensor']) or '--method'} "
            "of the tensor method: its density is set by --nodes"
        )
    for method, options in asked.items():
        if options and meshing.method not in ("auto", method):
            raise InputError(f"expected no {options[0]}, which is for {method}, with --method {meshing.method}")
    given = [method for method, options in asked.items() if options]
    if len(given) > 1:
        mixed = " and ".join(f"{asked[method][0]} of {method}" for method in given)
        raise InputError(f"expected options of one method, got {mixed}")
    if meshing.method != "auto":
        choice = Choice(meshing.method, "asked for")
    elif given:
        choice = Choice(given[0], f"{asked[given[0]][0]} is for it")
    else:
        return None
    for option in _spline_options(shaping) if choice.method == "blocks" else ():
        raise InputError(f"expected no {option}, which is for tensor and butterfly, with blocks ({choice.why})")
    return choice


def _tensor_options(shaping: Shaping, sampling: Sampling, sliced: bool, structured: bool) -> list[str]:
    given = {
        "--output .vts": structured,
        "--slice": sliced,
        "--control": shaping.control is not None and len(shaping.control) < 4,
        "--nodes": sampling.nodes is not None and len(sampling.nodes) < 4,
        "--fit": shaping.fit != "control",
        "--degree of several": len(set(shaping.degree)) > 1,
        "--smooth-rows": shaping.row_smoothing != SMOOTHING,
        "--transverse-law": sampling.mapping.transverse is not None,  # only structured meshes have a w throughout
    }
    return [name for name, there in given.items() if there]


def _spline_options(shaping: Shaping) -> list[str]:
    """Options of both methods that have splines, which blocks have not."""
    given = {"--degree": shaping.degree != Shaping.degree, "--interpolation": shaping.interpolation != "linear"}
    return [name for name, there in given.items() if there]


def choose(
    body: Body,
    meshing: Meshing,
    shaping: Shaping,
    sampling: Sampling,
    axis: str,
    device: Device,
    sliced: bool = False,
    structured: bool = False,
) -> Choice:
    """Take the method asked for or implied; else the simplest that fits the body.

    That is the tensor method where every slice is one region that every row crosses once, unless an element size or
    number is asked for, which it does not know; five patches where every section is one part without holes; else
    blocks.
    """
    sampling.laws_of(body.labels)  # refuses before any work what no label is
    found = implied(meshing, shaping, sampling, sliced, structured)
    if found is not None:
        patches = _patches(body, shaping, axis, device) if found.method == "butterfly" else None
        return Choice(found.method, found.why, patches)
    sized = meshing.size_mm is not None or meshing.elements is not None
    if not sized and body.volume is not None and body.one_grid and is_row_convex(body.region, axis):
        return Choice("tensor", "every slice is one region that every row crosses once")
    try:
        made = _patches(body, shaping, axis, device)
    except NoSectionsError as error:
        for option in _spline_options(shaping):
            warnings.warn(f"{option} does nothing in blocks, which have no splines", GpubsplineWarning, stacklevel=2)
        return Choice("blocks", f"no butterfly: {error.found}")
    return Choice("butterfly", "every section is one part without holes", made)


def is_row_convex(region: Region, axis: str = "z") -> bool:
    """Whether every slice along the axis is one region that every row through it crosses once."""
    inside = stack(region, axis).distance_mm < 0
    starts = inside[..., :1].sum(axis=2) + (inside[..., 1:] & ~inside[..., :-1]).sum(axis=2)
    rows = starts > 0
    row_starts = rows[:, :1].sum(axis=1) + (rows[:, 1:] & ~rows[:, :-1]).sum(axis=1)
    meets = (inside[:, 1:] & inside[:, :-1]).any(axis=2) | ~(rows[:, 1:] & rows[:, :-1])
    return bool(starts.max() == 1 and (row_starts == 1).all() and meets.all())


def _patches(body: Body, shaping: Shaping, axis: str, device: Device) -> Butterfly:
    control = shaping.control
    if control is not None and len(control) != 4:
        raise InputError(f"expected 4 control counts U,V,R,W for a butterfly, got {control}")
    options: dict[str, Any] = {"axis": axis, "degree": shaping.degree[0], "interpolation": shaping.interpolation}
    options["partial_volume"] = body.partial_volume
    return butterfly(
        body.region,
        body.volume,
        control=None if control is None else (control[0], control[1], control[2], control[3]),
        smoothing=BUTTERFLY_SMOOTHING,
        device=device,
        **options,
    )


def mesh_body(body: Body, choice: Choice, meshing: Meshing, sampling: Sampling, device: Device, clock: Clock) -> Meshed:
    """Mesh a body with five patches a section or with blocks."""
    if choice.patches is not None:
        with clock.stage("sample"):
            return _butterfly_mesh(choice.patches, meshing, sampling, device)
    with clock.stage("blocks"):
        return _blocks_mesh(body, meshing, sampling, device, clock)


def _butterfly_mesh(made: Butterfly, meshing: Meshing, sampling: Sampling, device: Device) -> Meshed:
    nodes = sampling.nodes
    if nodes is not None and len(nodes) != 4:
        raise InputError(f"expected 4 node counts U,V,R,W for a butterfly, got {nodes}")
    if meshing.size_mm is None and meshing.elements is None:
        counts = None if nodes is None else (nodes[0], nodes[1], nodes[2], nodes[3])
    elif nodes is not None:
        raise InputError("expected --nodes, or --size or --elements, got both")
    else:
        counts = nodes_for(made, meshing.size_mm, meshing.elements)
    mesh = sample_butterfly(made, counts, order=sampling.order, element_type=sampling.element_type, device=device)
    fit = {"method": "interpolate", "error_mm": made.error.mean_mm, "error_hu": made.error.mean_hu}
    return Meshed(mesh, {"fit": fit})


def _blocks_mesh(body: Body, meshing: Meshing, sampling: Sampling, device: Device, clock: Clock) -> Meshed:
    if sampling.nodes is not None:
        raise InputError("expected --size or --elements for blocks, got --nodes")
    if sampling.optimize:
        raise InputError("expected no --optimize with blocks, whose nodes are moved to the best places already")
    if meshing.size_mm is not None and meshing.elements is not None:
        raise InputError("expected --size or --elements, got both")
    asked = meshing.elements or body.region.volume_mm3 / max((meshing.size_mm or np.inf) ** 3, 1e-300)
    if asked > MOST_BLOCKS:
        raise InputError(f"expected at most {MOST_BLOCKS:,} hexes of blocks, got about {asked:.2g}: a larger --size")
    size = blocks_size(body.region, meshing, device)
    element = sampling.element_type or {1: "hex8", 2: "hex20"}.get(sampling.order, f"order {sampling.order}")
    if element not in ("hex8", "hex20", "hex27"):
        raise InputError(f"expected hex8, hex20 or hex27 for blocks, got {element}")
    if meshing.refine > 1 and element != "hex8":
        raise InputError(f"expected hex8 with --refine, got {element}, whose curved edges follow the surface already")
    foretell(body.region, size, clock, of_surface=body.volume is None or not body.one_grid)
    parts, numbers = _parts(body, meshing)
    made = _counted(body.region, size, parts, meshing, device, clock)
    size = made.report.size_mm
    refuse_remnant(made, body.region)
    made = refine(made, meshing.refine, device=device)
    mesh, figures = (made.mesh, {}) if element == "hex8" else _curved(made, element, device)
    report = replace(made.report, bodies=measured(made.report.bodies, mesh))
    if parts:
        label = np.zeros(mesh.n_elements, dtype=np.int32)
        for name, number in numbers.items():
            label[mesh.element_sets[name]] = number
        mesh = mesh.with_cell_fields({"label": label})
    if body.volume is not None:
        points = mesh.points.astype(np.float64)
        hu = surface_hu(body.volume, body.region, points, partial_volume=body.partial_volume, device=device)
        mesh = mesh.with_fields({"HU": hu.astype(mesh.points.dtype)})
    keeps = None if made.report.is_whole or parts else size_that_keeps_topology(body.region, size, device=device)
    warn_of_topology(report, keeps)
    warn_of_bodies(report.bodies, parts, size)
    return Meshed(mesh, report.to_dict() | figures, MOST_LOST * size)


def refuse_remnant(made: Blocks, region: Region) -> None:
    """Raise MeshError where blocks hold so little of a region that they are no mesh of it."""
    share = made.mesh.volume_mm3 / region.volume_mm3
    if share < REMNANT:
        lost = made.report.lost_features
        place = ", ".join(f"{x:.4g}" for x in (lost[0].place_mm if lost else thinnest(region)[1]))
        raise MeshError(
            f"expected hexes of {made.report.size_mm:.3g} mm to fill the region, got {share:.0%} of it: it is thinner "
            f"than they are, as at ({place}) mm; ask for a smaller size or close the region's pores first"
        )


def _curved(made: Blocks, element: str, device: Device) -> tuple[Mesh, dict[str, Any]]:
    """Hexes whose midway nodes follow the surface, and how many of these could not."""
    curved = curve(made, device=device)
    held = curved.held_back
    if held["count"]:
        warnings.warn(
            f"{held['count']:,} midway nodes go only part of their way to the surface, or the boundary between labels, "
            f"so that no hex folds: up to {held['max_mm']:.2g} mm are left of it",
            GpubsplineWarning,
            stacklevel=2,
        )
    mesh = curved.sample(1, element)
    return replace(mesh, node_sets=sets_carried_to(mesh, made.mesh)), {"held_back_nodes": held}


def _parts(body: Body, meshing: Meshing) -> tuple[dict[str, Region], dict[str, int]]:
    """Bodies whose interfaces the mesh is to follow, and the label number of each; none without labels."""
    if body.labels is None or body.whole is None or body.volume is None or not (meshing.conforming and body.one_grid):
        return {}, {}
    return parts_of(body.region, body.volume, body.labels, body.whole)


def _counted(
    region: Region, size_mm: float, parts: Mapping[str, Region], meshing: Meshing, device: Device, clock: Clock
) -> Blocks:
    """Mesh by blocks; once more where the place taken has another number of hexes than was asked for.

    Hexes are counted in one place of the lattice before they are made: those of thin walls differ from place to place.
    """
    inverted = meshing.allow_inverted
    make = partial(blocks_mesh, region, parts=parts, allow_inverted=inverted, device=device, tell=clock.tell)
    made, asked = make(size_mm), meshing.elements
    if asked is None or abs(made.mesh.n_elements / asked - 1) <= MOST_OFF_COUNT:
        return made
    try:
        again = make(size_mm * float(made.mesh.n_elements / asked) ** (1 / 2.7))
    except MeshError:
        return made
    return min(made, again, key=lambda mesh: abs(mesh.mesh.n_elements - asked))


def blocks_size(region: Region, meshing: Meshing, device: Device) -> float:
    """Element size, mm, of a mesh of blocks: as asked for, for a number of elements, or for the thinnest feature."""
    if meshing.size_mm is not None:
        return meshing.size_mm
    return default_size(region) if meshing.elements is None else size_for(region, meshing.elements, device)
