"""Row spans against analytic shapes, wherever the image lies; quality on a real head."""

from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from scipy import ndimage
from scipy.interpolate import BSpline

from gpubspline.ct.phantom import phantom
from gpubspline.ct.region import Region, otsu_threshold, region_from_threshold
from gpubspline.ct.volume import Volume
from gpubspline.errors import InputError
from gpubspline.spline import lattice as lattice_module
from gpubspline.spline.lattice import ControlLattice, control_lattice, data_shape, default_shape, sample_hu
from gpubspline.spline.reformat import stack
from gpubspline.spline.spans import blend, fill_gaps, inset, row_spans, tips

SHAPE = (40, 44, 48)  # i, j, k
CENTRE = np.array([19.3, 21.6, 23.4])
SEMI_AXES = np.array([12.3, 15.7, 18.2])  # of an ellipsoid, in voxels
GRADIENT, OFFSET = np.array([3.0, -2.0, 1.5]), 40.0  # of a linear HU field, per mm


def turn(axis: tuple[float, float, float], degrees: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def affine_of(edges: np.ndarray) -> np.ndarray:
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = edges, (-31.0, 12.0, 407.0)
    return affine


SPACING = np.diag([0.7, 0.9, 1.6])
AFFINES = {
    "axial": affine_of(SPACING),
    "oblique": affine_of(turn((1, 2, 3), 35) @ SPACING),
    "left-handed": affine_of(turn((1, 2, 3), 35) @ SPACING @ np.diag([1, 1, -1])),
    "sheared": affine_of(SPACING + np.array([[0, 0, 0], [0, 0, 0.5], [0, 0, 0]])),
}


def index_grid(shape: tuple[int, int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).transpose(2, 1, 0, 3)


def scene(affine: np.ndarray, level: np.ndarray) -> tuple[Volume, Region]:
    """A region given by its distance, in a volume whose HU is linear in patient space."""
    indices = index_grid(level.shape[::-1])
    points = indices @ affine[:3, :3].T + affine[:3, 3]
    hu = (points @ GRADIENT + OFFSET).astype(np.float32)
    return Volume(hu, affine), Region(level < 0, level.astype(np.float32), affine)


def reach(indices: np.ndarray) -> np.ndarray:
    return np.linalg.norm((indices - CENTRE) / SEMI_AXES, axis=-1)


def ellipsoid(affine: np.ndarray) -> tuple[Volume, Region]:
    return scene(affine, (reach(index_grid(SHAPE)) - 1) * SEMI_AXES.min())


@pytest.mark.parametrize("name", AFFINES)
def test_row_ends_lie_on_the_ellipsoid_and_points_evenly_between_them(name: str) -> None:
    volume, region = ellipsoid(AFFINES[name])
    points = control_lattice(volume, region, (9, 15, 17), smoothing=0).points
    indices = volume.to_indices(points[..., :3])
    # linear crossing of a curved distance between voxels: a few hundredths of the semi-axes in voxels
    np.testing.assert_allclose(reach(indices[[0, -1]]), 1, atol=0.012)
    np.testing.assert_allclose(np.diff(points[..., :3], 2, axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(indices[..., 1], axis=0), 0, atol=1e-9)  # rows stay rows
    np.testing.assert_allclose(np.diff(indices[0, :, :, 1], 2, axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(indices[..., 2], axis=(0, 1)), 0, atol=1e-9)  # slices stay slices
    assert (np.diff(indices[..., 0], axis=0) > 0).all()
    assert (np.diff(indices[..., 1], axis=1) > 0).all()
    assert (np.diff(indices[..., 2], axis=2) > 0).all()


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("axis", ["x", "y", "z", "long"])
def test_linear_hu_is_reproduced_at_the_lattice_points(axis: str, interpolation: str) -> None:
    volume, region = ellipsoid(AFFINES["sheared"])
    how = {"interpolation": interpolation, "partial_volume": "none"}  # what is folded in at the surface is not linear
    points = control_lattice(volume, region, (7, 8, 9), axis=axis, **how).points
    tolerance = 2e-5 if interpolation == "linear" else 1e-2  # float32 samples; the cubic's mirrored border
    np.testing.assert_allclose(points[..., 3], points[..., :3] @ GRADIENT + OFFSET, rtol=tolerance, atol=tolerance)


def test_hu_agrees_with_scipy() -> None:
    volume, region = ellipsoid(AFFINES["oblique"])
    rough = Volume(np.random.default_rng(1).normal(300, 90, volume.hu.shape).astype(np.float32), volume.affine)
    for interpolation, order in (("linear", 1), ("cubic", 3)):
        how = {"interpolation": interpolation, "partial_volume": "none"}
        points = control_lattice(rough, region, (8, 9, 10), **how).points
        where = rough.to_indices(points[..., :3])[..., ::-1].transpose(3, 0, 1, 2)
        expected = ndimage.map_coordinates(rough.hu, where, np.float64, order=order, mode="nearest")
        np.testing.assert_allclose(points[..., 3], expected, atol=0.05)  # float32 prefilter of the oracle


def test_ends_lie_one_per_cent_inside_the_tips() -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    indices = volume.to_indices(control_lattice(volume, region, (5, 9, 11), smoothing=0).points[..., :3])
    low, high = indices[0, 0, :, 2][[0, -1]]
    extent = 2 * SEMI_AXES[2]
    assert low - (CENTRE[2] - SEMI_AXES[2]) == pytest.approx(0.01 * extent, abs=0.1)
    assert (CENTRE[2] + SEMI_AXES[2]) - high == pytest.approx(0.01 * extent, abs=0.1)
    assert (indices[-1, :, :, 0] - indices[0, :, :, 0]).min() > 0


def test_ends_lie_on_the_border_where_the_scan_cuts_the_region() -> None:
    level = np.abs(index_grid((20, 30, 12))[..., 0] - 9.5) - 6.25  # a slab through all rows and slices
    volume, region = scene(AFFINES["axial"], level)
    indices = volume.to_indices(control_lattice(volume, region, (4, 5, 6)).points[..., :3])
    np.testing.assert_allclose(indices[0, 0, 0], [3.25, 0, 0], atol=1e-6)
    np.testing.assert_allclose(indices[-1, -1, -1], [15.75, 29, 11], atol=1e-6)


def test_slices_and_rows_that_miss_are_left_out_and_gaps_take_their_neighbours_spans() -> None:
    level = np.full((8, 21, 20), 1.0)
    level[2:6, 4:8, 5:13] = -1.0
    level[2:6, 13:17, 5:13] = -1.0  # rows 8 to 12 miss
    volume, region = scene(AFFINES["axial"], level)
    indices = volume.to_indices(control_lattice(volume, region, (4, 12, 4), smoothing=0).points[..., :3])
    assert indices[0, 0, 0, 2] > 1.5
    assert indices[0, 0, -1, 2] < 5.5
    assert indices[..., 1].min() > 3.5
    assert indices[..., 1].max() < 16.5
    assert ((indices[0, :, 0, 1] > 8.5) & (indices[0, :, 0, 1] < 11.5)).any()  # some rows lie in the gap
    # 8 voxels where whole voxels lie, 7 at the tips of the blended slices and rows, never longer and never none
    np.testing.assert_allclose(indices[-1, :, :, 0] - indices[0, :, :, 0], 7.5, atol=0.51)


def test_axes_agree_when_the_volume_is_permuted() -> None:
    volume, region = ellipsoid(AFFINES["oblique"])
    straight = control_lattice(volume, region, (6, 7, 8), axis="z").points
    for axis, order in (("x", (1, 2, 0)), ("y", (2, 0, 1))):  # i, j, k of the old become `order`'s of the new
        inverse = np.argsort(order)
        source = [2 - int(inverse[2 - a]) for a in range(3)]
        affine = volume.affine.copy()
        affine[:3, :3] = volume.affine[:3, inverse]
        moved = Volume(np.transpose(volume.hu, source), affine)
        turned = Region(moved.hu > -np.inf, np.transpose(region.distance_mm, source), affine)
        np.testing.assert_allclose(control_lattice(moved, turned, (6, 7, 8), axis=axis).points, straight, atol=1e-4)


def test_stack_spells_out_axes_in_cyclic_order() -> None:
    _, region = ellipsoid(AFFINES["axial"])
    for axis, columns in (("x", [1, 2, 0]), ("y", [2, 0, 1]), ("z", [0, 1, 2])):
        np.testing.assert_array_equal(stack(region, axis).affine[:3, :3], region.affine[:3, columns])


@pytest.mark.parametrize("handed", [1, -1])
def test_long_axis_of_a_turned_ellipsoid(handed: int) -> None:
    affine = affine_of(np.diag([1.0, 1.0, 1.5 * handed]))
    axes = turn((1.0, -0.6, 0.2), 38)
    semi_axes = np.array([9.0, 11.0, 21.0])
    points = index_grid((50, 60, 40)) @ affine[:3, :3].T + affine[:3, 3]
    centre = points.reshape(-1, 3).mean(axis=0)

    def level(at: np.ndarray) -> np.ndarray:
        return (np.linalg.norm((at - centre) @ axes / semi_axes, axis=-1) - 1) * semi_axes.min()

    volume, region = scene(affine, level(points))
    lattice = control_lattice(volume, region, (8, 11, 13), axis="long", smoothing=0).points
    w = lattice[0, 0, -1, :3] - lattice[0, 0, 0, :3]
    across = stack(region, "long").affine[:3, 2]
    assert abs(across @ axes[:, 2]) / np.linalg.norm(across) > np.cos(np.radians(1))
    assert np.linalg.norm(w @ axes[:, 2]) == pytest.approx(2 * 21 * 0.98, rel=0.03)
    # twice interpolated from 1.5 mm slices: within a quarter of a millimetre of the surface
    np.testing.assert_allclose(level(lattice[[0, -1]][..., :3]), 0, atol=0.25)
    sides = np.linalg.det(stack(region, "long").affine[:3, :3])
    assert sides > 0


def test_long_axis_stops_where_the_scan_does() -> None:
    points = index_grid((30, 30, 60)) - np.array([14.5, 14.5, 0])
    axis = np.array([0.15, 0, 1]) / np.hypot(0.15, 1)
    level = np.linalg.norm(np.cross(points - np.array([-4.0, 0, 0]), axis), axis=-1) - 6
    volume, region = scene(np.eye(4), level)
    k = volume.to_indices(control_lattice(volume, region, (6, 7, 12), axis="long").points[..., :3])[..., 2]
    assert k.min() > -0.5  # half a sample of the turned grid
    assert k.max() < 59.5


def test_one_slice_gives_a_surface_in_its_plane() -> None:
    volume, region = ellipsoid(AFFINES["sheared"])
    lattice = control_lattice(volume, region, (11, 13), slice_index=25, smoothing=0)
    assert lattice.shape == (11, 13)
    indices = volume.to_indices(lattice.points[..., :3])
    np.testing.assert_allclose(indices[..., 2], 25, atol=1e-9)
    np.testing.assert_allclose(reach(indices[[0, -1]]), 1, atol=0.012)
    flat = Volume(volume.hu[25:26], volume.affine)
    alone = Region(region.mask[25:26], region.distance_mm[25:26], volume.affine)
    assert control_lattice(flat, alone, (11, 13)).shape == (11, 13)


def test_points_are_planes_with_u_fastest() -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    lattice = control_lattice(volume, region, (5, 6, 7))
    assert lattice.points.flags.f_contiguous
    assert lattice.points.dtype == np.float64
    assert lattice.shape == (5, 6, 7)
    assert lattice.channels == ("HU",)
    with pytest.raises(InputError, match="expected control points of shape"):
        ControlLattice(np.zeros((5, 6, 7, 3)))


def test_smoothing_takes_a_spike_and_leaves_straight_sides() -> None:
    level = np.abs(index_grid((40, 31, 12))[..., 0] - 19.5) - 8.25
    level[:, 15, 27:36] = -1.0  # one row sticks out on one side
    volume, region = scene(AFFINES["axial"], level)
    ends = [
        volume.to_indices(control_lattice(volume, region, (4, 31, 12), smoothing=sigma).points[-1, ..., :3])[..., 0]
        for sigma in (0.0, 1.0)
    ]
    assert ends[0][15, 6] > 35
    assert 27.75 < ends[1][15, 6] < 32
    np.testing.assert_allclose(ends[1][:8], 27.75, atol=1e-6)


def test_default_shape_never_exceeds_the_data() -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    for axis in ("x", "y", "z", "long"):
        shape = default_shape(region, axis)
        assert all(2 <= n <= most for n, most in zip(shape, (20, 24, 46), strict=True))
        assert control_lattice(volume, region, shape, axis=axis).shape == shape
    assert default_shape(region, "z") == (20, 24, 36)  # slices 5.2 to 41.6 hit
    for index in (6, 23):
        shape = default_shape(region, "z", index)
        assert control_lattice(volume, region, shape, slice_index=index).shape == shape


def test_data_shape_is_what_the_data_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    assert data_shape(region) == (24, 32, 36)
    assert control_lattice(volume, region, data_shape(region)).shape == (24, 32, 36)
    assert data_shape(region, "z", 23) == (24, 32)
    monkeypatch.setattr(lattice_module, "LARGEST_DATA", 24 * 32 * 36 / 8)
    assert data_shape(region) == (12, 16, 18)
    monkeypatch.setattr(lattice_module, "LARGEST_DATA", 12)  # a thin slab of many samples keeps its two
    assert data_shape(region) == (2, 2, 2)


@pytest.mark.parametrize("turned", [1, -1])
@pytest.mark.parametrize("name", AFFINES)
def test_the_long_axis_runs_the_way_of_the_images_own(name: str, turned: int) -> None:
    """Slices go from the first of the image to its last, whichever of its two ways an eigenvector points."""
    affine = AFFINES[name].copy()
    affine[:3, :3] = affine[:3, :3] @ np.diag([1, 1, turned])
    volume, region = ellipsoid(affine)
    indices = volume.to_indices(control_lattice(volume, region, (3, 4, 5), axis="long").points[..., :3])
    assert (np.diff(indices[..., 2], axis=2) > 0).all()


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_hu_of_points_outside_are_those_of_the_nearest_place(interpolation: str) -> None:
    """Of points that all lie beyond one end, too: none of the volume is around them."""
    hu = np.random.default_rng(0).normal(size=(7, 8, 9))
    volume = Volume(hu.astype(np.float32), np.eye(4))
    for outside, nearest in (((99, 3, 2), (8, 3, 2)), ((-99, 3, 2), (0, 3, 2)), ((4, 7, 99), (4, 7, 6))):
        found = sample_hu(volume, np.array([outside, outside], dtype=float), interpolation)
        np.testing.assert_allclose(found, hu[nearest[::-1]], rtol=1e-6)


@pytest.mark.parametrize(
    ("shape", "options", "message"),
    [
        ((8, 8, 8), {"axis": "w"}, "expected the stacking axis x, y, z, long, got 'w'"),
        ((8, 8, 8), {"interpolation": "nearest"}, "expected the interpolation linear or cubic, got 'nearest'"),
        ((8, 8, 1), {}, "at least 2 control points a direction, got 8,8,1"),
        ((8,), {}, "expected 2 or 3 control counts, got 1"),
        ((8, 8, 38), {}, "expected at most 24,32,36 control points.* got 8,8,38"),
        ((8, 33, 8), {}, "expected at most 24,32,36 control points.* got 8,33,8"),
        ((26, 8, 8), {}, "expected at most 24,32,36 control points.* got 26,8,8"),
        ((8, 8, 8), {"slice_index": 20}, "expected two control counts for one slice"),
        ((8, 8), {}, "expected a slice of the 48 along z for two control counts, got none"),
        ((8, 8), {"slice_index": 48}, "expected a slice of 0 to 47 along z, got 48"),
        ((8, 8), {"slice_index": 3}, r"expected a slice that hits the region \(6 to 41 along z\), got 3"),
        ((8, 8), {"slice_index": 3, "axis": "long"}, "expected the axis x, y or z for one slice, got long"),
    ],
)
def test_what_the_data_do_not_allow_is_one_line(shape: tuple[int, ...], options: dict, message: str) -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    with pytest.raises(InputError, match=message) as caught:
        control_lattice(volume, region, shape, **options)
    assert "\n" not in str(caught.value)


def test_one_slice_is_no_solid() -> None:
    volume, region = ellipsoid(AFFINES["axial"])
    flat = Volume(volume.hu[25:26], volume.affine)
    alone = Region(region.mask[25:26], region.distance_mm[25:26], volume.affine)
    with pytest.raises(InputError, match="several slices along z for a solid, got one: ask for a surface"):
        control_lattice(flat, alone, (8, 8, 8))
    distance = np.where(np.arange(48)[:, None, None] == 25, region.distance_mm, 5.0).astype(np.float32)
    with pytest.raises(InputError, match="a region of several slices for a solid, got one slice"):
        control_lattice(volume, Region(distance < 0, distance, volume.affine), (8, 8, 8))
    with pytest.raises(InputError, match="expected a region on the volume's grid"):
        control_lattice(flat, region, (8, 8, 8))


def test_ends_are_smoothed_by_two_thirds_as_many_slices_as_rows() -> None:
    spike = np.zeros((31, 41))
    spike[15, 20] = 1.0
    (found,) = lattice_module._smooth([spike], 3.0)
    away = np.indices(spike.shape) - np.array([15, 20])[:, None, None]
    np.testing.assert_allclose(np.sqrt((found * away**2).sum(axis=(1, 2))), [2.0, 3.0], rtol=0.01)


def test_ends_are_drawn_in_by_a_voxel_at_most() -> None:
    """One per cent of the extent, where that is less; nothing where the grid's end cuts."""
    low, high = inset(np.array([5.0, 5.0, 0.0]), np.array([55.0, 305.0, 400.0]), 400, 0.01)
    np.testing.assert_allclose(low, [5.5, 6.0, 0.0])
    np.testing.assert_allclose(high, [54.5, 304.0, 400.0])


def test_spans_tips_and_gaps_of_small_rows() -> None:
    rows = np.array([[3.0, -1, -1, 1], [-2, 1, -1, -1], [1, 2, 3, 4]], np.float32)
    enter, leave = row_spans(rows)
    np.testing.assert_allclose(enter, [0.75, 0, np.nan])
    np.testing.assert_allclose(leave, [2.5, 3, np.nan])
    first, final = tips(rows[None])
    assert first[0] == 0  # the grid cuts the first row
    # the blend of rows 1 and 2 is inside at sample 0 until -2 (1 - t) + t = 0
    assert final[0] == pytest.approx(1 + 2 / 3, abs=1e-6)
    np.testing.assert_allclose(blend(rows, np.array([0.5]), 0)[0], [0.5, 0, -1, 0])
    gap = np.nan
    np.testing.assert_allclose(fill_gaps(np.array([[gap, 1, gap, 3], [gap] * 4, [5.0, 5, 5, 5]]))[1], [3, 3, 3.5, 4])


# quality on real data: the patch by scipy, the scaled Jacobian by numpy


def basis(count: int, samples: int) -> np.ndarray:
    knots = np.r_[np.zeros(3), np.linspace(0, 1, count - 2), np.ones(3)]
    return np.asarray(BSpline.design_matrix(np.linspace(0, 1, samples), knots, 3).todense())


def sampled(points: np.ndarray, nodes: tuple[int, ...]) -> np.ndarray:
    for axis, count in enumerate(nodes):
        points = np.moveaxis(np.tensordot(basis(points.shape[axis], count), points, (1, axis)), 0, axis)
    return points


def scaled_jacobian(nodes: np.ndarray) -> np.ndarray:
    """Least determinant of unit edges over the corners, of quads in a plane of constant z or of hexes."""
    directions = nodes.ndim - 1
    nodes = nodes[..., :directions]
    least = np.inf
    for corner in np.ndindex(*(2,) * directions):
        edges = []
        for axis in range(directions):
            ends = []
            for side in (0, 1):
                at = [*corner[:axis], side, *corner[axis + 1 :]]
                ends.append(nodes[tuple(slice(a, a + n - 1) for a, n in zip(at, nodes.shape, strict=False))])
            edge = ends[1] - ends[0]
            edges.append(edge / np.linalg.norm(edge, axis=-1, keepdims=True))
        least = np.minimum(least, np.linalg.det(np.stack(edges, axis=-1)))
    return least


@pytest.fixture(scope="module")
def real_head(data: Path) -> tuple[Volume, Region]:
    image = sitk.ReadImage(str(data / "head" / "ct_example.nii.gz"))
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    volume = Volume(sitk.GetArrayFromImage(image).astype(np.float32), affine)
    return volume, region_from_threshold(volume, -200.0)


def test_real_head_gives_good_hexes(real_head: tuple[Volume, Region]) -> None:
    quality = scaled_jacobian(sampled(control_lattice(*real_head, (20, 80, 26)).points, (20, 80, 28)))
    assert quality.size == 40527
    assert quality.min() > 0.1
    assert (quality > 0.5).mean() >= 0.97


@pytest.mark.parametrize("index", [0, 5, 9, 13, 25])
def test_real_head_slices_give_good_quads(real_head: tuple[Volume, Region], index: int) -> None:
    shape = default_shape(real_head[1], "z", index)
    quality = scaled_jacobian(sampled(control_lattice(*real_head, shape, slice_index=index).points, (140, 140)))
    assert quality.size == 19321
    assert quality.min() > 0.2
    assert (quality > 0.5).mean() >= 0.97


PAPER = {  # samples (Figs. 4 and 5): least share above 0.5, most below 0.1 (Figs. 6 to 9), where the paper gives them
    "child-femur": [((11, 18, 34), 0.76, 0.105)],
    "adult-femur": [((14, 24, 46), 0.88, 0.02), ((10, 10, 30), 0, 1), ((14, 26, 46), 0, 1), ((20, 20, 50), 0, 1)],
    "head": [((20, 80, 28), 0.91, 0.02)],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PAPER)
def test_the_papers_figures_are_met_on_the_phantoms(name: str) -> None:
    volume = phantom(name).scan()
    threshold = -200.0 if name == "head" else 300.0
    for hu in (threshold, otsu_threshold(volume)):
        region = region_from_threshold(volume, hu)
        for nodes, good, poor in PAPER[name]:
            for control in (nodes, default_shape(region)):
                quality = scaled_jacobian(sampled(control_lattice(volume, region, control).points, nodes))
                assert quality.min() > 0.02
                assert (quality > 0.5).mean() >= good
                assert (quality < 0.1).mean() <= poor


@pytest.mark.slow
def test_the_papers_head_slices_are_met_on_the_phantom() -> None:
    volume = phantom("head").scan()
    region = region_from_threshold(volume, -200.0)
    for index in range(0, 55, 6):
        lattice = control_lattice(volume, region, default_shape(region, "z", index), slice_index=index)
        for nodes in ((140, 140), (40, 70)):
            quality = scaled_jacobian(sampled(lattice.points, nodes))
            assert quality.min() > 0.3
            assert (quality > 0.5).mean() >= 0.95
