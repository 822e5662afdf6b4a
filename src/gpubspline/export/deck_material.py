"""The material as a deck carries it: element sets by modulus, a table by node that plays the temperature, or fields."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.export.formats import Format
from gpubspline.export.modulus_bins import ModulusBins, modulus_bins
from gpubspline.export.modulus_table import ModulusTable, modulus_table
from gpubspline.export.units import Units
from gpubspline.material.orthotropy import MODULI, is_orthotropic
from gpubspline.mesh.mesh import Mesh

DEFAULT_BINS = 100
"""Element sets by modulus where a format has nothing better and none are asked for."""

CONSTANTS = (*MODULI, "nu12", "nu13", "nu23", "G12_MPa", "G13_MPa", "G23_MPa")
"""Fields of orthotropic elements, in the order of Abaqus's engineering constants."""

LARGEST_TEMPERATURE = 1000.0
"""CalculiX 2.20 takes temperatures above 2,000, or below -2,000, for none: elements get the modulus at zero."""

TABLE_ERRORS = ("error", "poisson_error", "density_error", "density_total_error", "share_off")
"""Of ``ModulusTable``, in the figures of a deck."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Section:
    """Elements of one material, in the deck's units; ``density`` is None where the mesh has none above zero.

    ``constants`` are those of orthotropic elements: E1, E2, E3, nu12, nu13, nu23, G12, G13, G23.
    """

    name: str
    members: NDArray[Any]
    modulus: float
    poisson: float
    density: float | None
    constants: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class NodalTable:
    """A material along a nodal field that plays the temperature.

    Attributes
    ----------
    carrier: name of the field.
    temperature: (n,) its values at the nodes.
    at: (r,) its value in each row of the table, rising, in the type of the nodes' own.
    modulus, poisson, density: (r,) in the deck's units; density None as in ``Section``.
    """

    carrier: str
    temperature: NDArray[Any]
    at: NDArray[Any]
    modulus: Floats
    poisson: Floats
    density: Floats | None


@dataclass(frozen=True, eq=False)
class Means:
    """By what means a deck has its modulus, in words and figures; see ``Deck``."""

    words: str = ""
    figures: dict[str, Any] | None = None
    sections: tuple[Section, ...] = ()
    table: NodalTable | None = None
    nodal: dict[str, NDArray[Any]] = field(default_factory=dict)
    elemental: dict[str, NDArray[Any]] = field(default_factory=dict)
    axes: Floats | None = None


def material_means(mesh: Mesh, form: Format, units: Units, bins: int | None, nodal: bool) -> Means:
    """Choose how a deck has its modulus: by node as a table or a field, or in ``bins``; ``nodal`` wants it by node.

    Raises
    ------
    InputError where bins or nodes are asked for and the mesh has no material, or none that the format can hold.
    """
    by_node = {"E_MPa", "nu"} <= mesh.fields.keys()
    by_element = {"E_MPa", "nu"} <= mesh.cell_fields.keys()
    if bins is not None and not (by_node or by_element):
        raise InputError("expected the fields E_MPa and nu to gather by modulus, got a mesh without them")
    if nodal and not by_node:
        raise InputError("expected the nodal fields E_MPa and nu for a modulus by node, got a mesh without them")
    if not (by_node or by_element) or not (form.binned or form.nodal):
        return Means()
    count = DEFAULT_BINS if bins is None else bins
    if is_orthotropic(mesh) and form.orthotropic:
        if nodal:
            raise InputError(
                "expected isotropic elements for a modulus by node, got orthotropic ones, which are binned"
            )
        return _orthotropic(mesh, modulus_bins(mesh, count), units)
    if bins is None and by_node and form.nodal == "table":
        return _table(mesh, form, units)
    if bins is None and form.nodal == "field":
        return _fields(mesh, units, by_node)
    return _sections(modulus_bins(mesh, count), units)


def _table(mesh: Mesh, form: Format, units: Units) -> Means:
    straight = mesh.element.order == 1
    found = modulus_table(mesh.fields, form.most_rows, straight)
    density = found.columns.get("density_g_cm3")
    carried = mesh.fields[found.carrier]
    over = 10.0 ** max(0, np.ceil(np.log10(max(np.abs(carried).max() / LARGEST_TEMPERATURE, 1e-300))))
    table = NodalTable(
        found.carrier,
        carried / carried.dtype.type(over),
        found.at.astype(carried.dtype) / carried.dtype.type(over),  # in its type, so that a node lies on its row
        found.columns["E_MPa"] * units.per_mpa,
        found.columns["nu"],
        None if density is None else density * units.per_g_cm3,
    )
    told = f"the field {found.carrier}" + ("" if over == 1 else f" over {over:g}")
    within = "each element takes the mean of its nodes" if straight else "between nodes the solver interpolates it"
    words = (
        f"Material by node: the temperature is {told}, no heat; {within}. The table gives each node "
        f"its modulus within {100 * found.error:.2g} %. {_beside(found)} Give no thermal expansion and no other "
        "temperature."
    )
    figures: dict[str, Any] = {"means": "table by node", "carrier": found.carrier, "rows": found.at.size}
    figures |= {name: getattr(found, name) for name in TABLE_ERRORS}
    return Means(words, figures, table=table)


def _beside(found: ModulusTable) -> str:
    """Say how well a table keeps what is not the modulus."""
    poisson, density = f"{found.poisson_error:.2g}", f"{100 * found.density_error:.3g} %"
    if not found.share_off:
        return f"Poisson's ratio and density are theirs, within {poisson} and {density}."
    return (
        f"Where the law gives one modulus at two densities, as for {100 * found.share_off:.3g} % of the nodes, "
        f"Poisson's ratio and density are means of both. Poisson's ratio is off by at most {poisson}; the density of a "
        f"node, which weight alone takes, by {density}, and the mass of all by {100 * found.density_total_error:.2g} %."
    )


def _fields(mesh: Mesh, units: Units, by_node: bool) -> Means:
    given = mesh.fields if by_node else mesh.cell_fields
    fields = {"modulus": _times(given["E_MPa"], units.per_mpa), "poisson": given["nu"]}
    if "density_g_cm3" in given and np.all(given["density_g_cm3"] > 0):
        fields["density"] = _times(given["density_g_cm3"], units.per_g_cm3)
    if by_node:
        words = "Material by node: inside each element the modulus is interpolated between its nodes'."
        return Means(words, {"means": "field by node", "error": 0.0}, nodal=fields)
    return Means("Material by element.", {"means": "field by element", "error": 0.0}, elemental=fields)


def _times(values: NDArray[Any], factor: float) -> NDArray[Any]:
    """Values in another unit, which may be their own."""
    return values if factor == 1 else values * factor


def _sections(bins: ModulusBins, units: Units) -> Means:
    density = [None] * len(bins.members) if bins.density_g_cm3 is None else bins.density_g_cm3 * units.per_g_cm3
    rows = zip(bins.members, bins.modulus_mpa * units.per_mpa, bins.poisson, density, strict=True)
    sections = tuple(
        Section(f"modulus_{number}", members, float(modulus), float(poisson), float(rho) if rho and rho > 0 else None)
        for number, (members, modulus, poisson, rho) in enumerate(rows, start=1)
    )
    words = (
        f"Material by element: {bins.source}, in {len(bins.members)} bins of it and of Poisson's ratio. Binning "
        f"changes it by {100 * bins.mean_error:.3g} % on average and {100 * bins.largest_error:.3g} % at most, and "
        f"Poisson's ratio by {bins.poisson_error:.3g} at most."
    )
    errors = {"mean_error": bins.mean_error, "largest_error": bins.largest_error, "poisson_error": bins.poisson_error}
    return Means(words, {"means": "bins", "bins": len(bins.members), **errors}, sections)


def _orthotropic(mesh: Mesh, bins: ModulusBins, units: Units) -> Means:
    """Sections by the mean modulus, each with the mean constants of its elements; axes by element."""
    given = {name: mesh.cell_fields[name].astype(np.float64) for name in CONSTANTS}
    plain = _sections(bins, units)
    sections, off = [], np.zeros(mesh.n_elements)
    for section in plain.sections:
        mean = {name: float(values[section.members].mean()) for name, values in given.items()}
        for name in MODULI:
            error = np.abs(mean[name] / given[name][section.members] - 1)
            off[section.members] = np.maximum(off[section.members], error)
        scaled = (value * (units.per_mpa if name.endswith("_MPa") else 1.0) for name, value in mean.items())
        sections.append(replace(section, constants=tuple(scaled)))
    axes = np.stack([mesh.cell_fields[f"axis{axis}_{c}"] for axis in (1, 2) for c in "xyz"], axis=1)
    words = (
        f"Orthotropic by element: {len(sections)} bins of the mean modulus, each with the mean constants of its "
        f"elements, which changes E1, E2 and E3 by {100 * off.mean():.3g} % on average and {100 * off.max():.3g} % at "
        "most. Axis 3 runs along w, from slice to slice, axis 1 across it in the plane of u and w."
    )
    errors = {"mean_error": float(off.mean()), "largest_error": float(off.max()), "poisson_error": bins.poisson_error}
    figures = {"means": "bins", "bins": len(sections), "orthotropic": True, **errors}
    return Means(words, figures, tuple(sections), axes=axes.astype(np.float64))
