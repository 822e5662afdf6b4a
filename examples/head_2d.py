r"""A head in 2-D: one slice as a B-spline surface that carries HU, sampled to quads.

Equation:  $p(u, v) = \sum_i \sum_j N_{i,p}(u) N_{j,q}(v) P_{i,j}$, eq. 3.2
Source:    Pise, Bhatt and Srivastava, section 3.1
Figure:    their Fig. 3a, 140 x 140 samples, and the histogram of its scaled Jacobians, Fig. 6

Run it with the path of a head's CT, or without: then the phantom head is scanned.
"""

import sys

import gpubspline as gb

device = gb.open_device()
volume = gb.read_volume(sys.argv[1]) if len(sys.argv) > 1 else gb.phantom("head").scan()
region = gb.region_from_threshold(volume, -200)
middle = region.mask.shape[0] // 2
lattice = gb.control_lattice(volume, region, (60, 60), slice_index=middle)
patch = gb.fit(lattice, degree=3, device=device).patch
mesh = gb.sample(patch, (140, 140), device=device)
mesh, quality = gb.assess(mesh, device)

print(f"{mesh.n_elements:,} quads, {quality.fraction_above_0_5:.1%} above 0.5, {quality.inverted} inverted")
gb.write(mesh, "head_2d.vtu")
gb.write_picture(mesh, "head_2d.png", field="HU")
gb.write_histogram(quality, "head_2d_quality.png")
