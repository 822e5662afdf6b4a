r"""Single-legged stance: linear elasticity on graded elements, displacement and von Mises stress.

Equation:  $\nabla \cdot \sigma = 0$, $\sigma = \lambda(x)\,\mathrm{tr}(\varepsilon) I + 2 \mu(x)\,\varepsilon$
Source:    Pise, Bhatt and Srivastava, section 3.6 and its table of forces
Figure:    their Fig. 12, the load case; the child femur, coloured by von Mises stress
"""

import gpubspline as gb
from gpubspline.clock import Clock

device = gb.open_device()
volume = gb.phantom("child-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
mesh, _ = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), device=device)

response = gb.respond(mesh, gb.load_case("stance"), device, Clock())
figures = response.figures()
balance = [a + r for a, r in zip(figures["applied_n"], figures["reaction_n"], strict=True)]
print(f"moved {figures['max_displacement_mm']:.2f} mm at most, forces balance to {max(map(abs, balance)):.0e} N")
print(f"von Mises stress {figures['max_von_mises_mpa']:.0f} MPa at most: {figures['max_von_mises_is']}")
gb.write(response.mesh, "stance.vtu")
gb.write_picture(response.mesh, "stance.png", field="von_mises_mpa")
