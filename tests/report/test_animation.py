"""The turning mesh: what is seen in which picture, and films that can be read back."""

import av
import numpy as np
import pytest
import trimesh
from PIL import Image

from silmesh.report.animation import SIDE, draw_turn, write_gif, write_mp4
from silmesh.report.pictures import GROUND

UP, AHEAD = np.array([0.0, 1, 0]), np.array([0.0, 0, -1])


@pytest.fixture(scope="module")
def turn():
    """A long box, far from the origin, red on the side towards +z and blue elsewhere."""
    mesh = trimesh.creation.box((0.9, 0.3, 0.3))
    mesh.apply_translation([5, 1, 2])
    red = mesh.face_normals[:, 2] > 0.9
    mesh = trimesh.Trimesh(
        mesh.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    mesh.visual.vertex_colors = np.repeat(
        np.where(red[:, None], (255, 0, 0), (0, 0, 255)), 3, axis=0
    )
    return draw_turn(mesh, UP, AHEAD, 8)


def measure(picture):
    """How wide the mesh is drawn, and how much of it is red."""
    pixels = np.asarray(picture, int)
    mesh = np.abs(pixels - GROUND).max(axis=2) > 40
    columns = np.flatnonzero(mesh.any(axis=0))
    assert 0 < columns.min() <= columns.max() < SIDE - 1  # never cut
    return np.ptp(columns), (pixels[..., 0] > pixels[..., 2])[mesh].mean()


def test_the_first_picture_looks_ahead_and_the_scale_stays(turn):
    widths, reds = zip(*map(measure, turn), strict=True)
    assert reds[0] > 0.5 > max(reds[3:6])
    assert np.argmin(widths) in (2, 6)  # a quarter turn on, its short side
    assert widths[2] == pytest.approx(widths[0] / 3, rel=0.25)
    assert widths[4] == pytest.approx(widths[0], abs=2)
    # The camera goes to the side of +x, so its red front leaves to the left: it is not mirrored.
    pixels = np.asarray(turn[1], int)
    red = np.nonzero((pixels[..., 0] > 150) & (pixels[..., 2] < 90))[1]
    blue = np.nonzero((pixels[..., 2] > 100) & (pixels[..., 0] < 90))[1]
    assert red.mean() < blue.mean()


def test_the_gif_and_the_film_show_the_same_and_stay_the_same(turn, tmp_path):
    for name in ("a", "b"):
        write_gif(tmp_path / f"{name}.gif", turn)
        write_mp4(tmp_path / f"{name}.mp4", turn)
    for ending in ("gif", "mp4"):
        assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.n_frames, gif.info["loop"]) == (len(turn), 0)
        gif.seek(3)
        shown = np.asarray(gif.convert("RGB"), int)
    with av.open(str(tmp_path / "a.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]
    assert len(frames) == len(turn)
    for picture in (shown, frames[3]):
        assert np.abs(picture - np.asarray(turn[3], int)).mean() < 4
