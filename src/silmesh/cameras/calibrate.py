"""Cameras of a turntable whose geometry is unknown, from silhouettes alone.

``silmesh.cameras.turntable_fit`` fits the turntable that most silhouettes agree on. The covariance
of its parameters says how well the silhouettes fix each. Views that disagree are named, and so is
what else a person should know of the result.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import OptimizeResult

from silmesh.cameras.arcs import CUT, find_without_arcs
from silmesh.cameras.attempt import CHECK_SERIES, Attempt
from silmesh.cameras.consensus import Consensus
from silmesh.cameras.crop_fit import CropFit
from silmesh.cameras.frontier import SCALE
from silmesh.cameras.rounds import (
    Signs,
    describe_short,
    find_given,
    read_signs,
)
from silmesh.cameras.silhouette_coherence import Misses, distance_between, trace
from silmesh.cameras.trying_crops import Crops
from silmesh.cameras.trying_rounds import Asked, Found, fit_any, fit_split
from silmesh.cameras.turntable_fit import (
    FEWEST_AGREEING,
    SUSPECT,
    Given,
    free_parameters,
    root_mean_square,
)
from silmesh.cameras.turntable_residuals import (
    ELEVATION,
    INDEPENDENT,
    NAMES,
    NOISE,
    PHASE,
    STEP,
    VIEW,
    Turntable,
    part_of,
    place_of,
)
from silmesh.errors import NAMED, InputError, name_some
from silmesh.geometry.camera import Cameras
from silmesh.geometry.frame import whole_frames
from silmesh.progress import Share, untold
from silmesh.settings.turntable import Turntable as Known
from silmesh.views import View

FEWEST_VIEWS = 3  # silhouettes without which no turntable is looked for
# All outlines together are sampled at about POINTS points, and each at a number within the limits.
POINTS, FEWEST_SAMPLES, MOST_SAMPLES = 1728, 32, 96
SAME = 0.02  # two steps whose relative difference is smaller count as the same
# A parameter is reported as found if its standard deviation is at most this, in the order of NAMES
# and in its own unit; otherwise it is reported as open.
FIXED = np.array([2.0, 1.0, 1.0, 0.5, 0.3])
LEVEL = 3.0  # degrees of elevation below which the mirrored object may fit as well, so warn
ALIKE = 0.35  # pixels: outlines whose root mean square difference is less all look the same
# Two neighbours that differ by less than this share of the median difference between neighbours
# are taken to be the same photograph.
REPEATED = 0.05
LATHE = (
    "all silhouettes are the same, as of a thing turned on a lathe that stands on the axis: they "
    "show the axis, and neither elevation, perspective, step nor direction"
)
REFUSED = 4.0  # pixels, as SUSPECT: root mean square residual from which a turntable is refused
# Share of the views with a silhouette that have to agree on a turntable, beside FEWEST_AGREEING.
SHARE = 0.55
FULL = "it fills its photograph"
AIMED = (
    "nothing shows: the camera is taken to have been aimed at the object, and the elevation is "
    "that of its line of sight"
)
AIMED_AS_GIVEN = "follows from the elevation that was given"
TURNED = 5.0  # degrees: phases that differ by less are the same


@dataclass(frozen=True)
class Estimate:
    """A parameter as found.

    Attributes:
        value: in degrees; of the axis in pixels
        sd: standard deviation, in the same units; 0 if it was given
        status: ``given``, ``found``, or ``open``: the silhouettes do not fix it
    """

    value: float
    sd: float
    status: str


@dataclass(frozen=True)
class Round:
    """A round of several.

    Attributes:
        views: in the order of the turn
        estimates: ``elevation``, ``step``, and ``phase``: the turn of its first view against the
            first view of the first round
    """

    views: tuple[str, ...]
    estimates: dict[str, Estimate]


@dataclass(frozen=True)
class Crop:
    """How a view was cropped, against the camera that stands still.

    Attributes:
        shift: x and y in pixels of the silhouettes, at the image's middle
        scale: about 1 in the mean, in pixels of the photographs
        shift_sd: standard deviations of the shift
        scale_sd: of the scale, in parts of it; 0 if the views were not scaled
    """

    shift: tuple[float, float]
    scale: float
    shift_sd: tuple[float, float]
    scale_sd: float


@dataclass(frozen=True)
class Calibration:
    """Cameras found, and how far to trust them.

    Attributes:
        cameras: in pixels of the silhouettes; the world's axis y is the turntable's
        estimates: ``elevation`` of the camera above the table; ``roll`` of the axis in the image,
            clockwise; ``axis``, its column at the row ``row``; ``half_angle`` of view over half of
            the image's side; ``step`` from view to view, negative where the turning is opposite
            to ``turntable_cameras``; no ``axis`` where the views were cropped
        row: the middle of the silhouettes, in pixels
        direction_certain: whether the other direction fits clearly worse
        mirror: what tells the object from its mirror image: ``perspective``, ``table`` (the camera
            is taken to stand above it), ``elevation`` (it was given), or ``open``
        rms: root mean square of the residuals of the views that agree, in pixels
        view_rms: of each view, 0 without an outline; of one that disagrees, by how much
        disagreeing: views that had no say, since the others contradict their silhouettes: by how
            much, in words
        offsets: [views] degrees by which each view's angle differs from even steps
        warnings: what a person should know, in sentences
        rounds: what was found of each round, if there are several
        rounds_because: what tells them apart
        crops: of each view with an outline, if the views were cropped one by one
        cut: a sentence that such crops seem to cut the object, if so
    """

    cameras: Cameras
    estimates: dict[str, Estimate]
    row: float
    direction_certain: bool
    mirror: str
    rms: float
    view_rms: np.ndarray
    disagreeing: dict[str, str]
    offsets: np.ndarray
    warnings: tuple[str, ...]
    rounds: tuple[Round, ...] = ()
    rounds_because: str = ""
    crops: dict[str, Crop] = field(default_factory=dict)
    cut: str = ""


def calibrate(
    silhouettes: np.ndarray,
    views: Sequence[str],
    step: float | None = None,
    elevation: float | None = None,
    distance: float | None = None,
    above_table: bool = True,
    aspect: float = 1.0,
    frames: np.ndarray | None = None,
    scales: np.ndarray | None = None,
    rounds: Sequence[Known] = (),
    signs: Callable[[], Signs | None] = lambda: None,
    guess: bool = True,
    progress: Share = untold,
) -> Calibration:
    """Find the cameras of a turntable.

    If no turn of one round explains all silhouettes, it is tried whether each view was cropped by
    itself, and rounds that the photographs show.

    Args:
        silhouettes: [views, size, size] bool, in the order in which the views were taken; an empty
            one says nothing, and its camera stands where the even steps put it
        views: their names
        step: degrees from view to view, if known; its sign does not matter
        elevation: of the camera above the table in degrees, if known
        distance: of the camera from the axis in sizes of the object, if known roughly
        above_table: whether the camera is taken not to look up at the table, unless perspective
            clearly says so; it tells an object from its mirror image, which turns the other way
            before a camera below
        aspect: height over width of a square's image, for photographs that were stretched
        frames: [views, 4] left, top, right and bottom of the photographs within the images: beyond
            them nothing is known; the whole images if not given
        scales: [views, 2] pixels of the images for one of the photographs, in x and in y; all
            alike if not given
        rounds: what is known of each round, if there are several: in place of ``step``,
            ``elevation`` and ``distance``
        signs: gives what the photographs say of rounds beside their silhouettes
        guess: whether rounds and crops that nothing tells clearly are tried as well, and views
            that agree are looked for where most contradict the others by far
        progress: is told which share is done

    Raises:
        InputError: fewer than 3 views have a silhouette, or no turntable explains most of them
    """
    shown, full = _find_shown(silhouettes, views, frames)
    split = find_given(rounds, silhouettes, signs()) if len(rounds) > 1 else None
    far = rounds[0].distance if split else distance
    turn = _trace(silhouettes, views, shown, frames, aspect, far)
    given = Given(len(views), step, elevation, above_table)
    crops = Crops(silhouettes, frames, scales)
    fewest = max(SHARE * (len(shown) + len(full)), FEWEST_AGREEING)
    asked = Asked(turn, given, silhouettes, signs, crops, fewest)
    if split:
        found = fit_split(asked, split, rounds, True, progress)
    else:
        found = fit_any(asked, guess, progress)
    progress(1)
    repeated = _find_repeated(silhouettes[shown], [views[i] for i in shown])
    if found.is_of_all:
        sets = crops.say_sets() if guess else []  # a guessed set is told of its whole
        _refuse_incoherent(found, [*repeated, *crops.say_cut(turn), *sets], signs)
    return _judge(found, turn, views, full, repeated, crops)


def _trace(
    silhouettes: np.ndarray,
    views: Sequence[str],
    shown: np.ndarray,
    frames: np.ndarray | None,
    aspect: float,
    distance: float | None,
) -> Turntable:
    """The outlines of the views that have one, as a turntable's."""
    samples = int(np.clip(POINTS // len(views), FEWEST_SAMPLES, MOST_SAMPLES))
    some = None if frames is None else frames[shown]
    outlines = trace(silhouettes[shown], samples, [views[i] for i in shown], some)
    return Turntable(outlines, silhouettes.shape[1], aspect, distance, shown)


def _judge(
    found: Found,
    turn: Turntable,
    views: Sequence[str],
    full: np.ndarray,
    repeated: Sequence[str],
    crops: Crops,
) -> Calibration:
    """What was found, and what a person should know of it.

    Args:
        turn: the outlines of all views that have one
        full: positions of those that fill their photographs
        repeated: a sentence on views that came twice, if any did
    """
    named = [views[i] for i in turn.index]
    verdict = None if found.is_of_all else found.verdict
    disagreeing = {views[i]: FULL for i in full} | _name_disagreeing(verdict, named)
    said = [*repeated, *_warn_of_disagreement(disagreeing, views)]
    if found.crops or crops.told or (disagreeing and crops.are_cut(turn)):
        said += _tell_cut(found, crops.say_cut(turn))
    if not (found.crops and found.crops.cropped.whole.all()):
        said += _find_cut(turn, named)
    pixels = {} if verdict is None else dict(zip(turn.index, verdict.pixels, strict=True))
    cut = crops.say_along_edges(turn) if crops.told else []
    return replace(_report(found, views, pixels, disagreeing, said), cut="".join(cut))


def calibrate_views(
    silhouettes: np.ndarray, views: Sequence[View], **known: float | bool | Share | None
) -> Attempt:
    """``calibrate`` from the silhouettes of working images, as an attempt.

    Args:
        silhouettes: [views, size, size] bool
        views: these views, in the order in which they were taken
        known: what else ``calibrate`` takes
    """
    scale = views[0].pixel_map
    return attempt_calibration(
        silhouettes,
        [view.view for view in views],
        aspect=float(scale[1, 1] / scale[0, 0]),
        frames=np.array([view.frame for view in views]),
        scales=np.array([np.diag(view.pixel_map)[:2] for view in views]),
        signs=lambda: read_signs(views),
        **known,
    )


def attempt_calibration(
    silhouettes: np.ndarray,
    views: Sequence[str],
    **known: float | bool | np.ndarray | Share | None,
) -> Attempt:
    """``calibrate`` with the same arguments, as an attempt: a refusal is kept, not raised."""
    try:
        found = find_without_arcs(calibrate, silhouettes, views, **known)
    except InputError as error:
        return Attempt("calibrate", None, refusal=str(error))
    figures = {
        "estimates": {name: asdict(e) for name, e in found.estimates.items()},
        "row": float(found.row),
        "direction_certain": found.direction_certain,
        "mirror": found.mirror,
        "rms": found.rms,
        "disagreeing": found.disagreeing,
        "view_rms": dict(zip(found.cameras.views, found.view_rms.tolist(), strict=True)),
        "offsets": dict(zip(found.cameras.views, found.offsets.tolist(), strict=True)),
    }
    if found.rounds:
        figures["rounds_because"] = found.rounds_because
        figures["rounds"] = [asdict(one) for one in found.rounds]
    if found.crops:
        figures["crops"] = {view: asdict(crop) for view, crop in found.crops.items()}
    if found.cut:
        figures["cut"] = found.cut
    return Attempt("calibrate", found.cameras, warnings=found.warnings, figures=figures)


def _find_shown(
    silhouettes: np.ndarray, views: Sequence[str], frames: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the views with an outline, and of those whose silhouette fills its photograph.

    Raises:
        InputError: too few have an outline
    """
    shown = silhouettes.any(axis=(1, 2))
    if shown.sum() < FEWEST_VIEWS:
        raise InputError(
            f"cameras 'calibrate': there are {shown.sum()} views with a silhouette; it takes at "
            f"least {FEWEST_VIEWS}, and a dozen to be trusted"
        )
    boxes = whole_frames(silhouettes) if frames is None else frames
    full = np.array(
        [
            s[top:bottom, left:right].all()
            for s, (left, top, right, bottom) in zip(silhouettes, boxes, strict=True)
        ]
    )
    if (shown & ~full).sum() < max(FEWEST_VIEWS, SHARE * shown.sum()):
        names = name_some([repr(views[i]) for i in np.flatnonzero(full)])
        raise InputError(
            f"cameras 'calibrate': {full.sum()} of the {shown.sum()} silhouettes fill their "
            f"photographs and have no outline: {names}"
        )
    return np.flatnonzero(shown & ~full), np.flatnonzero(full)


def _find_repeated(silhouettes: np.ndarray, views: Sequence[str]) -> list[str]:
    """A sentence that names neighbours with the same silhouette, if there are any."""
    changes = np.array([(a ^ b).sum() for a, b in pairwise(silhouettes)])
    twice = np.flatnonzero(changes < REPEATED * np.median(changes))
    if not len(twice):
        return []
    pairs = [f"{views[i]!r} and {views[i + 1]!r}" for i in twice]
    return [
        f"{name_some(pairs)} show the same silhouette: if a photograph came twice, leave one out"
    ]


def _find_cut(turn: Turntable, views: Sequence[str]) -> list[str]:
    """A sentence that names the views in which the frame cuts the object, if there are any."""
    cut = np.flatnonzero(turn.outlines.cut)
    if not len(cut):
        return []
    names = name_some([repr(views[i]) for i in cut])
    return [f"{CUT} {len(cut)} of {len(views)} views: {names}"]


def _name_disagreeing(verdict: Consensus | None, views: Sequence[str]) -> dict[str, str]:
    """The views that disagree, and by how much."""
    if verdict is None:
        return {}
    judged = zip(views, verdict.pixels, verdict.agrees, strict=True)
    wrong = {str(view): pixels for view, pixels, agrees in judged if not agrees}
    return {view: f"it disagrees by {pixels:.2g} pixels" for view, pixels in wrong.items()}


def _warn_of_disagreement(disagreeing: dict[str, str], views: Sequence[str]) -> list[str]:
    if not disagreeing:
        return []
    names = name_some([f"{view!r} ({why})" for view, why in disagreeing.items()])
    return [
        f"the silhouettes of {len(disagreeing)} of {len(views)} views disagree with the turntable "
        f"that the others agree on, and had no say: {names}"
    ]


def _refuse_incoherent(
    found: Found, said: Sequence[str], signs: Callable[[], Signs | None]
) -> None:
    """Refuse a fit of all views whose residuals are too large."""
    fit, verdict = found.fit, found.verdict
    allowed = REFUSED * fit.turn.size / 256
    if fit.rms <= allowed:
        return
    told = signs()
    said = [*said, *_say_tried(found), *(describe_short(told) if told else [])]
    most = ""
    if verdict:
        most = (
            f"; no turntable explains more than {verdict.agrees.sum()} of the {len(verdict.agrees)}"
        )
    raise InputError(
        f"cameras 'calibrate': no turntable explains these silhouettes: at best their "
        f"outlines miss each other by {fit.rms:.2g} pixels (root mean square; at most "
        f"{allowed:.2g} is accepted){most}" + "".join(f"; {s}" for s in said) + CHECK_SERIES
    )


def _tell_cut(found: Found, cut: Sequence[str]) -> Sequence[str]:
    """Refuse crops that seem to cut the object and contradict each other; otherwise say so."""
    if cut and found.crops and not found.is_of_all:
        agree = found.verdict.agrees
        raise InputError(
            f"cameras 'calibrate': the photographs seem to be cropped one by one, but crops "
            f"explain {agree.sum()} of {len(agree)} views only; {cut[0]}"
        )
    return cut


def _say_tried(found: Found) -> list[str]:
    """Into which rounds the photographs were divided, if they were."""
    if found.split is None:
        return []
    sizes = " and ".join(str(len(views)) for views in found.split.rounds)
    return [f"they were taken to be rounds of {sizes}, told {found.split.because}"]


def _report(
    found: Found,
    views: Sequence[str],
    pixels: dict[int, float],
    disagreeing: dict[str, str],
    said: Sequence[str],
) -> Calibration:
    """What was found; ``pixels`` says by how much views disagree, if that had to be asked."""
    fit, given = found.fit, found.given
    turn, best, misses, count = fit.turn, fit.best, fit.misses, len(views)
    cameras, own = _place_cameras(found, views)
    alike = distance_between(turn.outlines) < ALIKE
    free = free_parameters(turn, given.known, offsets=bool(own.any()))
    crops: dict[str, Crop] = {}
    if found.crops:
        sd, own_sd = found.crops.deviations(given.known)
        crops = _describe_crops(found.crops, own_sd, views)
    else:
        sd = _find_deviations(turn, best, misses, given.known, free, alike)
    estimates = _estimate(best.x, sd, given.known)
    if crops:  # the camera before the crops looks at the axis
        del estimates["axis"]
    rounds = _describe_rounds(turn, best.x, sd, given.known, views)
    view_rms = _measure_views(turn, misses, pixels, count)
    certain = not alike and all(x[STEP] * best.x[STEP] > 0 for x in fit.rivals)
    because = found.split.because if found.split else ""
    warnings = [
        *_say_rounds(rounds, because),
        *_say_crops(crops, estimates),
        *said,
        *([LATHE] if alike else _warn_of_estimates(estimates)),
        *([] if alike else _warn_of_rivals(estimates, fit.rivals, certain, fit.mirror)),
        *_warn_of_phases(turn, best.x, fit.rivals),
        *_warn_of_misses(turn, fit.rms, view_rms, views),
    ]
    return Calibration(
        cameras, estimates, turn.row, certain, fit.mirror, fit.rms, view_rms, disagreeing, own,
        tuple(warnings), rounds, because, crops,
    )  # fmt: skip


def _place_cameras(found: Found, views: Sequence[str]) -> tuple[Cameras, np.ndarray]:
    """The cameras of all views, crops in their K, and degrees by which each is off even steps.

    Views that had no say stand where the even steps put them.
    """
    turn, count = found.fit.turn, len(views)
    *camera, own = turn.cameras_at(found.fit.best.x, count)
    K, R, t = map(torch.as_tensor, camera)
    K = K.repeat(count, 1, 1)
    if found.crops:
        K = torch.as_tensor(found.crops.maps_of(count)) @ K
    return Cameras(tuple(views), torch.full((count, 2), turn.size), K, R, t), own


def _measure_views(
    turn: Turntable, misses: Misses, pixels: dict[int, float], count: int
) -> np.ndarray:
    """Root mean square residual of each view: [count] pixels; 0 where nothing is known.

    Args:
        misses: of the views that were fitted
        pixels: of others, by their positions
    """
    view_rms = np.zeros(count)
    view_rms[list(pixels)] = list(pixels.values())
    view_rms[turn.index] = [
        root_mean_square(r[k]) if k.any() else 0.0
        for r, k in zip(misses.pixels, turn.outlines.known, strict=True)
    ]
    return view_rms


def _find_deviations(
    turn: Turntable,
    fit: OptimizeResult,
    misses: Misses,
    known: Sequence[int],
    free: np.ndarray,
    alike: bool,
) -> np.ndarray:
    """Standard deviations of the parameters, from the residuals' derivatives at the fit.

    If all silhouettes look the same, they fix the axis and the roll only. Elevation, half angle
    and step then get the standard deviations of their priors.
    """
    noise = max(NOISE, root_mean_square(misses.pixels[turn.outlines.known]))
    turn = turn.sparse()
    slopes = turn.slopes(fit.x, turn.misses(fit.x))
    slopes[..., : turn.shared] = turn.secants(fit.x)
    data = slopes.reshape(-1, len(fit.x))[:, free]
    _, prior_sd = turn.prior()
    weight = INDEPENDENT / turn.outlines.known.shape[1] / noise**2
    precision = weight * data.T @ data + np.diag(prior_sd[free] ** -2.0)
    sd = np.zeros(len(fit.x))
    sd[free] = np.sqrt(np.diag(np.linalg.pinv(precision)))
    if alike:
        unknown = [i for i in (ELEVATION, VIEW, STEP) if i not in known]
        sd[unknown] = np.where(
            np.isfinite(prior_sd[unknown]), prior_sd[unknown], np.abs(fit.x[unknown])
        )
    return sd


def _estimate(x: np.ndarray, sd: np.ndarray, known: Sequence[int]) -> dict[str, Estimate]:
    """The parameters of ``NAMES`` with their standard deviations."""
    values, sd = x[: len(NAMES)].copy(), sd.copy()
    values[VIEW] = math.degrees(math.atan(math.exp(values[VIEW])))
    status = ["found" if s <= most else "open" for s, most in zip(sd, FIXED, strict=False)]
    sd[VIEW] *= math.degrees(math.sin(2 * math.radians(values[VIEW])) / 2)  # d angle / d log tan
    return {
        name: Estimate(float(values[i]), float(sd[i]), "given" if i in known else status[i])
        for i, name in enumerate(NAMES)
    }


def _describe_rounds(
    turn: Turntable,
    x: np.ndarray,
    sd: np.ndarray,
    known: Sequence[int],
    views: Sequence[str],
) -> tuple[Round, ...]:
    """What was found of each round, if there are several."""

    def estimate(place: int, most: float) -> Estimate:
        status = "found" if sd[place] <= most else "open"
        value = float(x[place])
        return Estimate(value, float(sd[place]), "given" if place in known else status)

    found = []
    for number, positions in enumerate(turn.rounds):
        estimates = {
            "elevation": estimate(place_of(ELEVATION, number), FIXED[ELEVATION]),
            "step": estimate(place_of(STEP, number), FIXED[STEP]),
            "phase": Estimate(0.0, 0.0, "given"),
        }
        if number:
            phase = estimate(part_of(number).start + PHASE, FIXED[ELEVATION])
            estimates["phase"] = replace(phase, value=phase.value % 360)
        found.append(Round(tuple(views[i] for i in positions), estimates))
    return tuple(found)


def _say_rounds(rounds: Sequence[Round], because: str) -> list[str]:
    """A sentence that names the rounds, if there are several."""
    if not rounds:
        return []
    said = "; ".join(
        f"{one.views[0]!r} to {one.views[-1]!r} ({len(one.views)} views, from "
        f"{one.estimates['elevation'].value:.1f} degrees)"
        for one in rounds
    )
    return [f"the photographs are taken to be {len(rounds)} rounds, told {because}: {said}"]


def _describe_crops(fit: CropFit, sd: np.ndarray, views: Sequence[str]) -> dict[str, Crop]:
    """The crop of each view with an outline."""
    middle = fit.cropped.turn.size / 2
    crops = fit.cropped.split(fit.x)[1]
    maps = fit.cropped.at(fit.x)[0].maps
    shifts = maps[:, 1] + (maps[:, 0] - 1) * middle
    return {
        views[i]: Crop(
            tuple(shift.tolist()),
            float(np.exp(crop[SCALE])),
            tuple(one[:SCALE].tolist()),
            float(one[SCALE]),
        )
        for i, shift, crop, one in zip(fit.cropped.turn.index, shifts, crops, sd, strict=True)
    }


def _say_crops(crops: dict[str, Crop], estimates: dict[str, Estimate]) -> list[str]:
    """A sentence that says that the views were cropped, if they were."""
    if not crops:
        return []
    scales = [crop.scale for crop in crops.values()]
    shifts = np.array([crop.shift for crop in crops.values()])
    sd = np.median([[*crop.shift_sd, crop.scale_sd] for crop in crops.values()], axis=0)
    scaled = max(scales) > min(scales)
    said = f", scaled from {min(scales):.2f} to {max(scales):.2f} (+- {sd[2]:.1%})" * scaled
    x, y = np.ptp(shifts, axis=0)
    given = estimates["elevation"].status == "given"
    return [
        f"the photographs are taken to be cropped one by one: shifted by up to {x:.1f} and {y:.1f} "
        f"pixels of the working images against each other (+- {sd[0]:.1f} and {sd[1]:.1f}){said}; "
        f"where their middles were before, {AIMED_AS_GIVEN if given else AIMED}"
    ]


def _warn_of_phases(turn: Turntable, x: np.ndarray, rivals: Sequence[np.ndarray]) -> list[str]:
    """A sentence that names rounds that may be turned otherwise against the first."""
    said = []
    for number in range(1, len(turn.rounds)):
        place = part_of(number).start + PHASE
        others = {
            round(float(rival[place] % 360))
            for rival in rivals
            if abs((rival[place] - x[place] + 180) % 360 - 180) > TURNED
        }
        if others:
            listed = ", ".join(map(str, sorted(others)))
            said.append(
                f"round {number + 1} begins {x[place] % 360:.0f} degrees after the first one, but "
                f"{listed} explain the silhouettes as well"
            )
    return said


def _warn_of_estimates(estimates: dict[str, Estimate]) -> list[str]:
    return [
        f"{name} is not fixed by the silhouettes: {e.value:.3g} +- {e.sd:.2g} is mostly a guess"
        for name, e in estimates.items()
        if e.status == "open"
    ]


def _warn_of_rivals(
    estimates: dict[str, Estimate],
    rivals: Sequence[np.ndarray],
    certain: bool,
    mirror: str,
) -> list[str]:
    """Sentences that name other turntables which explain the silhouettes as well."""
    said = []
    elevation, step = estimates["elevation"].value, estimates["step"].value
    others = {round(abs(x[STEP]), 3) for x in rivals if abs(abs(x[STEP] / step) - 1) > SAME}
    if others:
        listed = ", ".join(f"{other:.3g}" for other in sorted(others))
        said.append(
            f"steps of {abs(step):.3g} and {listed} degrees explain the silhouettes as well; if "
            "you know the step, give it: turntable ',,step'"
        )
    if mirror == "perspective" and elevation < 0:
        said.append(
            f"the camera looks up at the table ({elevation:.3g} degrees): by its perspective, a "
            "camera above fits clearly worse"
        )
    if not certain:
        said.append(
            "both directions of turning explain the silhouettes; if the mesh is mirrored, "
            "it is the other one"
        )
    elif mirror == "open":
        said.append(
            "a camera above and one below the table explain the silhouettes; if the mesh is "
            "mirrored, it is the other one"
        )
    elif abs(elevation) < LEVEL and mirror == "table":
        said.append(
            f"the camera looks almost level ({elevation:.2g} degrees), where a mirrored object "
            "that turns the other way looks the same; the direction may be wrong"
        )
    return said


def _warn_of_misses(
    turn: Turntable, rms: float, view_rms: np.ndarray, views: Sequence[str]
) -> list[str]:
    if rms <= SUSPECT * turn.size / 256:
        return []
    worst = sorted(range(len(views)), key=lambda i: -view_rms[i])[:NAMED]
    listed = ", ".join(f"{views[i]!r} ({view_rms[i]:.2g})" for i in worst)
    return [
        f"the outlines miss each other by {rms:.2g} pixels; the views that miss most are "
        f"{listed}: look at their silhouettes, and at the order of the views"
    ]
