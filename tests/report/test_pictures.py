"""The pictures: drawn where the cameras say, against projections and known shapes."""

import numpy as np
import pytest
import torch
import trimesh
from drawing import render_colours
from PIL import Image

from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.textured_mesh import texture_mesh
from silmesh.report.pictures import (
    CELL,
    FINE,
    GROUND,
    MESH,
    SILHOUETTE,
    Camera,
    camera_of,
    crop_thumbnail,
    draw_edges,
    draw_outlines,
    draw_picture,
    frame,
    paint,
    quarter_turn,
    raised,
    shade,
    trace,
)


@pytest.fixture
def cameras():
    return turntable_cameras([f"r{i}" for i in range(12)], 96, 2.732, 20.0, 30.0)


@pytest.fixture
def mesh():
    """A lopsided body, so that no mirror image of it could pass for it."""
    ball = trimesh.creation.icosphere(3, 0.25)
    knob = trimesh.creation.icosphere(2, 0.1)
    knob.apply_translation([0.3, 0.15, 0.1])
    return trimesh.util.concatenate(ball, knob)


def test_a_sphere_shows_where_the_camera_projects_it(cameras):
    centre = np.array([0.12, -0.2, 0.05])
    ball = trimesh.creation.icosphere(4, 0.2)
    ball.apply_translation(centre)
    for i in (0, 2):
        rows, columns = np.nonzero(trace(ball, camera_of(cameras, i)).mask)
        expected = cameras.project(torch.tensor(centre[None]))[i, 0].numpy()
        seen = np.array([columns.mean(), rows.mean()]) + 0.5
        # An off-centre sphere's outline is an ellipse whose middle lies a little further out.
        np.testing.assert_allclose(seen, expected, atol=0.6)
        depth = float(cameras.depths(torch.tensor(centre[None]))[i, 0])
        radius = float(cameras.K[i, 0, 0]) * 0.2 / depth
        assert len(rows) == pytest.approx(np.pi * radius**2, rel=0.04)


def test_sees_the_faces_that_the_renderer_draws(cameras, mesh):
    """Against the projection of the whole mesh by another method, nearest face by nearest face."""
    verts = torch.tensor(mesh.vertices, dtype=torch.float64)
    faces = torch.tensor(mesh.faces)
    one = cameras.select([1])
    names = torch.arange(len(faces), dtype=torch.float64) + 1
    colours = names[:, None, None].expand(-1, 3, 3)
    drawn = render_colours(
        one.project(verts), one.depths(verts), faces, colours, (96, 96), background=(0, 0, 0)
    )
    drawn = drawn[0, 0].round().long().numpy() - 1  # the number of the face, -1 for none
    hits = trace(mesh, camera_of(one, 0))
    seen = np.full((96, 96), -1)
    seen[hits.mask] = hits.faces
    assert (seen != drawn).mean() < 1e-3
    assert (seen >= 0).mean() > 0.05


def test_weights_give_back_the_pixel(cameras, mesh):
    camera = camera_of(cameras, 4)
    hits = trace(mesh, camera)
    points = np.einsum("ni,nij->nj", hits.weights, mesh.triangles[hits.faces])
    projected = cameras.project(torch.tensor(points))[4].numpy()
    np.testing.assert_allclose(projected, np.argwhere(hits.mask)[:, ::-1] + 0.5, atol=1e-3)
    assert (hits.weights > -1e-3).all()


def test_a_crop_shows_the_same_larger(cameras):
    camera = camera_of(cameras, 0)
    cropped = camera.cropped(10, 20, 32, 96)
    origin, rays = camera.rays()
    same, larger = cropped.rays()
    np.testing.assert_allclose(same, origin)
    # pixel (row 1, column 1) of the crop is (10 + 1.5 / 3, 20 + 1.5 / 3), a pixel's centre
    np.testing.assert_allclose(larger[1, 1], rays[20, 10], atol=1e-12)


def test_the_second_view_is_a_quarter_turn_on(cameras):
    assert quarter_turn(turntable_cameras(["a", "b", "c"], 96, 2.0, 0.0, 40.0)) == 2  # 80 degrees
    flat = turntable_cameras([f"r{i}" for i in range(8)], 96, 2.0, 0.0, 45.0)
    assert quarter_turn(flat) in (2, 6)


def test_from_above_the_top_comes_nearer_and_all_is_in_the_picture(cameras, mesh):
    camera = camera_of(cameras, 0)
    above = raised(camera, mesh)
    up = -camera.R[1]  # what is up in the picture
    assert above.R[2] @ up < camera.R[2] @ up - 0.3  # looks further down
    assert np.linalg.norm(above.R @ mesh.bounds.mean(0) + above.t) == pytest.approx(
        np.linalg.norm(camera.R @ mesh.bounds.mean(0) + camera.t)
    )
    mask = trace(mesh, above).mask
    assert not mask[[0, -1]].any()
    assert not mask[:, [0, -1]].any()
    assert np.ptp(np.nonzero(mask), axis=1).max() > 0.8 * len(mask)


def test_a_surface_turned_inside_out_is_red(cameras):
    ball = trimesh.creation.icosphere(3, 0.3)
    camera = camera_of(cameras, 0)
    hits = trace(ball, camera)
    outside = shade(ball, camera, hits, smooth=True)[hits.mask]
    assert np.ptp(outside.mean(axis=0)) < 0.08  # grey
    assert outside.std() > 0.05  # with light and shade
    ball = trimesh.Trimesh(ball.vertices, ball.faces[:, ::-1], process=False)
    hits = trace(ball, camera)
    inside = shade(ball, camera, hits, smooth=True)[hits.mask]
    assert (inside[:, 0] > 1.5 * inside[:, 1]).all()


def test_the_light_falls_from_the_upper_left(cameras):
    ball = trimesh.creation.icosphere(3, 0.3)
    camera = camera_of(cameras, 0)
    image = shade(ball, camera, trace(ball, camera), smooth=True).mean(axis=2)
    assert image[38, 38] > image[58, 58] + 0.1


def test_edges_are_dark_only_near_edges():
    """One triangle that faces the camera: its middle keeps its colour, its rim darkens."""
    camera = Camera(
        np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), np.eye(3), np.zeros(3), 100
    )
    corners = [[-0.4, -0.4, 1], [0.4, -0.4, 1], [-0.4, 0.4, 1]]  # pixels (10, 10) (90, 10) (10, 90)
    mesh = trimesh.Trimesh(corners, [[0, 2, 1]], process=False)
    hits = trace(mesh, camera)
    image = np.ones((100, 100, 3))
    draw_edges(image, mesh, camera, hits, width=2)
    assert (image[20, 10] < 0.8).all()  # half a pixel from the left edge
    assert (image[10, 20] < 0.8).all()
    assert (image[49, 49] < 0.8).all()  # on the long edge
    assert (image[30, 30] == 1).all()
    assert (image[70, 70] == 1).all()  # nothing is seen there


def test_the_outline_of_a_square_is_drawn_where_the_square_ends():
    mask = np.zeros((20, 20), bool)
    mask[5:15, 4:12] = True  # from x = 4 to 12 and y = 5 to 15
    image = Image.new("RGB", (400, 400), (255, 255, 255))
    draw_outlines(image, mask, 20.0, (0, 0), SILHOUETTE)
    pixels = np.asarray(image)
    drawn = (pixels == SILHOUETTE).all(axis=2)
    rows, columns = np.nonzero(drawn)
    reach = 2 * FINE
    assert columns.min() == pytest.approx(4 * 20, abs=reach)
    assert columns.max() == pytest.approx(12 * 20, abs=reach)
    assert rows.min() == pytest.approx(5 * 20, abs=reach)
    assert rows.max() == pytest.approx(15 * 20, abs=reach)
    assert not drawn[5 * 20 + 20 : 15 * 20 - 20, 4 * 20 + 20 : 12 * 20 - 20].any()


def test_the_frame_is_a_square_about_the_silhouette_within_the_image():
    mask = np.zeros((100, 100), bool)
    mask[40:60, 45:55] = True
    left, top, side = frame(mask)
    assert side == pytest.approx(20 * 1.28)
    assert (left + side / 2, top + side / 2) == pytest.approx((50, 50))
    mask[:] = False
    mask[0:20, 90:100] = True
    left, top, side = frame(mask)
    assert (top, left + side) == pytest.approx((0, 100))
    assert frame(np.ones((100, 100), bool)) == (0, 0, 100)


def test_the_picture_of_a_perfect_fit(cameras, mesh, tmp_path):
    shown = cameras.select([0, 3])
    masks = np.stack([trace(mesh, camera_of(shown, i)).mask for i in range(2)])
    photographs = [tmp_path / f"{view}.png" for view in shown.views]
    for mask, path in zip(masks, photographs, strict=True):
        Image.fromarray(np.where(mask[..., None], (200, 30, 30), (0, 0, 90)).astype("u1")).save(
            path
        )
    picture = draw_picture(mesh, shown, photographs, masks)
    assert picture.tobytes() == draw_picture(mesh, shown, photographs, masks).tobytes()
    thumbnail = np.asarray(crop_thumbnail(picture)).astype(int)
    assert thumbnail.shape == (CELL, CELL, 3)
    # The shaded mesh covers in its cell what the silhouette covers in the frame of its image.
    left, top, side = frame(masks[0])
    seen = np.abs(thumbnail - GROUND).max(axis=2) > 6
    centres = (np.argwhere(seen) + 0.5) * side / CELL + (top, left)
    inside = masks[0][tuple(centres.astype(int).T)]
    assert inside.mean() > 0.95
    assert seen.mean() == pytest.approx(masks[0].sum() / side**2, rel=0.05)
    colours = {tuple(c) for c in np.asarray(picture).reshape(-1, 3).tolist()}
    assert MESH in colours
    assert SILHOUETTE in colours


def test_colours_are_mixed_between_the_corners(cameras):
    """A triangle before the camera, red, green and blue at its corners."""
    camera = camera_of(cameras, 0)
    right, up = camera.R[0], -camera.R[1]
    verts = np.stack([-0.3 * right, 0.3 * right, 0.4 * up])
    colours = 255 * np.eye(3, dtype=np.uint8)
    flat = trimesh.Trimesh(verts, [[0, 1, 2]], vertex_colors=colours, process=False)
    hits = trace(flat, camera)
    image = paint(flat, hits)
    np.testing.assert_allclose(
        image[~hits.mask], np.tile(np.array(GROUND) / 255, [(~hits.mask).sum(), 1])
    )
    np.testing.assert_allclose(image[hits.mask], hits.weights, atol=1e-9)


def test_a_texture_is_painted_where_its_coordinates_say(cameras):
    """A triangle before the camera; its texture grows redder rightwards and greener upwards."""
    camera = camera_of(cameras, 0)
    right, up = camera.R[0], -camera.R[1]
    verts = np.stack([-0.3 * right, 0.3 * right, 0.4 * up])
    uv = np.array([[0.1, 0.2], [0.9, 0.2], [0.5, 0.8]])
    row, column = np.mgrid[:128, :128] + 0.5
    image = np.stack([2 * column, 256 - 2 * row, 0 * row], axis=-1).round().astype(np.uint8)
    flat = texture_mesh(verts, np.array([[0, 1, 2]]), uv, image)
    hits = trace(flat, camera)
    painted = paint(flat, hits)[hits.mask]
    expected = np.pad(hits.weights @ uv, [(0, 0), (0, 1)])
    np.testing.assert_allclose(painted, expected, atol=1.5 / 255)
