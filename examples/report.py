r"""A report: one page that opens without a network, with the mesh to turn, CT slices, charts, laws and citations.

Equation:  $SJ = \min_i \det(e_{i1}, e_{i2}, e_{i3})$ of unit edge vectors, eqs 3.4 and 3.5
Source:    Pise, Bhatt and Srivastava, section 3.3
Figure:    report.html; its histogram stands beside their Fig. 7
"""

import gpubspline as gb
from gpubspline.report.page import Account, write_report

device = gb.open_device()
volume = gb.phantom("child-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
mesh, _ = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), device=device)
mesh, quality = gb.assess(mesh, device)

account = Account(f"Mesh of {mesh.n_elements:,} hex8", mesh, quality=quality, volume=volume, laws=[gb.law()])
write_report(account, "report.html")
print(f"report.html: {mesh.n_elements:,} hexes, scaled Jacobian from {quality.min:.2f}")
