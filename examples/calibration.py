r"""Calibrating the scanner: rods of known density in the scan give the line from HU to density.

Equation:  least squares of $\rho = a\,\mathrm{HU} + b$ over the rods; then the law's own powers, eq. 3.6
Source:    Pise, Bhatt and Srivastava, section 3.5, which takes one line for every scanner
Figure:    none; the rods' densities, known and fitted
"""

from pathlib import Path

import numpy as np

import gpubspline as gb
from gpubspline.material.calibration_file import read_calibration

RODS_G_CM3 = {0.05: 40.0, 0.1: 92.0, 0.2: 196.0, 0.4: 404.0}
"""Density of each rod of the phantom below the patient, and the HU it has in this scan."""

affine = np.diag([1.0, 1.0, 2.0, 1.0])
samples = np.random.default_rng(0).normal(0, 8, (20, 40, 120)).astype(np.float32)  # (k, j, i): water, with noise
lines = ['kind = "QCT"', 'source = "phantom of May"']
for number, (density, hu) in enumerate(RODS_G_CM3.items()):
    i = 15 + 30 * number
    samples[:, 10:30, i - 10 : i + 10] += hu
    lines += ["[[rods]]", f"density_g_cm3 = {density}", f"centre_mm = [{i}.0, 20.0, 20.0]", "radius_mm = 6.0"]
Path("rods.toml").write_text("\n".join(lines))
scan = gb.Volume(samples, affine)

found = read_calibration("rods.toml").carry_out(scan)
for rod in found.references:
    print(f"{rod.hu:6.1f} HU: known {rod.density_g_cm3:.3f}, fitted {rod.fitted_g_cm3:.3f} g/cm3")
law = gb.law().calibrated(found.relation)
low, high = law.range_hu
print(f"off by {found.rms_g_cm3:.4f} g/cm3; the law {law.name} now speaks of {low:.0f} to {high:.0f} HU")
