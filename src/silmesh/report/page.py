"""The page that a person opens: one HTML file with every table, figure and picture in it."""

import base64
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from silmesh.report.pictures import crop_thumbnail
from silmesh.report.tables import Run, objects_of

LACKING = "–"
COHERENT = 0.9  # below this hull IoU, cameras and silhouettes contradict each other
LIBRARIES = ("silmesh", "torch", "numba", "numpy", "scikit-image", "trimesh", "snakemake")
THUMBNAIL = 132  # pixels


@dataclass(frozen=True)
class Metric:
    """How a number of ``metrics.json`` is shown, and what it means."""

    key: str
    label: str
    meaning: str
    form: str = ".3f"


@dataclass(frozen=True)
class Scene:
    """The cameras that a run was fitted with.

    Attributes:
        name: of the scene, which runs may share
        told: its ``scene.json``
        picture: of the cameras, PNG
    """

    name: str
    told: Mapping[str, Any]
    picture: Path


PARAMETERS = {  # of a calibration: what they are called, their unit, and what they mean
    "elevation": ("Elevation", "°", "of the camera above the table"),
    "roll": ("Lean", "°", "of the axis in the image, clockwise"),
    "axis": ("Axis", " px", "column of the working image at which it passes the object's middle"),
    "half_angle": ("Half angle", "°", "of view over half of the image's side"),
    "step": ("Step", "°", "from view to view, negative the other way round"),
}

METRICS = (
    Metric(
        "iou_mean",
        "IoU, mean",
        "How much of the mesh's outline and the object's silhouette is common to both, averaged "
        "over the photographs that were fitted; 1 is a perfect match.",
    ),
    Metric("iou_min", "IoU, least", "The same in the photograph that the mesh fits worst."),
    Metric(
        "iou_holdout",
        "IoU, held out",
        "The same averaged over photographs that the fit never saw.",
    ),
    Metric(
        "hull_iou_mean",
        "Hull IoU",
        "How well the largest body that all silhouettes allow fills them. It says how well "
        f"cameras and silhouettes agree: below {COHERENT} they contradict each other.",
    ),
    Metric(
        "loss_final",
        "Final loss",
        "What the fit made small, at its last iteration: one minus the soft IoU, plus the weighted "
        "smoothness terms.",
        ".4f",
    ),
    Metric("views", "Views", "Photographs that were fitted.", ",d"),
    Metric(
        "views_dropped",
        "Views dropped",
        "Photographs that were left out, because no camera was found for them.",
        ",d",
    ),
    Metric("iterations", "Iterations", "Steps of the fit.", ",d"),
    Metric("fit_seconds", "Seconds", "How long the fit took.", ",.0f"),
    Metric("vertices", "Vertices", "Corners of the mesh.", ",d"),
    Metric("faces", "Faces", "Triangles of the mesh.", ",d"),
    Metric("watertight", "Closed", "Whether the surface has no hole and no face turned round."),
    Metric(
        "manifold",
        "Manifold",
        "Whether at most two triangles meet at each edge, and those about a corner form one fan.",
    ),
    Metric("components", "Pieces", "Parts of the mesh that do not hang together.", ",d"),
    Metric("genus", "Genus", "Handles of the body: 0 for a ball, 1 for a ring.", ",d"),
    Metric(
        "self_intersections",
        "Self-intersections",
        "Pairs of triangles that cut through each other; 0 is best.",
        ",d",
    ),
    Metric(
        "edge_length_spread",
        "Edge spread",
        "Standard deviation of the edges' lengths over their mean; 0 for edges of one length.",
    ),
    Metric(
        "smallest_angle",
        "Smallest angle",
        "The sharpest corner of any triangle, in degrees; 60 at best.",
        ".1f",
    ),
    Metric(
        "small_angle",
        "Smallest angles, 1 %",
        "One triangle in a hundred has a corner sharper than this, in degrees.",
        ".1f",
    ),
    Metric(
        "aligned",
        "Aligned",
        "Whether the mesh was turned, shifted and scaled onto the truth before it was compared, "
        "since its cameras were estimated and their frame is arbitrary.",
    ),
    Metric("scale", "Scale", "How much the mesh was enlarged for that.", ".4g"),
    Metric(
        "chamfer",
        "Chamfer distance",
        "Mean distance between the fitted and the true surface, in the truth's units; 0 is best.",
        ".4g",
    ),
    Metric(
        "f_score",
        "F-score",
        "How much of the two surfaces lies within 1\u00a0% of the truth's diagonal of each other; "
        "1 is best.",
    ),
    Metric("volume_iou", "Volume IoU", "How much of the two bodies is common to both; 1 is best."),
    Metric(
        "normal_consistency",
        "Normal consistency",
        "How well the two surfaces' directions agree at nearest points; 1 is best.",
    ),
)
OVERVIEW = ("iou_mean", "iou_min", "hull_iou_mean", "loss_final", "iterations", "fit_seconds")
TRUTH = ("chamfer", "f_score", "volume_iou", "normal_consistency")  # shown if any run has them


def write_page(
    metrics: Mapping[Run, Mapping[str, Any]],
    figures: Mapping[str, Path],
    pictures: Mapping[Run, Path],
    scenes: Mapping[Run, Scene],
    settings: Mapping[str, Any],
    sheets: Mapping[str, Sequence[Path]] = MappingProxyType({}),
) -> str:
    """Write the page.

    Args:
        metrics: each run's ``metrics.json``
        figures: each object's loss figure, SVG
        pictures: each run's picture, PNG
        scenes: each run's cameras
        settings: ``configuration``: the whole of it, defaults filled in; ``objects``: what the
            rows of the objects say, for example where their silhouettes come from
        sheets: each object's sheets of silhouettes, PNG, named by how they were found
    Returns:
        HTML, the same for the same arguments and versions
    """
    page = Environment(
        loader=PackageLoader("silmesh.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html.j2")
    shown = [
        key for key in TRUTH if any(values.get(key) is not None for values in metrics.values())
    ]
    known = [metric for metric in METRICS if any(metric.key in v for v in metrics.values())]
    return page.render(
        objects=[
            _describe_object(object_, variants, metrics, figures, pictures, scenes, settings)
            | {"sheets": [_embed_sheet(sheet) for sheet in sheets.get(object_, ())]}
            for object_, variants in objects_of(metrics).items()
        ],
        count=len(metrics),
        overview=[metric for metric in METRICS if metric.key in (*OVERVIEW, *shown)],
        meanings=known,
        coherent=COHERENT,
        configuration=settings["configuration"],
        versions=_versions(),
    )


def _describe_object(
    object_: str,
    variants: Sequence[str],
    metrics: Mapping[Run, Mapping[str, Any]],
    figures: Mapping[str, Path],
    pictures: Mapping[Run, Path],
    scenes: Mapping[Run, Scene],
    settings: Mapping[str, Any],
) -> dict[str, Any]:
    """All that the template shows of an object."""
    runs = [
        {
            "variant": variant,
            "values": {m.key: show(metrics[object_, variant].get(m.key), m) for m in METRICS},
            "incoherent": is_incoherent(metrics[object_, variant]),
            "doubtful": metrics[object_, variant].get("hull_doubtful"),
            "first": describe_first(metrics[object_, variant].get("first", {})),
            "picture": _embed_png(pictures[object_, variant].read_bytes()),
            "thumbnail": _embed_thumbnail(pictures[object_, variant]),
            "cameras": metrics[object_, variant].get("cameras"),
            "settings": run_settings(object_, variant, settings),
        }
        for variant in variants
    ]
    rows = [m for m in METRICS if any(m.key in metrics[object_, v] for v in variants)]
    ends = [f"{run['variant']} ends at {run['values']['loss_final']}" for run in runs]
    return {
        "name": object_,
        "runs": runs,
        "rows": rows,
        "scenes": _describe_scenes({v: scenes[object_, v] for v in variants}),
        "figure": _embed("image/svg+xml", figures[object_].read_bytes()),
        "figure_says": f"Loss of {object_} against the iteration: {', '.join(ends)}.",
    }


def _describe_scenes(scenes: Mapping[str, Scene]) -> list[dict[str, Any]]:
    """What the template shows of the cameras of an object's variants, each scene once."""
    variants: dict[str, list[str]] = {}
    for variant, scene in scenes.items():
        variants.setdefault(scene.name, []).append(variant)
    return [
        {
            "variants": names,
            "source": scene.told["cameras"],
            "count": len(scene.told["hull_iou"]),
            "coherence": f"{scene.told['hull_iou_mean']:.3f}",
            "dropped": scene.told["dropped"],
            "warnings": scene.told["warnings"],
            "estimates": _show_estimates(scene.told["figures"].get("estimates", {})),
            "picture": _embed_png(scene.picture.read_bytes()),
        }
        for names in variants.values()
        for scene in [scenes[names[0]]]
    ]


def _show_estimates(estimates: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """A calibration's parameters as text: name, meaning, value with its deviation, status."""
    rows = []
    for name, (label, unit, meaning) in PARAMETERS.items():
        if name in estimates:
            e = estimates[name]
            number = f"{e['value']:.2f}" + (f" ± {e['sd']:.2g}" if e["sd"] else "")
            rows.append(
                {
                    "label": label,
                    "meaning": meaning,
                    "value": number + unit,
                    "status": e["status"],
                }
            )
    return rows


def show(value: Any, metric: Metric) -> str:
    """A metric's value as text; an en dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return LACKING
    if isinstance(value, str | bool):
        return str(value)
    if metric.form.endswith("d") and value != int(value):
        return f"{value:.4g}"
    return format(int(value) if metric.form.endswith("d") else value, metric.form)


def describe_first(told: Mapping[str, Any]) -> dict[str, Any]:
    """What the page says of a first mesh, from its ``init.json``."""
    return {
        "shape": told.get("shape"),
        "scores": {
            shape: [format(score[when], ".4f") for when in ("before", "after")]
            for shape, score in told.get("scores", {}).items()
        },
        "warnings": told.get("warnings", []),
    }


def is_incoherent(values: Mapping[str, Any]) -> bool:
    """Whether the hull fills the silhouettes so badly that the cameras must contradict them."""
    hull = values.get("hull_iou_mean")
    return hull is not None and not hull >= COHERENT


def run_settings(object_: str, variant: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a run was told: the object's row, and over it what the variant says, by dotted key."""
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


def _versions() -> dict[str, str]:
    """Versions of Python and of the libraries that decide the numbers, here and now."""
    found = {"Python": python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = LACKING
    return found


def _embed(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _embed_png(content: bytes) -> str:
    return _embed("image/png", content)


def _embed_sheet(sheet: Path) -> dict[str, str]:
    """A sheet's name and picture; a JPEG, since it is made of photographs."""
    stream = io.BytesIO()
    with Image.open(sheet) as image:
        image.convert("RGB").save(stream, "jpeg", quality=85)
    return {"name": sheet.stem, "picture": _embed("image/jpeg", stream.getvalue())}


def _embed_thumbnail(picture: Path) -> str:
    with Image.open(picture) as image:
        small = crop_thumbnail(image).resize((THUMBNAIL, THUMBNAIL), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    small.save(stream, "png", optimize=True)
    return _embed_png(stream.getvalue())
