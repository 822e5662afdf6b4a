"""The README's picture of blocks: ``python docs/scripts/gallery.py DATA docs/blocks.png``.

DATA is the folder of real CT and surfaces that tests look for beside the clone. Each body is meshed by the command
line, cut through the middle and coloured by scaled Jacobian.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

import gpubspline as gb
from gpubspline.report.camera import OBLIQUE, Camera
from gpubspline.report.painter import paint
from gpubspline.report.quantity import quantity
from gpubspline.report.skin import cut_skin

matplotlib.use("Agg")

import matplotlib.pyplot as plt

VERTEBRA = "vertebra/sub-ct_label-22_ct.nii.gz"
BODIES = {
    "bone, the benchmark's surface": (["surfaces/bone.ply"], ["--elements", "9800"], "z"),
    "vertebra L3, a label": (
        [VERTEBRA, "--mask", "vertebra/sub-ct_seg-vert_label-22_msk.nii.gz"],
        ["--label", "22", "--size", "2.2"],
        "x",
    ),
    "hip, above 200 HU": (
        ["hips/example_ct.nii.gz"],
        ["--threshold", "200", "--box=-146,-66,-190,-100,94,160", "--fill", "volume", "--size", "3.5"],
        "y",
    ),
    "head, above -200 HU": (
        ["head/ct_example.nii.gz"],
        ["--threshold", "-200", "--fill", "volume", "--size", "5"],
        "z",
    ),
    "head in a tilted gantry, skin": (
        ["dicom_tilt"],
        ["--threshold", "-200", "--elements", "10000"],
        "x",
    ),
    "hips, JPEG 2000, skin": (["dicom_j2k"], ["--threshold", "-200", "--elements", "10000"], "z"),
    "adult femur, the phantom": (["PHANTOM"], ["--elements", "14000"], "y"),
}


def draw(data: Path, path: Path) -> None:
    """Mesh every body and draw the cuts side by side."""
    colours, _ = quantity("scaled_jacobian").scale(np.array([0.0, 1.0]))
    figure, grid = plt.subplots(2, -(-len(BODIES) // 2), figsize=(15, 7), layout="constrained")
    panels = grid.ravel()
    for unused in panels[len(BODIES) :]:
        unused.axis("off")
    with tempfile.TemporaryDirectory() as folder:
        gb.write_phantom("adult-femur", Path(folder) / "PHANTOM")
        for panel, (title, (inputs, options, clip)) in zip(panels, BODIES.items(), strict=False):
            words = [w if w.startswith("--") else str((Path(folder) if w == "PHANTOM" else data) / w) for w in inputs]
            made = Path(folder) / "mesh.vtu"
            command = [sys.executable, "-m", "gpubspline", "mesh", *words, *options, "--method", "blocks"]
            subprocess.run([*command, "-o", str(made), "--quiet"], check=True)
            mesh = gb.read_mesh(made)
            _draw_cut(panel, mesh, "xyz".index(clip), colours)
            least = mesh.cell_fields["scaled_jacobian"].min()
            panel.set_title(f"{title}\n{mesh.n_elements:,} hexes, worst {least:.2f}", fontsize=10)
    figure.colorbar(colours, ax=grid, label="scaled Jacobian", fraction=0.012, pad=0.01)
    figure.savefig(path, dpi=90)


def _draw_cut(panel: Axes, mesh: gb.Mesh, axis: int, colours: ScalarMappable) -> None:
    """The half behind a cut, seen a little from the side."""
    oblique = Camera.looking(OBLIQUE)
    shell, normal = cut_skin(mesh, "scaled_jacobian", oblique.toward, axis)
    camera = Camera.looking(normal + 0.35 * (oblique.toward - (oblique.toward @ normal) * normal))
    picture, _ = camera.project(shell.corners.reshape(-1, 3))
    (left, low), (right, high) = picture.min(axis=0), picture.max(axis=0)
    panel.set_xlim(left, right)
    panel.set_ylim(low, high)
    panel.set_aspect("equal")
    panel.axis("off")
    paint(panel, shell, camera, colours)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
