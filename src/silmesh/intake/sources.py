"""Where silhouettes and cameras come from, by what a few of the photographs themselves show."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from silmesh.errors import InputError
from silmesh.planning.feasible import has_matting
from silmesh.silhouettes.threshold import border_noise
from silmesh.views import read_image

LOOKED_AT = 8  # photographs, spread over all
SMALL = 256  # longer side of what is looked at, in pixels
PLAIN = 8.0  # grey levels a plain background strays by at most; a cluttered one by 20 and more
STILL = 4.0  # grey levels by which the border changes while the camera stands still


@dataclass(frozen=True)
class Look:
    """What photographs show of their background.

    Attributes:
        noise: how far their borders stray from a plain background, in grey levels
        change: how far the borders change from one to another; infinite if their sizes do
        cut_out: whether they are transparent around the object
    """

    noise: float
    change: float
    cut_out: bool

    @property
    def plain(self) -> bool:
        """Whether the background is plain."""
        return self.noise <= PLAIN

    @property
    def still(self) -> bool:
        """Whether the camera stood still, so that the object must have turned."""
        return self.change <= STILL


def look(files: Sequence[Path]) -> Look:
    """Look at some of the photographs, and of these at what can be read.

    Raises:
        InputError: none of them can
    """
    places = np.linspace(0, len(files) - 1, min(LOOKED_AT, len(files))).round().astype(int)
    shown, wrong = [], []
    for i in places:
        try:
            shown.append(read_image(files[i], (SMALL, SMALL)))
        except InputError as error:
            wrong.append(error)
    if not shown:
        raise wrong[0]
    for image in shown:
        image.thumbnail((SMALL, SMALL))
    cut_out = all(i.mode == "RGBA" and i.getchannel("A").getextrema()[0] < 128 for i in shown)
    pixels = [np.asarray(image.convert("RGB")) for image in shown]
    noise = float(np.median([border_noise(picture) for picture in pixels]))
    return Look(noise, _change(pixels), cut_out)


def _change(pictures: Sequence[np.ndarray]) -> float:
    """How far the border of pictures [height, width, 3] is from what most of them have there."""
    if len({picture.shape for picture in pictures}) > 1:
        return float("inf")
    borders = np.stack([np.concatenate([p[0], p[-1], p[:, 0], p[:, -1]]) for p in pictures])
    off = np.abs(borders - np.median(borders, axis=0)).max(axis=-1)
    return float(np.median(off))


def choose_silhouettes(seen: Look, masks: Sequence[Path], files: str) -> tuple[str, str]:
    """A source of silhouettes, and why.

    Args:
        seen: what the photographs show
        masks: of each its mask, or none
        files: what they are called, for messages

    Raises:
        InputError: it would be the foreground model, which is not installed
    """
    if masks:
        return "mask", f"each photograph has one, as {masks[0]}"
    if seen.cut_out:
        return "alpha", "the photographs are transparent around the object"
    if seen.plain:
        return "threshold", f"the background is plain to {seen.noise:.0f} of 255 grey levels"
    why = f"the background is not plain: it strays by {seen.noise:.0f} of 255 grey levels"
    if has_matting():
        return "matting", f"{why}; its weights, 88 MB, are fetched once"
    raise InputError(
        f"{files}: {why}. The foreground model finds objects before any background: "
        "`pip install 'silmesh[matting]'`, then the same command again; or give masks with --masks"
    )


def choose_cameras(seen: Look) -> tuple[tuple[str, ...], str]:
    """Sources of cameras, the next if the silhouettes contradict the one before, and why."""
    if seen.plain or seen.cut_out:
        return ("calibrate", "auto"), "the object is taken to turn before a plain background"
    if seen.still:
        return ("calibrate", "auto"), "the background stands still, so the object turns"
    return ("auto",), "the background moves, so the camera may; COLMAP is tried, then a turntable"
