"""Whether what the photographs make of a surface is better: photographs that were kept out say so.

Every HELD-th photograph is kept out of the refinement. Its pixels are then predicted by the others:
a pixel's ray meets the surface, the point there is looked up in the nearest views that see it, and
what they show is compared with what the photograph shows, by PSNR of the colours and by normalised
cross-correlation (NCC) of the brightness in small blocks. A surface in the wrong place looks up the
wrong colours. Only what the refinement moved is judged; the rest is the same for both.

A first, coarse surface is judged in the same way, beside the old one on the same coarse grid: where
it predicts nothing better, by neither measure, a finer one is not tried. Where the photographs
confirm the finer one, the surface is refined once more by all photographs, those included, and that
surface is taken if it passes the same judgement, which is no independent one then.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.ndimage import minimum_filter

from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.geometry.resampling import resample
from silmesh.geometry.small_images import LARGEST, shrink
from silmesh.progress import Share, untold, within
from silmesh.relief.free_space import Grid
from silmesh.relief.refinement import Doubt, Relief, refine
from silmesh.relief.surface import GUESS, STANDINGS, judge_standing

HELD = 6  # every so many-th photograph is kept out
FEWEST = 8  # photographs: of fewer too few are left to agree
NEIGHBOURS = 4  # views that predict a photograph
BLOCKS, BLOCK = 400, 5  # of a photograph, and their side in pixels
FLAT = 2.0  # grey levels: a block or a photograph that varies less shows nothing
MOVED = 0.002  # of the mesh's size: a surface that is so much nearer or farther is another
LEAST = 100  # pixels that must have moved to be judged
GAIN = 0.5  # dB that is better: wrong surfaces that glossy objects suggested gained up to 0.31
TRIED = "one by the photographs was tried"
HINT = 0.1, 0.02  # dB, or NCC, that a coarse surface has to gain for a finer one to be tried
LOST = 0.001  # of the silhouettes' IoU that may be lost
LIFT = 1e-4  # of the mesh's size: rays start so far above the surface


@dataclass(frozen=True)
class Judged:
    """A surface after photo-consistency was tried.

    Attributes:
        mesh: refined, or the one that was given
        standing: [verts] uint8, what each vertex stands on, a position in ``STANDINGS``
        notes: for JSON: ``surface``, the share of each; whether it was ``taken``, ``because`` of
            what, and both ``said`` in a line; where it was tried also ``held_out``, ``psnr``,
            ``ncc`` and ``iou`` before and after, what filled its outlines, ``seconds`` and
            the refinement's own notes; where it was taken, ``by_all``: the same of the surface
            by all photographs, and whether it was ``taken``
    """

    mesh: trimesh.Trimesh
    standing: np.ndarray
    notes: dict[str, Any]


def refine_if_better(
    mesh: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    cameras: Cameras,
    overlap: Callable[[trimesh.Trimesh], float],
    kept: Sequence[int] | None = None,
    seed: int = 0,
    progress: Share = untold,
    by: Callable[..., Relief] = refine,
    mend: Callable[[trimesh.Trimesh], trimesh.Trimesh] | None = None,
    span: Callable[[trimesh.Trimesh], trimesh.Trimesh] | None = None,
) -> Judged:
    """Refine a surface by photographs, and take it if photographs that were kept out agree.

    Args:
        mesh, originals, silhouettes, cameras, seed, progress: as ``refine`` has them
        overlap: measures the mean IoU of a mesh with the silhouettes
        kept: positions of the views that are believed; all if not given
        by: what refines
        mend: moves the vertices of a mesh back to the silhouettes, if these are lost otherwise
        span: moves those that no view sees, as ``silmesh.geometry.unseen.span_unseen`` does
    """
    started = time.perf_counter()
    views = list(range(len(cameras)) if kept is None else kept)
    before = _stand(mesh, silhouettes, cameras, views)
    if doubt := _find_doubt(originals, silhouettes, views):
        return _stay(mesh, before, doubt, {}, started)
    held = views[HELD - 1 :: HELD]
    used = [view for view in views if view not in held]
    scene = _Scene(mesh, originals, silhouettes, overlap, mend, span)
    given = mesh, originals, silhouettes, cameras
    relief = by(*given, used, seed, within(progress, 0, 0.7), None, scene.doubt_by(held, used))
    notes = {"held_out": [cameras.views[i] for i in held], "refinement": relief.notes}
    if not relief.changed:
        return _stay(mesh, before, str(relief.notes["reason"]), notes, started)
    first = _judge(relief, scene, held, used)
    notes |= first.notes
    if not first.better:
        return _stay(mesh, before, first.why, notes, started)
    relief = by(*given, views, seed, within(progress, 0.7, 1), relief.found)
    whole = _judge(relief, scene, held, used) if relief.changed else first
    taken = whole if whole.better else first
    notes["by_all"] = {"taken": taken is not first, "because": whole.why, **whole.notes}
    said = _describe(True, first.why, taken.standing, notes, started)
    return Judged(taken.mesh, taken.standing, said)


@dataclass(frozen=True)
class _Scene:
    """What surfaces are judged by: see ``refine_if_better``; ``mesh`` is the one to be beaten."""

    mesh: trimesh.Trimesh
    originals: Originals
    silhouettes: np.ndarray
    overlap: Callable[[trimesh.Trimesh], float]
    mend: Callable[[trimesh.Trimesh], trimesh.Trimesh] | None
    span: Callable[[trimesh.Trimesh], trimesh.Trimesh] | None

    def doubt_by(self, held: Sequence[int], used: Sequence[int]) -> Doubt:
        """Why a coarse surface is a hint at nothing better, as ``refine`` asks for it."""

        def doubt(mesh: trimesh.Trimesh, surface: trimesh.Trimesh) -> str:
            seen = compare(mesh, surface, self.originals, self.silhouettes, held, used)
            return _find_no_hint(seen)

        return doubt


@dataclass(frozen=True)
class _Proposal:
    """A refined surface whose outlines are filled, and what was found of it."""

    mesh: trimesh.Trimesh
    standing: np.ndarray
    better: bool
    why: str
    notes: dict[str, Any]


def _judge(relief: Relief, scene: _Scene, held: Sequence[int], used: Sequence[int]) -> _Proposal:
    """Whether a refined surface predicts the photographs at ``held`` better.

    It is judged as it was led back to the outlines. Where it lost a trace of them only, and is not
    confirmed so, it is judged as it is.
    """
    new = _as_written(relief)
    before, after = map(scene.overlap, (scene.mesh, new))
    as_is = new, {"iou": _pair(before, after), "mended": False}
    mended = _lead_back(scene, new, before, after)
    if mended is None:
        return _weigh(*as_is, relief.standing, scene, held, used)
    found = _weigh(*mended, relief.standing, scene, held, used)
    if found.better or before - after > LOST:
        return found
    return _weigh(*as_is, relief.standing, scene, held, used)


def _weigh(
    refined: trimesh.Trimesh,
    notes: dict[str, Any],
    standing: np.ndarray,
    scene: _Scene,
    held: Sequence[int],
    used: Sequence[int],
) -> _Proposal:
    """The same of a surface, once its ends are spanned; its ``notes`` begin with its ``iou``."""
    if scene.span:
        spanned = scene.span(refined)
        moved = (spanned.vertices != refined.vertices).any(axis=1)
        if moved.any():
            refined, standing = spanned, np.where(moved, GUESS, standing)
            notes["iou"]["after"] = scene.overlap(refined)
    notes |= compare(scene.mesh, refined, scene.originals, scene.silhouettes, held, used)
    why, better = _decide(notes["iou"], notes)
    return _Proposal(refined, standing, better, why, notes)


def compare(
    old: trimesh.Trimesh,
    new: trimesh.Trimesh,
    originals: Originals,
    silhouettes: np.ndarray,
    held: Sequence[int],
    used: Sequence[int],
) -> dict[str, Any]:
    """How well two surfaces predict the photographs at ``held`` from those at ``used``.

    Returns:
        ``moved``, how many of the pixels that were looked at lie where the surfaces differ;
        ``psnr`` in dB and ``ncc``, each with ``before`` and ``after``, there, None if there is no
        such pixel; ``psnr_all``, of all pixels
    """
    blocks = [_pick(originals, silhouettes, i) for i in held]
    hits = [[_meet(body, block) for block in blocks] for body in (old, new)]
    seen = [
        _predict(body, hit, blocks, originals, used)
        for body, hit in zip((old, new), hits, strict=True)
    ]
    scale, errors, correlations, moved = old.scale, ([], []), ([], []), []
    for i, block in enumerate(blocks):
        both = np.isfinite(seen[0][i][:, 0]) & np.isfinite(seen[1][i][:, 0])
        apart = np.linalg.norm(hits[0][i].points - hits[1][i].points, axis=1) > MOVED * scale
        moved.append((both & apart)[both])
        for side in (0, 1):
            error = ((seen[side][i] - block.colours) ** 2).mean(axis=1)
            errors[side].append(error[both])
            correlations[side].append(_correlate(seen[side][i], block.colours, both & apart))
    where = np.concatenate(moved)
    told = [np.concatenate(side) for side in errors]
    alike = [np.concatenate(side) for side in correlations]
    return {
        "moved": int(where.sum()),
        "pixels": len(where),
        "psnr": _pair(*(_psnr(error[where]) for error in told)),
        "psnr_all": _pair(*map(_psnr, told)),
        "ncc": _pair(*(_mean(found) for found in alike)),
    }


@dataclass(frozen=True)
class _Blocks:
    """Pixels of a photograph in blocks that lie within the silhouette.

    Attributes:
        eye: [3] of its camera
        rays: [n, 3] through the pixels, a block's BLOCK * BLOCK pixels after one another
        colours: [n, 3] as it shows them, 0 to 255
    """

    eye: np.ndarray
    rays: np.ndarray
    colours: np.ndarray


@dataclass(frozen=True)
class _Hits:
    """Where rays meet a mesh first: [n, 3] points and unit normals, NaN where they miss it."""

    points: np.ndarray
    normals: np.ndarray


def _find_doubt(originals: Originals, silhouettes: np.ndarray, views: Sequence[int]) -> str:
    """Why there is nothing to be tried; "" if there is."""
    if len(views) < FEWEST:
        return f"of {len(views)} photographs too few would be left; {FEWEST} are needed"
    some = views[:: max(1, len(views) // 5)]
    if np.median([_vary(originals, silhouettes, i) for i in some]) < FLAT:
        return "the photographs show nothing within the outlines"
    return ""


def _vary(originals: Originals, silhouettes: np.ndarray, i: int) -> float:
    """Standard deviation of what a photograph shows within its silhouette, in grey levels."""
    inside = _shrink(originals.enlarge(i, silhouettes[i]))
    return float(originals.read(i)[inside].mean(axis=1).std()) if inside.any() else 0.0


def _shrink(inside: np.ndarray) -> np.ndarray:
    """The pixels of a silhouette that have a block's width of it on all sides."""
    return minimum_filter(inside, size=2 * BLOCK + 1, mode="constant")


def _pick(originals: Originals, silhouettes: np.ndarray, i: int) -> _Blocks:
    """Blocks that are spread at random over the i-th photograph's silhouette."""
    picture = originals.read(i)
    centres = np.argwhere(_shrink(originals.enlarge(i, silhouettes[i])))
    count = min(BLOCKS, len(centres))
    chosen = centres[np.random.default_rng(i).choice(len(centres), count, replace=False)]
    reach = np.arange(BLOCK) - BLOCK // 2
    offsets = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
    y, x = (chosen[:, None] + offsets).reshape(-1, 2).T
    camera = originals.cameras
    pixels = np.stack([x + 0.5, y + 0.5, np.ones(len(x))], axis=1)
    rays = pixels @ np.linalg.inv(camera.K[i].numpy()).T @ camera.R[i].numpy()
    return _Blocks(camera.centres[i].numpy(), rays, picture[y, x].astype(float))


def _meet(mesh: trimesh.Trimesh, block: _Blocks) -> _Hits:
    points, normals = np.full(block.rays.shape, np.nan), np.full(block.rays.shape, np.nan)
    if not len(block.rays):
        return _Hits(points, normals)
    faces = mesh.ray.intersects_first(np.tile(block.eye, (len(block.rays), 1)), block.rays)
    hit = faces >= 0
    corner, normal = mesh.triangles[faces[hit], 0], mesh.face_normals[faces[hit]]
    along = ((corner - block.eye) * normal).sum(axis=1) / (block.rays[hit] * normal).sum(axis=1)
    points[hit] = block.eye + along[:, None] * block.rays[hit]
    normals[hit] = normal
    return _Hits(points, normals)


def _predict(
    mesh: trimesh.Trimesh,
    hits: Sequence[_Hits],
    blocks: Sequence[_Blocks],
    originals: Originals,
    used: Sequence[int],
) -> list[np.ndarray]:
    """What the nearest of the used views show at each of the hits: [n, 3] each, NaN if none."""
    middle, cameras = mesh.bounds.mean(axis=0), originals.cameras
    near = [
        _nearest(block.eye - middle, cameras.centres.numpy() - middle, used) for block in blocks
    ]
    sums = [np.zeros((len(block.rays), 4)) for block in blocks]
    for view in sorted({view for angles in near for view in angles}):
        picture = originals.read(view).astype(np.float32)
        for hit, total, angles in zip(hits, sums, near, strict=True):
            if view in angles:
                total += _look_up(mesh, hit, cameras, view, picture) / max(angles[view], 0.01) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return [total[:, :3] / total[:, 3:] for total in sums]


def _nearest(towards: np.ndarray, others: np.ndarray, used: Sequence[int]) -> dict[int, float]:
    """The used views whose cameras stand nearest in direction, with the angles in radians."""
    units = others[list(used)] / np.linalg.norm(others[list(used)], axis=1, keepdims=True)
    angles = np.arccos((units @ (towards / np.linalg.norm(towards))).clip(-1, 1))
    order = np.argsort(angles, kind="stable")[:NEIGHBOURS]
    return {used[i]: float(angles[i]) for i in order}


def _look_up(
    mesh: trimesh.Trimesh, hit: _Hits, cameras: Cameras, view: int, picture: np.ndarray
) -> np.ndarray:
    """Colours times weight, and weight, of points in one view: [n, 4]; 0 where it sees them not."""
    found = np.zeros((len(hit.points), 4))
    towards = cameras.centres[view].numpy() - hit.points
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    cosine = (towards * hit.normals).sum(axis=1)
    facing = np.flatnonzero(cosine > 0.1)  # NaN is not
    if not len(facing):
        return found
    starts = hit.points[facing] + LIFT * mesh.scale * hit.normals[facing]
    facing = facing[~mesh.ray.intersects_any(starts, towards[facing])]
    P = cameras.projections[view].numpy()
    seen = hit.points[facing] @ P[:, :3].T + P[:, 3]
    pixels = seen[:, :2] / seen[:, 2:]
    width, height = cameras.sizes[view].tolist()
    within = ((pixels > 0) & (pixels < (width, height))).all(axis=1)
    facing, pixels = facing[within], pixels[within]
    colours = resample(picture, pixels[None], (1, len(pixels)))[0]
    found[facing] = cosine[facing, None] * np.column_stack([colours, np.ones(len(facing))])
    return found


def _correlate(seen: np.ndarray, shown: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """NCC of the blocks whose pixels all count, and which show something: [blocks of them]."""
    size = BLOCK * BLOCK
    whole = counted.reshape(-1, size).all(axis=1)
    a, b = (part.mean(axis=1).reshape(-1, size)[whole] for part in (seen, shown))
    a, b = (part - part.mean(axis=1, keepdims=True) for part in (a, b))
    rich = b.std(axis=1) > FLAT
    a, b = a[rich], b[rich]
    return (a * b).sum(axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + 1e-9)


def _psnr(error: np.ndarray) -> float | None:
    """Of squared errors of 0..255."""
    return float(10 * np.log10(255**2 / max(error.mean(), 1e-9))) if len(error) else None


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def _pair(before: Any, after: Any) -> dict[str, Any]:
    return {"before": before, "after": after}


def _lead_back(
    scene: _Scene, new: trimesh.Trimesh, before: float, after: float
) -> tuple[trimesh.Trimesh, dict[str, Any]] | None:
    """A refined surface mended, if it does not fill the silhouettes as the old one does.

    A surface between depths ends a part of a pixel within the outlines, and an old mesh may follow
    each step of the masks' pixels.

    Args:
        before, after: IoU with the silhouettes, of the old surface and of the new one
    Returns:
        the surface, and the notes ``iou`` and ``mended``; None if it is not mended or no better
    """
    if after >= before or not scene.mend:
        return None
    mended = scene.mend(new)
    iou = scene.overlap(mended)
    return (mended, {"iou": _pair(before, iou), "mended": True}) if iou > after else None


def _decide(iou: dict[str, float], seen: dict[str, Any]) -> tuple[str, bool]:
    """What to say of a refined surface, and whether it is better."""
    if iou["before"] - iou["after"] > LOST:
        return (
            f"{TRIED}, but it fills the outlines worse: their mean IoU would fall from "
            f"{iou['before']:.4f} to {iou['after']:.4f}, and may fall by {LOST:g}"
        ), False
    if seen["moved"] < LEAST:
        return f"{TRIED}, but no photograph that was kept out to judge it shows what moved", False
    before, after = seen["psnr"].values()
    told = f"(PSNR; {before:.2f} dB before)"
    if after - before < GAIN:
        return (
            f"{TRIED}, but it predicts the photographs that were kept out to judge it with "
            f"{after:.2f} dB where it moved {told}: too little, {GAIN:g} dB should be gained"
        ), False
    if worse := _name_worse(seen):
        return f"{TRIED}, but photographs that were kept out to judge it {worse}", False
    return (
        f"it predicts photographs that were kept out to judge it with {after:.2f} dB where it "
        f"moved {told}"
    ), True


def _name_worse(seen: dict[str, Any]) -> str:
    """By what else photographs that were kept out are predicted worse, if so."""
    for measure, what in (
        ("ncc", "correlate less with it"),
        ("psnr_all", "fit it less as a whole"),
    ):
        before, after = seen[measure].values()
        if before is not None and after < before:
            return f"{what} ({after:.2f}, {before:.2f} before)"
    return ""


def _find_no_hint(seen: dict[str, Any]) -> str:
    """Why a coarse surface does not promise a better one; "" if it does, or if nothing can tell."""
    if seen["moved"] < LEAST or seen["ncc"]["before"] is None:
        return ""
    gains = [seen[measure]["after"] - seen[measure]["before"] for measure in ("psnr", "ncc")]
    if any(gain >= least for gain, least in zip(gains, HINT, strict=True)):
        return ""
    return (
        f"{TRIED}, coarsely, but it predicts the photographs that were kept out to judge it no "
        f"better where it moved ({gains[0]:+.2f} dB PSNR)"
    )


def _as_written(relief: Relief) -> trimesh.Trimesh:
    """The mesh as it is read from the file that is written of it."""
    single = np.asarray(relief.verts).astype(np.float32).astype(np.float64)
    return trimesh.Trimesh(single, relief.faces, process=False)


def _stand(
    mesh: trimesh.Trimesh, silhouettes: np.ndarray, cameras: Cameras, views: Sequence[int]
) -> np.ndarray:
    """What the vertices stand on before photographs have a say: an outline, or nothing."""
    grid = Grid.over(mesh, 2)
    unseen = np.zeros(grid.shape, np.float32)
    shown = shrink(silhouettes[list(views)], cameras.select(list(views)), LARGEST)
    return judge_standing(np.asarray(mesh.vertices), unseen, grid, *shown)


def _stay(
    mesh: trimesh.Trimesh, standing: np.ndarray, why: str, notes: dict[str, Any], started: float
) -> Judged:
    return Judged(mesh, standing, _describe(False, why, standing, notes, started))


def _describe(
    taken: bool, why: str, standing: np.ndarray, notes: dict[str, Any], started: float
) -> dict[str, Any]:
    shares = np.bincount(standing, minlength=len(STANDINGS)) / max(len(standing), 1)
    surface = dict(zip(STANDINGS, shares.tolist(), strict=True))
    said = f"the surface stays as the outlines have it: {why}"
    if taken:
        said = f"the photographs move {surface['photographs']:.0%} of the surface: {why}"
    told = {"surface": surface, "taken": taken, "because": why, "said": said, **notes}
    return told | {"seconds": round(time.perf_counter() - started, 2)}
