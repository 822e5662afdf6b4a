"""ANSYS: mapdl-archive reads nodes, elements and components; the commands are one a line, read as they stand."""

import re
from pathlib import Path

import numpy as np

from foreign import Found

CORNERS = {1: (0, 3, 2, 1), 2: (0, 1, 5, 4), 3: (1, 2, 6, 5), 4: (2, 3, 7, 6), 5: (3, 0, 4, 7), 6: (4, 5, 6, 7)}
"""Of the faces of SOLID185: J-I-L-K, I-J-N-M, J-K-O-N, K-L-P-O, L-I-M-P, M-N-O-P."""


def read(path: Path) -> Found:
    import mapdl_archive

    archive = mapdl_archive.Archive(str(path), parse_vtk=False)
    assert (archive.nnum == np.arange(1, len(archive.nnum) + 1)).all()
    own = archive.etype != 200
    assert (archive.enum == np.arange(1, len(archive.enum) + 1)).all()
    rows = [np.asarray(row)[10:] for row in archive.elem]
    count = int(own.sum())
    cells = np.array(rows[:count]) - 1
    outer = np.array([row[:4] for row in rows[count:]]) - 1
    node_sets = {name.lower(): labels - 1 for name, labels in archive.node_components.items()}
    kept = {name.lower(): labels - 1 for name, labels in archive.element_components.items()}
    found = Found("mapdl-archive", np.asarray(archive.nodes)[:, :3], cells, node_sets)
    found.element_sets = {name: members for name, members in kept.items() if not name.endswith("_faces")}
    found.surfaces = {
        name.removesuffix("_faces"): {frozenset(face) for face in outer[members - count].tolist()}
        for name, members in kept.items()
        if name.endswith("_faces")
    }
    text = path.read_text()
    found.comment = " ".join(re.findall(r"^/COM,(.*)", text, re.MULTILINE))
    commands = [line.split(",") for line in text.splitlines() if re.match(r"[A-Z]+,", line)]
    material(found, commands, np.asarray(archive.material_type)[:count])
    if any(words[0] == "D" for words in commands):
        loads(found, commands)
    return found


def material(found, commands, numbers):
    at, columns = [], {}
    for words in commands:
        if words[0] == "MPTEMP":
            at += [float(word) for word in words[2:]]
        elif words[0] == "MPDATA":
            columns.setdefault(words[1], []).extend(float(word) for word in words[4:])
    keys = {"modulus": "EX", "poisson": "PRXY", "density": "DENS"}
    if at:
        assert len(at) <= 100
        temperature = {int(words[1]): float(words[3]) for words in commands if words[0] == "BF" and words[2] == "TEMP"}
        nodal = np.array([temperature[label] for label in range(1, len(found.points) + 1)])
        for name, key in keys.items():
            setattr(found, name, np.interp(nodal, at, columns[key]))
        return
    for name, key in keys.items():
        given = {int(words[2]): float(words[3]) for words in commands if words[:2] == ["MP", key]}
        if given:
            setattr(found, name, np.array([given[number] for number in numbers]))


def loads(found, commands):
    shape = found.points.shape
    found.fixed, found.prescribed, found.forces = np.zeros(shape, dtype=bool), np.zeros(shape), np.zeros(shape)
    found.pressed, pressed = [], {}
    for words in commands:
        if words[0] in ("D", "F"):
            node, axis, value = int(words[1]) - 1, "XYZ".index(words[2][-1]), float(words[3])
            if words[0] == "F":
                found.forces[node, axis] += value
            else:
                found.fixed[node, axis], found.prescribed[node, axis] = True, value
        elif words[0] == "SFE":
            face = found.cells[int(words[1]) - 1, list(CORNERS[int(words[2])])]
            pressed.setdefault(float(words[5]), set()).add(frozenset(face.tolist()))
        elif words[0] == "ACEL":
            found.gravity = -np.array([float(word) for word in words[1:]])
    found.pressed = [(group, value) for value, group in pressed.items()]
