"""Silhouettes from mask files: two values, of which the brighter or more opaque is the object."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from silmesh.errors import InputError, name_some
from silmesh.views import View, read_image

TRIED = 8  # masks, spread over all, whose values are checked before any work
LOOKED_AT = 512  # pixels: a mask with a longer side is subsampled before its values are counted
FEW = 64  # up to so many values are all distinct; among more, some are noise or soft edges
ALIKE = 1 / 10  # among more than FEW values, those nearer than this share of the range are one
# A flat pixel has the same value as all its neighbours. A value counts as one of the mask's if its
# flat pixels are at least PART of those without the commonest value (fewer are a seam between two
# others) and SHOWN of all flat pixels.
PART = 0.02
SHOWN = 1e-3
# PART for a value near the lowest or the highest one, where compression leaves flat blocks.
MUCH = 0.15
WIDE = 4  # pixels: a pixel is inside a region if all pixels up to this distance have its value
WHOLE = 1 / 4  # a value fills regions if at least this share of its flat pixels is inside one
GREY = 1 / 3  # of the pixels that are not background: if more lie between two values, refuse them
NAMED = 5  # most values that a message lists


class SeveralValuesError(InputError):
    """A mask tells more than object and background apart, so the others may mean more too."""


def find(image: Image.Image, view: View, mask: Path | None) -> np.ndarray:
    """Resize the mask as its photograph was, and take what is nearer to its brighter value.

    So masks of 0 and 1, soft or compressed ones, masks that are only an alpha channel, and the grey
    silhouettes that this package writes, are read as well.

    Raises:
        InputError: the mask cannot be read, has another size than the photograph, or more than
            two values
    """
    drawn = read_image(mask)
    if drawn.size != (view.width, view.height):
        turned = drawn.size == (view.height, view.width)
        raise InputError(
            f"{mask}: is {drawn.width}x{drawn.height}, but its photograph {view.source} is "
            f"{view.width}x{view.height}; a mask should have its photograph's size"
            + ", turned upright as its EXIF orientation says"
            * turned
        )
    brightness = read_brightness(drawn)
    low, high = find_levels(np.asarray(brightness), str(mask))
    scale = 255 / (high - low)
    spread = brightness.point([min(max(round((v - low) * scale), 0), 255) for v in range(256)])
    return np.asarray(view.into_square(spread, Image.Resampling.BILINEAR)) > 127


def refuse_labels(files: Sequence[Path]) -> None:
    """Refuse masks of more than two values before any work, by a look at some of them.

    What else is wrong with one, that it cannot be read for example, is left to the policy.

    Raises:
        SeveralValuesError: one has more
    """
    for i in np.linspace(0, len(files) - 1, min(TRIED, len(files))).round().astype(int):
        try:
            drawn = read_image(files[i])
        except InputError:
            continue
        find_levels(np.asarray(read_brightness(drawn)), str(files[i]))


def read_brightness(drawn: Image.Image) -> Image.Image:
    """The one channel, L, of an image that says what is the object.

    Of an image that is transparent in places it is the alpha, unless what is opaque is a mask
    itself, of a few flat values that are not all alike; else the brightness.
    """
    grey = drawn.convert("RGB").convert("L")
    if drawn.mode != "RGBA":
        return grey
    alpha = drawn.getchannel("A")
    least, most = alpha.getextrema()
    if least == most:
        return grey
    opaque = np.asarray(alpha) > (least + most) / 2
    shown = np.count_nonzero(np.bincount(np.asarray(grey)[opaque], minlength=256))
    if not 1 < shown <= FEW:
        return alpha
    return Image.composite(grey, Image.new("L", grey.size), alpha)


def find_levels(values: np.ndarray, name: str) -> tuple[int, int]:
    """The values that stand for the background and for the object, the first below the second.

    A value counts where it fills whole neighbourhoods of pixels: the ringing of compression and
    soft edges do not, nor do the flat blocks that compression leaves.

    Args:
        values: [height, width] uint8
        name: of the file, for messages

    Raises:
        SeveralValuesError: there are more than two
    """
    step = -(-max(values.shape) // LOOKED_AT)
    looked = Image.fromarray(np.ascontiguousarray(values[::step, ::step]))
    least, most = looked.getextrema()
    several = np.count_nonzero(looked.histogram())
    if several <= 2:
        return (least, most) if least < most else (0, most or 255)
    near = int((most - least) * ALIKE) if most - least >= FEW else 0
    reach = near if several > FEW else 0
    flat = _count_flat(looked, 1)
    found = _group(flat, reach)
    if len(found) > 2:
        whole = _count_flat(looked, WIDE) > flat * WHOLE
        found = _drop_noise(found, whole, near)
    if len(found) > 2:
        raise SeveralValuesError(_describe(found, name))
    if len(found) == 2:
        least, most = min(found), max(found)
    _refuse_grey(looked, least, most, name)
    return least, most


def _count_flat(image: Image.Image, radius: int) -> np.ndarray:
    """How many pixels of each value have just that value around them: [256]."""
    low, high = _extremes(image, radius)
    return np.bincount(low[low == high], minlength=256)


def _extremes(image: Image.Image, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest value around each pixel: twice [height, width] uint8."""
    low = high = image
    for _ in range(radius):
        low, high = low.filter(ImageFilter.MinFilter(3)), high.filter(ImageFilter.MaxFilter(3))
    return np.asarray(low), np.asarray(high)


def _group(counts: np.ndarray, reach: int) -> dict[int, int]:
    """The values that stand out, the commonest first, with the counts of all within ``reach``."""
    counts, found = counts.copy(), {}
    while counts.any():
        value = int(counts.argmax())
        around = slice(max(value - reach, 0), value + reach + 1)
        found[value] = int(counts[around].sum())
        counts[around] = 0
    total = sum(found.values())
    least = max(PART * (total - max(found.values(), default=0)), SHOWN * total)
    return {value: count for value, count in found.items() if count >= least}


def _drop_noise(found: Mapping[int, int], whole: np.ndarray, near: int) -> dict[int, int]:
    """Of the values that stand out the lowest, the highest, and those that fill regions.

    Args:
        whole: [256], whether a value does
        near: how far from the lowest and highest compression leaves flat blocks
    """
    ends = min(found), max(found)
    rest = sum(found.values()) - max(found.values())
    return {
        value: count
        for value, count in found.items()
        if value in ends
        or (whole[value] and (count > MUCH * rest or min(abs(value - end) for end in ends) > near))
    }


def _refuse_grey(image: Image.Image, least: int, most: int, name: str) -> None:
    """Refuse what has whole regions between its two values: a photograph, a map of depth."""
    quarter = (most - least) / 4
    low, high = _extremes(image, WIDE)
    between = np.count_nonzero((low > least + quarter) & (high < most - quarter))
    if between > GREY * np.count_nonzero(np.asarray(image) > least + quarter):
        raise SeveralValuesError(
            f"{name}: holds all values from {least} to {most}, in whole regions; a mask should be "
            "255 on the object and 0 elsewhere"
        )


def _describe(found: Mapping[int, int], name: str) -> str:
    """What is wrong with a mask of these values, and what to do."""
    total = sum(found.values())
    named = [f"{value} ({found[value] / total:.0%})" for value in sorted(found)]
    listed = name_some(named, NAMED)
    return (
        f"{name}: holds {len(found)} values, {listed}, and no more than two can be told apart; "
        "a mask should be 255 on the object and 0 elsewhere. In Python `from PIL import Image; "
        f"Image.open({name!r}).convert('L').point(lambda v: 255 * (v > {min(found)}))"
        f".save('new.png')` makes one of all above {min(found)}, `v == {max(found)}` of that value "
        "alone"
    )
