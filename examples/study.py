r"""A study: meshes of growing density of one body under one load, until the answer stays.

Equation:  $\Delta\sigma_v = (\sigma_i - \sigma_{ref}) / \sigma_{ref}$, the change of the maximum von Mises stress
Source:    Pise, Bhatt and Srivastava, section 3.6
Figure:    their Fig. 13; study/study.png

The same from the command line: ``gpubspline study femur --load stance -o study``.
"""

import json
import subprocess
import sys
from pathlib import Path

import gpubspline as gb

if not Path("femur").exists():
    gb.write_phantom("child-femur", "femur")
words = ["--load", "stance", "--control", "11,18,34", "--nodes-list", "6x9x17 8x12x22 11x18x34", "-o", "study"]
subprocess.run([sys.executable, "-m", "gpubspline", "study", "femur", *words, "--quiet"], check=True)
found = json.loads(Path("study/study.json").read_text())
for model in found["models"]:
    print(f"{model['elements']:6,} elements: {model['max_von_mises_mpa']:.1f} MPa")
