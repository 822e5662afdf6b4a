"""Laws by label: each element by the law of its label, the deck of two materials solved as springs in series."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from gpubspline.analysis.elasticity import solve
from gpubspline.ct.region import region_from_mask
from gpubspline.ct.volume import Volume
from gpubspline.device import Device
from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.export import write
from gpubspline.material.assign import Mapping, assign
from gpubspline.material.density import DensityRelation
from gpubspline.material.laws import Law, Piece, constant_law
from gpubspline.material.mapping import law_on_device, map_material
from gpubspline.material.registry import law
from gpubspline.material.voxel_mass import voxel_mass_g
from gpubspline.mesh.mesh import Mesh

COUNTS, SIZES = (3, 4, 9), (2.0, 3.0, 12.0)
TITANIUM = law("constant:E=110000,nu=0.3,rho=4.43")


def bar(labels: tuple[int, ...] = (1, 1, 1, 2, 2, 2, 2, 2)) -> Mesh:
    """A bar along z in layers of a label each, HU 300 to 1500 along it."""
    axes = [np.linspace(0, size, n) for size, n in zip(SIZES, COUNTS, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3, order="F")
    mesh = Mesh(points, "hex8", structure=COUNTS, fields={"HU": 300 + 100 * points[:, 2]})
    mesh = replace(mesh, node_sets={side: np.unique(mesh.boundary(side)) for side in mesh.element.sides})
    return mesh.with_cell_fields({"label": np.repeat(labels, mesh.n_elements // len(labels)).astype(np.int32)})


@pytest.mark.parametrize("how", ["element-e", "element-hu", "gauss"])
def test_each_element_has_the_law_of_its_label(how: str, device: Device) -> None:
    """As if the whole mesh had it; constants to the last bit, pieces numbered on end, alarms summed.

    But densities of another kind than the others' are converted.
    """
    mesh, own = bar((1, 1, 3, 3, 2, 2, 2, 1)), law("keyak-1998")
    label = mesh.cell_fields["label"]
    mapped, alarms = assign(mesh, None, Mapping(how), by_label={2: TITANIUM, 3: own}, device=device)
    alone = {1: assign(mesh, None, Mapping(how), device=device), 3: assign(mesh, own, Mapping(how), device=device)}
    wet, _ = assign(mesh, own.weighed("apparent"), Mapping(how), device=device)
    names = ["E_MPa", "nu", "density_g_cm3", "HU", *(f"E_MPa_{k}" for k in range(1, 9) if how == "gauss")]
    for number, (whole, _) in alone.items():
        for name in names:
            expected = wet if number == 3 and name.startswith("density") else whole
            np.testing.assert_array_equal(
                mapped.cell_fields[name][label == number], expected.cell_fields[name][label == number]
            )
    there = {name: mapped.cell_fields[name][label == 2] for name in names}
    assert np.all(there["E_MPa"] == 110000) and np.all(there["nu"] == np.asarray(0.3, there["nu"].dtype))
    assert np.all(there["density_g_cm3"] == np.asarray(4.43, there["nu"].dtype))
    assert how != "gauss" or np.all(there["E_MPa_8"] == 110000)
    np.testing.assert_array_equal(mapped.cell_fields["law"], np.where(label == 1, 0, label))
    material, first = mapped.cell_fields["material"], {1: 0, 3: 3}  # two pieces of the default, one constant
    for number, start in first.items():
        expected = alone[number][0].cell_fields["material"][label == number]
        np.testing.assert_array_equal(material[label == number], expected + start)
    assert np.all(material[label == 2] == 3)
    shares = [(share["label"], share["law"], share["elements"]) for share in alarms.by_label]
    assert shares == [(0, "wirtz-2000", 18), (2, TITANIUM.name, 18), (3, "keyak-1998", 12)]
    assert alarms.count == 48 and alarms.mass_mesh_g == pytest.approx(sum(s["mass_g"] for s in alarms.by_label))
    assert alarms.by_label[1]["mass_g"] == pytest.approx(4.43 * 27e-3, rel=1e-5)


def test_a_constant_is_one_for_any_hu(any_device: Device) -> None:
    """Of one density, or of that of the HU; never outside, whatever the policy."""
    hu = np.array([-3000.0, 0.0, 350.0, 30000.0])
    for policy in ("clamp", "floor", "error"):
        made = map_material(hu, law("constant:E=2.5,nu=0.25"), policy=policy, device=any_device)
        np.testing.assert_array_equal(made.modulus_mpa, 2.5)
        np.testing.assert_array_equal(made.poisson, 0.25)
        np.testing.assert_allclose(made.density_g_cm3, np.maximum(1.9 * hu / 1630, 0), rtol=1e-6)
        assert made.out_of_range == 0
    given = DensityRelation("QCT", 0.001, 0.1)
    assert constant_law(5.0, 0.1, density=given).calibrated(given).density == given
    assert TITANIUM.calibrated(given) == TITANIUM and TITANIUM.beside(law("keyak-1998")) == TITANIUM
    assert law("constant:E=1,nu=0").beside(law("keyak-1998")).density == law("keyak-1998").density


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("constant:E=5", r"expected constant:E=\.\.\.,nu=\.\.\.\[,rho=\.\.\.\] .*got 'constant:E=5'"),
        ("constant", "expected constant:E="),
        ("constant:E=x,nu=0.3", "expected constant:E="),
        ("constant:E=1,E=2,nu=0.3", "expected constant:E="),
        ("constant:E=nan,nu=0.3", "expected constant:E="),
        ("constant:E=0,nu=0.3", "positive modulus in MPa, got 0"),
        ("constant:E=5,nu=0.5", "Poisson's ratio from 0 up to and without 0.5, got 0.5"),
        ("constant:E=5,nu=0.3,rho=0", "positive density in g/cm3, got 0"),
    ],
)
def test_bad_constants(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        law(text)


def test_what_does_not_go_together(device: Device) -> None:
    mesh, by_label = bar(), {2: TITANIUM}
    with pytest.raises(InputError, match=r"gauss, element-hu, element-e with laws by label, got nodal"):
        assign(mesh, by_label=by_label, device=device)
    with pytest.raises(InputError, match="laws by label or a transverse law, got both"):
        across = Mapping("element-e", transverse=law("wirtz-2000-transverse"))
        assign(mesh, None, across, by_label=by_label, device=device)
    with pytest.raises(InputError, match="element field label"):
        assign(replace(mesh, cell_fields={}), None, Mapping("element-e"), by_label=by_label, device=device)
    with pytest.warns(GpubsplineWarning, match="no element has the label 7"):
        mapped, _ = assign(mesh, None, Mapping("element-e"), by_label={7: TITANIUM}, device=device)
    assert not mapped.cell_fields["law"].any()


def test_mass_of_voxels_by_label(device: Device) -> None:
    """Two constants in a box of 9 x 9 x 9 mm: 4 slices and a half of one, the others of the other."""
    volume = Volume(np.full((12, 12, 12), 500, np.float32), np.eye(4))
    inside = np.zeros((12, 12, 12), dtype=bool)
    inside[1:-1, 1:-1, 1:-1] = True
    region = region_from_mask(volume, inside, smoothing_mm=0.0)
    labels = np.where(np.arange(12)[:, None, None] < 6, 1, 2) * np.ones((1, 12, 12), int)
    laws = [law(f"constant:E=1,nu=0.3,rho={rho}") for rho in (1.0, 3.0)]
    one, three = (law_on_device(each, device) for each in laws)
    alone = voxel_mass_g(volume, region, one, device)
    both = voxel_mass_g(volume, region, one, device, by_label={2: three}, labels=labels)
    assert both == pytest.approx(2 * alone, rel=1e-6)  # the halves are mirror images
    with pytest.raises(InputError, match="expected the labels of the voxels"):
        voxel_mass_g(volume, region, one, device, by_label={2: three})
    given = {"by_label": {2: laws[1]}, "volume": volume, "region": region, "device": device}
    assert assign(bar(), laws[0], Mapping("element-e"), **given)[1].mass_voxels_g is None


def test_floored_elements_are_of_no_piece(device: Device) -> None:
    """Of whichever law: those of label 2 lie above all that theirs covers."""
    narrow = Law("narrow", "", DensityRelation("apparent", 0.001), (Piece(1.0, 500.0, 1000.0, 1.0),))
    floor = Mapping("element-hu", policy={"policy": "floor"})
    mapped, alarms = assign(bar(), None, floor, by_label={2: narrow}, device=device)
    label, material = (mapped.cell_fields[name] for name in ("label", "material"))
    assert not material[label == 2].any() and material[label == 1].all()
    assert [share["outside_law"] for share in alarms.by_label] == [0, 1]


def test_two_materials_in_series(tmp_path: Path, device64: Device) -> None:
    """The deck as meshio reads it has two sections, exact; CalculiX and our solver pull it as the closed form says.

    Force of 0.1 mm: 0.1 A / (L1 / E1 + L2 / E2); no Poisson's ratio, so that the bar is one-dimensional.
    """
    laws = {1: law("constant:E=1200,nu=0"), 2: law("constant:E=30,nu=0,rho=1.1")}
    mapped, _ = assign(bar(), None, Mapping("element-e"), by_label=laws, device=device64)
    area, lengths = SIZES[0] * SIZES[1], SIZES[2] * np.array([3, 5]) / 8
    expected = 0.1 * area / (lengths / [1200, 30]).sum()
    pull = "*BOUNDARY\nu0, 1, 1\nv0, 2, 2\nw0, 3, 3\n*STEP\n*STATIC\n*BOUNDARY\nw1, 3, 3, 0.1\n"
    deck = tmp_path / "model.inp"
    step = f"{pull}*NODE PRINT, NSET=w1\nRF\n*END STEP\n"
    figures = write(mapped, deck, law={"a": laws[1], "b": laws[2]}, step=step)
    assert figures["modulus"]["bins"] == 2 and figures["modulus"]["largest_error"] == 0
    text = deck.read_text()
    stiffness = re.findall(r"\*ELASTIC[^\n]*\n([^\n]+)", text, re.IGNORECASE)
    assert [[float(part) for part in row.split(",")] for row in stiffness] == [[1200, 0], [30, 0]]
    assert "Material law of the set b: constant:E=30,nu=0,rho=1.1" in text
    sets = {name.lower(): members[0] for name, members in meshio.read(deck).cell_sets.items()}
    label = mapped.cell_fields["label"]
    assert sorted(len(sets[name]) for name in ("modulus_1", "modulus_2")) == [18, 30]
    assert {np.unique(label[sets[name]]).size for name in ("modulus_1", "modulus_2")} == {1}
    ends = {side: mapped.node_sets[side] for side in ("u0", "v0", "w0", "w1")}
    held, moved = np.zeros((mapped.n_nodes, 3), bool), np.zeros((mapped.n_nodes, 3))
    held[ends["u0"], 0] = held[ends["v0"], 1] = held[ends["w0"], 2] = held[ends["w1"], 2] = True
    moved[ends["w1"], 2] = 0.1
    ours = solve(mapped, held, np.zeros((mapped.n_nodes, 3)), prescribed_mm=moved, device=device64)
    assert 2 * ours.strain_energy_nmm / 0.1 == pytest.approx(expected, rel=1e-5)
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed: apt-get install calculix-ccx")
    done = subprocess.run(["ccx", "-i", "model"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    rows = re.search(r"for set W1 .*?\n\n((?:\s+\d+\s.*\n)+)", (tmp_path / "model.dat").read_text())
    assert rows is not None
    assert sum(float(row.split()[3]) for row in rows[1].splitlines()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("how", ["element-e", "element-hu", "gauss"])
def test_masses_of_unlike_kinds_are_no_sum(how: str, device64: Device) -> None:
    """Ash is 0.6 of the apparent density: beside a metal's own the bone counts with its wet mass, in every field."""
    mesh, ash = bar(), law("keyak-1998")
    mapped, alarms = assign(mesh, ash, Mapping(how), by_label={2: TITANIUM}, device=device64)
    bone, metal = alarms.by_label
    alone, own = assign(mesh, ash, Mapping(how), device=device64)
    assert own.density_kind == "ash" and own.to_dict()["mass_g"]["converted_by"] == []
    assert (bone["density"], metal["density"], alarms.density_kind) == ("ash", "apparent", "apparent")
    assert bone["mass_by_law_g"] == pytest.approx(0.6 * bone["mass_g"], rel=1e-12)
    assert metal["mass_by_law_g"] == metal["mass_g"]
    assert alarms.mass_mesh_g == pytest.approx(bone["mass_by_law_g"] / 0.6 + 4.43 * 45e-3, rel=1e-12)
    label, density = mapped.cell_fields["label"] == 1, mapped.cell_fields["density_g_cm3"]
    np.testing.assert_allclose(density[label], alone.cell_fields["density_g_cm3"][label] / 0.6, rtol=1e-12)
    np.testing.assert_array_equal(mapped.cell_fields["E_MPa"][label], alone.cell_fields["E_MPa"][label])
    told = alarms.to_dict()["mass_g"]
    assert told["density"] == "apparent" and "rho_ash / rho_app = 0.6" in told["converted_by"][0]
    same, both = assign(mesh, ash, Mapping(how), by_label={2: law("keller-1994-spine")}, device=device64)
    assert both.density_kind == "ash" and both.to_dict()["mass_g"]["converted_by"] == []
    assert both.mass_mesh_g == pytest.approx(own.mass_mesh_g, rel=1e-3)  # the same ash but where HU end
    assert same.cell_fields["density_g_cm3"].max() < density.max()


def test_voxels_weigh_as_the_mesh_does(device: Device) -> None:
    """A bar of QCT and ash laws in a scan of its own HU: one kind on both sides, so no difference."""
    z = np.arange(-1, 14, 0.5)
    hu = np.broadcast_to(300 + 100 * z[:, None, None], (30, 16, 14)).astype(np.float32)
    affine = np.diag([0.5, 0.5, 0.5, 1.0])
    affine[:3, 3] = -1.25, -1.25, -1.0
    volume, inside = Volume(hu, affine), np.zeros(hu.shape, dtype=bool)
    inside[2:27, 3:9, 3:7] = True
    region = region_from_mask(volume, inside, smoothing_mm=0.0)
    labels = np.where(np.arange(30)[:, None, None] * 0.5 - 1 < 4.5, 1, 2) * np.ones((1, 16, 14), int)
    how: dict[str, Any] = {"volume": volume, "region": region, "labels": labels, "device": device}
    by_label = {1: law("kopperdahl-2002-power"), 2: law("keyak-1998")}
    _, alarms = assign(bar(), None, Mapping("element-e", partial_volume="none"), by_label=by_label, **how)
    assert alarms.density_kind == "apparent" and len(alarms.converted_by) == 2
    exact_g = 1.9 / 1630 * 900 * 72e-3  # mean HU by volume
    assert alarms.mass_mesh_g == pytest.approx(exact_g, rel=2e-3)
