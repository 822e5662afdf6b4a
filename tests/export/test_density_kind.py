"""Files tell which density they hold: apparent, ash and QCT are no one quantity."""

from dataclasses import replace

import numpy as np
import pytest

from gpubspline.cli.describe import mesh_lines
from gpubspline.export import formats, read_mesh, write
from gpubspline.export.from_pyvista import from_pyvista
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.density import DENSITY_KINDS
from gpubspline.material.laws import constant_law
from gpubspline.material.registry import law
from gpubspline.mesh.mesh import Mesh

READABLE = [name for name, form in formats().items() if form.readable and form.fields and form.cell_fields]


def cube() -> Mesh:
    axes = [np.linspace(0.0, 3.0, 4)] * 3
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    return Mesh(points, "hex8", structure=(4, 4, 4), fields={"HU": np.linspace(150.0, 1500.0, 64)})


@pytest.mark.parametrize("name", READABLE)
@pytest.mark.parametrize("kind", DENSITY_KINDS)
def test_the_kind_goes_through_every_format(name, kind, tmp_path):
    density = np.linspace(0.1, 1.9, 64)
    mesh = replace(cube().with_fields({"density_g_cm3": density}), density_kind=kind)
    mesh = mesh.with_cell_fields({"density_g_cm3_1": np.linspace(0.1, 1.0, 27)})
    path = tmp_path / f"a{formats()[name].extensions[0]}"
    write(mesh, path)
    assert f"density_{kind}_g_cm3".encode() in path.read_bytes() or name in ("exodus", "vtkhdf", "xdmf")  # compressed
    back = read_mesh(path)
    assert back.density_kind == kind and not any(kind in field for field in (*back.fields, *back.cell_fields))
    np.testing.assert_allclose(back.fields["density_g_cm3"], density, rtol=1e-6)
    assert "density_g_cm3_1" in back.cell_fields
    assert f"density    {kind} density" in "\n".join(mesh_lines(back))


def test_paraview_and_pyvista_see_the_name(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh, _ = assign(cube(), law("keyak-1998"))
    write(mesh, tmp_path / "a.vtu")
    grid = pyvista.read(tmp_path / "a.vtu")
    assert "density_ash_g_cm3" in grid.point_data and "density_g_cm3" not in grid.point_data
    assert from_pyvista(grid).density_kind == "ash"
    write(mesh, tmp_path / "b.vtu", units="m-N-Pa")
    assert "density_ash_kg_m3" in pyvista.read(tmp_path / "b.vtu").point_data


def test_laws_give_their_kind_and_several_the_one_that_is_weighed():
    for name in ("wirtz-2000", "keyak-1998"):
        for mapping in ("nodal", "nodal-e", "element-e"):
            assert assign(cube(), law(name), Mapping(mapping))[0].density_kind == law(name).density.kind
    halves = {"1": np.arange(13), "2": np.arange(13, 27)}
    mesh = replace(cube(), element_sets={f"label_{name}": members for name, members in halves.items()})
    mesh = mesh.with_cell_fields({"label": np.repeat([1, 2], [13, 14]).astype(np.int32)})
    metal = constant_law(110e3, 0.3, 4.4, density=law("keyak-1998").density)
    mixed, _ = assign(mesh, law("keyak-1998"), Mapping("element-e"), by_label={1: law("wirtz-2000"), 2: metal})
    assert mixed.density_kind == "apparent"


def test_a_deck_of_a_file_says_what_its_density_is(tmp_path):
    """Without the law, which a mesh file does not hold."""
    mesh, _ = assign(cube(), law("keyak-1998"))
    write(mesh, tmp_path / "a.vtu")
    write(read_mesh(tmp_path / "a.vtu"), tmp_path / "a.inp")
    assert "** Densities are ash: mineral alone. Gravity takes them for weight." in (tmp_path / "a.inp").read_text()
    old = replace(mesh, density_kind=None)  # as of 0.7 and before
    write(old, tmp_path / "old.vtu")
    back = read_mesh(tmp_path / "old.vtu")
    assert back.density_kind is None and "density_g_cm3" in back.fields
    assert "density    not told: apparent, ash and QCT" in "\n".join(mesh_lines(back))
    write(back, tmp_path / "old.inp")
    assert "Densities are" not in (tmp_path / "old.inp").read_text()


def test_densities_of_two_kinds_keep_their_names(tmp_path):
    both = cube().with_fields({f"density_{kind}_g_cm3": np.ones(64) for kind in ("ash", "QCT")})
    write(both, tmp_path / "a.vtu")
    back = read_mesh(tmp_path / "a.vtu")
    assert back.density_kind is None and {"density_ash_g_cm3", "density_QCT_g_cm3"} <= back.fields.keys()
