"""The page that a person opens: one HTML file with every table, curve, photograph and mesh in it.

Of very many objects there is an index, and a page of each; see ``index.py``.

What is large lies packed in the page, in one block an object and one a mesh, and is unpacked when
the object is opened; so do the libraries. See ``parts.py`` for what the page is put together from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import trimesh
from PIL import Image

from silmesh.geometry.camera import MIRROR
from silmesh.report.budget import choose_views
from silmesh.report.curves import describe_curve, table_of
from silmesh.report.gallery import encode_webp
from silmesh.report.measures import METRICS, describe_relief, is_incoherent
from silmesh.report.overview import describe_numbers, encode_thumbnail, read_part, render
from silmesh.report.packing import encode_glb, pack, pack_json
from silmesh.report.page_textures import ROOM, add_texture
from silmesh.report.parts import LIBRARIES, PAGE
from silmesh.report.tables import Run, objects_of

STILLS = 600_000  # bytes of the page, for the still pictures of all runs and scenes
WIDTHS = (1122, 840, 640, 480)  # pixels of a still, of which the first that fits is taken
DENSE = 0.06  # bytes that a pixel of a still takes in the page


@dataclass(frozen=True)
class Scene:
    """The cameras that a run was fitted with.

    Attributes:
        name: of the scene, which runs may share
        notes: its ``scene.json``
        picture: of the cameras, PNG
    """

    name: str
    notes: Mapping[str, Any]
    picture: Path


@dataclass(frozen=True)
class Result:
    """What the page shows of a run.

    Attributes:
        metrics: its ``metrics.json``
        losses: its ``loss.csv``
        picture: the mesh beside its photographs, PNG
        exhibit: see ``describe_exhibit``
        scene: its cameras
        gallery: names the photographs that it was fitted to
        published: ``iteration`` and ``loss`` of the curve that it repeats, or None
        held: the views that the fit never saw
        seconds: how long its stages took, those of which it is known
    """

    metrics: Mapping[str, Any]
    losses: pd.DataFrame
    picture: Path
    exhibit: Mapping[str, Any]
    scene: Scene
    gallery: str
    published: pd.DataFrame | None = None
    held: Sequence[str] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)


PARAMETERS = {  # of a calibration: what they are called, their unit, and what they mean
    "elevation": ("Elevation", "°", "of the camera above the table"),
    "roll": ("Lean", "°", "of the axis in the image, clockwise"),
    "axis": ("Axis", " px", "column of the working image at which it passes the object's middle"),
    "half_angle": ("Half angle", "°", "of view over half of the image's side"),
    "step": ("Step", "°", "from view to view, negative the other way round"),
}


def write_page(
    results: Mapping[Run, Result],
    galleries: Mapping[tuple[str, str], Mapping[str, Any]],
    settings: Mapping[str, Any],
    truths: Mapping[str, trimesh.Trimesh] = MappingProxyType({}),
    conclusions: Sequence[str] = (),
    unfinished: Sequence[Mapping[str, str]] = (),
    index: str = "",
) -> str:
    """Write a page.

    Args:
        results: of each run, in the order in which they are shown
        galleries: by object and name; see ``describe_gallery``
        settings: ``configuration``: the whole of it, defaults filled in; ``objects``: what the
            rows of the objects say, for example where their silhouettes come from
        truths: the true meshes of objects
        conclusions: what can be concluded of the variants, in sentences
        unfinished: runs that came to nothing: ``object``, ``variant``, ``stage``, ``reason``
        index: where a page of all objects lies, if this is the page of some
    Returns:
        HTML, the same for the same arguments and versions
    """
    objects, shown_variants = objects_of(results), {variant for _, variant in results}
    order = [name for name in settings["configuration"]["variants"] if name in shown_variants]
    room = STILLS // (len(results) + len({(o, r.scene.name) for (o, _), r in results.items()}))
    described = [
        _describe_object(
            object_,
            {variant: results[object_, variant] for variant in variants},
            {name: g for (of, name), g in galleries.items() if of == object_},
            settings,
            order,
            truths.get(object_),
            (len(objects), room, ROOM / max(_count_textures(results), 1)),
        )
        for object_, variants in objects.items()
    ]
    return render(
        PAGE,
        described,
        {run: result.metrics for run, result in results.items()},
        settings,
        conclusions=conclusions,
        unfinished=unfinished,
        index=index,
        beside="the report" if index else "this page",
        libraries=_pack_libraries(),
    )


@cache  # a report of many objects has as many pages
def _pack_libraries() -> dict[str, str]:
    return {name: pack(read_part(file).encode()) for name, file in LIBRARIES.items()}


def _describe_object(
    object_: str,
    results: Mapping[str, Result],
    galleries: Mapping[str, Mapping[str, Any]],
    settings: Mapping[str, Any],
    order: Sequence[str],
    truth: trimesh.Trimesh | None,
    shares: tuple[int, int, float],
) -> dict[str, Any]:
    """All that the template shows of an object.

    ``shares``: how many objects there are, bytes of a still, bytes of a texture.
    """
    chosen = {variant: run_settings(object_, variant, settings) for variant in results}
    thinned = _thin_galleries(galleries, results, shares[0])
    runs = [
        _describe_run(variant, result, order)
        | {
            "still": _embed_still(result.picture, shares[1]),
            "fitted": _add_texture(result, shares[2]),
        }
        for variant, result in results.items()
    ]
    curves = _name_curves(results)
    at, losses = table_of(curves)
    ends = [f"{run['variant']} ends at {run['values']['loss_final']}" for run in runs]
    return {
        "name": object_,
        "link": f"#object-{object_}",
        "runs": runs,
        "incoherent": _group_incoherent(results),
        "rows": [m for m in METRICS if any(m.key in r.metrics for r in results.values())],
        "scenes": _describe_scenes({v: r.scene for v, r in results.items()}, shares[1]),
        "says": f"Loss of {object_} against the iteration: {', '.join(ends)}.",
        "iterations": at,
        "losses": losses,
        "settings": _tabulate(chosen),
        "seconds": _tabulate({v: r.seconds for v, r in results.items()}),
        "truth": truth is not None and pack(encode_glb(np.asarray(truth.vertices), truth.faces)),
        "truths": [] if truth is None else _tell_truths(results),
        "shown": {name: len(g["views"]) for name, g in thinned.items()},
        "views": {name: len(galleries[name]["views"]) for name in thinned},
        "data": _pack_data(results, thinned, truth),
    }


def _describe_run(variant: str, result: Result, order: Sequence[str]) -> dict[str, Any]:
    """What the template shows of a run."""
    metrics = result.metrics
    return describe_numbers(variant, metrics) | {
        "place": order.index(variant),
        "initial": describe_initial(metrics.get("first", {})),
        "fit_warnings": metrics.get("fit", {}).get("warnings", []),
        "texture_warnings": metrics.get("texture", {}).get("warnings", []),
        "thumbnail": f"data:image/webp;base64,{encode_thumbnail(result.picture)}",
        "cameras": metrics.get("cameras"),
        "initial_mesh": result.exhibit["first"],
        "standing": result.exhibit.get("standing"),
        "relief": describe_relief(metrics),
        "gallery": result.gallery,
    }


def _count_textures(results: Mapping[Run, Result]) -> int:
    return sum(result.exhibit.get("texture") is not None for result in results.values())


def _add_texture(result: Result, room: float) -> str:
    """A run's fitted mesh, with its texture if it has one for which there is room."""
    texture = result.exhibit.get("texture")
    fitted = result.exhibit["fitted"]
    return fitted if texture is None else add_texture(fitted, texture, room)


def _group_incoherent(results: Mapping[str, Result]) -> dict[tuple[str, str | None], list[str]]:
    """The variants of low coherence, by their hull IoU and their probable outliers."""
    groups: dict[tuple[str, str | None], list[str]] = {}
    for variant, result in results.items():
        if is_incoherent(result.metrics):
            hull = f"{result.metrics['hull_iou_mean']:.3f}"
            groups.setdefault((hull, result.metrics.get("hull_doubtful")), []).append(variant)
    return groups


def _thin_galleries(
    galleries: Mapping[str, Mapping[str, Any]], results: Mapping[str, Result], objects: int
) -> dict[str, dict[str, Any]]:
    """The galleries, of the views that there is room for."""
    thinned = {}
    for name, gallery in galleries.items():
        views = gallery["views"]
        outlines = [r.exhibit["outlines"] for r in results.values() if r.gallery == name]
        shown = [views[i] for i in choose_views(views, outlines, objects)]
        thinned[name] = {**gallery, "views": shown}
    return thinned


def _pack_data(
    results: Mapping[str, Result],
    galleries: Mapping[str, Mapping[str, Any]],
    truth: trimesh.Trimesh | None,
) -> str:
    """What the scripts draw of an object, packed."""
    runs = [
        _describe_data(variant, result, galleries[result.gallery], truth)
        for variant, result in results.items()
    ]
    return pack_json({"galleries": galleries, "runs": runs})


def _describe_data(
    variant: str,
    result: Result,
    gallery: Mapping[str, Any],
    truth: trimesh.Trimesh | None,
) -> dict[str, Any]:
    """What the scripts draw of a run."""
    outlines = result.exhibit["outlines"]
    shown = {view["name"] for view in gallery["views"]}
    iou = result.metrics.get("iou", {})
    return {
        "variant": variant,
        "gallery": result.gallery,
        "outlines": {view: path for view, path in outlines.items() if view in shown},
        **{key: result.exhibit[key] for key in ("cameras", "up", "ahead")},
        "iou": {view: round(value, 4) for view, value in iou.items()},
        "held": list(result.held),
        "curve": describe_curve(result.losses),
        "published": None if result.published is None else describe_curve(result.published),
        "placed": None if truth is None else _place_truth(result),
    }


def _tell_truths(results: Mapping[str, Result]) -> list[int]:
    """The positions of the runs in whose worlds the truth lies otherwise than in those before."""
    places = [_place_truth(result) for result in results.values()]
    return [i for i, place in enumerate(places) if place not in places[:i]]


def _place_truth(result: Result) -> list[float]:
    """The matrix from the truth's world to the normalised one, a column after another, [16].

    Metrics hold the registration with the truth, scale R X + t, if there was one. The truth of a
    left-handed world is mirrored first.
    """
    move = np.eye(4)
    if (found := result.metrics.get("placement")) is not None:
        move[:3, :3] = found["scale"] * np.array(found["R"])
        move[:3, 3] = found["t"]
    normalise = np.eye(4) * result.scene.notes["scale"]
    normalise[:3, 3] = -result.scene.notes["scale"] * np.array(result.scene.notes["centre"])
    normalise[3, 3] = 1
    mirror = np.diag([*MIRROR, 1.0]) if result.scene.notes.get("mirrored") else np.eye(4)
    return (normalise @ np.linalg.inv(move) @ mirror).T.ravel().tolist()


def _name_curves(results: Mapping[str, Result]) -> dict[str, pd.DataFrame]:
    """The curves of the table, a published one below ours."""
    curves = {}
    for variant, result in results.items():
        curves[variant] = result.losses
        if result.published is not None:
            last = result.losses["iteration"].iloc[-1]
            curves[f"{variant}, published"] = result.published[
                result.published["iteration"] <= last
            ]
    return curves


def _tabulate(columns: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Rows of a table by key: the values of the variants in their order, or None."""
    keys = dict.fromkeys(key for values in columns.values() for key in values)
    return {key: [values.get(key) for values in columns.values()] for key in keys}


def _describe_scenes(scenes: Mapping[str, Scene], room: int) -> list[dict[str, Any]]:
    """What the template shows of the cameras of an object's variants, each scene once."""
    variants: dict[str, list[str]] = {}
    for variant, scene in scenes.items():
        variants.setdefault(scene.name, []).append(variant)
    return [
        {
            "variants": names,
            "source": scene.notes["cameras"],
            "count": len(scene.notes["hull_iou"]),
            "coherence": f"{scene.notes['hull_iou_mean']:.3f}",
            "dropped": scene.notes["dropped"],
            "warnings": scene.notes["warnings"],
            "estimates": _show_calibration(scene.notes["figures"]),
            "picture": _embed_still(scene.picture, room),
        }
        for names in variants.values()
        for scene in [scenes[names[0]]]
    ]


def _show_calibration(figures: Mapping[str, Any]) -> list[dict[str, str]]:
    """All that was found of a turntable; of several rounds each has its elevation."""
    rounds = figures.get("rounds", [])
    estimates = {
        name: one
        for name, one in figures.get("estimates", {}).items()
        if not (rounds and name == "elevation")
    }
    return [
        *_show_estimates(estimates),
        *_show_rounds(rounds),
        *_show_crops(figures.get("crops", {})),
    ]


def _show_estimates(estimates: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """A calibration's parameters as text: name, meaning, value with its deviation, status."""
    return [
        _show_estimate(label, meaning, unit, estimates[name])
        for name, (label, unit, meaning) in PARAMETERS.items()
        if name in estimates
    ]


def _show_crops(crops: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """That the photographs were cropped one by one, if so: by which scales and how far shifted."""
    if not crops:
        return []
    scales = [crop["scale"] for crop in crops.values()]
    columns, rows = zip(*(crop["shift"] for crop in crops.values()), strict=True)
    apart = [max(values) - min(values) for values in (columns, rows)]
    return [
        {
            "label": "Crops",
            "value": f"{min(scales):.2f} to {max(scales):.2f}",
            "status": "found",
            "meaning": f"scales of {len(crops)} photographs, which are shifted by up to "
            f"{apart[0]:.1f} and {apart[1]:.1f} pixels against each other",
        }
    ]


def _show_rounds(rounds: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """The elevation of each round of several, and which views it has."""
    _, unit, _ = PARAMETERS["elevation"]
    return [
        _show_estimate(
            f"Round {number}",
            f"elevation of its {len(one['views'])} views, {one['views'][0]} to {one['views'][-1]}",
            unit,
            one["estimates"]["elevation"],
        )
        for number, one in enumerate(rounds, start=1)
    ]


def _show_estimate(
    label: str, meaning: str, unit: str, estimate: Mapping[str, Any]
) -> dict[str, str]:
    deviation = f" ± {estimate['sd']:.2g}" if estimate["sd"] else ""
    return {
        "label": label,
        "meaning": meaning,
        "value": f"{estimate['value']:.2f}{deviation}{unit}",
        "status": estimate["status"],
    }


def describe_initial(notes: Mapping[str, Any]) -> dict[str, Any]:
    """What the page says of an initial mesh, from its ``init.json``."""
    return {
        "shape": notes.get("shape"),
        "scores": {
            shape: [format(score[when], ".4f") for when in ("before", "after")]
            for shape, score in notes.get("scores", {}).items()
        },
        "warnings": notes.get("warnings", []),
    }


def run_settings(object_: str, variant: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a run: the object's row, and over it what the variant says, by dotted key."""
    configuration = settings["configuration"]
    said = {"views": configuration["views"]}
    for layer in (settings["objects"].get(object_, {}), configuration["variants"][variant]):
        said = _overlay(said, layer)
    return dict(_dotted(said))


def _overlay(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """``below`` with what ``above`` says and is not None, section by section."""
    merged = dict(below)
    for key, value in above.items():
        if isinstance(value, dict):
            merged[key] = _overlay(merged.get(key, {}), value)
        elif value is not None:
            merged[key] = value
    return merged


def _dotted(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows = []
    for key, value in values.items():
        nested = isinstance(value, dict)
        rows += _dotted(value, f"{prefix}{key}.") if nested else [(prefix + key, value)]
    return rows


def _embed_still(picture: Path, room: int) -> str | None:
    """A picture as wide as it may be to fit in about so many bytes, or None."""
    with Image.open(picture) as image:
        sizes = [(width, round(image.height * width / image.width)) for width in WIDTHS]
        fitting = [(w, h) for w, h in sizes if DENSE * w * h <= room and w <= image.width]
        if not fitting:
            return None
        small = image.convert("RGB").resize(fitting[0], Image.Resampling.LANCZOS)
    return f"data:image/webp;base64,{encode_webp(small, 70)}"
