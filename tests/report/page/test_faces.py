"""What a page shows of a mesh: closed skins, whole surfaces, and the elements that they belong to."""

from collections.abc import Callable

import numpy as np
import pytest

from gpubspline.mesh.mesh import Mesh
from gpubspline.report.page import faces as page_faces
from gpubspline.report.page.faces import KEPT_BELOW, centroids, pairs, side_faces, surface_and_cuts

MakeBox = Callable[..., Mesh]


def explicit(mesh: Mesh) -> Mesh:
    return Mesh(mesh.points, mesh.element_type, connectivity=mesh.cells, fields=mesh.fields)


def bent(mesh: Mesh) -> Mesh:
    """The box, twisted, so that no plane runs along its layers."""
    x, y, z = mesh.points.T
    angle = 0.2 * z
    points = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z], axis=1)
    return Mesh(points, "hex8", structure=mesh.structure)


def test_neighbours_of_a_structure_are_those_of_its_cells(box: MakeBox) -> None:
    mesh = box((4, 3, 5))
    found = []
    for each in (mesh, explicit(mesh)):
        owner, side, other = pairs(each)
        corners = np.sort(side_faces(each, owner, side), axis=1).tolist()
        rows = zip(
            np.minimum(owner, other).tolist(), np.maximum(owner, other).tolist(), map(tuple, corners), strict=True
        )
        found.append(sorted(rows))
    assert found[0] == found[1]
    assert sum(low == -1 for low, _, _ in found[0]) == len(mesh.boundary())


@pytest.mark.parametrize("make", [lambda m: m, explicit])
def test_what_a_cut_leaves_is_closed_and_holds_the_kept_elements(make: Callable[[Mesh], Mesh], box: MakeBox) -> None:
    mesh = make(bent(box()))
    surface, cuts, said = surface_and_cuts(mesh)
    middle = centroids(mesh)
    assert "24 places" in said and len(cuts) == 72 and len(surface.owners) == len(mesh.boundary())
    for cut in cuts:
        kept = (middle[:, cut.axis] < cut.at_mm) == KEPT_BELOW[cut.axis]
        assert kept[cut.faces.owners].all() and 0 < kept.sum() < mesh.n_elements
        shown = np.concatenate([surface.nodes[kept[surface.owners]], cut.faces.nodes])
        inside = Mesh(mesh.points, "hex8", connectivity=mesh.cells[kept])
        assert sorted(map(sorted, shown.tolist())) == sorted(map(sorted, inside.boundary().tolist()))


def test_few_places_where_faces_are_many_and_a_thinned_surface(box: MakeBox, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = box((21, 21, 21), 1.0)
    monkeypatch.setattr(page_faces, "CUT_FACES", 12_000)
    monkeypatch.setattr(page_faces, "SURFACE_FACES", 800)
    surface, cuts, said = surface_and_cuts(mesh)
    assert sum(len(cut.faces.owners) for cut in cuts) <= 12_000 and len(cuts) == 3 * 10
    assert "thinned from 2,400 to" in said and 200 < len(surface.owners) <= 800
    corners = mesh.points[surface.nodes]
    area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1).sum() / 2
    assert area == pytest.approx(6 * 400, rel=0.15)  # it still covers the box
    assert np.ptp(corners.reshape(-1, 3), axis=0).min() >= 18
