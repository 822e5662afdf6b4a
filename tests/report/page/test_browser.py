"""The report in a real browser: it opens alone, turns, cuts, answers a pick, prints, and fits a phone."""

import base64
import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By

from gpubspline.ct.volume import Volume
from gpubspline.material.registry import law
from gpubspline.mesh.mesh import Mesh
from gpubspline.mesh.quality import summarise
from gpubspline.report.page import Account, Curve, Setting, Table, write_report

MakeBox = Callable[..., Mesh]


def account(mesh: Mesh, **more: Any) -> Account:
    quality = summarise(mesh, np.asarray(mesh.cell_fields["scaled_jacobian"]))
    figures = {"nodes": mesh.n_nodes, "elements": mesh.n_elements} | {f"figure_{n}_mm": n / 7 for n in range(20)}
    figures["seconds"] = {stage: 0.5 for stage in ("read", "region", "lattice", "fit", "sample", "material", "solve")}
    return Account("A box", mesh, figures, quality, **more)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, box: MakeBox, scan: Volume) -> Path:
    path = tmp_path_factory.mktemp("page") / "box.html"
    more = {
        "volume": scan,
        "laws": (law(),),
        "command": "gpubspline mesh INPUT -o FILE.vtu",
        "settings": [Setting(f"Panel {n // 6}", f"--option-{n}", f"value {n}", n % 5 == 0) for n in range(42)],
        "tables": [Table("Runs", ("elements", "MPa"), [(1000, 1.25), (2000, 1.5)])],
        "curves": [Curve("Convergence", "elements", "MPa", {"max": ([1000, 2000, 9000], [1.0, 1.5, 1.6])}, log_x=True)],
    }
    write_report(account(box(), **more), path)
    return path


def opened(browser: Any, path: Path) -> None:
    browser.get_log("browser"), browser.get_log("performance")
    browser.get(path.as_uri())
    until = time.monotonic() + 60
    while not browser.execute_script("return document.documentElement.dataset.ready"):
        assert time.monotonic() < until, browser.get_log("browser")
        time.sleep(0.05)


def drawn(browser: Any, canvas: str = "#mesh") -> np.ndarray:
    """Pixels (h, w, 4) of a canvas, after what was asked of it is drawn."""
    script = """
      const [selector, done] = arguments;
      requestAnimationFrame(() => requestAnimationFrame(() => {
        const from = document.querySelector(selector), to = document.createElement("canvas");
        [to.width, to.height] = [from.width, from.height];
        const pen = to.getContext("2d");
        pen.drawImage(from, 0, 0);
        const bytes = pen.getImageData(0, 0, to.width, to.height).data;
        let text = "";
        for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
        done([to.width, to.height, btoa(text)]);
      }));"""
    width, height, text = browser.execute_async_script(script, canvas)
    return np.frombuffer(base64.b64decode(text), dtype=np.uint8).reshape(height, width, 4)


def press(browser: Any, selector: str) -> None:
    browser.find_element(By.CSS_SELECTOR, selector).click()


def picked(browser: Any) -> dict[str, str]:
    spans = browser.find_elements(By.CSS_SELECTOR, "#pick span")
    return {
        s.text.removesuffix(s.find_element(By.TAG_NAME, "b").text).strip(): s.find_element(By.TAG_NAME, "b").text
        for s in spans
    }


def answers(found: dict[str, str], mesh: Mesh) -> int:
    """Check every value of a pick against the mesh, and give the element."""
    element, node = (int(found[name].replace(",", "")) - 1 for name in ("element", "node"))
    assert node in mesh.cells[element]
    np.testing.assert_allclose(np.fromstring(found["x, y, z (mm)"], sep=","), mesh.points[node], atol=0.051)
    for label, value in (
        ("HU", mesh.fields["HU"][node]),
        ("Young's modulus MPa", mesh.fields["E_MPa"][node]),
        ("scaled Jacobian", mesh.cell_fields["scaled_jacobian"][element]),
    ):
        assert float(found[label].replace(",", "")) == pytest.approx(value, rel=2e-3), label
    return element


def test_it_opens_without_an_error_and_asks_the_network_for_nothing(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    assert browser.get_log("browser") == []
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
    own = [each["request"]["url"] for each in sent if each["documentURL"] == whole.as_uri()]  # not the browser's pages
    assert whole.as_uri() in own  # what is looked for would be seen
    assert [url for url in own if url != whole.as_uri() and url.partition(":")[0] not in ("data", "blob")] == []
    assert np.mean(drawn(browser)[..., 3] > 0) > 0.1  # a good part of the canvas is body


def test_the_picture_changes_when_turned_and_comes_back_when_reset(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    first = drawn(browser)
    canvas = browser.find_element(By.ID, "mesh")
    ActionChains(browser).move_to_element(canvas).click_and_hold().move_by_offset(120, 30).release().perform()
    turned = drawn(browser)
    assert np.mean(np.any(turned != first, axis=2)) > 0.05
    press(browser, "#reset")
    assert np.array_equal(drawn(browser), first)


def test_a_pick_answers_with_the_values_of_the_mesh(browser: Any, whole: Path, box: MakeBox) -> None:
    mesh = box()
    opened(browser, whole)
    press(browser, "#mesh")
    outside = answers(picked(browser), mesh)
    press(browser, "[data-cut='0']")
    press(browser, "#mesh")
    inside = answers(picked(browser), mesh)
    assert outside != inside
    assert inside % 6 == 2  # the cut in the middle leaves three of the six layers along u
    ActionChains(browser).move_to_element_with_offset(browser.find_element(By.ID, "mesh"), -500, -150).click().perform()
    assert browser.find_element(By.ID, "mark").get_attribute("hidden")  # beside the body there is nothing to mark


def test_cuts_and_colours_change_the_picture(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    pictures = [drawn(browser)]
    for axis in "012":
        press(browser, f"[data-cut='{axis}']")
        pictures.append(drawn(browser))
    press(browser, "[data-cut='none']")
    assert np.array_equal(drawn(browser), pictures[0])
    for field in ("E_MPa", "HU", "scaled_jacobian"):
        browser.execute_script(f"field.value = '{field}'; field.dispatchEvent(new Event('change'))")
        pictures.append(drawn(browser))
    assert len({picture.tobytes() for picture in pictures}) == len(pictures)


def test_a_row_of_the_worst_elements_shows_the_element(browser: Any, whole: Path, box: MakeBox) -> None:
    opened(browser, whole)
    before = drawn(browser)
    rows = browser.find_elements(By.CSS_SELECTOR, "tr[data-worst]")
    assert len(rows) == 10
    rows[2].click()
    assert picked(browser)["element"] == "3"  # scaled Jacobians rise with the number
    answers(picked(browser), box())
    shown = drawn(browser).astype(int)
    middle = shown[shown.shape[0] // 2, shown.shape[1] // 2]
    assert middle[0] > middle[1] + 60 and not np.array_equal(shown, before)  # painted, in the middle


def test_slices_lie_as_radiology_has_them_with_the_outline_where_the_mesh_is(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    shown = {}
    for view, sign in (("axial", "max"), ("coronal", "min"), ("sagittal", "min")):
        slider = f"document.querySelector('input[data-view={view}]')"
        browser.execute_script(f"{slider}.value = {slider}.{sign}; {slider}.dispatchEvent(new Event('input'))")
        shown[view] = drawn(browser, f"canvas[data-view={view}]")[..., 0].astype(int)
    for view, (row, column) in {"axial": (0.1, 0.9), "coronal": (0.1, 0.9), "sagittal": (0.1, 0.1)}.items():
        image = shown[view]  # left is on the right, anterior up or to the left, superior up
        h, w = image.shape
        assert image[int(row * h), int(column * w)] > 200 and image[int((1 - row) * h), int((1 - column) * w)] < 50, (
            view
        )
    browser.execute_script(
        "const s = document.querySelector('input[data-view=axial]'); s.value = 9; s.dispatchEvent(new Event('input'))"
    )
    axial = drawn(browser, "canvas[data-view=axial]").astype(int)
    blue = np.argwhere((axial[..., 2] > 200) & (axial[..., 0] < 150))
    voxels = browser.execute_script("return JSON.parse(document.getElementById('data').textContent).slices.shape")
    pixel = axial.shape[1] / voxels[0]  # per mm; the box is 12 by 10 mm
    np.testing.assert_allclose(np.ptp(blue, axis=0) / pixel, (10, 12), atol=0.5)


def test_it_prints_to_two_pages(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    pdf = base64.b64decode(browser.print_page())
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 2


def test_it_is_dark_where_the_system_is_and_fits_a_phone(browser: Any, whole: Path) -> None:
    opened(browser, whole)
    ground = "return getComputedStyle(document.documentElement).backgroundColor"
    light = browser.execute_script(ground)
    try:
        wanted = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
        assert browser.execute_script(ground) != light
        size = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        opened(browser, whole)
        wide = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        assert browser.execute_script(wide) == [390, 390]
        assert browser.get_log("browser") == []
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_a_million_elements_open(browser: Any, tmp_path: Path, box: MakeBox) -> None:
    mesh = box((101, 101, 101), 1.0)
    noise = np.random.default_rng(1)
    fields = {name: values * (1 + 0.1 * noise.random(mesh.n_nodes)) for name, values in mesh.fields.items()}
    rough = Mesh(mesh.points + 0.2 * noise.random((mesh.n_nodes, 3)), "hex8", structure=mesh.structure, fields=fields)
    write_report(account(rough.with_cell_fields(dict(mesh.cell_fields))), tmp_path / "million.html")
    assert (tmp_path / "million.html").stat().st_size < 25e6
    opened(browser, tmp_path / "million.html")
    assert browser.get_log("browser") == []
    said = browser.find_element(By.ID, "sceneNote").text
    assert re.search(r"Of 1,000,000 elements this page holds the surface and cuts at \d+ places", said)
    press(browser, "#mesh")
    assert picked(browser)["element"]


def test_a_slice_is_shown_flat_with_its_outline(browser: Any, tmp_path: Path, scan: Volume) -> None:
    x, y = np.meshgrid(np.arange(0.0, 11.0), np.arange(0.0, 9.0), indexing="ij")
    points = np.stack([x.ravel(order="F"), y.ravel(order="F"), np.full(x.size, 3.0)], axis=1)
    mesh = Mesh(points, "quad4", structure=x.shape, fields={"HU": points[:, 0]})
    mesh = mesh.with_cell_fields({"scaled_jacobian": np.linspace(0.5, 1, mesh.n_elements)})
    write_report(account(mesh, volume=scan.crop((0, 0, 9), (24, 20, 10))), tmp_path / "slice.html")
    opened(browser, tmp_path / "slice.html")
    assert browser.get_log("browser") == []
    assert not browser.find_element(By.ID, "cutting").is_displayed()
    assert len(browser.find_elements(By.CSS_SELECTOR, ".trio canvas")) == 1
    body = drawn(browser)[..., 3] > 0
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(10 / 8, rel=0.02)  # seen face-on
    axial = drawn(browser, "canvas[data-view=axial]").astype(int)
    assert np.count_nonzero((axial[..., 2] > 200) & (axial[..., 0] < 150)) > 500
