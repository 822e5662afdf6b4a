"""Nastran: pyNastran, in an interpreter of its own, since it wants numpy below 2.

The environment variable ``GPUBSPLINE_PYNASTRAN`` names that interpreter; this file is also what it runs.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__)


def interpreter() -> str | None:
    return os.environ.get("GPUBSPLINE_PYNASTRAN")


def read(path: Path):
    import numpy as np

    from foreign import Found

    done = subprocess.run([interpreter(), str(SCRIPT), str(path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    given = {
        key: np.array(value) if isinstance(value, list) else value for key, value in json.loads(done.stdout).items()
    }
    text = path.read_text()
    names = {int(number): name for number, name in re.findall(r"^\$ \w+ (?:set )?(\d+): (\w+)", text, re.MULTILINE)}
    sets = {names[int(number)]: np.array(ids) - 1 for number, ids in given.pop("sets").items() if int(number) < 2000}
    elements = {names[int(n)]: np.array(ids) - 1 for n, ids in given.pop("element_sets").items()}
    surfaces = {names[int(n)]: {frozenset(face) for face in each} for n, each in given.pop("surfaces").items()}
    pressed = given.pop("pressed", None)
    found = Found("pyNastran", given.pop("points"), given.pop("cells"), sets, elements, surfaces, **given)
    if pressed is not None:
        found.pressed = [({frozenset(face) for face in each}, float(value)) for value, each in pressed.items()]
    found.comment = " ".join(re.findall(r"^\$(.*)", text, re.MULTILINE))
    return found


ORDER = {8: range(8), 20: (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}


def plain(path: str) -> dict:
    """What pyNastran reads, as lists; it uses no other code of this project."""
    import numpy as np
    from pyNastran.bdf.bdf import read_bdf

    bdf = read_bdf(path, debug=False)
    nodes, elements = sorted(bdf.nodes), sorted(bdf.elements)
    assert nodes == list(range(1, len(nodes) + 1)) and elements == list(range(1, len(elements) + 1))
    cells = np.array([bdf.elements[e].nodes for e in elements]) - 1
    out = {"points": [bdf.nodes[n].xyz.tolist() for n in nodes], "cells": cells[:, ORDER[cells.shape[1]]].tolist()}
    ids = {number: each.ids for number, each in bdf.sets.items()}
    out["sets"] = {n: list(map(int, each)) for n, each in ids.items() if n < 2000}
    out["element_sets"] = {n: list(map(int, each)) for n, each in ids.items() if n >= 2000}
    out["surfaces"] = {n: faces(bdf, loads) for n, loads in bdf.loads.items() if n >= 3001}
    out |= material(bdf, nodes, elements)
    case = bdf.case_control_deck.subcases.get(1)
    if case is not None and "SPC" in case:
        out |= loads(bdf, case, len(nodes))
    return out


def faces(bdf, loads) -> list:
    """Corners of the faces that pressures act on, by pyNastran's own search."""
    found = []
    for load in loads:
        element = bdf.elements[load.eids[0]]
        corner, opposite = load.g1, load.g34
        for face in element.faces.values():
            if corner in face[:4] and opposite in face[:4]:
                found.append([int(n) - 1 for n in face[:4]])
    assert len(found) == len(loads)
    return found


def material(bdf, nodes, elements) -> dict:
    import numpy as np

    if bdf.MATT1:
        table = bdf.MATT1[1]
        assert bdf.case_control_deck.subcases[0].get_parameter("TEMPERATURE(MATERIAL)")[0] == 3
        temperature = {n: t for load in bdf.loads[3] for n, t in load.temperatures.items()}
        at = np.array([temperature[n] for n in nodes])
        out = {}
        for name, number in (("modulus", table.e_table), ("poisson", table.nu_table), ("density", table.rho_table)):
            of = bdf.tables_m[number]
            out[name] = np.interp(at, of.x, of.y).tolist()
        return out
    if not bdf.materials:
        return {}
    of = [bdf.materials[bdf.properties[bdf.elements[e].pid].mid] for e in elements]
    return {"modulus": [m.e for m in of], "poisson": [m.nu for m in of], "density": [m.rho for m in of]}


def loads(bdf, case, count) -> dict:
    import numpy as np

    fixed, at, forces = np.zeros((count, 3), dtype=bool), np.zeros((count, 3)), np.zeros((count, 3))
    for spc in bdf.spcs[case["SPC"][0]]:
        for node, components, value in zip(spc.nodes, spc.components, spc.enforced, strict=True):
            for component in str(components):
                fixed[node - 1, int(component) - 1], at[node - 1, int(component) - 1] = True, value
    pressed, gravity = {}, None
    combination = bdf.load_combinations[case["LOAD"][0]][0]
    assert combination.scale == 1 and set(combination.scale_factors) == {1.0}
    for number in combination.get_load_ids():
        for load in bdf.loads[number]:
            if load.type == "FORCE":
                forces[load.node - 1] += load.mag * load.xyz
            elif load.type == "GRAV":
                gravity = (load.scale * load.N).tolist()
            else:
                assert load.type == "PLOAD4" and len(set(load.pressures)) == 1
                pressed.setdefault(float(load.pressures[0]), []).append(load)
    out = {"fixed": fixed.tolist(), "prescribed": at.tolist(), "forces": forces.tolist()}
    out["pressed"] = {value: faces(bdf, each) for value, each in pressed.items()}
    return out | ({"gravity": gravity} if gravity is not None else {})


if __name__ == "__main__":
    json.dump(plain(sys.argv[1]), sys.stdout)
