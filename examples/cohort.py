r"""A cohort: a manifest of subjects worked through by processes, resumed, and compared.

Equation:  $M_i = 0.6745 (x_i - \tilde{x}) / \mathrm{MAD}$, the modified z-score; beyond 3.5 is an outlier
Source:    Iglewicz and Hoaglin, How to Detect and Handle Outliers (1993)
Figure:    cohort/cohort.html

The same from the command line: ``gpubspline batch cohort.csv -o cohort``.
"""

import subprocess
import sys
from pathlib import Path

import gpubspline as gb

MANIFEST = """subject,input,control,nodes,threshold
fine,femur,"11,18,34","11,18,34",
coarse,femur,"8,10,16","8,10,16",
empty,femur,"8,10,16","8,10,16",9000
"""

if __name__ == "__main__":  # workers are processes of their own, which import this file
    if not Path("femur").exists():
        gb.write_phantom("child-femur", "femur")
    Path("cohort.csv").write_text(MANIFEST)
    command = [sys.executable, "-m", "gpubspline", "batch", "cohort.csv", "-o", "cohort", "--workers", "2"]
    first, second = (subprocess.run(command, check=False, capture_output=True, text=True) for _ in range(2))
    print(first.stdout, f"exit status {first.returncode}\nand again:\n{second.stdout}", sep="")
