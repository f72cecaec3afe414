"""Lenses: how the image of a camera departs from a pinhole's, by the models that COLMAP names.

One is ours: BROWN, a polynomial of four terms, as Metashape and RealityCapture have it.

A model moves the normalised coordinates (x, y) = (X, Y) / Z of a point before K makes pixels of
them, so it does not depend on how an image was scaled and shifted. The equations are those of
COLMAP's camera models, which are OpenCV's; with r^2 = x^2 + y^2, or theta^2 in place of r^2 where
(x, y) was bent to the angle theta = atan r from the axis first (the fisheye models):

    radial       (x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
                 of the fisheyes, BROWN  (x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8)
    tangential   + (2 p1 x y + p2 (r^2 + 2 x^2),  p1 (r^2 + 2 y^2) + 2 p2 x y)
    thin prism   + (s1 r^2, s2 r^2)
    FOV          (x, y) atan(2 r tan(omega / 2)) / (r omega)
"""

import re
import reprlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from silmesh.errors import InputError, shorten

PLAIN = ("SIMPLE_PINHOLE", "PINHOLE")  # models of COLMAP without distortion
CURVED = {  # models of COLMAP with distortion: their parameters beyond K
    "SIMPLE_RADIAL": ("k1",),
    "RADIAL": ("k1", "k2"),
    "OPENCV": ("k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "SIMPLE_FISHEYE": (),
    "FISHEYE": (),
    "SIMPLE_RADIAL_FISHEYE": ("k1",),
    "RADIAL_FISHEYE": ("k1", "k2"),
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    "THIN_PRISM_FISHEYE": ("k1", "k2", "p1", "p2", "k3", "k4", "s1", "s2"),
    "FOV": ("omega",),
}
PARAMETERS = CURVED | {"BROWN": ("k1", "k2", "k3", "k4", "p1", "p2")}
NAMES = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "omega")
STRANGE = re.compile(  # names of what a file may say of lenses, shutters and projections
    r"[kpsb]\d+|d|xi|omega|alpha|lens|lens_(mode|model|type)|shift_[xy]|camera_type|projection"
    r"|dist_?co.*|transform_matrix_(start|end)"
    r"|.*(distort|fisheye|theta|shutter|ortho|equirect|latlong|panoram|spherical|cylind|skew).*",
    re.IGNORECASE,
)
STRAIGHT = {"pinhole", "perspective", "persp", "opencv", "none", "linear"}  # mean no distortion
SAMPLES = 2000  # radii at which a model is sampled to find where it stops to be monotonic
WIDEST = 20.0  # greatest normalised radius that is considered: 87 degrees from the axis
STEPS, CLOSE = 30, 1e-9  # most iterations of Newton's method, and the residual at which it ends
NUDGE = 1e-6  # step of the central differences


@dataclass(frozen=True)
class Lens:
    """A camera's distortion.

    Attributes:
        model: as COLMAP names it, or BROWN; a key of ``PARAMETERS``
        parameters: those beyond K, in COLMAP's order
    """

    model: str
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in PARAMETERS:
            raise InputError(
                f"camera model {shorten(self.model)} cannot be read; known are "
                f"{', '.join((*PLAIN, *PARAMETERS))}. Other ones are undistorted by the program "
                "that found the cameras, whose new images and cameras can be read"
            )
        names = PARAMETERS[self.model]
        if len(self.parameters) != len(names) or not np.isfinite(self.parameters).all():
            raise InputError(
                f"camera model {self.model!r} takes {len(names)} finite parameters beyond K "
                f"({', '.join(names) or 'none'}), not {shorten(list(self.parameters))}"
            )

    @property
    def bends(self) -> bool:
        """Whether it moves any point at all."""
        return self.model.endswith("FISHEYE") or any(self.parameters)

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Where a pinhole's normalised coordinates [..., 2] lie behind this lens: [..., 2].

        A polynomial turns back somewhere, and beyond it would show a second image of what is
        within: there it is NaN.
        """
        points = np.asarray(points, np.float64)
        moved = self._move(points)
        moved[np.linalg.norm(points, axis=-1) >= self.reach] = np.nan
        return moved

    def undistort(self, points: np.ndarray) -> np.ndarray:
        """The inverse of ``distort`` by Newton's method; NaN for what the lens does not show."""
        goal = np.asarray(points, np.float64)
        found = self._guess(goal)
        for _ in range(STEPS):
            miss = self._move(found) - goal
            if np.abs(miss).max(initial=0) < CLOSE:
                break
            found = found - _solve(self._slopes(found), miss)
            found = np.nan_to_num(found).clip(-WIDEST, WIDEST)
        lost = np.linalg.norm(self._move(found) - goal, axis=-1) > 1e3 * CLOSE
        found[lost | (np.linalg.norm(found, axis=-1) >= self.reach)] = np.nan
        return found

    @cached_property
    def reach(self) -> float:
        """The normalised radius at which the model turns back; infinite if it never does."""
        moved = [self._move(np.outer(_RADII, d)) @ d for d in _DIRECTIONS]
        back = (np.diff(moved, axis=1) <= 0).any(axis=0)
        return float(_RADII[np.argmax(back)]) if back.any() else np.inf

    def _guess(self, goal: np.ndarray) -> np.ndarray:
        """About where ``undistort`` leads: by the radius along x alone."""
        radii = _RADII[: np.searchsorted(_RADII, self.reach, side="right")]
        moved = (self._move(np.outer(radii, _DIRECTIONS[0])) @ _DIRECTIONS[0]).clip(min=0)
        r = np.linalg.norm(goal, axis=-1, keepdims=True)
        return goal * np.interp(r, np.maximum.accumulate(moved), radii) / np.maximum(r, 1e-12)

    def _slopes(self, points: np.ndarray) -> np.ndarray:
        """Derivatives of ``_move`` by differences: [..., 2, 2], rows are what is moved."""
        nudges = NUDGE * np.eye(2)
        columns = [(self._move(points + n) - self._move(points - n)) / (2 * NUDGE) for n in nudges]
        return np.stack(columns, axis=-1)

    def _move(self, points: np.ndarray) -> np.ndarray:
        """``distort`` without a limit."""
        given = zip(PARAMETERS[self.model], self.parameters, strict=True)
        value = dict.fromkeys(NAMES, 0.0) | dict(given)
        r = np.linalg.norm(points, axis=-1, keepdims=True)
        if self.model == "FOV":
            return points * _bend_fov(r, value["omega"])
        fisheye = self.model.endswith("FISHEYE")
        if fisheye:
            points = points * np.where(r > 1e-12, np.arctan(r) / np.maximum(r, 1e-12), 1.0)
        k = [value[f"k{i}"] for i in range(1, 7)]
        r2 = (points**2).sum(axis=-1, keepdims=True)
        if fisheye or self.model == "BROWN":
            radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))
        else:
            radial = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (
                1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]))
            )
        p = np.array([value["p2"], value["p1"]])
        xy = points.prod(axis=-1, keepdims=True)
        s = np.array([value["s1"], value["s2"]])
        return points * radial + p * (r2 + 2 * points**2) + 2 * p[::-1] * xy + s * r2


_RADII = np.linspace(0, WIDEST, SAMPLES) ** 2 / WIDEST  # denser near the axis
_DIRECTIONS = np.stack([np.cos(a := np.arange(8) * np.pi / 4), np.sin(a)], axis=1)


def _solve(slopes: np.ndarray, miss: np.ndarray) -> np.ndarray:
    """x of slopes x = miss for matrices [..., 2, 2]; not finite where one is singular."""
    (a, b), (c, d) = np.moveaxis(slopes, (-2, -1), (0, 1))
    u, v = np.moveaxis(miss, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]


def _bend_fov(r: np.ndarray, omega: float) -> np.ndarray:
    """By how much Devernay and Faugeras' model scales a point at the radius r."""
    if abs(omega) < 1e-6:
        return np.ones_like(r)
    wide = 2 * np.tan(omega / 2)
    return np.where(r > 1e-9, np.arctan(r * wide) / np.maximum(r, 1e-9), wide) / omega


def lens_of(model: str, parameters: Sequence[float]) -> Lens | None:
    """The lens of a camera model and its parameters beyond K; None for one that bends nothing."""
    if model in PLAIN:
        return None
    lens = Lens(model, tuple(float(p) for p in parameters))
    return lens if lens.bends else None


def refuse_strange(fields: Mapping[str, Any], known: Collection[str]) -> None:
    """Refuse what a file says of a camera's lens, shutter or projection that is not read.

    Zeros, nothing, and words for a pinhole are let pass, and a focal length that is called lens.

    Raises:
        InputError: a field beside the known ones says something
    """
    for key, value in fields.items():
        if key in known or not STRANGE.fullmatch(key) or _says_nothing(value):
            continue
        if key.lower() == "lens" and isinstance(value, int | float):
            continue
        raise InputError(
            f"{key} = {reprlib.repr(value)} says that the camera has a lens, a shutter or a "
            "projection that is not read; undistort the photographs, by the program that found "
            "the cameras, and give its new images and cameras"
        )


def _says_nothing(value: Any) -> bool:
    if isinstance(value, list):
        return not any(value)
    if isinstance(value, str):
        return value.lower() in STRAIGHT or not value
    return not value
