"""The one camera convention: pinhole cameras, how they project, and ``cameras.json``.

Camera   OpenCV: x right, y down, z forward. A world point X is seen at the pixel (u, v) with
         z (u, v, 1) = K (R X + t). Pixel centres lie at integer + 0.5 (COLMAP's convention).
World    right-handed, y up. The initial mesh and the fit live in a world that is normalised so
         that the object lies in the sphere of radius 0.5 about the origin.

                 y                      +-----------> u (width)
                 |                      | .(0.5, 0.5) is the first pixel's centre
                 o--- x                 |
                /                       v
               z                        (height)

Lens     a camera may have one (``silmesh.geometry.lens``) until its images are undistorted for the
         scene; what projects, projects as the pinhole, and the scene's cameras are just that.

SoftRas's ``look_at`` is left-handed: its world is the mirror image (z negated) of this one. The
conversion is in ``silmesh.cameras.turntable`` and nowhere else.
"""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from silmesh.errors import InputError, blaming, cut, explain, shorten
from silmesh.files import replacing
from silmesh.geometry.lens import Lens, lens_of, refuse_strange
from silmesh.reading import read_json

MOST = 20_000  # most cameras of a file that is read
WIDEST = 1_000_000  # pixels: greatest width and height of a photograph
LARGEST = 1e15  # greatest number in a file, whose cube is still finite
ROUNDING = 1e-4  # error of a rotation matrix that is accepted, as of four decimals
OPENGL = np.diag([1.0, -1.0, -1.0])  # from OpenGL's camera axes (y up, looking along -z) to ours
MIRROR = (1.0, 1.0, -1.0)  # from a left-handed world to its mirror image, which is right-handed
OBJECT_RADIUS = 0.5  # of the sphere about the origin that holds the object in the normalised world
INITIAL_SCALE = 2.0  # size of an initial mesh in its file over that in the fit, as in the report


@dataclass(frozen=True)
class Cameras:
    """The cameras of all views of an object, in one order.

    Attributes:
        views: name of each view, the stem of its photograph
        sizes: [views, 2] int64, width and height in pixels
        K: [views, 3, 3] float64, intrinsics in pixels
        R: [views, 3, 3] float64, rotation from world to camera
        t: [views, 3] float64, translation from world to camera
        lenses: of each view what its photograph departs from the pinhole by, or None
    """

    views: tuple[str, ...]
    sizes: Tensor
    K: Tensor
    R: Tensor
    t: Tensor
    lenses: tuple[Lens | None, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "lenses", self.lenses or (None,) * len(self.views))

    def __len__(self) -> int:
        return len(self.views)

    @property
    def centres(self) -> Tensor:
        """Where the cameras stand in the world: [views, 3]."""
        return -(self.R.mT @ self.t.unsqueeze(-1)).squeeze(-1)

    @property
    def up(self) -> Tensor:
        """The upright of cameras that stand upright, a unit vector [3].

        It is what is most square to the rows of all images, turned to the cameras' own up; the
        mean of their ups would lean where they look down from one side only.
        """
        across = self.R[:, 0]
        up = torch.linalg.eigh(across.mT @ across)[1][:, 0]
        return up if up @ self.R[:, 1].mean(0) <= 0 else -up

    @property
    def projections(self) -> Tensor:
        """Projection matrices K [R | t]: [views, 3, 4]."""
        return self.K @ torch.cat([self.R, self.t.unsqueeze(-1)], dim=-1)

    def project(self, verts: Tensor) -> Tensor:
        """Project world points into every view.

        Args:
            verts: [verts, 3] in the world
        Returns:
            [views, verts, 2] pixels, x right and y down, of the dtype and on the device of
            ``verts``. A point that is not in front of a camera is NaN in that view, which leaves
            its faces out of the rendering, and passes no gradient.
        """
        P = self.projections.to(verts)
        projected = verts @ P[:, :, :3].mT + P[:, None, :, 3]
        depth = projected[..., 2:]
        in_front = depth > 0
        points = projected[..., :2] / torch.where(in_front, depth, 1)
        return torch.where(in_front, points, math.nan)

    def depths(self, verts: Tensor) -> Tensor:
        """Distance of world points along each camera's axis: [views, verts]."""
        return self.R[:, 2].to(verts) @ verts.mT + self.t[:, 2:].to(verts)

    def meet(self, pixels: Tensor) -> Tensor:
        """The point closest to the rays through one pixel [views, 2] of each view: [3].

        It solves sum_i (1 - d_i d_i^T) (x - c_i) = 0 for rays from c_i along the unit vectors d_i.

        Raises:
            InputError: the rays are parallel
        """
        homogeneous = torch.cat([pixels, torch.ones_like(pixels[:, :1])], dim=1)
        rays = torch.linalg.solve(self.K, homogeneous)
        along = torch.nn.functional.normalize((self.R.mT @ rays.unsqueeze(-1)).squeeze(-1), dim=1)
        across = torch.eye(3, dtype=along.dtype) - along.unsqueeze(2) * along.unsqueeze(1)
        left = across.sum(0)
        if torch.linalg.eigvalsh(left)[0] < 1e-6 * len(self):
            raise InputError(
                "the cameras all look along one line; views from several sides are needed"
            )
        return torch.linalg.solve(left, (across @ self.centres.unsqueeze(-1)).sum(0).squeeze(-1))

    def select(self, index: Sequence[int]) -> "Cameras":
        """Only the views at these positions, in this order."""
        at = places(index)
        return Cameras(
            tuple(self.views[i] for i in index),
            self.sizes[at],
            self.K[at],
            self.R[at],
            self.t[at],
            tuple(self.lenses[i] for i in index),
        )

    def to(self, device: torch.device | str) -> "Cameras":
        """The same on a device, where they project; their sizes stay."""
        K, R, t = (part.to(device) for part in (self.K, self.R, self.t))
        return replace(self, K=K, R=R, t=t)

    def shrink(self, factor: float, size: tuple[int, int]) -> "Cameras":
        """The same cameras for images that are smaller by a factor, of this height and width."""
        maps = _shrinking(factor, self.K.device).expand(len(self), 3, 3)
        return self.in_pixels_of(maps, torch.tensor([size[::-1]]).expand(len(self), 2))

    def named(self, views: Sequence[str]) -> "Cameras":
        """The same cameras under other names."""
        return replace(self, views=tuple(views))

    def in_pixels_of(self, maps: Tensor, sizes: Tensor) -> "Cameras":
        """The same cameras for images that were scaled and shifted.

        Args:
            maps: [views, 3, 3] from homogeneous pixels of the old images to those of the new
            sizes: [views, 2] width and height of the new images
        """
        return replace(self, sizes=sizes, K=maps.to(self.K) @ self.K)

    def in_mirrored_world(self) -> "Cameras":
        """The same pictures of the mirrored world: R X + t = (R M) (M X) + t for M = diag(MIRROR).

        An R that is a rotation becomes a reflection, and the other way round.
        """
        return replace(self, R=self.R * torch.tensor(MIRROR, dtype=self.R.dtype))

    def turned_round(self) -> "Cameras":
        """The same lines of sight seen the other way: what was behind a camera is before it.

        R becomes a reflection where it was a rotation, and the other way round.
        """
        return replace(self, R=-self.R, t=-self.t)

    def in_world_of(self, similarity: "Similarity") -> "Cameras":
        """The same cameras seen from a world that was shifted and scaled.

        A point X of the old world is s (X - c) in the new one, so R X + t becomes, up to the
        scale s that no image shows, R X' + s (R c + t).
        """
        c = similarity.centre.to(self.R)
        return replace(self, t=similarity.scale * (self.R @ c + self.t))


def places(index: Sequence[int]) -> slice | list[int]:
    """Positions as a tensor takes them: a range without copying, nor asking for a GPU's answer."""
    if isinstance(index, range):
        return slice(index.start, index.stop, index.step)
    return list(index)


@cache
def _shrinking(factor: float, device: torch.device) -> Tensor:
    """The map [3, 3] to the pixels of images that are smaller by a factor, kept on its device."""
    return torch.diag(torch.tensor([1 / factor, 1 / factor, 1.0])).double().to(device)


@dataclass(frozen=True)
class Similarity:
    """From the input's own world to the normalised one: X' = scale (X - centre)."""

    centre: Tensor  # [3] float64
    scale: float

    @staticmethod
    def identity() -> "Similarity":
        """Leave the world as it is."""
        return Similarity(torch.zeros(3, dtype=torch.float64), 1.0)

    @staticmethod
    def centring(box: np.ndarray) -> "Similarity":
        """To the world in which a box, [2, 3] its ends, is about the origin; its diagonal is 1."""
        return Similarity(
            torch.as_tensor(box.mean(axis=0)), 1 / float(np.linalg.norm(box[1] - box[0]))
        )

    def apply(self, verts: Tensor) -> Tensor:
        """Points [n, 3] of the input's world, in the normalised one."""
        return (verts - self.centre.to(verts)) * self.scale

    @property
    def inverse(self) -> "Similarity":
        """From the normalised world back: X = X' / s + c = (X' + s c) / s."""
        return Similarity(-self.scale * self.centre, 1 / self.scale)


def concatenate(*cameras: Cameras) -> Cameras:
    """Cameras of different views of one world, as one."""
    return Cameras(
        tuple(view for one in cameras for view in one.views),
        *(torch.cat([getattr(one, name) for one in cameras]) for name in ("sizes", "K", "R", "t")),
        tuple(lens for one in cameras for lens in one.lenses),
    )


def write_cameras(path: Path | str, cameras: Cameras) -> None:
    """Write ``cameras.json``: a list of ``{view, width, height, K, R, t}``.

    A camera that has a lens also has ``lens``: ``{model, parameters}``.
    """
    rows = [
        {
            "view": view,
            "width": int(cameras.sizes[i, 0]),
            "height": int(cameras.sizes[i, 1]),
            "K": cameras.K[i].tolist(),
            "R": cameras.R[i].tolist(),
            "t": cameras.t[i].tolist(),
        }
        | ({"lens": asdict(lens)} if (lens := cameras.lenses[i]) else {})
        for i, view in enumerate(cameras.views)
    ]
    with replacing(path) as part:
        part.write_text(
            "[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n", encoding="utf-8"
        )


def read_cameras(path: Path | str, mirrors: bool = False) -> Cameras:
    """Read ``cameras.json``.

    Args:
        mirrors: whether R may be a reflection, as in a left-handed world

    Raises:
        InputError: the file is not such a list, a matrix has another shape or is not a rotation,
            a view comes twice
    """
    rows = read_json(Path(path))
    if not isinstance(rows, list) or not rows:
        raise InputError(
            f"{path}: should be a list of {{view, width, height, K, R, t}}, one for each photograph"
        )
    refuse_many(path, len(rows))
    cameras = [_parse_row(row, f"{path}: camera {i}", mirrors) for i, row in enumerate(rows)]
    views = [view for view, *_ in cameras]
    if twice := sorted(view for view, count in Counter(views).items() if count > 1):
        raise InputError(f"{path}: view {shorten(twice[0])} comes twice; each view has one camera")
    *numbers, lenses = list(zip(*cameras, strict=True))[1:]
    return Cameras(tuple(views), *map(torch.stack, numbers), lenses)


def refuse_many(path: Path | str, count: int) -> None:
    """Refuse a file of more cameras than anyone takes photographs, before each is looked at."""
    if count > MOST:
        raise InputError(f"{path}: holds {count:,} cameras; should be at most {MOST:,}")


def _parse_row(
    row: object, where: str, mirrors: bool
) -> tuple[str, Tensor, Tensor, Tensor, Tensor, Lens | None]:
    """One camera of ``cameras.json``, checked: view, size, K, R, t, lens."""
    if not isinstance(row, dict):
        raise InputError(f"{where}: should be an object with view, width, height, K, R and t")
    for key in ("view", "width", "height", "K", "R", "t"):
        if key not in row:
            raise InputError(f"{where}: {key!r} is missing")
    where = f"{where} ({cut(str(row['view']), 80)})"
    with blaming(where):
        refuse_strange(row, ("lens",))
    K = _parse_array(row["K"], (3, 3), f"{where}: K")
    R = _parse_array(row["R"], (3, 3), f"{where}: R")
    t = _parse_array(row["t"], (3,), f"{where}: t")
    size = _parse_array([row["width"], row["height"]], (2,), f"{where}: width and height")
    if size.min() < 1 or size.max() > WIDEST or not torch.equal(size, size.round()):
        raise InputError(
            f"{where}: width and height should be 1, 2, ..., {WIDEST}, not {size.tolist()}"
        )
    off = float((R @ R.mT - torch.eye(3, dtype=R.dtype)).abs().max())
    if off > ROUNDING or (R.det() < 0 and not mirrors):
        raise InputError(
            f"{where}: R should be a rotation (R R^T = 1 to within {ROUNDING:g}, det R = +1); "
            f"R R^T is off by {off:.2g}, det R = {R.det():.4g}"
        )
    below = [K[1, 0], *K[2]]
    if K[0, 0] <= 0 or K[1, 1] <= 0 or below != [0, 0, 0, 1]:
        raise InputError(
            f"{where}: K should be [[fx, s, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0, "
            f"not {shorten(K.tolist())}"
        )
    return str(row["view"]), size.long(), K, R, t, _parse_lens(row.get("lens"), where)


def _parse_lens(value: object, where: str) -> Lens | None:
    if value is None:
        return None
    if not isinstance(value, dict) or set(value) != {"model", "parameters"}:
        raise InputError(f"{where}: lens should be {{model, parameters}}, not {shorten(value)}")
    count = len(value["parameters"]) if isinstance(value["parameters"], list) else 0
    given = _parse_array(value["parameters"], (count,), f"{where}: lens: parameters")
    with blaming(where):
        return lens_of(str(value["model"]), given.tolist())


def _parse_array(value: object, shape: tuple[int, ...], where: str) -> Tensor:
    try:
        if value is None:
            raise TypeError("not null")
        array = torch.from_numpy(np.array(value, dtype=object).astype(np.float64))
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise InputError(
            f"{where} should be numbers of shape {list(shape)}: {explain(error)}"
        ) from error
    if array.shape != shape:
        raise InputError(
            f"{where} should be finite numbers of shape {list(shape)}, not {list(array.shape)}"
        )
    if not array.isfinite().all():
        raise InputError(f"{where} should be finite numbers, not {shorten(array.tolist())}")
    if (array.abs() > LARGEST).any():
        raise InputError(
            f"{where} should be numbers up to {LARGEST:g}, not {shorten(array.tolist())}"
        )
    return array
