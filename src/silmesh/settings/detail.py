"""Levels of detail: what each sets, and what it costs, in one table.

What a level sets is a default: an option of its own that a person gives stays as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from silmesh.errors import InputError

NORMAL = "normal"
FAST = "fast"  # the preset that the settings of the fit are of
OWN = "own"  # a size: the photographs'
DETAILS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {  # sections of the configuration
    "draft": {"views": {"size": 128}},
    "normal": {"views": {"size": 256}},
    "high": {"views": {"size": OWN}, "fit": {"vertices": 100_000}},
}
LEAST, MOST = 256, 4096  # pixels: what the photographs' own size is held to
BOUND = 8.0  # GiB that a level with the photographs' own size may need
GRAIN = 64  # pixels: a size that is lowered for it is a multiple
# The estimate, fitted to the tables in docs/detail.md: GiB and seconds of a processor at least, a
# million pixels of all views, and (seconds) a thousand vertices a view.
MEMORY = (0.95, 0.0065)
SECONDS = (26.0, 0.3, 0.105)
CORES = 1.5  # of which a run makes use on average, at most


@dataclass(frozen=True)
class Chosen:
    """A level of detail for some photographs.

    Attributes:
        settings: sections of the configuration, the size a number
        memory: GiB that the run will need
        seconds: of one core
        said: lines for a person: what it will need, and what was lowered for it
    """

    settings: Mapping[str, Mapping[str, Any]]
    memory: float
    seconds: float
    said: tuple[str, ...]


def choose_detail(
    detail: str,
    longest: int,
    views: int,
    size: int | None = None,
    cores: int = CORES,
    preset: str = FAST,
) -> Chosen:
    """What a level of detail sets for so many photographs.

    Args:
        detail: one of ``DETAILS``
        longest: the longer side of the largest photograph, in pixels
        views: how many there are
        size: of the working images, where a person gives it
        cores: that may be used
        preset: of the fit

    Raises:
        InputError: there is no such level, or the preset cannot do it
    """
    if detail not in DETAILS:
        raise InputError(f"detail {detail!r}: should be one of {', '.join(DETAILS)}")
    settings = {name: dict(section) for name, section in DETAILS[detail].items()}
    if preset != FAST:
        settings.pop("fit", None)
        if settings["views"]["size"] == OWN and size is None:
            raise InputError(
                f"detail {detail!r}: the preset {preset!r} looks at whole images, which takes too "
                f"much of large ones; should be the preset {FAST!r}, or a size be given"
            )
    wanted, lowered = settings["views"]["size"] if size is None else size, ()
    if wanted == OWN:
        own = min(max(longest, LEAST), MOST)
        wanted = _fit_memory(own, views)
        if wanted < own:
            lowered = (
                f"detail: working images of {wanted} pixels in place of {own}, to stay within "
                f"{BOUND:g} GiB",
            )
    settings["views"]["size"] = wanted
    most = settings.get("fit", {}).get("vertices", 0)
    memory, seconds = estimate(wanted, views, most)
    shared = seconds / max(1, min(cores, CORES))
    said = (
        f"detail: {detail}, working images of {wanted} pixels; about {_in_words(shared)} and "
        f"{memory:.1f} GiB of memory"
    )
    return Chosen(settings, memory, seconds, (*lowered, said))


def estimate(size: int, views: int, vertices: int = 0) -> tuple[float, float]:
    """GiB and processor seconds that a run takes by the command's defaults, masks given."""
    pixels = views * size**2 / 1e6
    grown = min(vertices, 1500 * (size / LEAST) ** 2) * views / 1e3
    memory = MEMORY[0] + MEMORY[1] * pixels
    seconds = SECONDS[0] + SECONDS[1] * pixels + SECONDS[2] * grown
    return memory, seconds


def _fit_memory(size: int, views: int) -> int:
    """The largest size, not above this one, whose run stays within ``BOUND``."""
    while size > LEAST and estimate(size, views)[0] > BOUND:
        size = max(LEAST, (size - 1) // GRAIN * GRAIN)
    return size


def _in_words(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
