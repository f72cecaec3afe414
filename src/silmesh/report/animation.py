"""A mesh that turns once about its upright, as an animated GIF and as an MP4.

It is seen from a little above, in the colours of its vertices, lit from beside the camera. What
turns is the camera: a cylinder about the upright that holds the mesh decides the scale, so that
this stays the same in all pictures.
"""

from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np
import trimesh
from PIL import Image

from silmesh.files import replacing
from silmesh.report.pictures import paint, relight, to_image, trace
from silmesh.report.rings import look

FRAMES, SIDE, FINE = 36, 192, 1.5  # of a turn; pixels; drawn so many times larger than shown
SECONDS = 3.6  # a turn
RAISED = 20.0  # degrees
AROUND = 48  # points of each rim of the cylinder


def draw_turn(
    mesh: trimesh.Trimesh, up: np.ndarray, ahead: np.ndarray, frames: int = FRAMES
) -> list[Image.Image]:
    """Draw a turn, the first picture from the side that ``ahead`` looks at.

    Args:
        mesh: with colours of its vertices
        up, ahead: unit vectors [3], at right angles, of its world
    """
    centred = mesh.copy()
    centred.apply_translation(-mesh.bounds.mean(axis=0))
    rims = _rims(centred.vertices, up, ahead)
    aside = np.cross(up, ahead)
    pictures = []
    for angle in 2 * np.pi * np.arange(frames) / frames:
        towards = np.cos(angle) * ahead + np.sin(angle) * aside
        camera = look(up, towards, RAISED, rims, round(FINE * SIDE))
        hits = trace(centred, camera)
        lit = relight(paint(centred, hits), centred, camera, hits)
        pictures.append(to_image(lit).resize((SIDE, SIDE), Image.Resampling.BOX))
    return pictures


def _rims(verts: np.ndarray, up: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """The rims of the cylinder about ``up`` through the origin that holds points: [points, 3]."""
    heights = verts @ up
    radius = np.linalg.norm(verts - heights[:, None] * up, axis=1).max()
    angle = 2 * np.pi * np.arange(AROUND)[:, None] / AROUND
    rim = radius * (np.cos(angle) * ahead + np.sin(angle) * np.cross(up, ahead))
    return np.concatenate([rim + height * up for height in (heights.min(), heights.max())])


def write_gif(path: Path, pictures: Sequence[Image.Image]) -> None:
    """Write a GIF that turns for ever; all pictures share the colours of a quarter of them."""
    strip = np.concatenate([np.asarray(p) for p in pictures[:: max(len(pictures) // 9, 1)]])
    palette = Image.fromarray(strip).quantize(255)
    frames = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    with replacing(path) as part:
        frames[0].save(
            part,
            save_all=True,
            append_images=frames[1:],
            duration=round(1000 * SECONDS / len(frames)),
            loop=0,
            optimize=False,
        )


def write_mp4(path: Path, pictures: Sequence[Image.Image]) -> None:
    """Write an H.264 film of one turn that any player takes; the same bytes each time.

    x264's vector code does not always give the same bytes, so it is asked for what does.
    """
    with replacing(path) as part, av.open(str(part), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=round(len(pictures) / SECONDS))
        stream.width, stream.height = pictures[0].size
        stream.pix_fmt = "yuv420p"
        stream.options = {
            "crf": "22",
            "preset": "medium",
            "threads": "1",
            "x264-params": "cpu-independent=1",
        }
        for picture in pictures:
            film.mux(stream.encode(av.VideoFrame.from_image(picture)))
        film.mux(stream.encode())
