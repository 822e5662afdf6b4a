r"""A femur with material: every node gets its density, Young's modulus and Poisson's ratio from its HU.

Equation:  $\rho = 1.9\,\mathrm{HU} / 1630$, eq. 3.7; $E = 1904 \rho^{1.64}$ or $2065 \rho^{3.09}$, eq. 3.6
Source:    Pise, Bhatt and Srivastava, sections 3.2 and 3.5, after Wirtz et al. 2000
Figure:    their Fig. 4b, 14 x 24 x 46 samples of 97 slices, and Fig. 11b, the distribution of E
"""

import gpubspline as gb

device = gb.open_device()
volume = gb.phantom("adult-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
lattice = gb.control_lattice(volume, region, (14, 24, 46))
patch = gb.fit(lattice, degree=3, device=device).patch
mesh = gb.sample(patch, (14, 24, 46), device=device)
mesh, material = gb.apply_material(mesh, device=device)
mesh, quality = gb.assess(mesh, device)

modulus = mesh.fields["E_MPa"]
print(f"{mesh.n_elements:,} hexes, {quality.fraction_above_0_5:.1%} above 0.5, {quality.inverted} inverted")
print(f"E {modulus.min():.0f} to {modulus.max():.0f} MPa; {material.out_of_range} nodes outside the law's range")
gb.write(mesh, "femur.vtu")
gb.write(mesh, "femur.inp", law=gb.law())
gb.write_picture(mesh, "femur.png", field="E_MPa")
