"""Photographs out of a video: the sharpest picture of each of its parts."""

import os
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import av
import numpy as np
from PIL import Image

from silmesh.errors import InputError, reading
from silmesh.files import making

PARTS = 60  # photographs of a video
SMALL = 480  # longer side of what is judged for sharpness, in pixels
QUALITY = 95  # of JPEG
DONE = "cut"  # names the folder's file that says which video it is of


def cut(video: Path, folder: Path) -> list[Path]:
    """Cut a video into photographs, unless that was done before.

    Args:
        folder: to make
    Returns:
        the photographs, in the order of time

    Raises:
        InputError: it cannot be read
    """
    seen = video.stat()
    stamp = os.fsencode(f"{video.absolute()} {seen.st_size} {seen.st_mtime_ns}\n")
    done = folder / DONE
    if not (done.is_file() and done.read_bytes() == stamp):
        with making(folder) as part:
            for i, picture in enumerate(_sharpest(video)):
                picture.save(part / f"{i:04d}.jpg", quality=QUALITY)
            (part / DONE).write_bytes(stamp)
    return sorted(folder.glob("*.jpg"))


def _sharpest(video: Path) -> Iterator[Image.Image]:
    """The sharpest frame of each part, upright."""
    # Opened here, since its name may not be in UTF-8.
    with reading(video, "a video"), open(video, "rb") as file, av.open(file) as film:
        if not film.streams.video:
            raise InputError(f"{video}: has no pictures")
        stream = film.streams.video[0]
        stream.thread_type = "AUTO"
        length = _count(film, stream)
        frames = enumerate(film.decode(stream))
        for _, part in groupby(frames, lambda pair: min(pair[0] * PARTS // length, PARTS - 1)):
            yield _upright(max((frame for _, frame in part), key=_sharpness))


def _count(film: av.container.InputContainer, stream: av.VideoStream) -> int:
    """How many frames there are, or about as many."""
    if stream.frames:
        return stream.frames
    seconds = (film.duration or 0) / av.time_base
    return max(int(seconds * float(stream.average_rate or 0)), 1)


def _sharpness(frame: av.VideoFrame) -> float:
    """How much neighbouring pixels of a small grey picture differ, as mean square."""
    scale = min(1.0, SMALL / max(frame.width, frame.height))
    size = {"width": round(scale * frame.width), "height": round(scale * frame.height)}
    grey = frame.reformat(**size, format="gray").to_ndarray().astype(np.float32)
    return float((np.diff(grey, axis=0) ** 2).mean() + (np.diff(grey, axis=1) ** 2).mean())


def _upright(frame: av.VideoFrame) -> Image.Image:
    """A frame as the player turns it: counterclockwise by its display matrix's degrees."""
    return frame.to_image().rotate(frame.rotation, expand=True)
