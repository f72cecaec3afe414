"""What a run came to, in one line, and what to do where it is doubtful; the mesh as a file."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from silmesh.errors import InputError
from silmesh.files import replacing

SUFFIXES = (".glb", ".obj", ".ply", ".stl")
HULL, MEAN, WORST = 0.9, 0.95, 0.85  # IoU below which cameras, the fit and a view are doubted
NAMED = 3  # views, at most


def refuse_suffix(output: Path) -> None:
    """Refuse to write a mesh in a format that is not known, or where no file can be."""
    if output.suffix.lower() not in SUFFIXES:
        raise InputError(f"{output}: should end in {', '.join(SUFFIXES)}, which names the format")
    if output.is_dir():
        raise InputError(f"{output}: is a folder; should be the file to write")


def describe(output: Path, metrics: Mapping[str, Any]) -> str:
    """The quality in one line."""
    views = f"{metrics['views']} photographs"
    if metrics["views_dropped"]:
        lost = [f"{view}, {why}" for view, why in metrics["cameras"]["dropped"].items()]
        named = "; ".join(lost[:NAMED]) + ("; ..." if lost[NAMED:] else "")
        views += f" ({metrics['views_dropped']} more left out: {named})"
    quality = "good" if not find_doubts(metrics, Path()) else "doubtful"
    whole = "closed" if metrics["watertight"] else "not closed"
    return (
        f"{output}: {quality}; its outline is the object's to {metrics['iou_mean']:.1%} (IoU) in "
        f"{views}, {metrics['iou_min']:.1%} in the worst; {metrics['faces']:,} triangles, {whole}"
    )


def find_doubts(metrics: Mapping[str, Any], folder: Path) -> list[str]:
    """What is doubtful about a mesh, each with what to do.

    Args:
        metrics: of ``metrics.json``
        folder: of the results, for paths
    """
    silhouettes = folder / metrics["silhouettes"]
    doubts = []
    if metrics["hull_iou_mean"] < HULL:
        doubts.append(
            f"cameras and silhouettes contradict each other: no body fills more than "
            f"{metrics['hull_iou_mean']:.0%} of these. Look at the silhouettes in {silhouettes}: "
            "where they are not the object's, give --masks or other --silhouettes; where they are, "
            "the photographs are not of one object that only turns: try --cameras colmap"
        )
    elif metrics["iou_mean"] < MEAN:
        doubts.append("the fit ended early: try --init auto")
    worst = sorted(metrics["iou"], key=metrics["iou"].get)
    worst = [view for view in worst if metrics["iou"][view] < WORST][:NAMED]
    if worst and metrics["hull_iou_mean"] >= HULL:
        doubts.append(
            f"the mesh misses the object in {', '.join(worst)}: look at their silhouettes in "
            f"{silhouettes}, and leave out photographs that show it wrongly"
        )
    if metrics["views_dropped"] > metrics["views"] / 4:
        doubts.append(
            f"{metrics['views_dropped']} of {metrics['views'] + metrics['views_dropped']} "
            "photographs are left out, because the others contradict them: other --silhouettes or "
            "--masks may save them"
        )
    if not metrics["watertight"]:
        doubts.append("the mesh is not closed: try --init ellipsoid")
    return doubts


def export(results: Path, output: Path) -> None:
    """Write a result's mesh where it is wanted, in the format of its ending.

    Args:
        results: the folder of ``mesh.glb`` and ``mesh.obj``
    """
    suffix = output.suffix.lower()
    with replacing(output) as part:
        if suffix in (".glb", ".obj"):
            shutil.copyfile(results / f"mesh{suffix}", part)
        else:
            import trimesh

            trimesh.load_mesh(results / "mesh.obj", process=False).export(part, suffix[1:])
