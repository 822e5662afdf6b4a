"""Surface files of every kind, written by others' code and by hand."""

import warnings

import meshio
import numpy as np
import pytest

from gpubspline.errors import GpubsplineWarning, InputError
from gpubspline.surface.read import EXTENSIONS, is_surface, read_surface
from gpubspline.surface.surface import Surface


def save(surface, path):
    if path.suffix == ".vtp":
        pyvista = pytest.importorskip("pyvista")
        pyvista.make_tri_mesh(surface.points, surface.triangles).save(path)
    else:
        meshio.write_points_cells(path, surface.points, [("triangle", surface.triangles)])


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_every_format_gives_the_surface(shapes, extension, tmp_path):
    body = shapes.sphere()
    save(body, tmp_path / f"a{extension}")
    assert is_surface(f"A{extension.upper()}")
    read = read_surface(tmp_path / f"a{extension}")
    assert read.volume_mm3 == pytest.approx(body.volume_mm3, rel=1e-5)
    assert (len(read.points), read.euler) == (len(body.points), 2)


def test_text_stl_and_quads_of_obj(shapes, tmp_path):
    box = shapes.box()
    rows = [
        "solid box",
        *(
            "facet normal 0 0 0\nouter loop\n"
            + "\n".join("vertex " + " ".join(f"{x:g}" for x in corner) for corner in triangle)
            + "\nendloop\nendfacet"
            for triangle in box.corners
        ),
        "endsolid box",
    ]
    (tmp_path / "box.stl").write_text("\n".join(rows) + "\n")
    assert read_surface(tmp_path / "box.stl").volume_mm3 == pytest.approx(24)
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    lines = [f"v {x} {y} {z}" for x, y, z in box.points]
    lines += ["f " + " ".join(f"{n + 1}//1" for n in quad) for quad in quads]
    (tmp_path / "box.obj").write_text("vn 0 0 1\n" + "\n".join(lines) + "\n")
    assert read_surface(tmp_path / "box.obj").volume_mm3 == pytest.approx(24)


def test_points_that_differ_by_rounding_are_joined_with_a_word(shapes, tmp_path):
    body = shapes.sphere()
    loose = body.corners.reshape(-1, 3) + np.random.default_rng(0).uniform(-1e-8, 1e-8, (3 * len(body.triangles), 3))
    meshio.write_points_cells(tmp_path / "a.off", loose, [("triangle", np.arange(len(loose)).reshape(-1, 3))])
    with pytest.warns(GpubsplineWarning, match="points of open edges closer than .* joined"):
        read = read_surface(tmp_path / "a.off")
    assert (len(read.points), read.euler) == (len(body.points), 2)


def test_inside_out_files_are_turned_with_their_name(shapes, tmp_path):
    save(shapes.turn(shapes.box()), tmp_path / "knee.ply")
    with pytest.warns(GpubsplineWarning, match=r"knee\.ply is inside out: turned"):
        assert read_surface(tmp_path / "knee.ply").volume_mm3 == pytest.approx(24)


def test_negative_numbers_of_obj_count_from_the_last_vertex_so_far(shapes, tmp_path):
    """Vertices and faces in turn, as some exporters write each triangle."""
    box = shapes.box()
    lines = [f"v {x} {y} {z}\n" for x, y, z in box.corners.reshape(-1, 3)]
    faces = ["f -3/1 -2/2 -1/3\n"] * len(box.triangles)
    text = "".join("".join(lines[3 * n : 3 * n + 3]) + face for n, face in enumerate(faces))
    (tmp_path / "box.obj").write_text(text)
    back = read_surface(tmp_path / "box.obj")
    assert back.volume_mm3 == pytest.approx(24) and len(back.points) == 8


def test_a_body_of_micrometres_is_asked_about(shapes, tmp_path):
    save(shapes.box(size=(9e3, 1.2e4, 4e3)), tmp_path / "mouse.ply")
    with pytest.warns(GpubsplineWarning, match=r"mouse\.ply is 9e\+03 x 1\.2e\+04 x 4e\+03 mm: .* not micrometres\?"):
        read_surface(tmp_path / "mouse.ply")


def test_a_body_of_metres_is_asked_about(shapes, tmp_path):
    save(shapes.box(size=(0.07, 0.45, 0.1)), tmp_path / "femur.ply")
    with pytest.warns(GpubsplineWarning, match=r"femur\.ply is 0\.07 x 0\.45 x 0\.1 mm: .* not metres\?"):
        read_surface(tmp_path / "femur.ply")


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_files_of_something_else_are_one_line(extension, tmp_path, capfd):
    path = tmp_path / f"a{extension}"
    path.write_text("hello\n")
    with warnings.catch_warnings(), pytest.raises(InputError) as error:
        warnings.simplefilter("error")
        read_surface(path)
    assert path.name in str(error.value) and "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_other_names_are_refused(tmp_path):
    with pytest.raises(InputError, match="existing surface file"):
        read_surface(tmp_path / "none.ply")
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(InputError, match=r"expected a surface of \.stl"):
        read_surface(tmp_path / "a.txt")


def test_the_published_bone(data):
    bone = read_surface(data / "surfaces" / "bone.ply")
    assert (len(bone.points), bone.euler) == (6046, 2)  # one of its 6047 points is no triangle's
    assert bone.volume_mm3 == pytest.approx(29159, abs=1)  # its publishers' figure


@pytest.mark.parametrize("extension", [".ply", ".stl"])
def test_points_that_are_no_places_are_refused_with_their_neighbours(shapes, extension, tmp_path):
    body = shapes.box()
    points = body.points.copy()
    points[3, 1] = np.nan
    meshio.write_points_cells(tmp_path / f"a{extension}", points, [("triangle", body.triangles)])
    found = rf"finite coordinates in a{extension}, got NaN or infinity in \d of \d+ points, the first beside \(.*\) mm"
    with pytest.raises(InputError, match=found):
        read_surface(tmp_path / f"a{extension}")
    points[3] = body.points[3]
    points = np.concatenate([points, np.full((2, 3), np.nan)])  # of no triangle
    meshio.write_points_cells(tmp_path / "b.ply", points, [("triangle", body.triangles)])
    assert read_surface(tmp_path / "b.ply").volume_mm3 == pytest.approx(24)


def test_flat_sheets_are_refused(shapes, tmp_path):
    body = shapes.sphere(n=12)
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    save(Surface(body.points * [1, 1, 0] @ turned, body.triangles), tmp_path / "a.off")
    with pytest.raises(InputError, match=r"a\.off to enclose a volume, got a flat sheet of .* mm round \(.*\) mm"):
        read_surface(tmp_path / "a.off")


def test_of_what_is_refused_nothing_else_is_said(shapes, tmp_path):
    """A hole too large to be closed, beside triangles given twice and turned ones, which would be warned of."""
    box = shapes.box()
    faulty = np.concatenate([box.triangles[1:], box.triangles[5:6], box.triangles[7:8, ::-1]])
    save(Surface(box.points, faulty), tmp_path / "a.ply")
    with warnings.catch_warnings(), pytest.raises(InputError, match="edges that are open"):
        warnings.simplefilter("error")
        read_surface(tmp_path / "a.ply")
