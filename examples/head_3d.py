r"""A head in 3-D: slices stacked to a control lattice, a B-spline solid through it, sampled to hexes.

Equation:  $p(u, v, w) = \sum_i \sum_j \sum_k N_{i,p}(u) N_{j,q}(v) N_{k,r}(w) P_{i,j,k}$, eq. 3.1
Source:    Pise, Bhatt and Srivastava, section 3.2
Figure:    their Fig. 4c, 20 x 80 x 28 samples, and Fig. 9

Run it with the path of a head's CT, or without: then the phantom head is scanned.
"""

import sys

import gpubspline as gb

device = gb.open_device()
volume = gb.read_volume(sys.argv[1]) if len(sys.argv) > 1 else gb.phantom("head").scan()
region = gb.region_from_threshold(volume, -200)
lattice = gb.control_lattice(volume, region, (20, 80, min(28, volume.shape[2])))
patch = gb.fit(lattice, degree=3, device=device).patch
mesh = gb.sample(patch, (20, 80, 28), device=device)
mesh, quality = gb.assess(mesh, device)

print(f"{mesh.n_elements:,} hexes, {quality.fraction_above_0_5:.1%} above 0.5, {quality.inverted} inverted")
gb.write(mesh, "head_3d.vtu")
gb.write_picture(mesh, "head_3d.png", field="HU")
