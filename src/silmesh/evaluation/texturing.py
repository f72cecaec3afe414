"""The texture of a fitted mesh, and how well it shows the photographs that were held out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh

from silmesh.evaluation.appearance import LONGEST, measure_appearance
from silmesh.geometry.camera import Cameras
from silmesh.geometry.originals import Originals
from silmesh.progress import Share, untold, within
from silmesh.settings.texture import Texture as Settings
from silmesh.texture.bake import Texture, bake
from silmesh.views import View, held_out, refuse_changed

BAKED = 0.9  # of the work, where the held-out photographs are looked at after it
MANY = 0.1  # share of the surface that no photograph sees from which that is said


def make_texture(
    mesh: trimesh.Trimesh,
    cameras: Cameras,
    views: Sequence[View],
    lenses: Mapping[str, Mapping[str, Any]] | None,
    silhouettes: np.ndarray,
    settings: Settings,
    holdout: int = 0,
    progress: Share = untold,
) -> Texture:
    """Make a texture of the photographs that were fitted, and measure it on the others.

    Args:
        mesh: in the cameras' world
        cameras: in pixels of the working images
        views: of at least the same names
        lenses: of the views that had one, as ``scene.json`` says it
        silhouettes: [views, size, size] bool, of the working images
        holdout: every n-th view was kept out of the fit, and is kept out of the texture; 0 for none
        progress: is told which share is done
    Returns:
        the texture; its notes have ``held_out``, None or as ``measure_appearance`` says it, and
        ``warnings``, too

    Raises:
        InputError: a photograph is not there any more, or was changed
    """
    used = set(cameras.views)
    refuse_changed([view for view in views if view.view in used])
    held = held_out(len(cameras), holdout)
    kept = [i for i in range(len(cameras)) if i not in set(held)] if held else None
    originals = Originals(cameras, views, lenses, silhouettes=silhouettes)
    share = within(progress, 0.0, BAKED) if held else progress
    baked = bake(mesh, originals, silhouettes, settings.pixels, kept, share)
    measured = None
    if held:
        smaller = Originals(cameras, views, lenses, LONGEST, silhouettes)
        measured = measure_appearance(baked, smaller, silhouettes, held)
    progress(1.0)
    notes = {key: value for key, value in baked.notes.items() if key != "seconds"}  # same each time
    told = {"held_out": measured, "warnings": [*notes.get("warnings", []), *_warn(notes)]}
    return replace(baked, notes=notes | told)


def _warn(notes: Mapping[str, Any]) -> list[str]:
    if notes["unseen"] <= MANY:
        return []
    return [
        f"no photograph shows {notes['unseen']:.0%} of the texture: it is filled with the colours "
        "around it"
    ]
