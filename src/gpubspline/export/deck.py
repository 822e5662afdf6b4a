"""A model as decks carry it, as plain data in the deck's units: each format's module renders it.

mesh, node and element sets, surfaces      from the mesh and the regions of the load case
sections | table | nodal fields            the modulus, by element set or by node
loads                                      supports, nodal forces, pressures, gravity
"""

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.analysis.load_case import LoadCase
from gpubspline.export.deck_loads import DeckLoads, Faces, Placed, outer_faces, place_loads
from gpubspline.export.deck_material import NodalTable, Section, material_means
from gpubspline.export.density_names import with_kind
from gpubspline.export.formats import Format
from gpubspline.export.names import joined, named
from gpubspline.export.units import Units
from gpubspline.material.density import MASS_OF, WEIGHED
from gpubspline.material.laws import Law, common_kind
from gpubspline.mesh.mesh import Mesh

ALL_NODES, BODY = "all_nodes", ("body", "all_elements")
"""Sets that decks have of their own: of all nodes, and of all elements, where the body is a part as well."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Deck:
    """A model in one system of units, with names that every solver takes.

    Attributes
    ----------
    mesh: points in the deck's unit of length, fields renamed to its units, node and element sets.
    units: of all numbers here.
    surfaces: faces by name.
    sections: element sets by modulus, or none.
    table: the material by node as a table, or None.
    nodal: ``modulus``, ``poisson`` and perhaps ``density`` (n,) by node where the format holds fields, or nothing.
    elemental: the same by element (m,), of a mesh whose material is by element.
    axes: (m, 6) axes 1 and 2 of orthotropic elements, or None.
    loads: or None.
    comments: what the deck says of itself: units, law, means of the modulus and its error, load case.
    figures: the same as plain numbers, for a summary.
    thickness: of quads.
    step: text that ends the deck instead of the load case.
    """

    mesh: Mesh
    units: Units
    surfaces: dict[str, Faces]
    sections: tuple[Section, ...]
    table: NodalTable | None
    nodal: dict[str, NDArray[Any]]
    elemental: dict[str, NDArray[Any]]
    axes: Floats | None
    loads: DeckLoads | None
    comments: tuple[str, ...]
    figures: dict[str, Any]
    thickness: float
    step: str = ""

    @property
    def body(self) -> str:
        """Name of the set of all elements."""
        whole = len(self.mesh.element_sets.get(BODY[0], ())) in (0, self.mesh.n_elements)
        return BODY[0] if whole else BODY[1]

    @property
    def node_sets(self) -> dict[str, NDArray[Any]]:
        """Node sets but for ``all_nodes``, which some decks have of their own."""
        return {name: members for name, members in self.mesh.node_sets.items() if name != ALL_NODES}

    @property
    def element_sets(self) -> dict[str, NDArray[Any]]:
        """Element sets but for the one of all elements and those that are sections here."""
        own = {self.body, *(section.name for section in self.sections)}
        return {name: members for name, members in self.mesh.element_sets.items() if name not in own}

    @property
    def with_all_fields(self) -> Mesh:
        """The mesh with what formats of fields hold as such: the load case by node and the sections by element.

        They are ``force_n_x``, ``support_x`` and, if any is moved, ``prescribed_mm_x``; ``section_E_MPa``,
        ``section_nu`` and ``section_density_tonne_mm3``, in the deck's units.
        """
        by_node: dict[str, NDArray[Any]] = {}
        for place, axis in enumerate("xyz" if self.loads is not None else ""):
            assert self.loads is not None
            by_node[f"force_n_{axis}"] = np.ascontiguousarray(self.loads.all_forces[:, place])
            by_node[f"support_{axis}"] = self.loads.fixed[:, place].astype(np.int32)
            if self.loads.prescribed.any():
                name = f"prescribed_{self.units.length}_{axis}"
                by_node[name] = np.ascontiguousarray(self.loads.prescribed[:, place])
        names = {"modulus": f"E_{self.units.stress}", "poisson": "nu", "density": f"density_{self.units.density}"}
        by_element = {f"section_{name}": self._spread(key) for key, name in names.items() if self.sections}
        return self.mesh.with_fields(by_node).with_cell_fields(by_element)

    def _spread(self, key: str) -> Floats:
        values = np.zeros(self.mesh.n_elements)
        for section in self.sections:
            values[section.members] = getattr(section, key) or 0.0
        return values

    def comment_lines(self, width: int) -> list[str]:
        """Lines of the comments."""
        return [line for words in self.comments for line in textwrap.wrap(words, width)]


@dataclass(frozen=True)
class Wanted:
    """How a deck is asked for; see ``export.write``."""

    units: Units
    laws: Mapping[str, Law] = field(default_factory=dict)
    modulus_bins: int | None = None
    nodal_modulus: bool = False
    load: LoadCase | None = None
    thickness_mm: float = 1.0
    step: str = ""


def make_deck(mesh: Mesh, form: Format, wanted: Wanted) -> Deck:
    """Gather a model for a format.

    Raises
    ------
    InputError where bins or a table are wanted and the mesh has no material or none that the format can hold, or where
    the load case does not fit the mesh.
    """
    mesh = _with_sides(mesh)
    placed = Placed(None, {}, {}) if wanted.load is None else place_loads(wanted.load, mesh)
    wants_faces = form.binned or mesh.structure is not None or wanted.load is not None  # else they cost a search
    faces = _surfaces(mesh) if mesh.element.dimension == 3 and form.sets and wants_faces else {}
    means = material_means(mesh, form, wanted.units, wanted.modulus_bins, wanted.nodal_modulus)
    of_nodes, of_elements = ((ALL_NODES,), (*BODY, *(s.name for s in means.sections))) if form.binned else ((), ())
    node_sets, _ = joined(mesh.node_sets, placed.node_sets, _same_nodes, form.longest_name, of_nodes)
    surfaces, called = joined(faces, placed.surfaces, _same_faces, form.longest_name)
    element_sets = named(mesh.element_sets, {}, form.longest_name, of_elements)
    renamed = replace(with_kind(mesh), node_sets=node_sets, element_sets=element_sets)
    return Deck(
        mesh=_in_units(renamed, wanted.units),
        units=wanted.units,
        surfaces=surfaces,
        sections=means.sections,
        table=means.table,
        nodal=means.nodal,
        elemental=means.elemental,
        axes=means.axes,
        loads=None if placed.loads is None else _loads_in_units(placed.loads, called, wanted.units),
        comments=tuple(_comments(wanted, mesh, means.words, placed.loads)),
        figures={"format": form.name, "units": wanted.units.name, "modulus": means.figures}
        | _load_figures(placed.loads),
        thickness=wanted.thickness_mm * wanted.units.per_mm,
        step=wanted.step,
    )


def _with_sides(mesh: Mesh) -> Mesh:
    """Name the sides of a structured mesh, which a file that it was read from need not."""
    if mesh.structure is None or mesh.element.dimension == 2:
        return mesh
    sides = {side: mesh.boundary_nodes(side) for side in mesh.element.sides if side not in mesh.node_sets}
    if not sides:
        return mesh
    known = {**mesh.node_sets, **sides}
    outer = np.unique(np.concatenate([known[side] for side in mesh.element.sides]))
    return replace(mesh, node_sets={**known, "surface": mesh.node_sets.get("surface", outer)})


def _surfaces(mesh: Mesh) -> dict[str, Faces]:
    """Sides of a structured mesh, and for every other node set the boundary faces whose nodes are all in it."""
    if not mesh.node_sets:
        return {}
    outer, found = outer_faces(mesh), {}
    places = list(mesh.element.sides)
    starts = np.searchsorted(outer.sides, np.arange(len(places) + 1))  # a structured mesh's come side after side
    for name, members in mesh.node_sets.items():
        if mesh.structure is not None and name in places:
            place = places.index(name)
            faces = outer.only(slice(starts[place], starts[place + 1]))
        else:
            among = np.zeros(mesh.n_nodes, dtype=np.bool_)
            among[members] = True
            inside = np.logical_and.reduce([among[corner] for corner in outer.nodes.T])
            faces = outer if inside.all() else outer.only(inside)
        if faces.elements.size:
            found[name] = faces
    return found


def _in_units(mesh: Mesh, units: Units) -> Mesh:
    points = mesh.points if units.per_mm == 1 else mesh.points * mesh.points.dtype.type(units.per_mm)
    return replace(mesh, points=points, fields=units.fields(mesh.fields), cell_fields=units.fields(mesh.cell_fields))


def _same_nodes(one: NDArray[Any], other: NDArray[Any]) -> bool:
    return np.array_equal(np.unique(one), np.unique(other))


def _same_faces(one: Faces, other: Faces) -> bool:
    return np.array_equal(one.elements, other.elements) and np.array_equal(one.sides, other.sides)


def _loads_in_units(loads: DeckLoads, called: Mapping[str, str], units: Units) -> DeckLoads:
    """Loads in the deck's units, on surfaces by their names there."""
    return replace(
        loads,
        prescribed=loads.prescribed * units.per_mm,
        pressures=tuple((called[surface], pressure * units.per_mpa) for surface, pressure in loads.pressures),
        gravity=None if loads.gravity is None else loads.gravity * units.per_mm,
    )


def _comments(wanted: Wanted, mesh: Mesh, words: str, loads: DeckLoads | None) -> Iterable[str]:
    yield f"Units: {wanted.units.words}. Coordinates: patient, LPS. Labels from 1."
    for name, law in wanted.laws.items():
        of = f" of the set {name}" if name else " of the rest" if len(wanted.laws) > 1 else ""
        yield f"Material law{of}: {law.name}, {law.title}"
        yield law.citation
        yield from (f"Not confirmed from its source: {part}" for part in law.unconfirmed)
    kind = mesh.density_kind or (common_kind(wanted.laws.values()) if wanted.laws else None)
    if kind is not None:
        yield f"Densities are {kind}: {MASS_OF[kind]}." + (" Gravity takes them for weight." if kind != WEIGHED else "")
    if words:
        yield words
    if loads is not None:
        x, y, z = loads.total_n
        yield f"Load case: {loads.title}. Total force ({x:.9g}, {y:.9g}, {z:.9g}) N, as consistent nodal forces."


def _load_figures(loads: DeckLoads | None) -> dict[str, Any]:
    if loads is None:
        return {"load": None}
    held = int(np.count_nonzero(loads.fixed.any(axis=1)))
    return {"load": {"title": loads.title, "held_nodes": held, "total_n": loads.total_n.tolist()}}
