r"""A kernel of one's own on every backend: the speed of ultrasound in a femur.

Equation:  $c = \sqrt{\frac{E (1 - \nu)}{\rho (1 + \nu) (1 - 2 \nu)}}$, longitudinal waves in an isotropic solid
Source:    Achenbach, Wave Propagation in Elastic Solids (1973): the speed of longitudinal waves
Figure:    the femur, coloured by metres a second

A kernel is a pair of files in a package, here ``own_kernels/ultrasound.py`` and ``own_kernels/ultrasound.cl``, with one
name and one list of arguments; the device of either backend finds its own by ``"own_kernels.ultrasound.speed"``.
"""

import numpy as np

import gpubspline as gb

device = gb.open_device()
volume = gb.phantom("child-femur").scan()
region = gb.region_from_threshold(volume, gb.otsu_threshold(volume))
patch = gb.fit(gb.control_lattice(volume, region, (11, 18, 34)), degree=3, device=device).patch
mesh, _ = gb.apply_material(gb.sample(patch, (11, 18, 34), device=device), device=device)

fields = [mesh.fields[name] for name in ("E_MPa", "nu", "density_g_cm3")]
speed = device.empty(mesh.n_nodes)
device.launch("own_kernels.ultrasound.speed", mesh.n_nodes, *map(device.put, fields), mesh.n_nodes, speed)
mesh = mesh.with_fields({"speed_m_s": device.get(speed)})

modulus, poisson, density = (values.astype(float) for values in fields)
expected = np.sqrt(1e3 * modulus * (1 - poisson) / (density * (1 + poisson) * (1 - 2 * poisson)))
off = float(np.abs(mesh.fields["speed_m_s"] / expected - 1).max())
print(f"{device.backend}: {mesh.fields['speed_m_s'].max():.0f} m/s in the cortex, within {off:.0e} of numpy's")
gb.write_picture(mesh, "own_kernel.png", field="speed_m_s")
