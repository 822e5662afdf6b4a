"""FEBio: pyfebio's model of the format 4.0 (pydantic) checks every tag, attribute and type.

pyfebio is narrower than the format in some places, which are brought into its form before it checks: lists over several
lines (FEBio user manual 3.6), a value for each node of an element and loads by map (FEBio user manual A.2;
FEBioMeshDataSection4), flags of 0 and 1, which it writes but does not read, and the order of the last sections. Those
are read here from the XML.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from foreign import Found, faces


def read(path: Path) -> Found:
    from pyfebio.model import Model

    text = path.read_text()
    model = Model.from_xml(narrowed(text).encode())
    root = ElementTree.fromstring(text)
    points = np.array([[float(x) for x in node.text.split(",")] for node in model.mesh_.nodes[0].all_nodes])
    labels = [node.id for node in model.mesh_.nodes[0].all_nodes]
    assert labels == list(range(1, len(labels) + 1))
    blocks = {block.name: block for block in model.mesh_.elements}
    cells = {e.id: [int(n) - 1 for n in e.text.split(",")] for block in blocks.values() for e in block.all_elements}
    ids = {name: np.array([e.id for e in block.all_elements]) - 1 for name, block in blocks.items()}
    table = np.array([cells[label] for label in sorted(cells)])
    sets = {each.name: listed(each.text) for each in model.mesh_.node_sets}
    surfaces = {
        each.name: faces([listed(f.text) for f in (*each.all_quad4, *each.all_quad8)]) for each in model.mesh_.surfaces
    }
    elements = {**ids, **{each.name: listed(each.text) for each in model.mesh_.element_sets}}
    material = dict(zip(("modulus", "poisson", "density"), materials(root, model, ids, table.shape), strict=True))
    found = Found("pyfebio's model of the format", points, table, sets, elements, surfaces, **material)
    found.comment = " ".join(re.findall(r"<!--(.*?)-->", text))
    if root.find("Loads") is not None or root.find("Boundary") is not None:
        loads(found, root, model)
    return found


def narrowed(text: str) -> str:
    """The same model in the form that pyfebio knows."""
    text = re.sub(r"(<(?:NodeSet|ElementSet)[^>]*>)([^<]*)", lambda m: m[1] + re.sub(r"\s", "", m[2]), text)
    text = re.sub(r"<(x_dof|y_dof|z_dof|relative)>[01]</\1>\n", "", text)
    text = re.sub(r'(<elem lid="\d+">[^,<]*)[^<]*', r"\1", text)
    last = [re.search(rf"<{name}>.*</{name}>\n", text, re.DOTALL) for name in ("LoadData", "Loads", "Boundary")]
    parts = [match[0] for match in last if match]
    for part in parts:
        text = text.replace(part, "")
    text = text.replace("<Output>", "".join(parts) + "<Output>")
    return text.replace('<value lc="1" type="map">force_map</value>', '<value lc="1">0,0,0</value>')


def listed(text: str) -> np.ndarray:
    return np.array([int(part) for part in text.split(",")]) - 1


def materials(root, model, ids, shape):
    """Of each element and vertex where maps, else of each element."""
    values = [np.zeros(shape[0]) for _ in range(3)]
    mats = {mat.name: mat for mat in model.material_.all_materials}
    for domain in (*model.meshdomains_.solid_domains, *model.meshdomains_.shell_domains):
        mat = mats[domain.mat]
        for place, parameter in enumerate((mat.E, mat.v, mat.density)):
            if parameter.type == "map":
                tag = root.find(f"MeshData/ElementData[@name='{parameter.text}']")
                assert tag.get("elem_set") == domain.name
                assert [int(e.get("lid")) for e in tag] == list(range(1, shape[0] + 1))
                values[place] = np.array([[float(x) for x in e.text.split(",")] for e in tag])
            else:
                values[place][ids[domain.name]] = float(parameter.text)
    return values


def loads(found, root, model):
    """Boundary and Loads; a map gives the value of each node of its set, by place."""
    shape = found.points.shape
    found.fixed, found.prescribed, found.forces = np.zeros(shape, dtype=bool), np.zeros(shape), np.zeros(shape)
    for bc, tag in zip(model.boundary_.all_bcs, root.findall("Boundary/bc"), strict=True):
        nodes = found.node_sets[bc.node_set]
        if bc.type == "zero displacement":
            held = np.array([tag.find(f"{axis}_dof").text == "1" for axis in "xyz"])
            found.fixed[np.ix_(nodes, held)] = True
        else:
            assert tag.find("relative").text == "0"
            axis = "xyz".index(bc.dof)
            found.fixed[nodes, axis], found.prescribed[nodes, axis] = True, float(bc.value.text)
    for load in root.findall("Loads/nodal_load"):
        tag = root.find(f"MeshData/NodeData[@name='{load.find('value').text}']")
        assert tag.get("node_set") == load.get("node_set") and tag.get("data_type") == "vec3"
        nodes = found.node_sets[load.get("node_set")]
        found.forces[nodes] = [[float(x) for x in node.text.split(",")] for node in tag]
    controllers = {each.id: each.points.points for each in model.loaddata_.load_controllers}
    assert controllers == {1: ["0,0", "1,1"]}
    found.node_sets = {name: nodes for name, nodes in found.node_sets.items() if not name.startswith("load_")}
