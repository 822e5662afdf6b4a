"""Abaqus and CalculiX: meshio reads nodes, elements and sets; CalculiX solves it in ``test_calculix.py``."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np

from foreign import Found


def read(path: Path) -> Found:
    import meshio

    mesh = meshio.read(path)
    text = path.read_text()
    sets = {name: np.asarray(nodes) for name, nodes in mesh.point_sets.items() if name != "all_nodes"}
    elements = {name: np.asarray(members[0]) for name, members in mesh.cell_sets.items()}
    comment = " ".join(re.findall(r"^\*\*(.*)", text, re.MULTILINE))
    found = Found("CalculiX, meshio", mesh.points, mesh.cells[0].data, sets, elements, comment=comment)
    if "*STEP" in text and shutil.which("ccx"):
        found.internal = solve(text, path.parent / "ccx")
    return found


def solve(text: str, folder: Path) -> np.ndarray:
    """Internal forces (n, 3) of the nodes as CalculiX prints them, with six digits."""
    return printed(text, folder, "RF", r"forces \(fx,fy,fz\)")


def displacement(text: str, folder: Path) -> np.ndarray:
    """Displacement (n, 3) of the nodes as CalculiX prints it, with six digits."""
    return printed(text, folder, "U", r"displacements")


def printed(text: str, folder: Path, asked: str, title: str) -> np.ndarray:
    folder.mkdir()
    wanted = f"*NODE PRINT, NSET=all_nodes\n{asked}\n*NODE FILE\n"
    (folder / "model.inp").write_text(text.replace("*NODE FILE\n", wanted))
    done = subprocess.run(["ccx", "-i", "model"], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    rows = re.search(rf"{title} .*\n\n((?:\s+\d+\s.*\n)+)", (folder / "model.dat").read_text())[1]
    return np.array([[float(word) for word in row.split()[1:]] for row in rows.splitlines()])
