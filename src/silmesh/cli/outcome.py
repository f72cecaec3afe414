"""What a run came to, in one line, and what to do where it is doubtful; the mesh as a file."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from silmesh.errors import InputError
from silmesh.files import replacing

SUFFIXES = (".glb", ".obj", ".ply", ".stl")
HULL, MEAN, WORST = 0.9, 0.95, 0.85  # IoU below which cameras, the fit and a view are doubted
NAMED = 3  # views, at most
TURNED = "the photographs are not of one object that only turns: try --cameras colmap"
OTHERWISE = "the cameras are wrong: try --cameras calibrate if the object turned, colmap if not"


def refuse_suffix(output: Path) -> None:
    """Refuse to write a mesh in a format that is not known, or where a folder is."""
    if output.suffix.lower() not in SUFFIXES:
        raise InputError(f"{output}: should end in {', '.join(SUFFIXES)}, which names the format")
    if os.path.isdir(output):
        raise InputError(f"{output}: is a folder; should be the file to write")


def describe(output: Path, metrics: Mapping[str, Any]) -> str:
    """The quality in one line."""
    said = []
    if count := metrics["views_repaired"]:
        said.append(f"{count} redrawn")
    if count := metrics["views_dropped"]:
        lost = [f"{view}, {why}" for view, why in metrics["cameras"]["dropped"].items()]
        named = "; ".join(lost[:NAMED]) + ("; ..." if lost[NAMED:] else "")
        said.append(f"{count} more left out: {named}")
    views = f"{metrics['views']} photographs" + (f" ({', '.join(said)})" if said else "")
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
    turns = metrics["cameras"]["source"] == "calibrate"
    if metrics["hull_iou_mean"] < HULL:
        doubts.append(
            f"cameras and silhouettes contradict each other: no body fills more than "
            f"{metrics['hull_iou_mean']:.0%} of these. Look at the silhouettes in {silhouettes}: "
            "where they are not the object's, give --masks or other --silhouettes; where they are, "
            + (TURNED if turns else OTHERWISE)
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


def advise_on_cameras(silhouettes: Path) -> str:
    """What to do where no cameras are found.

    Args:
        silhouettes: the folder of what was found of them
    """
    return (
        f"what to do: look at the silhouettes in {silhouettes}; where they are not the object's, "
        "give --masks or other --silhouettes. Where they are, take 20 to 100 photographs, each "
        "at most 20 degrees from the next: of the object turned in even steps, or in a walk around "
        "it, with something patterned below; or give known cameras by --cameras file:PATH"
    )


def export(results: Path, output: Path) -> None:
    """Write a result's mesh where it is wanted, in the format of its ending.

    Args:
        results: the folder of ``mesh.glb`` and ``mesh.obj``
    """
    suffix = output.suffix.lower()
    if suffix in (".glb", ".obj"):
        copy(results / f"mesh{suffix}", output)
    else:
        import trimesh

        with replacing(output) as part:
            trimesh.load_mesh(results / "mesh.obj", process=False).export(part, suffix[1:])


def copy(made: Path, output: Path) -> None:
    """Copy a file to where it is wanted, whole or not at all."""
    with replacing(output) as part:
        shutil.copyfile(made, part)
