r"""A law of one's own: HU to density to modulus, from a TOML file.

Equation:  $\rho = a\,\mathrm{HU} + b$, $E = c \rho^{d}$, the form of eqs 3.6 and 3.7
Source:    Morgan, Bayraktar and Keaveny, J Biomech 36 (2003) 897-904: the femoral neck
Figure:    the child femur, coloured by the modulus of this law
"""

from pathlib import Path

import gpubspline as gb

LAW = """
[my-femur]
title = "Femoral neck, trabecular, with our scanner's calibration"
site = "femoral neck"
citation = "Morgan, Bayraktar, Keaveny, J Biomech 36 (2003) 897-904"
unconfirmed = ["Poisson's ratio"]

[my-femur.density]
kind = "apparent"
slope_g_cm3_per_hu = 0.00116
intercept_g_cm3 = 0.0
source = "calibration phantom"

[[my-femur.pieces]]
hu = [50.0, 1600.0]
factor_mpa = 6850.0
exponent = 1.49
poisson = 0.3
"""

Path("my_femur.toml").write_text(LAW)
device, law = gb.open_device(), gb.law("my_femur.toml")
volume = gb.phantom("child-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
mesh, material = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), law, device=device)

modulus = mesh.fields["E_MPa"]
print(f"{law.name}: E {modulus.min():.0f} to {modulus.max():.0f} MPa; unconfirmed: {', '.join(law.all_unconfirmed)}")
gb.write(mesh, "own_law.inp", law=law)
gb.write_picture(mesh, "own_law.png", field="E_MPa")
