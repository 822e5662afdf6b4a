"""LS-DYNA: dynakw reads the mesh, sets, parts and materials; dynars the loads, and validates references."""

import re
from pathlib import Path

import numpy as np

from foreign import Found, faces


def read(path: Path) -> Found:
    from dynakw import DynaKeywordReader

    with DynaKeywordReader(str(path)) as deck:
        every = [(word.full_keyword.lstrip("*"), word.cards) for word in deck.keywords()]
    cards = {name: held for name, held in every}
    node, solid = cards["NODE"]["Card 1"], cards["ELEMENT_SOLID"]
    points = np.stack([node[axis] for axis in "XYZ"], axis=1)
    cells = np.stack([solid["nodes"][f"N{n}"] for n in range(1, 9)], axis=1) - 1
    assert (node["NID"] == np.arange(1, len(points) + 1)).all()
    assert (solid["Card 1"]["EID"] == np.arange(1, len(cells) + 1)).all()
    text = path.read_text()
    found = Found("dynakw, dynars", points, cells)
    found.node_sets = dict(
        zip(titles(text, "SET_NODE_LIST_TITLE"), members(every, "SET_NODE_LIST_TITLE", "NID"), strict=True)
    )
    found.element_sets = dict(zip(titles(text, "SET_SOLID_TITLE"), members(every, "SET_SOLID_TITLE", "K"), strict=True))
    segments = [held["Card 2"] for name, held in every if name == "SET_SEGMENT_TITLE"]
    corners = [faces(np.stack([card[f"N{n}"] for n in range(1, 5)], axis=1) - 1) for card in segments]
    found.surfaces = dict(zip(titles(text, "SET_SEGMENT_TITLE"), corners, strict=True))
    found.comment = " ".join(re.findall(r"^\$(.*)", text, re.MULTILINE))
    materials = {int(m["MID"][0]): m for name, held in every if name == "MAT_ELASTIC" for m in [held["Card 1"]]}
    parts = {int(p["PID"][0]): int(p["MID"][0]) for name, held in every if name == "PART" for p in [held["Card 2"]]}
    of = [materials[parts[int(part)]] for part in solid["Card 1"]["PID"]]
    for name, key in (("modulus", "E"), ("poisson", "PR"), ("density", "RO")):
        setattr(found, name, np.array([float(mat[key][0]) for mat in of]))
    if "DEFINE_CURVE" in cards:
        loads(found, path, every)
    return found


def titles(text: str, keyword: str) -> list[str]:
    return re.findall(rf"^\*{keyword}\n(.*)", text, re.MULTILINE)


def members(every, keyword, key):
    for name, held in every:
        if name == keyword:
            table = np.stack([held["Card 2"][f"{key}{n}"] for n in range(1, 9)], axis=1)
            yield table[table > 0] - 1


def loads(found, path, every):
    import dynars

    deck = dynars.parse_deck(str(path))
    rules = [dynars.Rule.references_resolve_with_connectivity(), dynars.Rule.duplicate_ids()]
    assert not deck.validate(rules).findings
    shape = found.points.shape
    found.fixed, found.prescribed, found.forces = np.zeros(shape, dtype=bool), np.zeros(shape), np.zeros(shape)
    still = deck.table("BOUNDARY_SPC_NODE")
    for axis in range(3):
        found.fixed[still["NID"] - 1, axis] |= still[f"DOF{'XYZ'[axis]}"] == 1
    for name, held in every:
        if name == "BOUNDARY_PRESCRIBED_MOTION_NODE":
            card = held["Card 1"]
            assert (card["VAD"] == 2).all() and (card["LCID"] == 1).all()
            found.fixed[card["TYPEID"] - 1, card["DOF"] - 1] = True
            found.prescribed[card["TYPEID"] - 1, card["DOF"] - 1] = card["SF"]
        if name == "DEFINE_CURVE":
            assert held["Card 2"]["A1"].tolist() == held["Card 2"]["O1"].tolist() == [0, 1]
    pushed = deck.table("LOAD_NODE_POINT")
    np.add.at(found.forces, (pushed["NID"] - 1, pushed["DOF"] - 1), pushed["SF"])
    numbers = dict(enumerate(found.surfaces, start=1))
    schema = [[("SSID", "int", 10, 1), ("LCID", "int", 10, 1), ("SF", "float", 10, 1)]]
    table = dynars.parse_keyword_file(str(path)).parse_schema("LOAD_SEGMENT_SET", schema)
    found.pressed = [
        (found.surfaces[numbers[int(s)]], float(p)) for s, p in zip(table["SSID"], table["SF"], strict=True)
    ]
    found.gravity = np.array([-sum(deck.table(f"LOAD_BODY_{axis}")["SF"]) for axis in "XYZ"])
