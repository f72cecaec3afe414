import numpy as np
import pytest
from scenes import dome, silhouettes, turntable
from scipy.ndimage import gaussian_filter

from silmesh.settings.init import Init
from silmesh.shapes.alignment import align_to_box, choose_count, choose_report_count
from silmesh.shapes.initial import make_initial_mesh
from silmesh.shapes.sphere import unit_sphere


def box(size, left, top, right, bottom):
    """A silhouette whose first and last columns and rows are these."""
    silhouette = np.zeros((size, size), bool)
    silhouette[top : bottom + 1, left : right + 1] = True
    return silhouette


def test_the_reports_alignment_by_hand():
    # width 60, height 120 (last minus first), left 30, top 100, r 90:
    # x is scaled by 30/90 and moved by -((128 - 30) - 30)/90 = -68/90
    # y is scaled by 60/90 and moved by +((128 - 60) - 100)/90 = -32/90
    placed = align_to_box(np.array([[1.0, 1, 1], [0, 0, 0]]), box(256, 30, 100, 90, 220))
    np.testing.assert_allclose(placed, [[-38 / 90, 28 / 90, 1], [-68 / 90, -32 / 90, 0]])


def test_a_centred_box_of_180_pixels_leaves_the_sphere():
    verts = unit_sphere(12).vertices
    np.testing.assert_allclose(align_to_box(verts, box(256, 38, 38, 218, 218)), verts)


def test_pixels_are_those_of_256():
    # at 128: width 30, height 60, left 15, top 50 are 60, 120, 30, 100 at 256
    verts = unit_sphere(12).vertices
    np.testing.assert_allclose(
        align_to_box(verts, box(128, 15, 50, 45, 110)),
        align_to_box(verts, box(256, 30, 100, 90, 220)),
    )


def test_the_box_holds_every_piece():
    pieces = box(256, 30, 100, 40, 110) | box(256, 80, 200, 90, 220)
    verts = unit_sphere(12).vertices
    np.testing.assert_allclose(
        align_to_box(verts, pieces), align_to_box(verts, box(256, 30, 100, 90, 220))
    )


@pytest.mark.parametrize(
    ("radius", "count"),
    # a ball's surface is 4 pi radius^2; n vertices have 2 n - 4 even triangles of area
    # sqrt(3) / 4 * 5^2 = 10.8 square pixels: 642 to radius 33.2, 1,352 to 48.2
    [(10, 642), (32.5, 642), (34, 1352), (47.5, 1352), (49, 1922), (120, 1922)],
)
def test_auto_takes_the_fewest_vertices_with_edges_of_5_pixels(radius, count):
    rows, columns = np.indices((256, 256)) + 0.5
    disc = (rows - 128) ** 2 + (columns - 128) ** 2 < radius**2
    seen = np.stack([disc, disc])
    assert choose_report_count(seen) == count
    mesh = make_initial_mesh(Init(shape="sphere", align="none"), seen, turntable(2, 256)).mesh
    assert len(mesh.vertices) == count


def disc(radius):
    rows, columns = np.indices((256, 256)) + 0.5
    return (rows - 128) ** 2 + (columns - 128) ** 2 < radius**2


def test_any_count_has_edges_of_5_pixels():
    # a ball's surface is 4 pi 80^2 = 80,425 square pixels, in triangles of 10.83: 7,430 of these
    # are those of 7,430 / 2 + 2 = 3,717 vertices
    assert choose_count(disc(80)[None]) == pytest.approx(3717, rel=0.02)
    assert choose_count(disc(20)[None]) == 642  # and never fewer than the report's least


def test_richer_outlines_get_more_vertices():
    star = disc(80)
    star[:, 120:136] = False  # a slot splits it in two
    rich, plain = choose_count(star[None]), choose_count(disc(80)[None])
    assert rich > 1.5 * plain


def test_the_first_sphere_is_aligned_to_the_first_silhouette():
    views = np.stack([box(256, 30, 100, 90, 220), box(256, 0, 0, 9, 9)])
    cameras = turntable(2, 256)
    expected = align_to_box(unit_sphere(642).vertices, views[0])
    placed = make_initial_mesh(Init(shape="sphere", vertices=642), views, cameras).mesh
    np.testing.assert_allclose(placed.vertices, expected)
    plain = make_initial_mesh(Init(shape="sphere", vertices=642, align="none"), views, cameras).mesh
    np.testing.assert_allclose(plain.vertices, unit_sphere(642).vertices)


def test_noise_along_an_outline_is_no_detail():
    """A disc whose outline pixels are flipped at random needs no more vertices than the disc."""
    rows, columns = np.indices((128, 128)) - 63.5
    reach = np.hypot(rows, columns)
    disc = reach < 40
    flipped = np.random.default_rng(0).random(disc.shape) < 0.4
    noisy = disc ^ (flipped & (np.abs(reach - 40) < 1.5))
    plain = choose_count(disc[None])
    assert choose_count(noisy[None]) < 1.5 * plain


def test_a_star_is_detail():
    """Its outline is longer than that of its convex hull, and stays so when it is blurred."""
    rows, columns = np.indices((128, 128)) - 63.5
    angle = np.arctan2(rows, columns)
    star = np.hypot(rows, columns) < 40 + 15 * np.cos(6 * angle)
    disc = np.hypot(rows, columns) < np.sqrt(star.sum() / np.pi)
    assert choose_count(star[None]) > 1.5 * choose_count(disc[None])


@pytest.mark.parametrize("axes", [(0.35, 0.35, 0.35), (0.45, 0.08, 0.3)])
@pytest.mark.parametrize(("blur", "noise"), [(0, 0.3), (1, 0.1), (1.5, 0.2), (4, 0.1)])
def test_small_thresholded_photographs_get_no_more_vertices_than_sharp_ones(axes, blur, noise):
    """Noise of a sensor on soft and on sharp edges, in photographs of 128 pixels."""
    seen = silhouettes(dome(24, 128), axes)
    soft = [gaussian_filter(s.astype(float), blur) for s in seen]
    noisy = np.stack(soft) + np.random.default_rng(0).normal(0, noise, seen.shape) > 0.5
    assert choose_count(noisy) <= 1.05 * choose_count(seen)
