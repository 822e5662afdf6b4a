"""A format of one's own: the nodes of a mesh and their material as a table.

Equation:  none; a row a node: x, y, z in mm, E in MPa, nu
Source:    gpubspline.export.formats, the form in which every format declares what it holds
Figure:    none

A ``Format`` is a name, the extensions, what it holds, and a function that writes a deck: the model as plain data, with
fields and units already sorted out. Give it to ``write``; or let a package of yours declare it, and the command line
knows its extension:

    [project.entry-points."gpubspline.formats"]
    nodes-csv = "my_package:NODES_CSV"
"""

from pathlib import Path

import numpy as np

import gpubspline as gb
from gpubspline.export import Format
from gpubspline.export.deck import Deck
from gpubspline.files import whole_file


def write_nodes(deck: Deck, path: Path) -> None:
    """Write a deck's nodes and their material; the file appears whole or not at all."""
    mesh = deck.mesh
    table = np.column_stack([mesh.points, mesh.fields["E_MPa"], mesh.fields["nu"]])
    with whole_file(path) as temporary:
        np.savetxt(temporary, table, fmt="%.7g", delimiter=",", header="x_mm,y_mm,z_mm,E_MPa,nu", comments="")


NODES_CSV = Format("nodes-csv", (".csv",), ("quad4", "hex8"), write_nodes, nodal="field", fields=True)

device = gb.open_device()
volume = gb.phantom("child-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
mesh, _ = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), device=device)

gb.write(mesh, "own_format.csv", format=NODES_CSV)
rows = np.loadtxt("own_format.csv", delimiter=",", skiprows=1)
print(f"{len(rows):,} nodes, E from {rows[:, 3].min():.0f} to {rows[:, 3].max():.0f} MPa")
