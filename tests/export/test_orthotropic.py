"""Orthotropic elements in decks: constants by bins, axes by element; CalculiX solves them as we do."""

import re
import shutil
from xml.etree import ElementTree

import numpy as np
import pytest

from foreign.abaqus import displacement
from foreign.febio import narrowed
from gpubspline.analysis.load_case import load_case
from gpubspline.analysis.response import respond
from gpubspline.clock import Clock
from gpubspline.device import open_device
from gpubspline.errors import InputError
from gpubspline.export import formats, read_mesh, write
from gpubspline.export.modulus_bins import element_means
from gpubspline.material.orthotropy import with_orthotropy


@pytest.fixture(scope="module")
def across(femur):
    """The femur, across its axis 0.4 to 0.8 times as stiff as along it."""
    along = element_means(femur, "E_MPa")
    return with_orthotropy(femur, along, np.linspace(0.4, 0.8, along.size) * along, 0 * along + 0.3)


def test_calculix_moves_them_as_our_own_solve_does(across, tmp_path):
    """Constants by bin, axes by element; what is left of many bins is what they mix."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed: apt-get install calculix-ccx")
    case = load_case("stance")
    ours = respond(across, case, open_device("opencl", "float64"), Clock(), tolerance=1e-10).solution.displacement_mm
    errors = []
    for bins in (4, 128, 4096):
        figures = write(across, tmp_path / "deck.inp", load=case, modulus_bins=bins)
        found = displacement((tmp_path / "deck.inp").read_text(), tmp_path / f"ccx{bins}")
        errors.append(np.linalg.norm(found - ours) / np.linalg.norm(ours))
        assert figures["modulus"]["orthotropic"]
    assert errors[0] > 4 * errors[1] > 20 * errors[2] and errors[2] < 1e-3, errors


def test_febio_has_nine_constants_for_a_bin_and_axes_for_an_element(across, tmp_path):
    pytest.importorskip("pyfebio")
    from pyfebio.model import Model

    figures = write(across, tmp_path / "deck.feb", modulus_bins=5, units="m-N-Pa")
    text = (tmp_path / "deck.feb").read_text()
    plain = re.sub(r'<ElementData type="mat_axis".*?</ElementData>\n', "", text, flags=re.DOTALL)
    materials = Model.from_xml(narrowed(plain).encode()).material_.all_materials
    assert [each.type for each in materials] == 5 * ["orthotropic elastic"]
    root = ElementTree.fromstring(text)
    for number, each in enumerate(materials, start=1):
        part = root.find(f"Mesh/Elements[@name='modulus_{number}']")
        members = np.array([int(tag.get("id")) for tag in part]) - 1
        given = {name: across.cell_fields[name][members].mean() for name in across.cell_fields}
        for name in ("E1", "E2", "E3", "G12", "G23"):
            assert float(getattr(each, name).text) == pytest.approx(1e6 * given[f"{name}_MPa"])
        assert float(each.v31.text) == pytest.approx(given["nu13"] * given["E3_MPa"] / given["E1_MPa"])
        rows = root.find(f"MeshData/ElementData[@elem_set='modulus_{number}']")
        assert rows.get("type") == "mat_axis" and len(rows) == members.size
        for name, axis in (("a", 1), ("d", 2)):
            vectors = [[float(x) for x in row.find(name).text.split(",")] for row in rows]
            expected = np.stack([across.cell_fields[f"axis{axis}_{c}"][members] for c in "xyz"], axis=1)
            np.testing.assert_allclose(vectors, expected, atol=1e-12)
    assert 0 < figures["modulus"]["mean_error"] < figures["modulus"]["largest_error"]


@pytest.mark.parametrize("extension", [".vtu", ".vtkhdf", ".exo", ".med", ".xdmf"])
def test_formats_of_fields_keep_them_as_fields(extension, across, tmp_path):
    write(across, tmp_path / f"deck{extension}")
    back = read_mesh(tmp_path / f"deck{extension}")
    for name in ("E1_MPa", "E3_MPa", "nu12", "G23_MPa", "axis1_x", "axis2_z"):
        np.testing.assert_allclose(back.cell_fields[name], across.cell_fields[name], rtol=1e-6)


@pytest.mark.parametrize("name", ["ansys", "nastran", "lsdyna", "su2", "mdpa", "ply", "stl"])
def test_others_refuse_them(name, across, tmp_path):
    extension = formats()[name].extensions[0]
    with pytest.raises(InputError, match=rf"holds orthotropic elements.*got \{extension}"):
        write(across, tmp_path / f"deck{extension}")
    assert list(tmp_path.iterdir()) == []


def test_a_modulus_by_node_is_refused_of_them(across, tmp_path):
    with pytest.raises(InputError, match="isotropic elements for a modulus by node"):
        write(across, tmp_path / "deck.inp", nodal_modulus=True)
    assert list(tmp_path.iterdir()) == []
