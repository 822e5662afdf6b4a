"""The three methods: which fits, what implies one, and surfaces and sizes at the command line."""

import json
from dataclasses import replace

import meshio
import numpy as np
import pytest

from gpubspline import methods
from gpubspline.cautions import foretell, warn_of_bridges, warn_of_topology, warn_of_volume
from gpubspline.clock import Clock
from gpubspline.ct.region import region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.device import open_device
from gpubspline.errors import GpubsplineWarning, InputError, MeshError
from gpubspline.material.assign import Mapping
from gpubspline.material.registry import law
from gpubspline.mesh.blocks.mesher import blocks_mesh
from gpubspline.mesh.blocks.result import BlocksReport, OtherTopology
from gpubspline.mesh.element_size import size_of
from gpubspline.mesh.quality import assess
from gpubspline.methods import Choice, choose, implied, is_row_convex, mesh_body, refuse_remnant
from gpubspline.recipe import Body, Meshing, Sampling, Shaping


def scan(level, shape=(22, 40, 44), spacing=1.0):
    """A CT of 1000 HU where ``level(x, y, z)`` in mm is negative, -1000 where it is positive, linear between."""
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = -(np.array(shape[::-1]) - 1) / 2 * spacing
    k, j, i = np.indices(shape)
    x, y, z = np.moveaxis(np.stack([i, j, k], axis=-1) * spacing + affine[:3, 3], -1, 0)
    return Volume(np.clip(-600 * level(x, y, z), -1000, 1000).astype(np.float32), affine)


def body_of(level, **grid):
    volume = scan(level, **grid)
    return Body(volume, volume, region_from_threshold(volume, 0.0, fill="none"), 0.0)


def oval(x, y, z):
    return np.hypot(x / 1.3, y) - 12 + 0 * z


def bean(x, y, z):
    """A section with a dent in its rows: one part, no hole, but rows that cross it twice."""
    return np.maximum(np.hypot(x, y) - 15, 5 - np.hypot(x + 1, y - 14)) + 0 * z


def fork(x, y, z):
    """One leg above, two below."""
    legs = np.minimum(np.hypot(x - 8, y), np.hypot(x + 8, y)) - 5.5
    return np.where(z > 0, np.hypot(x / 1.6, y) - 9, legs)


def ring(x, y, z):
    return np.abs(np.hypot(x, y) - 12) - 5 + 0 * z


@pytest.mark.parametrize(("level", "convex"), [(oval, True), (bean, False), (fork, False), (ring, False)])
def test_row_convexity(level, convex):
    assert is_row_convex(body_of(level).region) is convex


def test_rows_that_do_not_meet_are_not_convex():
    """Two squares corner to corner but for a row: every row is crossed once, and yet there are two parts."""
    level = lambda x, y, z: np.where(y > 0, np.abs(x - 9), np.abs(x + 9)) + np.abs(y) * 0.05 - 6 + 0 * z  # noqa: E731
    region = region_from_threshold(scan(level), 0.0, fill="none", largest=False)
    assert not is_row_convex(region)


@pytest.mark.parametrize(
    ("level", "method", "why"),
    [
        (oval, "tensor", "one region that every row crosses once"),
        (bean, "butterfly", "one part without holes"),
        (fork, "blocks", r"no butterfly: a section with 2 parts at \("),
        (ring, "blocks", r"no butterfly: a section with a hole at \("),
    ],
)
def test_auto_takes_the_first_that_fits(level, method, why, device):
    import re

    chosen = choose(body_of(level), Meshing(), Shaping(), Sampling(law()), "z", device)
    assert chosen.method == method and re.search(why, chosen.why)


def test_what_is_wrong_is_not_taken_for_a_shape_that_no_butterfly_fits(device):
    with pytest.raises(InputError, match="septic"):
        choose(body_of(bean), Meshing(), Shaping(interpolation="septic"), Sampling(law()), "z", device)


def test_what_blocks_have_no_use_for_is_warned_of(device):
    with pytest.warns(GpubsplineWarning, match="--degree does nothing in blocks"):
        choose(body_of(fork), Meshing(), Shaping(degree=(2,)), Sampling(law()), "z", device)


def test_a_size_is_not_for_tensor(device):
    chosen = choose(body_of(oval), Meshing(elements=900), Shaping(), Sampling(law()), "z", device)
    assert chosen.method == "butterfly"


@pytest.mark.parametrize(
    ("options", "method"),
    [
        ({"shaping": Shaping(control=(5, 5, 5))}, "tensor"),
        ({"sampling": Sampling(law(), (5, 5, 5))}, "tensor"),
        ({"shaping": Shaping(fit="interpolate")}, "tensor"),
        ({"shaping": Shaping(degree=(2, 3, 2))}, "tensor"),
        ({"shaping": Shaping(row_smoothing=0.0)}, "tensor"),
        ({"sliced": True}, "tensor"),
        ({"structured": True}, "tensor"),
        ({"shaping": Shaping(control=(5, 5, 4, 5))}, "butterfly"),
        ({"sampling": Sampling(law(), (5, 5, 4, 5))}, "butterfly"),
        ({"meshing": Meshing("blocks")}, "blocks"),
        ({"meshing": Meshing(refine=2)}, "blocks"),
    ],
)
def test_what_implies_a_method(options, method):
    given = {"meshing": Meshing(), "shaping": Shaping(), "sampling": Sampling(law())} | options
    found = implied(**given)
    assert found is not None and found.method == method
    assert implied(Meshing(), Shaping(), Sampling(law())) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"meshing": Meshing("hexes")}, "auto, tensor, butterfly, blocks"),
        ({"meshing": Meshing("blocks"), "shaping": Shaping(control=(5, 5, 5))}, "--control, which is for tensor"),
        ({"meshing": Meshing("tensor"), "sampling": Sampling(law(), (5, 5, 4, 5))}, "which is for butterfly"),
        ({"meshing": Meshing("tensor", size_mm=2.0)}, "--size or --elements for butterfly or blocks"),
        ({"meshing": Meshing(size_mm=2.0), "sampling": Sampling(law(), (5, 5, 5))}, "got --nodes of the tensor method"),
        ({"meshing": Meshing(elements=5), "sliced": True}, "got --slice of the tensor method"),
        ({"meshing": Meshing("blocks"), "structured": True}, r"no --output \.vts, which is for tensor, with"),
        ({"meshing": Meshing(size_mm=2.0), "structured": True}, r"got --output \.vts of the tensor method"),
        (
            {"meshing": Meshing("blocks"), "sampling": Sampling(law(), mapping=Mapping("element-e", transverse=law()))},
            "no --transverse-law, which is for tensor",
        ),
        ({"meshing": Meshing("blocks"), "shaping": Shaping(degree=(2,))}, "no --degree, which is for tensor and b"),
        ({"meshing": Meshing("blocks"), "shaping": Shaping(interpolation="cubic")}, "no --interpolation, which is for"),
        ({"meshing": Meshing(refine=2), "shaping": Shaping(degree=(2,))}, r"no --degree, .*\(--refine is for it\)"),
        ({"meshing": Meshing("tensor", refine=2)}, "no --refine, which is for blocks"),
        ({"meshing": Meshing(refine=2), "structured": True}, r"--output \.vts of tensor and --refine of blocks"),
    ],
)
def test_what_does_not_fit_together_is_refused(options, words):
    given = {"meshing": Meshing(), "shaping": Shaping(), "sampling": Sampling(law())} | options
    with pytest.raises(InputError, match=words):
        implied(**given)


@pytest.mark.parametrize("level", [bean, fork])
def test_methods_mesh_what_they_were_chosen_for(level, device):
    body, meshing, sampling = body_of(level), Meshing(elements=2500), Sampling(law())
    chosen = choose(body, meshing, Shaping(), sampling, "z", device)
    made = mesh_body(body, chosen, meshing, sampling, device, Clock())
    mesh, quality = assess(made.mesh, device)
    assert quality.inverted == 0 and mesh.n_elements == pytest.approx(2500, rel=0.15)
    assert mesh.volume_mm3 == pytest.approx(body.region.volume_mm3, rel=0.03)
    assert 500 < np.median(mesh.fields["HU"]) <= 1000


def test_blocks_are_made_again_where_their_number_is_not_the_one_asked_for(monkeypatch):
    """A size found for a place of the lattice that is not the one taken."""
    device, body = open_device("opencl"), body_of(bean)
    monkeypatch.setattr(methods, "size_for", lambda region, elements, device: size_of(region, int(elements * 1.5)))
    meshing, sampling = Meshing(method="blocks", elements=900), Sampling(law())
    chosen = choose(body, meshing, Shaping(), sampling, "z", device)
    made = mesh_body(body, chosen, meshing, sampling, device, Clock())
    assert made.mesh.n_elements == pytest.approx(900, rel=0.1)


def test_the_tensor_method_warns_of_bridges():
    with pytest.warns(GpubsplineWarning, match="fills 24% more than the region"):
        warn_of_bridges(124.0, 100.0)
    with pytest.warns(GpubsplineWarning, match="fills 6% less"):
        warn_of_bridges(94.0, 100.0)
    warn_of_bridges(104.0, 100.0)
    with pytest.warns(
        GpubsplineWarning, match="less than the region: its rows are smoothed away; a smaller --smooth-rows"
    ):
        warn_of_bridges(94.0, 100.0, smoothed=True)


def test_blocks_warn_where_their_volume_is_not_the_regions():
    with pytest.warns(GpubsplineWarning, match=r"fills 21% more than the region: .* of 2\.73 mm .*smaller --size"):
        warn_of_volume(121.0, 100.0, 2.7312)
    warn_of_volume(104.0, 100.0, 2.7)
    with pytest.warns(GpubsplineWarning, match=r"fills 10% less than the region: what is thinner .* is left out"):
        warn_of_volume(90.0, 100.0, 2.7)


@pytest.fixture(scope="module")
def fork_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("fork") / "fork.nii.gz"
    volume = scan(fork)
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(volume.hu)
    image.SetOrigin(volume.affine[:3, 3].tolist())
    sitk.WriteImage(image, str(path))
    return path


def test_a_tensor_mesh_of_a_fork_is_warned_of(run, fork_file, tmp_path):
    words = ["--threshold", 0, "--fill", "none", "--method", "tensor", "--nodes", "9,9,9"]
    status, out, err = run("mesh", fork_file, "-o", tmp_path / "m.vtu", *words)
    assert status == 0 and "method     tensor: asked for" in out
    assert "more than the region" in err and "--method butterfly or blocks" in err


def test_auto_at_the_command_line_says_what_and_why(run, fork_file, tmp_path):
    files = ["-o", tmp_path / "m.vtu", "--summary", tmp_path / "s.json"]
    status, out, _ = run("mesh", fork_file, *files, "--threshold", 0, "--fill", "none", "--elements", 2000)
    assert status == 0 and ": no butterfly: a section with 2 parts at (" in out
    figures = json.loads((tmp_path / "s.json").read_text())
    assert figures["method"]["name"] == "blocks" and figures["euler"] == {"mesh": 1, "region": 1}
    assert figures["certified_valid"] is True and figures["scaled_jacobian"]["inverted"] == 0
    assert figures["modulus_mpa"]["max"] > 1000
    assert {"count", "max_mm"} == figures["off_surface_nodes"].keys()


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A ball of radius 8 as PLY, from VTK."""
    pyvista = pytest.importorskip("pyvista")
    path = tmp_path_factory.mktemp("ball") / "ball.ply"
    sphere = pyvista.Sphere(radius=8.0, theta_resolution=40, phi_resolution=40)
    meshio.write_points_cells(path, sphere.points, [("triangle", sphere.regular_faces)])
    return path


def test_a_surface_without_ct_is_meshed_without_material(run, ball, tmp_path):
    files = ["-o", tmp_path / "m.vtu", "--summary", tmp_path / "s.json", "--picture", tmp_path / "p.png"]
    status, out, err = run("mesh", ball, "--method", "blocks", "--elements", 700, *files)
    assert status == 0 and "no CT was given" in out and err == ""
    figures = json.loads((tmp_path / "s.json").read_text())
    assert figures["elements"] == pytest.approx(700, rel=0.1)
    assert figures["law"] is None and figures["hu"] is None and figures["modulus_mpa"] is None
    assert figures["volume_mm3"]["mesh"] == pytest.approx(4 / 3 * np.pi * 512, rel=0.05)
    written = meshio.read(tmp_path / "m.vtu")
    assert set(written.point_data) == set() and "scaled_jacobian" in written.cell_data
    assert (tmp_path / "p.png").stat().st_size > 1000


def test_blocks_are_refined_on_their_surface(run, ball, tmp_path):
    figures = {}
    for parts in (1, 2):
        words = ["--size", 3, "--method", "blocks", "--refine", parts, "--summary", tmp_path / "s.json"]
        assert run("mesh", ball, "-o", tmp_path / "m.vtu", *words)[0] == 0
        figures[parts] = json.loads((tmp_path / "s.json").read_text())
    assert figures[2]["elements"] == 8 * figures[1]["elements"]
    assert figures[2]["scaled_jacobian"]["min"] > figures[1]["scaled_jacobian"]["min"] - 0.04
    assert figures[2]["surface_distance_mm"]["mean"] < 0.6 * figures[1]["surface_distance_mm"]["mean"]
    status, _, err = run("mesh", ball, "-o", tmp_path / "n.vtu", "--refine", 2, "--order", 2)
    assert status == 2 and "expected hex8 with --refine, got hex20" in err and not (tmp_path / "n.vtu").exists()


def test_a_surface_takes_its_material_from_a_ct(run, ball, fork_file, tmp_path):
    words = ["--method", "blocks", "--size", 3, "--ct", fork_file, "-o", tmp_path / "m.vtu"]
    status, out, _ = run("mesh", ball, *words, "--partial-volume", "none")
    assert status == 0 and "material   HU -1000 to 1000" in out
    found = meshio.read(tmp_path / "m.vtu").point_data
    assert found["E_MPa"].max() > 1000
    status, out, _ = run("mesh", ball, *words)
    assert status == 0 and "folded back in" in out
    folded = meshio.read(tmp_path / "m.vtu").point_data
    assert folded["HU"].mean() > found["HU"].mean() + 10


def test_a_surface_by_butterfly(run, ball, tmp_path):
    status, out, _ = run("mesh", ball, "--elements", 3000, "-o", tmp_path / "m.vtu")
    assert status == 0 and "method     butterfly: every section is one part without holes" in out


def test_what_surfaces_and_sizes_refuse(run, ball, fork_file, tmp_path):
    far = meshio.read(ball)
    far.points = far.points + 500
    meshio.write(tmp_path / "far.ply", far)
    open_ball = meshio.Mesh(far.points, [("triangle", far.cells[0].data[len(far.cells[0].data) // 3 :])])
    meshio.write(tmp_path / "open.ply", open_ball)
    out = ["-o", tmp_path / "m.vtu"]
    for words, what in (
        (["mesh", ball, "--threshold", 5, *out], "without options that find a body in CT"),
        (["mesh", ball, "--method", "tensor", *out], "butterfly or blocks"),
        (["mesh", fork_file, "--ct", fork_file, *out], "--ct with a surface"),
        (["mesh", tmp_path / "far.ply", "--ct", fork_file, *out], "are its coordinates LPS mm"),
        (["mesh", tmp_path / "open.ply", *out], "close its holes"),
        (["mesh", ball, "--size", 0, *out], "--size above 0 mm"),
        (["mesh", ball, "--elements", 0, *out], "--elements of 1 or more"),
        (["mesh", ball, "--size", 1, "--elements", 10, *out], "got both"),
        (["mesh", ball, "--method", "blocks", "--nodes", "3,3,3", *out], "--nodes, which is for tensor"),
        (["mesh", fork_file, "--method", "blocks", "--size", 1e-9, *out], "at most 67,108,864 hexes of blocks"),
        (["mesh", fork_file, "--method", "blocks", "--elements", 10**12, *out], "at most 67,108,864 hexes of blocks"),
        (["mesh", fork_file, "--smooth-rows", "inf", *out], "--smooth-rows of 0 to 100, got inf"),
        (["mesh", fork_file, "--smooth-rows", 1e6, *out], "--smooth-rows of 0 to 100, got 1e+06"),
        (["mesh", fork_file, "--smooth", 1e9, *out], "a smoothing of at most 100 voxels, got"),
        (["mesh", ball, "--method", "blocks", "--size", 40, *out], "thicker than an element of 40 mm, got "),
        (["mesh", fork_file, "--method", "blocks", "-o", tmp_path / "m.vts"], "no --output .vts, which is for tensor"),
        (["mesh", fork_file, "--size", 2, "-o", tmp_path / "m.x", "--format", "vts"], "got --output .vts of the te"),
        (["mesh", ball, "-o", tmp_path / "m.vts"], "a CT for the tensor method (--output .vts is for it)"),
        (["mesh", ball, "--mapping", "element-e", *out], "--ct, which the material of a surface comes from, with --m"),
        (["mesh", ball, "--allow-gaps", *out], "--ct with options that read one"),
        (["mesh", ball, "-o", tmp_path / "m.feb"], "material for .feb, which holds no mesh without"),
        (["mesh", ball, "-o", tmp_path / "m.inp", "--modulus-bins", 5], "--ct for a modulus by bins"),
        (["mesh", ball, "--element", "hex27", "-o", tmp_path / "m.inp"], "for .inp, got hex27"),
        (["mesh", fork_file, "--slice", 9, "--order", 2, "-o", tmp_path / "m.k"], "for .k, got quad8"),
        (["mesh", ball, "--picture", tmp_path / "p.png", "--field", "HU_max", *out], "for --field"),
    ):
        status, said, err = run(*words)
        assert status == 2 and what in err and len(err.strip().splitlines()) == 1 and said == "", (words, err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["far.ply", "open.ply"]


def test_optimize_at_the_command_line(run, fork_file, tmp_path):
    files = ["-o", tmp_path / "m.vtu", "--summary", tmp_path / "s.json"]
    words = ["--threshold", 0, "--box", "-20,20,-20,20,1.5,10", "--elements", 900, "--optimize"]
    status, out, _ = run("mesh", fork_file, *words, *files)
    figures = json.loads((tmp_path / "s.json").read_text())
    done = figures["optimized"]
    assert status == 0 and "optimized  worst element from" in out and figures["method"]["name"] == "butterfly"
    assert done["before"] < done["after"] == pytest.approx(figures["scaled_jacobian"]["min"], abs=1e-3)
    assert done["boundary_mm"] < 0.1
    status, said, err = run("mesh", fork_file, "--threshold", 0, "--method", "blocks", "--optimize", *files[:2])
    assert status == 2 and "no --optimize with blocks" in err and said == ""


def test_the_number_of_blocks_is_foretold(device):
    """About as many as there will be; those that take minutes are warned of, with a size that does not."""
    body = body_of(lambda x, y, z: np.hypot(np.hypot(x, y) - 12, z) - 5, spacing=1.0)
    told = []
    clock = Clock()
    clock.tell = told.append
    meshed = mesh_body(body, Choice("blocks", ""), Meshing("blocks", 1.8), Sampling(law()), device, clock)
    count = int(told[0].split()[1].replace(",", ""))
    assert told[1] == f"{meshed.mesh.n_elements:,} hexes, place 1 of at most 6"
    assert count == pytest.approx(meshed.mesh.n_elements, rel=0.4) and told[0].endswith(" s")
    with pytest.warns(GpubsplineWarning, match=r"minutes; --size \d.* gives about 50,000"):
        foretell(body.region, 0.2, clock)


def test_walls_are_warned_of_before_the_work():
    """Half of a shell of two voxels is as thin: hexes of its size are foretold to be more than fit in, smaller not."""
    body = body_of(lambda x, y, z: np.abs(np.sqrt(x**2 + y**2 + z**2) - 14) - 1, spacing=1.0)
    said = r"half .* less than [12]\.?\d* mm thick, .* take about [3-9]\.\d times"
    with pytest.warns(GpubsplineWarning, match=said + r".* --size \S+ follows them, another --threshold"):
        foretell(body.region, 3.0, Clock())  # open at the ends of the scan: there is nothing to fill
    with pytest.warns(GpubsplineWarning, match=said + r".* --size \S+ follows them, --elements"):
        foretell(body.region, 3.0, Clock(), of_surface=True)  # which has no options that find another body
    hollow = body_of(lambda x, y, z: np.abs(np.sqrt(x**2 + y**2 + z**2) - 14) - 1, shape=(40, 40, 44))
    with pytest.warns(GpubsplineWarning, match=said + ".*, --fill volume, another --threshold"):
        foretell(hollow.region, 3.0, Clock())
    foretell(body.region, 1.0, Clock())


@pytest.mark.parametrize("element", ["hex20", "hex27"])
def test_curved_blocks_have_the_node_sets_of_straight_ones(element):
    body = body_of(lambda x, y, z: np.hypot(np.hypot(x, y) - 12, z) - 5, spacing=2.0)
    sampling = Sampling(law(), element_type=element)
    mesh = mesh_body(body, Choice("blocks", ""), Meshing("blocks", 4.0), sampling, open_device("opencl"), Clock()).mesh
    surface = mesh.node_sets["surface"]
    assert np.array_equal(surface, np.unique(mesh.boundary())) and len(surface) > 400


def test_other_topology_is_warned_of():
    whole = BlocksReport(2.0, 0.7, {"mesh": 1, "region": 1}, (), 0, {"count": 0, "max_mm": 0.0}, (), ())
    warn_of_topology(whole, None)
    places = tuple(OtherTopology((float(x), 2.0, 3.5), "closes a tunnel") for x in range(4))
    other = replace(whole, euler={"mesh": -3, "region": -7}, topology=places)
    said = r"Euler characteristic -3, not -7.*it closes a tunnel at \(0, 2, 3.5\) mm, closes .*, and 1 more"
    for keeps, offer in ((None, "--size below 2 mm"), (1.6, "--size 1.6 keeps")):
        with pytest.warns(GpubsplineWarning, match=said + ".*" + offer):
            warn_of_topology(other, keeps)


def test_blocks_that_miss_most_of_a_region_are_refused(monkeypatch, device):
    """A ball in the middle of a plate half as thick as an element: what is thick enough is a quarter of the whole."""
    monkeypatch.setattr("gpubspline.mesh.blocks.lay.FILLINGS", 0)  # else the plate is filled

    def plate(x, y, z):
        return np.minimum(np.hypot(np.hypot(x, y), z) - 5, np.maximum.reduce([abs(x) - 21, abs(y) - 19, abs(z) - 1.2]))

    region = body_of(plate).region
    made = blocks_mesh(region, 4.0, device=device, attempts=1)
    with pytest.raises(MeshError, match=r"hexes of 4 mm to fill the region, got [12]\d% of it: .* as at \(.*\) mm; "):
        refuse_remnant(made, region)
    smoothed_away = replace(made, report=replace(made.report, lost_features=()))
    with pytest.raises(MeshError, match=r"got [12]\d% of it: .* as at \(.*\) mm; "):
        refuse_remnant(smoothed_away, region)
