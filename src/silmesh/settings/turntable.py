"""What a person knows of a turntable: ``distance,elevation,step``, of each round one.

Rounds are separated by ``;``. A round of several may say of how many photographs it is, as its
fourth number: ``,5,20,18;,40,20,18``.
"""

from dataclasses import dataclass, replace

from silmesh.errors import InputError, shorten

FARTHEST = 100  # distance of a turntable's camera at which the object is 2 % of the picture
FEWEST = 5  # photographs of a round, if there are several
# What ShapeNet's renderings were taken with (Kato et al. 2018), as SoftRas reads them: its azimuth
# is -15 degrees times the view's number.
SOFTRAS_SHAPENET = "2.732,30,-15"
EXAMPLE = "',5,20;,40,20'"


@dataclass(frozen=True)
class Turntable:
    """What is known of a turntable's geometry; None where nothing is.

    Attributes:
        distance: of the camera from the origin, in scene units
        elevation: of the camera above the table, in degrees
        step: turn from one view to the next, in degrees
        photographs: how many there are, of one of several rounds
        later: the rounds after the first
    """

    distance: float | None
    elevation: float | None
    step: float | None
    photographs: int | None = None
    later: "tuple[Turntable, ...]" = ()

    @property
    def complete(self) -> bool:
        """Whether cameras can be made from it alone."""
        return not self.later and None not in (self.distance, self.elevation, self.step)

    @property
    def rounds(self) -> "tuple[Turntable, ...]":
        """Each round by itself."""
        return (replace(self, later=()), *self.later)

    @property
    def text(self) -> str:
        """As ``parse_turntable`` reads it."""
        return ";".join(map(_write, self.rounds))


def _write(one: Turntable) -> str:
    numbers = [one.distance, one.elevation, one.step]
    numbers += [] if one.photographs is None else [one.photographs]
    return ",".join("" if number is None else repr(number) for number in numbers)


def parse_turntable(cell: str) -> Turntable:
    """What is known of a turntable, in scene units and degrees.

    Raises:
        InputError: it is written otherwise, or a number is none that a turntable has
    """
    if not cell:
        return Turntable(None, None, None)
    parts = cell.split(";")
    shown = shorten(cell)
    first, *later = (_parse_round(shown, part, several=len(parts) > 1) for part in parts)
    return replace(first, later=tuple(later))


def _parse_round(cell: str, part: str, several: bool) -> Turntable:
    """One round; ``cell`` is all that was given, as a message shows it."""
    numbers = part.split(",")
    photographs = numbers.pop() if several and len(numbers) == 4 else ""
    try:
        if not part.isascii() or "_" in part:  # which Python's own numbers may have
            raise ValueError(part)
        distance, elevation, step = (
            float(number) if number.strip() else None for number in numbers
        )
        count = int(photographs) if photographs.strip() else None
    except ValueError as error:
        raise InputError(
            f"turntable: should be distance,elevation,step, for example 2.732,0,5, not {cell}"
            f"{_blame_digits(part)}; "
            "what cameras 'calibrate' should find is left out, as in ',,5'; several rounds are "
            f"separated by ';', as in {EXAMPLE}"
        ) from error
    if count is not None and count < FEWEST:
        raise InputError(
            f"turntable: {cell}: a round of {count} photographs is too short; each of several "
            f"should have {FEWEST} or more, and a dozen to be trusted"
        )
    _check_numbers(cell, distance, elevation, step)
    return Turntable(distance, elevation, step, count)


def _blame_digits(part: str) -> str:
    """Which digits are none of 0 to 9, if some are."""
    strange = "".join(c for c in part if c.isdecimal() and not c.isascii())
    return f" ({shorten(strange)} should be digits from 0 to 9)" if strange else ""


def _check_numbers(
    cell: str, distance: float | None, elevation: float | None, step: float | None
) -> None:
    if distance is not None and distance > FARTHEST:
        raise InputError(
            f"turntable: {cell}: a distance of {distance:g} is too far; its unit is the object's "
            "size, whatever it is in metres. The report's is 2.732"
        )
    if not (
        (distance is None or distance > 0)
        and (elevation is None or -90 <= elevation <= 90)
        and (step is None or 0 < abs(step) <= 360)
    ):
        raise InputError(
            f"turntable: {cell}: should have a positive distance, an elevation of -90 to 90 "
            "degrees, and a step of at most 360 degrees that is not 0"
        )
