"""The text of a report: what stands in it, in which order, escaped, and what it refuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.material.registry import law
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import summarise
from gpubspline.report.page import Account, Setting, Table, write_report
from gpubspline.report.page import slices as page_slices
from gpubspline.report.page.figures import figure_rows, number
from gpubspline.report.page.sections import warning_lines
from gpubspline.report.page.slices import slices
from gpubspline.report.page.write import page

MakeBox = Callable[..., Mesh]


def text_of(mesh: Mesh, **more: Any) -> str:
    return page(Account("A box", mesh, **more))


def test_every_law_and_conversion_stands_there_with_its_citation(box: MakeBox) -> None:
    laws = [law("wirtz-2000"), law("keyak-1998")]
    text = text_of(box(), laws=laws, sources=["Somebody 1999"])
    for each in laws:
        assert each.name in text and each.citation in text.replace("&#x27;", "'")
        for step in each.density.steps:
            assert step.name in text and step.source in text.replace("&#x27;", "'")
        for part in each.all_unconfirmed:
            assert text.replace("&#x27;", "'").count(part) >= 2  # as a warning, too
    assert "Somebody 1999" in text
    assert "E = 1904 ρ^1.64 MPa" in text and "at 350 HU from 438 to 129 MPa" in text


def test_warnings_come_first(box: MakeBox) -> None:
    values = np.linspace(-0.1, 1, box().n_elements)
    quality = summarise(box(), values)
    account = Account("A box", box(), {"nodes": 100, "out_of_range_nodes": 30}, quality, warnings=["two <gaps> filled"])
    said = warning_lines(account)
    assert said[0] == "two <gaps> filled" and "elements are inverted" in said[1] and "30 % of the nodes" in said[-1]
    text = page(account)
    assert text.index("two &lt;gaps&gt; filled") < text.index("<main>") < text.index("Worst elements")
    assert "No warnings" in text_of(box())


def test_texts_are_escaped_and_the_page_asks_for_nothing(box: MakeBox) -> None:
    bad = "</script><img src=http://x.example/a.png>$title"
    table = Table(bad, [bad], [[bad]], bad)
    text = page(Account(bad, box(), {bad: bad}, command=bad, settings=[Setting(bad, bad, bad)], tables=[table]))
    assert "<img" not in text and text.count("</script>") == 2
    assert "http" not in text.replace("http-equiv", "").replace("http://x.example", "")


def test_options_in_force_and_the_command(box: MakeBox) -> None:
    settings = [
        Setting("Mesh", "--nodes", "7,6,5", True),
        Setting("Mesh", "--order", "1"),
        Setting("Run", "--quiet", "no"),
    ]
    text = text_of(box(), command="gpubspline mesh INPUT", settings=settings)
    assert "<pre>gpubspline mesh INPUT</pre>" in text
    assert "<dt class=given>--nodes</dt><dd>7,6,5</dd><dt>--order</dt><dd>1</dd>" in text


def test_figures_become_words_with_units() -> None:
    figures = {
        "volume_mm3": {"mesh": 8.0, "region": None},
        "mass_g": 12.3456,
        "euler": {"region": 0, "mesh": 2},
        "off_surface_nodes": {"count": 425, "max_mm": 7.876},
        "reaction_n": [1.0, -2.5, 0.0],
        "threshold_hu": None,
        "load_case": {"name": "stance", "title": ""},
        "parts": [{"part": "head", "force_n": [0.0, 1e-12, -10.0], "volume_mm3": {"mesh": 8.123456, "region": 8}}],
        "seconds": {"total": 1.0},
    }
    assert figure_rows(figures) == [
        ("volume", "mesh 8 mm³"),
        ("mass", "12.35 g"),
        ("Euler number", "region 0, mesh 2"),
        ("off surface nodes", "count 425, max 7.876 mm"),
        ("reaction", "(1, -2.5, 0) N"),
        ("load case: name", "stance"),
        ("parts 1", "part head; force (0, 0, -10) N; volume mesh 8.123 mm³, region 8 mm³"),
    ]
    assert [number(v) for v in (1234567, 0.00012, 0.25, 1234.56, 20000.0, True, None, "a")] == [
        *("1,234,567", "1.200e-04", "0.25", "1,235", "20,000", "yes", "-", "a"),
    ]


def test_parts_left_out_and_where_loads_act_have_tables(box: MakeBox) -> None:
    acting = {"region": "head", "kind": "force", "force_n": [1.0, 1e-9, -2.0], "area_mm2": 3.25, "nodes": 7}
    figures = {
        "lost_features": [{"place_mm": [1.0, 2.0, 3.5], "out_mm": 11.64}],
        "load_case": {"name": "stance", "source": "section 3.6"},
        "regions": [acting | {"centre_mm": [0.0, 0.0, 9.0]}],
    }
    text = text_of(box(), figures=figures)
    assert "<td>(1, 2, 3.5)</td><td>11.64</td>" in text and "Parts of the region left out" in text
    assert "<td>(1, 0, -2)</td><td>3.25</td><td>7</td><td>(0, 0, 9)</td>" in text and "section 3.6" in text


def test_alarms_become_shares_and_masses() -> None:
    alarms = {"mapping": "nodal", "of": "nodes", "count": 200, "outside_law": 0.0825, "beyond_specimens": None}
    alarms |= {"near_zero_modulus": 0.0, "near_zero_mpa": 10.0, "surface_depth_mm": None, "order_difference": None}
    alarms |= {"mass_g": {"mesh": 129.94, "voxels": 143.1, "difference": -0.092}}
    assert figure_rows({"alarms": alarms, "mass_g": 129.94, "out_of_range_nodes": 16}) == [
        ("mapping", "nodal"),
        ("outside the law", "8.25 % of the nodes"),
        ("modulus below 10 MPa", "0 % of the nodes"),
        ("mass of the mesh", "129.9 g, of the voxels 143.1 g: -9.2 %"),
    ]


def test_fields_with_gaps_are_shown_where_they_are_known(box: MakeBox) -> None:
    mesh = box()
    hu, nothing = mesh.fields["HU"].copy(), np.full(mesh.n_nodes, np.nan)
    hu[::3] = np.nan
    text = text_of(mesh.with_fields({"HU": hu, "von_mises_mpa": nothing}), laws=[law()])
    assert "NaN" not in text.split('id="data">')[1].split("</script>")[0] and '"von_mises_mpa"' not in text
    assert '"HU"' in text and "HU of the nodes" in text


def test_a_large_ct_is_averaged_and_keeps_its_place(box: MakeBox, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_slices, "VOXELS", 3_000_000)
    shape = (150, 180, 200)
    k, j, i = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in shape), indexing="ij", sparse=True)
    affine = np.diag([0.06, 0.06, 0.08, 1.0])
    whole = Volume(np.asarray(i + 0 * j + 0 * k), affine)
    told = slices(whole, box())
    assert np.prod(told["shape"]) <= 3_000_000 and "Averaged to" in told["note"]
    placed = np.array(told["affine"])
    # the first voxel's middle is the middle of the voxels it stands for
    first = (placed[:3, 3] - whole.affine[:3, 3]) / [0.06, 0.06, 0.08]
    factor = np.diag(placed)[:3] / [0.06, 0.06, 0.08]
    np.testing.assert_allclose(first % 1, (factor - 1) / 2 % 1, atol=1e-9)


@pytest.mark.parametrize(
    ("fields", "name", "message"),
    [
        ({"HU": 1.0}, "page.pdf", r"ends in \.html, got page\.pdf"),
        ({"HU": 1.0}, "none/page.html", "does not exist"),
        ({}, "page.html", r"expected a mesh with fields to report on \(von_mises_mpa, HU, .*\), got none"),
        ({"weight": 1.0}, "page.html", "got weight"),
    ],
)
def test_bad_input_leaves_nothing_behind(
    tmp_path: Path, box: MakeBox, fields: dict[str, float], name: str, message: str
) -> None:
    mesh = box()
    bare = Mesh(mesh.points, "hex8", structure=mesh.structure)
    bare = bare.with_fields({key: np.full(mesh.n_nodes, value) for key, value in fields.items()})
    with pytest.raises(InputError, match=message):
        write_report(Account("A box", bare), tmp_path / name)
    assert not list(tmp_path.iterdir())
