"""The numbers of ``metrics.json``: what they are called, what they mean, and how they are shown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from silmesh.geometry.thresholds import COHERENT

LACKING = "–"


@dataclass(frozen=True)
class Metric:
    """How a number of ``metrics.json`` is shown, and what it means."""

    key: str
    label: str
    meaning: str
    form: str = ".3f"


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
        "Photographs that were left out: no camera was found for them, or the others contradict "
        "their silhouette.",
        ",d",
    ),
    Metric(
        "views_repaired",
        "Views repaired",
        "Photographs that were fitted with a silhouette that was drawn anew, since the others "
        "contradicted what was found.",
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
        "texture_psnr_holdout",
        "Texture, PSNR",
        "How like held-out photographs the texture is that was made of the others, inside the "
        "object, in decibels; more is better.",
        ".2f",
    ),
    Metric("texture_ssim_holdout", "Texture, SSIM", "The same by structure; 1 is best."),
    Metric("texture_size", "Texture, size", "Side of the texture, in pixels.", ",d"),
    Metric(
        "texture_unseen",
        "Texture, unseen",
        "Share of the texture that no photograph shows, filled with the colours around it.",
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
        "voxel_iou",
        "Voxel IoU",
        "How many voxels the two bodies fill in common, of those that either fills, in the grid of "
        "32\u00a0x\u00a032\u00a0x\u00a032 by which ShapeNet is measured; 1 is best.",
    ),
    Metric(
        "normal_consistency",
        "Normal consistency",
        "How well the two surfaces' directions agree at nearest points; 1 is best.",
    ),
)
OVERVIEW = ("iou_mean", "iou_min", "hull_iou_mean", "loss_final", "iterations", "fit_seconds")
# Shown if any run has them.
TRUTH = (
    "chamfer",
    "f_score",
    "volume_iou",
    "voxel_iou",
    "normal_consistency",
)


def show(value: Any, metric: Metric) -> str:
    """A metric's value as text; an en dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return LACKING
    if isinstance(value, str | bool):
        return str(value)
    if metric.form.endswith("d") and value != int(value):
        return f"{value:.4g}"
    return format(int(value) if metric.form.endswith("d") else value, metric.form)


def is_incoherent(values: Mapping[str, Any]) -> bool:
    """Whether the hull fills the silhouettes so badly that the cameras must contradict them."""
    hull = values.get("hull_iou_mean")
    return hull is not None and not hull >= COHERENT


def describe_relief(metrics: Mapping[str, Any]) -> str:
    """What the photographs have changed of a mesh, and what it stands on; "" if not tried."""
    if "relief" not in metrics:
        return ""
    shares = (f"{share:.0%} {what}" for what, share in metrics["surface"].items())
    return f"{metrics['relief']['said']} (it stands on: {', '.join(shares)})"
