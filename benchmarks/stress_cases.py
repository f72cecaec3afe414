"""The cases of ``stress.py``: an object, photographed, then damaged, in memory and as files.

A case is all in working images: square, the photographs within them in frames. Its cameras' world
is the normalised one, in which the truth lies, too.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import damage
import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from PIL import Image
from scenery import read_scan, stand_upright, texture_paint
from volumes import cast, two_rings

import silmesh
from silmesh.cameras.turntable import turntable_cameras
from silmesh.geometry.camera import Cameras, write_cameras
from silmesh.geometry.frame import whole_frames
from silmesh.synthetic.dataset import find_paint, make_object
from silmesh.synthetic.layout import OBJECTS
from silmesh.synthetic.orbit import DISTANCE, ELEVATION
from silmesh.synthetic.photograph import photograph

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
SCANS = {
    "blue_cup": ("scans/blue_cup.glb", 2),
    "shampoo": ("scans/shampoo.glb", 1),
}  # file and upward axis
REAL = {  # photographs, masks and cameras
    "moisturiser": (
        "aloi_moisturiser/png2/moisturiser",
        "aloi_moisturiser/mask2/moisturiser",
        "calibrate",
    ),
    "bunny": ("bunny/images", "bunny/masks", "bunny/projections"),
    "head": ("head/images", "head/masks", "head/poses_bounds.npy"),
    "axe": ("axe/images", "axe/masks", "axe/cameras.xml"),
}
STRANGERS = ("plane", "pot")  # whose silhouettes stand for another object's


@dataclass(frozen=True)
class Case:
    """What is given of an object, and what is true of it.

    Attributes:
        truth: the true mesh, of those that have one
        cameras, masks: true, [views, size, size] bool, nothing outside the frames
        frames: [views, 4] left, top, right and bottom of the photographs
        pictures: [views, size, size, 3] uint8
        given_cameras, given_masks: what is told
        wrong: positions of the views that are damaged
        unseen: the views that are not given, of a case that has fewer
    """

    truth: trimesh.Trimesh | None
    cameras: Cameras
    masks: NDArray[np.bool_]
    frames: NDArray[np.int64]
    pictures: NDArray[np.uint8]
    given_cameras: Cameras
    given_masks: NDArray[np.bool_]
    wrong: tuple[int, ...] = ()
    repaint: Callable | None = None
    unseen: "Case | None" = None

    def select(self, index: list[int]) -> "Case":
        """Only these views."""
        return replace(
            self,
            cameras=self.cameras.select(index),
            masks=self.masks[index],
            frames=self.frames[index],
            pictures=self.pictures[index],
            given_cameras=self.given_cameras.select(index),
            given_masks=self.given_masks[index],
        )

    def told(self, given: tuple) -> "Case":
        """The same with other masks, or other cameras, and the positions of the wrong ones."""
        value, wrong = given
        name = "given_cameras" if isinstance(value, Cameras) else "given_masks"
        return replace(self, wrong=tuple(wrong), **{name: value})


Damage = Callable[[Case, tuple, int], Case]


def _on_masks(harm: Callable) -> Damage:
    return lambda case, strength, seed: case.told(harm(case.masks, *strength, seed))


def _on_cameras(harm: Callable) -> Damage:
    return lambda case, strength, seed: case.told(harm(case.cameras, *strength, seed))


def _leave(case: Case, strength: tuple, seed: int) -> Case:
    return case


def _fill(case: Case, strength: tuple, seed: int) -> Case:
    return case.told(damage.fill(case.masks, *strength, seed, case.frames))


def _thin_out(case: Case, strength: tuple, seed: int) -> Case:
    kept = damage.thin_out(len(case.masks), *strength)
    others = np.setdiff1d(np.arange(len(case.masks)), kept).tolist()
    return replace(case.select(kept), unseen=case.select(others))


def _step_nearer(case: Case, strength: tuple, seed: int) -> Case:
    """Portrait photographs of which a share is cut, taken anew where there is a truth.

    None of them is wrong: a frame is no outline.
    """
    maps, frames, _ = damage.step_nearer(case.masks, *strength, seed)
    nearer = case.cameras.in_pixels_of(torch.from_numpy(maps), case.cameras.sizes)
    if case.repaint:
        pictures, masks = case.repaint(nearer)
    else:
        masks = damage.look_through(case.masks, maps, frames)
        pictures = _look_through(case.pictures, maps)
    masks = damage.keep_inside(masks, frames)
    return _clean(case.truth, nearer, masks, frames, pictures, case.repaint)


def _swap(case: Case, strength: tuple, seed: int) -> Case:
    return case.told(damage.swap(case.masks, _strangers(case), *strength, seed))


DAMAGES: dict[str, tuple[Damage, tuple[tuple, ...], str]] = {
    "clean": (_leave, ((),), "clean"),
    "bite": (
        _on_masks(damage.bite),
        ((0.05, 0.05), (0.1, 0.2), (0.15, 0.2), (0.15, 0.4), (0.2, 0.4)),
        "bites of {0:.0%} in {1:.0%}",
    ),
    "speck": (
        _on_masks(damage.add_specks),
        ((0.005, 1.0), (0.02, 0.4)),
        "specks of {0:.1%} in {1:.0%}",
    ),
    "blob": (
        _on_masks(damage.add_blobs),
        ((0.05, 0.2), (0.15, 0.4)),
        "blobs of {0:.0%} in {1:.0%}",
    ),
    "outline": (
        _on_masks(damage.grow),
        ((-4, 1.0), (-2, 1.0), (-1, 1.0), (1, 1.0), (2, 1.0), (4, 1.0), (-2, 0.4), (2, 0.4)),
        "outlines moved by {0:+} pixels in {1:.0%}",
    ),
    "empty": (
        _on_masks(damage.empty),
        ((0.05,), (0.15,), (0.4,)),
        "empty masks, {0:.0%}",
    ),
    "full": (
        _fill,
        ((0.05,), (0.15,), (0.4,)),
        "full masks, {0:.0%}",
    ),
    "other": (_swap, ((0.05,), (0.15,), (0.3,), (0.4,)), "another object's masks, {0:.0%}"),
    "shaken": (
        _on_cameras(damage.shake),
        ((0.2,), (0.5,), (1.0,), (2.0,)),
        "cameras shaken by {0:g} degrees",
    ),
    "misplaced": (
        _on_cameras(damage.misplace),
        ((0.05,), (0.1,), (0.2,)),
        "cameras wrong, {0:.0%}",
    ),
    "cut": (_step_nearer, ((0.2,), (0.4,), (0.6,)), "close-ups that the frame cuts, {0:.0%}"),
    "views": (
        _thin_out,
        ((4,), (6,), (8,), (12,)),
        "{0} views",
    ),
}


def name_cell(kind: str, strength: tuple) -> str:
    """What tables call a damage at a strength."""
    return DAMAGES[kind][2].format(*strength)


@cache
def make_clean(name: str, views: int, size: int, ring: bool) -> Case:
    """An object before any damage.

    Args:
        ring: made-up objects and scans turn before one camera, so that ``calibrate`` can find it;
            otherwise half of the views look down from higher up
    """
    if name in REAL:
        return _read_real(name, views, size)
    if name in OBJECTS:
        mesh, paint = stand_upright(make_object(name)), find_paint(name)
    else:
        path, up = SCANS[name]
        mesh = stand_upright(read_scan(DATA / path), up)
        paint = texture_paint(mesh)
    cameras = two_rings(views, size)
    if ring:
        cameras = turntable_cameras(cameras.views, size, DISTANCE, ELEVATION, 360 / views)

    def repaint(seen: Cameras) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        pictures, masks = zip(*photograph(mesh, seen, paint), strict=True)
        return np.stack(pictures), np.stack(masks)

    pictures, masks = repaint(cameras)
    return _clean(mesh, cameras, masks, whole_frames(masks), pictures, repaint)


def damage_case(clean: Case, kind: str, strength: tuple, seed: int) -> Case:
    """A clean case with one damage."""
    return DAMAGES[kind][0](clean, strength, seed)


def write_case(case: Case, folder: Path, size: int, calibrated: bool) -> None:
    """A case as a person would give it: photographs, masks, and cameras in their pixels."""
    for kind in ("photographs", "masks"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    given = case.given_cameras
    for view, frame, picture, mask in zip(
        given.views, case.frames, case.pictures, case.given_masks, strict=True
    ):
        left, top, right, bottom = frame
        for kind, image in (("photographs", picture), ("masks", np.uint8(255) * mask)):
            shown = Image.fromarray(image[top:bottom, left:right])
            shown.save(folder / kind / f"{view}.png")
    shift = torch.eye(3, dtype=torch.float64).repeat(len(given), 1, 1)
    frames = torch.from_numpy(case.frames)
    shift[:, :2, 2] = -frames[:, :2].double()
    own = given.in_pixels_of(shift, frames[:, 2:] - frames[:, :2])
    write_cameras(folder / "cameras.json", own)
    cameras = "calibrate" if calibrated else str((folder / "cameras.json").resolve())
    (folder / "case.json").write_text(json.dumps({"size": size, "cameras": cameras}))


def _clean(
    truth: trimesh.Trimesh | None,
    cameras: Cameras,
    masks: NDArray[np.bool_],
    frames: NDArray[np.int64],
    pictures: NDArray[np.uint8],
    repaint: Callable | None,
) -> Case:
    return Case(truth, cameras, masks, frames, pictures, cameras, masks, (), repaint)


def _read_real(name: str, views: int, size: int) -> Case:
    """Real photographs with the cameras that clean masks give or that are known."""
    images, masks, cameras = REAL[name]
    shown = silmesh.read_photographs(DATA / images, size=size)
    found = silmesh.find_silhouettes(shown, DATA / masks)
    source = cameras if cameras == "calibrate" else DATA / cameras
    scene = silmesh.find_cameras(shown, found, source)
    names = scene.cameras.views
    pictures = np.stack([np.asarray(scene.images[view].convert("RGB")) for view in names])
    whole = _clean(None, scene.cameras, scene.silhouettes, scene.frames, pictures, None)
    return whole.select(damage.thin_out(len(names), min(views, len(names))))


def _strangers(case: Case) -> NDArray[np.bool_]:
    """As many silhouettes of another object, which shares none with this one."""
    count, size = case.masks.shape[:2]
    known = [make_stranger(name, count, size) for name in STRANGERS]
    own = ((masks == case.masks).all(axis=(1, 2)).any() for masks in known)
    return next(masks for masks, alike in zip(known, own, strict=True) if not alike)


@cache
def make_stranger(name: str, views: int, size: int) -> NDArray[np.bool_]:
    """The silhouettes of an object in as many views."""
    return cast(stand_upright(make_object(name)), two_rings(views, size))


def _look_through(pictures: NDArray[np.uint8], maps: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Pictures [views, size, size, 3] scaled and shifted, black beyond what they show."""
    return np.stack(
        [
            np.asarray(
                Image.fromarray(picture).transform(
                    picture.shape[1::-1],
                    Image.Transform.AFFINE,
                    np.linalg.inv(way)[:2].ravel(),
                    Image.Resampling.BILINEAR,
                )
            )
            for picture, way in zip(pictures, maps, strict=True)
        ]
    )
