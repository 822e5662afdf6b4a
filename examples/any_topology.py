r"""Any topology: a ring, which no tensor-product patch can fill, as all-hexahedral blocks.

Equation:  $\chi = V - E + F - C$, the Euler characteristic: 0 for a ring, in the region and in the mesh
Source:    gpubspline.mesh.blocks: a core of lattice cells, its repair, a pillow of hexes, nodes moved to the level set
Figure:    the ring, coloured by scaled Jacobian
"""

import numpy as np

import gpubspline as gb

k, j, i = np.mgrid[:24, :56, :56].astype(np.float32)
off = np.hypot(np.hypot(i - 27.5, j - 27.5) - 17, k - 11.5) - 7  # signed distance of a torus, mm
volume = gb.Volume((-100 * off).astype(np.float32), np.eye(4))  # HU: 0 on the surface, rising inwards
region = gb.region_from_threshold(volume, 0, fill="none")

device = gb.open_device()
blocks = gb.blocks_mesh(region, 3.0, device=device)
mesh, quality = gb.assess(blocks.mesh, device)
report = blocks.report
print(f"{mesh.n_elements:,} hexes, scaled Jacobian from {quality.min:.2f}, Euler characteristic {report.euler}")
gb.write(mesh, "any_topology.vtu")
gb.write_picture(mesh, "any_topology.png", field="scaled_jacobian")
