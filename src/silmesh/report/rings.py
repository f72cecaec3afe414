"""The cameras around the object: a frustum a view about the visual hull, in two looks.

One look is obliquely from above, the other straight from the top. The hull is drawn by ray casting,
the frusta as lines before and behind it. Cameras of narrow view stand so far away that the object
would be a dot: all are drawn nearer by one factor, which the picture says, and their frusta opened
by the same. Views go from blue, the first, to orange, the last; sets of views between which the
object was turned over have a colour each.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from PIL import Image, ImageDraw

from silmesh.errors import name_some
from silmesh.geometry.camera import OBJECT_RADIUS, Cameras
from silmesh.report.pictures import FINE, GROUND, INK, MESH, Camera, font, shade, to_image, trace

PANEL, GAP, HEADER, LINE = 551, 8, 30, 18  # pixels
FIRST, LAST, DARK_LAST = (0, 90, 160), MESH, (168, 78, 0)
OF_SETS = (FIRST, LAST, (0, 120, 80), (150, 60, 130))  # colours of sets, in turn
TINT = 110  # of 255: how much the first and the last frustum hide
FAINT = (176, 172, 164)
RING = 3.2 * OBJECT_RADIUS  # median distance of the cameras from the middle, as drawn
OBLIQUE, TOP = 32.0, 90.0  # degrees from which the two looks look down
ASIDE = 35.0  # degrees by which the oblique look stands beside the first camera
MARGIN = 0.06  # of a panel
SHORTEST, LONGEST = 0.07, 0.42  # world units: a frustum from its tip to its image
NEAR = 70  # pixels: labels of frusta nearer than that stand side by side
LISTED = 8  # dropped views that are named


@dataclass(frozen=True)
class Frusta:
    """The cameras as they are drawn.

    Attributes:
        apexes: [views, 3]
        corners: [views, 4, 3] of the image, from the upper left one clockwise
        nearer: the factor of the cameras' distance from the middle at which they are drawn
    """

    apexes: np.ndarray
    corners: np.ndarray
    nearer: float


def frusta_of(cameras: Cameras) -> Frusta:
    """Bring the cameras to the ring that is drawn.

    An image's side at the middle of the object spans in the drawing what it spans in the world.
    """
    centres, R = cameras.centres.numpy(), cameras.R.numpy()
    nearer = min(1.0, RING / float(np.median(np.linalg.norm(centres, axis=1))))
    apexes = nearer * centres
    apart = np.linalg.norm(apexes[:, None] - apexes, axis=2) + np.diag(np.full(len(apexes), np.inf))
    length = float(np.clip(1.2 * np.median(apart.min(axis=1)), SHORTEST, LONGEST))
    width, height = cameras.sizes.double().numpy().T
    ends = np.zeros((len(cameras), 4, 3))
    ends[:, [1, 2], 0], ends[:, [2, 3], 1], ends[..., 2] = width[:, None], height[:, None], 1
    rays = np.einsum("vij,vcj->vci", np.linalg.inv(cameras.K.numpy()), ends)
    rays[..., :2] /= nearer
    rays *= length / max(1.0, float(np.abs(rays[..., :2]).max()))
    return Frusta(apexes, apexes[:, None] + np.einsum("vji,vcj->vci", R, rays), nearer)


def look(up: np.ndarray, ahead: np.ndarray, raised: float, points: np.ndarray, size: int) -> Camera:
    """A far camera that looks down at points by ``raised`` degrees and has all in its picture.

    Args:
        up, ahead: unit vectors [3], at right angles; level, it would look along ``ahead``
        points: [points, 3] in the world
        size: of its square image
    """
    e = np.radians(raised)
    forward = np.cos(e) * ahead - np.sin(e) * up
    down = -np.sin(e) * ahead - np.cos(e) * up
    R = np.stack([np.cross(down, forward), down, forward])
    far = 6 * float(np.linalg.norm(points, axis=1).max())
    camera = Camera(np.eye(3), R, np.array([0, 0, far]), size)
    seen = camera.project(points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    side = (high - low).max() / (1 - 2 * MARGIN)
    return camera.cropped(*((low + high - side) / 2), side, size)


def draw_rings(
    cameras: Cameras,
    mesh: trimesh.Trimesh,
    dropped: Mapping[str, str] | None = None,
    sets: Sequence[Sequence[str]] = (),
) -> Image.Image:
    """Draw the cameras around a mesh.

    Args:
        cameras: in the normalised world
        mesh: in that world; may be empty
        dropped: views without a camera, which are listed
        sets: the views of each set, if the object was turned over between them
    """
    frusta = frusta_of(cameras)
    up = cameras.up.numpy()
    ahead = look_ahead(cameras, up)
    aside = np.cos(np.radians(ASIDE)) * ahead + np.sin(np.radians(ASIDE)) * np.cross(up, ahead)
    notes = list(_notes(len(cameras), frusta.nearer, list(dropped or {}), sets))
    series = _divide(cameras.views, sets)
    width, height = 2 * PANEL + 3 * GAP, HEADER + PANEL + GAP + len(notes) * LINE + GAP
    sheet = Image.new("RGB", (width, height), GROUND)
    draw = ImageDraw.Draw(sheet)
    points = np.concatenate([frusta.apexes, frusta.corners.reshape(-1, 3), mesh.vertices])
    looks = (("obliquely from above", aside, OBLIQUE), ("straight from the top", ahead, TOP))
    for i, (title, towards, raised) in enumerate(looks):
        x = GAP + i * (PANEL + GAP)
        draw.text((x, HEADER / 2), title, fill=INK, font=font(13), anchor="lm")
        observer = look(up, towards, raised, points, FINE * PANEL)
        panel = draw_look(observer, frusta, mesh, cameras.views, series)
        sheet.paste(panel.resize((PANEL, PANEL), Image.Resampling.BOX), (x, HEADER))
    for i, note in enumerate(notes):
        y = HEADER + PANEL + GAP + (i + 0.5) * LINE
        draw.text((GAP, y), note, fill=INK, font=font(12), anchor="lm")
    return sheet


def _divide(views: Sequence[str], sets: Sequence[Sequence[str]]) -> list[list[int]]:
    """Positions of the views of each set that is drawn; all views, if there are no sets."""
    place = {view: i for i, view in enumerate(views)}
    return [[place[view] for view in s if view in place] for s in sets] or [[*range(len(views))]]


def _colour_views(count: int, series: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """A colour for each view: its set's, or from the first's to the last's where there is one."""
    if len(series) > 1:
        of = {i: OF_SETS[n % len(OF_SETS)] for n, part in enumerate(series) for i in part}
        return [of.get(i, FAINT) for i in range(count)]
    shares = [i / max(count - 1, 1) for i in range(count)]
    return [
        tuple(round((1 - s) * a + s * b) for a, b in zip(FIRST, LAST, strict=True)) for s in shares
    ]


def draw_look(
    observer: Camera,
    frusta: Frusta,
    mesh: trimesh.Trimesh,
    views: Sequence[str],
    series: Sequence[Sequence[int]],
) -> Image.Image:
    """One look: what is behind the middle, the mesh, and what is before it.

    Args:
        series: positions of the views that a line joins, of each set
    """
    depth = frusta.apexes @ observer.R[2] + observer.t[2]
    behind = depth > observer.t[2]
    image = Image.new("RGB", (observer.size, observer.size), GROUND)
    draw = ImageDraw.Draw(image, "RGBA")
    path = [tuple(p) for p in observer.project(frusta.apexes)]
    for part in series:
        draw.line([path[i] for i in part], fill=FAINT, width=FINE)
    colours = _colour_views(len(views), series)
    order = np.argsort(-depth)
    _draw_frusta(draw, observer, frusta, colours, [i for i in order if behind[i]])
    _paste_mesh(image, observer, mesh)
    _draw_frusta(draw, observer, frusta, colours, [i for i in order if not behind[i]])
    _label_ends(draw, observer, frusta, views)
    return image


def _draw_frusta(
    draw: ImageDraw.ImageDraw,
    observer: Camera,
    frusta: Frusta,
    colours: Sequence[tuple[int, ...]],
    which: Iterable[int],
) -> None:
    """Draw some frusta in this order; those of the first and the last view are filled."""
    last = len(frusta.apexes) - 1
    for i in which:
        colour = colours[i]
        apex = tuple(observer.project(frusta.apexes[i : i + 1])[0])
        ends = [tuple(p) for p in observer.project(frusta.corners[i])]
        width = (3 if i in (0, last) else 1.4) * FINE
        for a, b in zip(ends, ends[1:] + ends[:1], strict=True):
            if i in (0, last):
                draw.polygon([apex, a, b], fill=(*colour, TINT))
            draw.line([a, b], fill=colour, width=round(width))
            draw.line([apex, a], fill=colour, width=round(width))


def _paste_mesh(image: Image.Image, observer: Camera, mesh: trimesh.Trimesh) -> None:
    if not len(mesh.faces):
        return
    hits = trace(mesh, observer)
    shaded = to_image(shade(mesh, observer, hits, smooth=True))
    image.paste(shaded, mask=Image.fromarray(hits.mask))


def _label_ends(
    draw: ImageDraw.ImageDraw, observer: Camera, frusta: Frusta, views: Sequence[str]
) -> None:
    """Name the first and the last view beyond their frusta; side by side where these are near."""
    middle = observer.project(np.zeros((1, 3)))[0]
    ends = [0, len(views) - 1]
    places = [
        observer.project(np.concatenate([frusta.apexes[i : i + 1], frusta.corners[i]]))
        for i in ends
    ]
    centres = np.array([place.mean(axis=0) for place in places])
    near = bool((np.abs(centres[0] - centres[1]) < NEAR * FINE).all())
    if near:
        places = [np.concatenate(places)] * 2
    anchors = ("rm", "lm") if centres[0, 0] <= centres[1, 0] else ("lm", "rm")
    for i, place, colour, anchor in zip(ends, places, (FIRST, DARK_LAST), anchors, strict=True):
        text = f"{'last' if i else 'first'}: {_shorten(views[i])}"
        below = place[:, 1].mean() >= middle[1]
        y = place[:, 1].max() + 13 * FINE if below else place[:, 1].min() - 13 * FINE
        aside = {"rm": -8 * FINE, "lm": 8 * FINE}[anchor] if near else 0
        anchor = anchor if near else "mm"
        half = draw.textlength(text, font(13 * FINE)) * (1 if near else 0.5) + 12 * FINE
        x = float(np.clip(place[:, 0].mean(), half, observer.size - half)) + aside
        draw.text(
            (x, y), text, fill=colour, font=font(13 * FINE), anchor=anchor,
            stroke_width=2 * FINE, stroke_fill=GROUND,
        )  # fmt: skip


def look_ahead(cameras: Cameras, up: np.ndarray) -> np.ndarray:
    """The level way in which the first camera looks at the object: a unit vector [3].

    In the normalised world that is towards the origin; in any, its own axis is near enough.
    """
    return _level(cameras.R[0, 2].numpy(), up, cameras.R[0].numpy())


def _level(towards: np.ndarray, up: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The level unit vector nearest to ``towards``; of a camera R straight above, its own up."""
    for way in (towards, -R[1]):
        level = way - (way @ up) * up
        if np.linalg.norm(level) > 1e-3 * np.linalg.norm(way):
            return level / np.linalg.norm(level)
    return np.eye(3)[np.abs(up).argmin()]


def _notes(
    count: int, nearer: float, dropped: Sequence[str], sets: Sequence[Sequence[str]]
) -> Iterable[str]:
    where = "" if nearer == 1 else f", drawn at {nearer:.2g} of their distance from the middle"
    yield f"{count} cameras{where}; a thin line joins them in the order of the views"
    if sets:
        ends = [f"{_shorten(s[0])} to {_shorten(s[-1])} ({len(s)})" for s in sets]
        yield f"{len(sets)} sets, a colour each: {name_some(ends, len(OF_SETS))}"
    if dropped:
        yield f"no camera: {name_some([_shorten(name) for name in dropped], LISTED)}"


def _shorten(name: str) -> str:
    return name if len(name) <= 28 else f"{name[:13]}…{name[-14:]}"
