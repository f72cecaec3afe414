"""Photo-consistency after a fit: which views it may look at, and what it says of itself."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
import trimesh

from silmesh.fitting.fit import fitted_views
from silmesh.fitting.mending import follow_outlines
from silmesh.geometry.camera import Cameras, Similarity
from silmesh.geometry.mesh_files import to_tensors
from silmesh.geometry.originals import Originals
from silmesh.geometry.silhouette_iou import silhouette_iou
from silmesh.geometry.small_images import shrink, shrink_frames
from silmesh.geometry.unseen import span_unseen
from silmesh.progress import Share, untold
from silmesh.relief.judgement import Judged, refine_if_better
from silmesh.scene.scene import Scene
from silmesh.settings.fit import FastFit, spans_unseen
from silmesh.views import View

LONGEST = 1600  # pixels of a photograph's longer side; more shows no more of a shape
OUTLINES = 1024  # pixels of the images where a surface is judged by outlines, and led back to them


def refine_by_photographs(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    scene: Scene,
    views: Sequence[View],
    settings: FastFit,
    notes: Mapping[str, Any],
    progress: Share = untold,
) -> Judged:
    """Move a fitted surface to where the photographs agree, if some that are kept out confirm it.

    Args:
        mesh: fitted, in the cameras' world, which may be far from its origin and of any size
        cameras: of the scene's views, in pixels of the working images, as the fit left them
        scene: that it was fitted to
        views: of the photographs
        settings, notes: of the fit; views that were kept out of it, that have no weight or are
            distrusted are not looked at
        progress: is told which share is done
    """
    distrusted = set(notes.get("distrusted", ()))
    believed = [i for i in fitted_views(scene, settings) if cameras.views[i] not in distrusted]
    unreadable = {view.view for view in views if view.unreadable}
    silhouettes = np.asarray(scene.silhouettes)
    centring = Similarity.centring(mesh.bounds)  # lengths are those of a world of this size
    cameras = cameras.in_world_of(centring)

    small, seen = shrink(silhouettes, cameras, OUTLINES)
    frames = shrink_frames(silhouettes, OUTLINES, scene.frames)
    sigma = settings.sigma_at(small.shape[-1])

    spoken = None if frames is None else frames[believed]
    trusted = seen.select(believed), small[believed]

    def overlap(
        body: trimesh.Trimesh,
        views: Cameras = seen,
        shown: np.ndarray = small,
        around: np.ndarray | None = frames,
    ) -> float:
        return float(silhouette_iou(*to_tensors(body), views, shown, sigma, around).mean())

    def mend(refined: trimesh.Trimesh) -> trimesh.Trimesh:
        """By the silhouettes of the views that are believed."""
        return follow_outlines(refined, *trusted, settings, spoken)

    def span(refined: trimesh.Trimesh) -> trimesh.Trimesh:
        """By the same."""
        views, shown = trusted
        agree = partial(overlap, views=views, shown=shown, around=spoken)
        return span_unseen(refined, views, agree, spoken)

    judged = refine_if_better(
        _move(mesh, centring),
        Originals(cameras, views, scene.notes.get("lenses"), LONGEST, silhouettes),
        silhouettes,
        cameras,
        overlap,
        [i for i in believed if cameras.views[i] not in unreadable],
        settings.seed,
        progress,
        mend=mend,
        span=span if spans_unseen(settings) else None,
    )
    taken = judged.notes["taken"]
    return replace(judged, mesh=_move(judged.mesh, centring.inverse) if taken else mesh)


def _move(mesh: trimesh.Trimesh, similarity: Similarity) -> trimesh.Trimesh:
    """The same faces in another world."""
    verts = similarity.apply(torch.from_numpy(np.float64(mesh.vertices)))
    return trimesh.Trimesh(verts.numpy(), mesh.faces, process=False)
