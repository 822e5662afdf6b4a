"""Models for FEBio (.feb, version 4.0 of its format): the modulus is a map that each element interpolates.

A map holds a value for each node of each element, and FEBio interpolates it to the integration points with the
element's shape functions, as the project's own solver does: the field by node, not a mean. All loads are nodal forces;
FEBio's own gravity points the other way in some of its versions.

Source: FEBio user manual 4, chapters 3.6 Mesh, 3.8 MeshData, 3.11 Boundary, 3.13 Loads and appendix A.2; FEBio's
reader of maps (FEBioMeshDataSection4: one value for an element, or as many as it has nodes).
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from gpubspline.errors import InputError
from gpubspline.export.appended import xml_comment
from gpubspline.export.columns import write_labels, write_lines
from gpubspline.export.deck import Deck
from gpubspline.export.deck_loads import DeckLoads
from gpubspline.export.deck_material import Section
from gpubspline.export.formats import Format
from gpubspline.export.rows import REAL, chunks
from gpubspline.files import whole_file

ELEMENT_TYPES = ("quad4", "quad8", "hex8", "hex20")
"""FEBio calls them so too, and numbers their nodes as VTK does."""

CONTROL = """<Control>
<analysis>STATIC</analysis>
<time_steps>1</time_steps>
<step_size>1</step_size>
<solver type="solid"><symmetric_stiffness>symmetric</symmetric_stiffness></solver>
</Control>
"""
RAMP = """<LoadData>
<load_controller id="1" type="loadcurve">
<interpolate>LINEAR</interpolate>
<points><pt>0,0</pt><pt>1,1</pt></points>
</load_controller>
</LoadData>
"""
OUTPUT = """<Output>
<plotfile type="febio">
<var type="displacement"/>
<var type="stress"/>
</plotfile>
</Output>
"""
MAPS = {"modulus": "E", "poisson": "v", "density": "density"}
"""Parameters of FEBio's isotropic elastic material."""


def write(deck: Deck, path: Path) -> None:
    """Write a model; raises InputError for a mesh without material, which FEBio has not."""
    if not (deck.nodal or deck.elemental or deck.sections):
        raise InputError(
            "expected the fields E_MPa and nu for .feb, whose elements have a material, got a mesh without"
        )
    with whole_file(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as out:
        out.write('<?xml version="1.0" encoding="UTF-8"?>\n<febio_spec version="4.0">\n')
        out.writelines(f"{xml_comment(line)}\n" for line in deck.comment_lines(100))
        out.write('<Module type="solid"/>\n' + CONTROL)
        _write_materials(out, deck)
        with _tag(out, "Mesh"):
            _write_mesh(out, deck)
            if deck.loads is not None:
                _write_load_sets(out, deck.loads)
        with _tag(out, "MeshDomains"):
            _write_domains(out, deck)
        if deck.nodal or deck.elemental or deck.axes is not None or deck.loads is not None:
            with _tag(out, "MeshData"):
                _write_data(out, deck)
        if deck.loads is not None:
            _write_loads(out, deck.loads)
            out.write(RAMP)
        out.write(OUTPUT + "</febio_spec>\n")


@contextmanager
def _tag(out: TextIO, kind: str, /, **attributes: str) -> Iterator[None]:
    given = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
    out.write(f"<{kind}{given}>\n")
    yield
    out.write(f"</{kind}>\n")


def _parts(deck: Deck) -> Sequence[Section]:
    """Sections, or the body as one of no material of its own."""
    whole = Section(deck.body, np.arange(deck.mesh.n_elements), 0.0, 0.0, None)
    return deck.sections or (whole,)


def _write_materials(out: TextIO, deck: Deck) -> None:
    with _tag(out, "Material"):
        for number, section in enumerate(_parts(deck), start=1):
            kind = "orthotropic elastic" if section.constants else "isotropic elastic"
            with _tag(out, "material", id=str(number), name=_material(section), type=kind):
                maps = deck.nodal or deck.elemental
                if maps:
                    ordered = [key for key in ("density", "modulus", "poisson") if key in maps]
                    out.writelines(f'<{MAPS[k]} type="map">{k}_map</{MAPS[k]}>\n' for k in ordered)
                else:
                    density = "" if section.density is None else f"<density>{REAL % section.density}</density>\n"
                    if section.constants:
                        out.write(density + _constants(section.constants))
                        continue
                    out.write(f"{density}<E>{REAL % section.modulus}</E>\n<v>{REAL % section.poisson}</v>\n")


def _constants(given: tuple[float, ...]) -> str:
    """FEBio's own nine, of which v31 is nu13 E3 / E1."""
    names = ("E1", "E2", "E3", "v12", "v13", "v23", "G12", "G31", "G23")
    known = dict(zip(names, given, strict=True))
    known["v31"] = known.pop("v13") * known["E3"] / known["E1"]
    order = ("E1", "E2", "E3", "v12", "v23", "v31", "G12", "G23", "G31")
    return "".join(f"<{name}>{REAL % known[name]}</{name}>\n" for name in order)


def _material(section: Section) -> str:
    return f"bone_{section.name}"


def _write_mesh(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    with _tag(out, "Nodes", name="all_nodes"):
        write_lines(out, '<node id="{}">{},{},{}</node>', [np.arange(mesh.n_nodes) + 1, *mesh.planes])
    line = f'<elem id="{{}}">{_commas(mesh.element.n_nodes)}</elem>'
    for section in _parts(deck):
        with _tag(out, "Elements", type=mesh.element_type, name=section.name):
            for rows in chunks(len(section.members)):
                members = section.members[rows]
                write_lines(out, line, [members + 1, *(mesh.cells_of(members).T + 1)])
    face = mesh.element.side_name
    for name, faces in deck.surfaces.items():
        with _tag(out, "Surface", name=name):
            line = f'<{face} id="{{}}">{_commas(faces.nodes.shape[1])}</{face}>'
            write_lines(out, line, [np.arange(len(faces.nodes)) + 1, *(faces.nodes.T + 1)])
    whole = {} if not deck.sections else {deck.body: np.arange(mesh.n_elements)}
    for name, members in {**whole, **deck.element_sets}.items():
        _write_set(out, "ElementSet", name, members)
    for name, members in deck.node_sets.items():
        _write_set(out, "NodeSet", name, members)


def _commas(count: int) -> str:
    return ",".join(["{}"] * count)


def _write_set(out: TextIO, kind: str, name: str, members: NDArray[Any]) -> None:
    with _tag(out, kind, name=name):
        write_labels(out, members)


def _write_domains(out: TextIO, deck: Deck) -> None:
    for section in _parts(deck):
        names = f'name="{section.name}" mat="{_material(section)}"'
        if deck.mesh.element.dimension == 3:
            out.write(f"<SolidDomain {names}/>\n")
        else:
            out.write(f"<ShellDomain {names}><shell_thickness>{deck.thickness:g}</shell_thickness></ShellDomain>\n")


def _write_data(out: TextIO, deck: Deck) -> None:
    mesh = deck.mesh
    for section in deck.sections if deck.axes is not None else ():
        assert deck.axes is not None
        with _tag(out, "ElementData", type="mat_axis", elem_set=section.name):
            columns = [np.arange(len(section.members)) + 1, *deck.axes[section.members].T]
            write_lines(out, '<elem lid="{}"><a>{},{},{}</a><d>{},{},{}</d></elem>', columns)
    for key, values in deck.elemental.items():
        with _tag(out, "ElementData", name=f"{key}_map", elem_set=deck.body, data_type="scalar"):
            write_lines(out, '<elem lid="{}">{}</elem>', [np.arange(mesh.n_elements) + 1, values])
    for key, values in deck.nodal.items():
        with _tag(out, "ElementData", name=f"{key}_map", elem_set=deck.body, data_type="scalar"):
            for rows in chunks(mesh.n_elements):
                elements = np.arange(rows.start, rows.stop)
                columns = [elements + 1, *values[mesh.cells_of(elements).T]]
                write_lines(out, f'<elem lid="{{}}">{_commas(mesh.element.n_nodes)}</elem>', columns)
    if deck.loads is None:
        return
    nodes, forces = deck.loads.forced(everything=True)
    if nodes.size:
        with _tag(out, "NodeData", name="force_map", node_set="load_forces", data_type="vec3"):
            write_lines(out, '<node lid="{}">{},{},{}</node>', [np.arange(nodes.size) + 1, *forces.T])


def _write_load_sets(out: TextIO, loads: DeckLoads) -> None:
    for number, (nodes, _, _) in enumerate(loads.supports(), start=1):
        _write_set(out, "NodeSet", f"load_support_{number}", nodes)
    nodes, _ = loads.forced(everything=True)
    if nodes.size:
        _write_set(out, "NodeSet", "load_forces", nodes)


def _write_loads(out: TextIO, loads: DeckLoads) -> None:
    with _tag(out, "Boundary"):
        for number, (_, components, at) in enumerate(loads.supports(), start=1):
            still = components & (at == 0)
            if still.any():
                with _tag(out, "bc", type="zero displacement", node_set=f"load_support_{number}"):
                    out.writelines(f"<{axis}_dof>{int(s)}</{axis}_dof>\n" for axis, s in zip("xyz", still, strict=True))
            for axis, moved, value in zip("xyz", components & ~still, at, strict=True):
                if moved:
                    with _tag(out, "bc", type="prescribed displacement", node_set=f"load_support_{number}"):
                        out.write(f'<dof>{axis}</dof>\n<value lc="1">{REAL % value}</value>\n<relative>0</relative>\n')
    if loads.all_forces.any():
        with _tag(out, "Loads"), _tag(out, "nodal_load", type="nodal_force", node_set="load_forces"):
            out.write('<value lc="1" type="map">force_map</value>\n')


FORMATS = (
    Format(
        "febio",
        (".feb",),
        ELEMENT_TYPES,
        write,
        nodal="field",
        binned=True,
        orthotropic=True,
        loads=True,
        sets=True,
        material=True,
        readable=False,
    ),
)
