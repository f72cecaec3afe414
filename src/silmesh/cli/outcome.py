"""The result of a run in one line, with what to do if it is doubtful; the mesh as a file."""

import re
import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from silmesh.errors import NAMED, InputError, name_some
from silmesh.files import replacing
from silmesh.geometry.obj_companions import copy_obj, name_companions
from silmesh.geometry.thresholds import COHERENT
from silmesh.naming import quote

SUFFIXES = (".glb", ".obj", ".ply", ".stl")
MEAN, WORST = 0.95, 0.85  # mean IoU, and least IoU of a view, below which the mesh is doubtful
FEWEST = 8  # with fewer photographs even a visual hull of true silhouettes is far too large
CONTRADICTED = 0.1  # share of views with contradicted silhouettes from which it is doubtful
BROKEN = 0.1  # share of the hull's volume in its smaller pieces from which it is doubtful
UNUSED = 0.2  # share of unused photographs from which it is doubtful
CALIBRATE, COLMAP = "calibrate", "colmap"
SOURCES = {CALIBRATE: {CALIBRATE}, COLMAP: {COLMAP}, "auto": {CALIBRATE, COLMAP}}
WHEN = {  # advice on other sources of cameras
    CALIBRATE: "--cameras calibrate if the object turned before a camera that stood still",
    COLMAP: "--cameras colmap if the camera moved",
}
TURNED = "the photographs are not of one object that only turns"
OTHERWISE = "the cameras are wrong"
KNOWN = "give known cameras by --cameras file:PATH"


def refuse_suffix(output: Path) -> None:
    """Refuse to write a mesh in a format that is not known."""
    if output.suffix.lower() not in SUFFIXES:
        raise InputError(f"{output}: should end in {', '.join(SUFFIXES)}, which names the format")


def describe(output: Path, metrics: Mapping[str, Any], doubts: Sequence[str]) -> str:
    """The quality in one line; ``doubts`` are those of ``find_doubts``."""
    said = []
    if count := metrics["views_repaired"]:
        said.append(f"{count} redrawn")
    if count := metrics["views_dropped"]:
        lost = [f"{view}, {why}" for view, why in metrics["cameras"]["dropped"].items()]
        named = "; ".join(lost[:NAMED]) + ("; ..." if lost[NAMED:] else "")  # they have commas
        said.append(f"{count} more left out: {named}")
    views = f"{metrics['views']} photographs" + (f" ({', '.join(said)})" if said else "")
    quality = "doubtful" if doubts else "good"
    whole = "closed" if metrics["watertight"] else "not closed"
    return (
        f"{output}: {quality}; its outline is the object's to {metrics['iou_mean']:.1%} (IoU) in "
        f"{views}, {metrics['iou_min']:.1%} in the worst; {metrics['faces']:,} triangles, {whole}"
    )


def describe_repairs(metrics: Mapping[str, Any]) -> list[str]:
    """A line for each silhouette that was redrawn: why, and how much of it changed."""
    return [
        f"view {view!r} is redrawn: {told['why']}; {told['added']:.1%} of its area added, "
        f"{told['removed']:.1%} removed"
        for view, told in metrics.get("repairs", {}).items()  # results of before have none
    ]


def find_doubts(
    metrics: Mapping[str, Any], folder: Path, tried: Sequence[str] = (), unread: int = 0
) -> list[str]:
    """What is doubtful about a mesh, each with what to do.

    Args:
        metrics: of ``metrics.json``
        folder: of the results, for paths
        tried: the sources of cameras that were tried, beside that of the mesh
        unread: how many photographs were given in formats that are not read
    """
    silhouettes = folder / metrics["silhouettes"]
    doubts = list(metrics.get("measured", ()))  # results of before have none
    turns = metrics["cameras"]["source"] == CALIBRATE
    if metrics["hull_iou_mean"] < COHERENT:
        doubts.append(
            f"cameras and silhouettes contradict each other: no body fills more than "
            f"{metrics['hull_iou_mean']:.0%} of these. Look at the silhouettes in "
            f"{quote(silhouettes)}: where they are not the object's, give --masks or other "
            f"--silhouettes; where they are, {TURNED if turns else OTHERWISE}: "
            + _advise_others([*tried, *_list_sources(metrics["cameras"])])
        )
    elif metrics["iou_mean"] < MEAN and metrics["views"] >= FEWEST and not doubts:
        doubts.append("the fit ended early: try --init auto")
    worst = sorted(metrics["iou"], key=metrics["iou"].get)
    worst = [view for view in worst if metrics["iou"][view] < WORST][:NAMED]
    if worst and metrics["hull_iou_mean"] >= COHERENT:
        doubts.append(
            f"the mesh misses the object in {', '.join(worst)}: look at their silhouettes in "
            f"{quote(silhouettes)}, and leave out photographs that show it wrongly"
        )
    if broken := _describe_broken(metrics):
        doubts.append(broken)
    if unused := _describe_unused(metrics, unread):
        doubts.append(unused)
    if metrics["views"] < FEWEST:
        doubts.append(
            f"{metrics['views']} photographs leave much of the shape open, however well it fills "
            f"them: take {FEWEST} or more, better 20 to 100, from all around"
        )
    if contradicted := _name_contradicted(metrics):
        doubts.append(
            f"along the outlines of {contradicted} the photographs change little, or more beside "
            f"it: look at the silhouettes in {quote(silhouettes)}. A shadow or a reflection "
            "that passes for the object wants --silhouettes matting or --masks, masks that lie "
            "beside the object or are another photograph's the right ones"
        )
    if not metrics["watertight"]:
        doubts.append("the mesh is not closed: try --init ellipsoid")
    return doubts


def _describe_broken(metrics: Mapping[str, Any]) -> str:
    """That the silhouettes are of several bodies, and the mesh is of one."""
    first = metrics.get("first", {})
    if first.get("pieces", 1) < 2 or first.get("lost", 0.0) <= BROKEN:
        return ""
    return (
        f"what the silhouettes show comes in {first['pieces']} pieces, {first['lost']:.0%} of the "
        "volume in the smaller ones, and the mesh is one: give masks of one object alone"
    )


def _describe_unused(metrics: Mapping[str, Any], unread: int) -> str:
    """Why photographs have no part in the mesh, if they are more than a few."""
    kinds = defaultdict(list)
    for view, why in metrics["cameras"]["dropped"].items():
        kinds[re.sub(r"'[^']*'|\d+", "", why)].append(f"{view}: {why}")
    unused = unread + sum(map(len, kinds.values()))
    if unused <= UNUSED * (metrics["views"] + unused):
        return ""
    reasons = [f"{unread} are in formats that are not read"] * bool(unread)
    for views in sorted(kinds.values(), key=len, reverse=True):
        reasons.append(f"{len(views)} as {views[0]}" if views[1:] else views[0])
    remedies = ["save those as JPEG or PNG"] * bool(unread)
    remedies += [
        "get anew what cannot be read",
        "other --silhouettes or --masks may save what others deny",
    ] * bool(kinds)
    return (
        f"{unused} of {metrics['views'] + unused} photographs are not used ({'; '.join(reasons)}): "
        + "; ".join(remedies)
    )


def _name_contradicted(metrics: Mapping[str, Any]) -> str:
    """The views of which the colours contradict the silhouettes, if they are more than a few."""
    views = metrics.get("silhouettes_contradicted", ())  # results of before have none
    if len(views) <= CONTRADICTED * metrics["views"]:
        return ""
    return f"{name_some(views)} ({len(views)} of {metrics['views']})"


def advise_on_cameras(silhouettes: Path, tried: Sequence[str], measured: bool) -> str:
    """What to do where no cameras are found.

    Args:
        silhouettes: the folder of what was found of them
        tried: the sources of cameras that were tried
        measured: whether something was found that explains it, and is said with what to do
    """
    if measured:
        then = f"Where they are, do what stands beside what was measured, or {KNOWN}"
    elif not _find_untried(tried):
        then = (
            "Where they are, take 20 to 100 photographs, each at most 20 degrees from the next: of "
            "the object turned in even steps, or in a walk around it, with something patterned "
            f"below; or {KNOWN}"
        )
    else:
        then = f"Where they are: {_advise_others(tried)}"
    return (
        f"what to do: look at the silhouettes in {quote(silhouettes)}; where they are not the "
        f"object's, give --masks or other --silhouettes. {then}"
    )


def _list_sources(cameras: Mapping[str, Any]) -> list[str]:
    """The sources that were tried for a mesh's cameras."""
    return [cameras["source"], *(attempt["source"] for attempt in cameras.get("attempts", ()))]


def _find_untried(tried: Sequence[str]) -> list[str]:
    """The sources of cameras that find them, and were not tried."""
    done = set().union(*(SOURCES.get(source, set()) for source in tried))
    return [source for source in (CALIBRATE, COLMAP) if source not in done]


def _advise_others(tried: Sequence[str]) -> str:
    """Other cameras than those that were tried."""
    others = [WHEN[source] for source in _find_untried(tried)]
    return f"try {', '.join(others)}; or {KNOWN}" if others else KNOWN


def name_outputs(output: Path, textured: bool) -> tuple[Path, ...]:
    """The mesh to write, and what is written beside it."""
    several = textured and output.suffix.lower() == ".obj"
    return (output, *name_companions(output)) if several else (output,)


def export(results: Path, output: Path, textured: bool = False) -> None:
    """Write a result's mesh where it is wanted, in the format of its ending.

    Args:
        results: the folder of ``mesh.glb`` and ``mesh.obj``
        textured: whether these have a texture, and ``coloured.ply`` has colours of the vertices

    Raises:
        InputError: a person's file is where an OBJ's MTL or PNG belongs
    """
    suffix = output.suffix.lower()
    if len(name_outputs(output, textured)) > 1:
        copy_obj(results / "mesh.obj", output)
    elif suffix in (".glb", ".obj"):
        copy(results / f"mesh{suffix}", output)
    else:
        import trimesh

        coloured = results / ("coloured.ply" if textured else "mesh.obj")
        with replacing(output) as part:
            trimesh.load_mesh(coloured, process=False).export(part, suffix[1:])


def copy(made: Path, output: Path) -> None:
    """Copy a file to where it is wanted, whole or not at all."""
    with replacing(output) as part:
        shutil.copyfile(made, part)
