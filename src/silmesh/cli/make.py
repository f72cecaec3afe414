"""Makes one object's mesh: chooses sources, runs the workflow, and says what it came to."""

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from glob import escape
from pathlib import Path
from typing import Any

import click

from silmesh.cameras.locate import locate
from silmesh.cameras.sets import describe_unused, find_sets
from silmesh.cli.bar import Bar
from silmesh.cli.outcome import (
    CALIBRATE,
    advise_on_cameras,
    copy,
    describe,
    describe_repairs,
    export,
    find_doubts,
    name_outputs,
    refuse_suffix,
)
from silmesh.cli.runner import RunError, Runner
from silmesh.cli.workspace import Workspace, claim, name_links, place_of, try_workspace
from silmesh.errors import InputError, shorten
from silmesh.files import try_file
from silmesh.geometry.obj_companions import try_companions
from silmesh.geometry.thresholds import CONVINCING
from silmesh.intake.photographs import (
    describe_count,
    find_cameras,
    find_longest,
    find_masks,
    find_photographs,
    find_unread,
    is_picture,
    is_video,
)
from silmesh.intake.sources import choose_cameras, choose_silhouettes, look
from silmesh.naming import name_views
from silmesh.own_code import own_file
from silmesh.planning.datasets import usable
from silmesh.remote.cache import CACHE
from silmesh.settings.detail import NORMAL, choose_detail
from silmesh.settings.fit import name_fit
from silmesh.settings.init import mesh_file
from silmesh.settings.texture import NONE
from silmesh.silhouettes.mask import refuse_labels
from silmesh.steps.fork_server import serving

VIDEO = "video"  # folder of what a video is cut into; no masks lie beside it
OTHER_KEEP = "--keep should name another folder"
OTHER_CACHE = f"--keep FOLDER works in another one, and ${CACHE} may name another folder for all"
PAGE = "results/report/report.html"
RESULTS = ("mesh.glb", "mesh.obj", "metrics.json")
TEXTURED = ("mesh.mtl", "mesh.png", "coloured.ply")  # beside these, of a mesh with a texture
FILE = "file"  # the source of cameras that a path follows
MASK = "mask"  # the source of silhouettes that are files
TAKING_SETS = (None, "calibrate", "auto")  # sources of cameras; None where they are chosen
PHOTOMETRIC = {None: None, "auto": "auto", "none": False}  # words of the command
BEFORE_CAMERAS = ("", "views", "fetch_weights", "silhouettes")  # other cameras do not mend these


def make_mesh(
    paths: Sequence[Path],
    output: Path,
    *,
    page: Path | None,
    keep: Path | None,
    masks: Path | None,
    silhouettes: str | None,
    cameras: str | None,
    cores: int,
    verbose: bool,
    **options: Any,
) -> None:
    """Make a mesh of the photographs that a person names.

    Args:
        paths: a folder, or several, or files, or a video
        output: the mesh to write
        page: the page to write; None for none
        keep: the folder to work in; None for one in the cache
        masks: their folder; None where they are not given
        silhouettes, cameras: sources; None where they are to be chosen
        options: of the configuration: ``turntable``, ``sets``, ``detail``, ``size``, ``init``,
            ``preset``, ``quality``, ``photometric``, ``texture``; None where a level of detail or
            a size is not given

    Raises:
        InputError: what is named cannot be used
        RunError: a step of the workflow failed
    """
    _try_outputs(output, page, options["texture"] != NONE)
    _refuse_sets(paths, options["sets"], cameras)
    folder, name = place_of(paths, keep)
    try_workspace(folder, OTHER_KEEP if keep else OTHER_CACHE)
    named = _cut_video(paths, folder)
    several = bool(options["sets"].strip())
    others = (output, page, folder)
    files, found = _find_inputs(named, masks, silhouettes, cameras, others, several)
    silhouettes, tries = _choose(files, found, silhouettes, cameras)
    if silhouettes == MASK:
        refuse_labels(found)
    options["sets"] = _name_sets(options["sets"], files)
    options["chosen"] = _choose_detail(files, options, cores)
    if options["sets"]:
        _say(*filter(None, [describe_unused(tries[0])]))
    work = Workspace(folder, name, tuple(files), tuple(found))
    work.check(*_configure(silhouettes, tries[0], options)[1:])
    outputs = (*name_outputs(output, options["texture"] != NONE), page)
    _refuse_inputs(outputs, (*paths, *files, *found, *_list_files(cameras)))
    if before := work.prepare():
        _say(f"the results in {work.folder} are of silmesh {before}; what changed is made anew")
    bar = Bar(len(files), silhouettes)
    besides = [PAGE] if page else []
    with serving() as served, closing(bar):
        runner = Runner(work.folder, cores, verbose, served)
        variant, tried = _try(work, runner, bar, silhouettes, tries, options, besides)
    export(work.folder / work.result(variant, ""), output, options["texture"] != NONE)
    if page:
        copy(work.folder / PAGE, page)
    _say_outcome(work, variant, tried, output, len(find_unread(named, files)))


def _say_outcome(
    work: Workspace, variant: str, tried: Sequence[str], output: Path, unread: int
) -> None:
    """Say what the stages warn of, the quality of the mesh, and what to do about it.

    Args:
        tried: the sources of cameras that were tried
        unread: how many photographs are in formats that are not read
    """
    metrics = _read(work, variant)
    if relief := metrics.get("relief"):
        _say(relief["said"])
    _say(*(_as_written(warning, tried[-1]) for warning in metrics["cameras"]["warnings"]))
    _say(*describe_repairs(metrics))
    for stage in ("first", "fit", "texture"):
        _say(*metrics.get(stage, {}).get("warnings", ()))
    doubts = find_doubts(metrics, work.folder / "results", tried, unread)
    click.echo(describe(output, metrics, doubts))
    _say(*(f"doubtful: {doubt}" for doubt in doubts))


def _path_of(cameras: str | None) -> Path | None:
    """The file or folder that cameras are read from, if they are."""
    _, _, path = (cameras or "").partition(":")
    return Path(path).expanduser() if path else None  # a shell leaves file:~ as it is


def _list_files(cameras: str | None) -> Sequence[Path]:
    """The files that cameras are read from, if they are."""
    path = _path_of(cameras)
    return locate(path).files if path else ()


def _try_outputs(output: Path, page: Path | None, textured: bool) -> None:
    """Try whether what is asked for can be written where it is wanted.

    Raises:
        InputError: it cannot
    """
    refuse_suffix(output)
    try_file(output)
    written = name_outputs(output, textured)
    if len(written) > 1:
        try_companions(output)
    if page:
        try_file(page)
        if os.path.lexists(page) and is_picture(page):
            raise InputError(f"{page}: is a picture or a video; should be the page to write")
        if _place_of(page) in map(_place_of, written):
            raise InputError(f"{page}: should be another file than that of the mesh")


def _place_of(file: Path) -> Path:
    """Where a file lies, however its folder is named; what is written there replaces a link."""
    return Path(os.path.realpath(file.parent), file.name)


def _refuse_inputs(outputs: Sequence[Path | None], files: Sequence[Path]) -> None:
    """Refuse to write over what is read."""
    read = {os.path.realpath(file) for file in files}
    for output in filter(None, outputs):
        if os.path.realpath(output) in read:
            raise InputError(f"{output}: is one of the files that are read; should be another one")


def _refuse_sets(paths: Sequence[Path], sets: str, cameras: str | None) -> None:
    """Refuse to name sets of a video's pictures, or beside cameras that do not take them."""
    if not sets.strip():
        return
    given = f"--sets {shorten(sets)}"
    if len(paths) == 1 and is_video(paths[0]):
        raise InputError(
            f"{given}: {paths[0]} is a video, whose pictures have no names yet; give photographs "
            "of each set, or leave --sets out"
        )
    if cameras not in TAKING_SETS:
        raise InputError(
            f"{given}: --cameras {cameras} takes no sets; should be "
            f"{' or '.join(filter(None, TAKING_SETS))}, or --sets left out"
        )


def _cut_video(paths: Sequence[Path], folder: Path) -> Sequence[Path]:
    """What is named; of a video the photographs that it is cut into, in the folder to work in."""
    if len(paths) > 1 or not is_video(paths[0]):
        return paths
    from silmesh.intake.video import cut  # its libraries, for few

    claim(folder)
    _say(f"{paths[0]}: is a video; the sharpest pictures are taken from it")
    return cut(paths[0], folder / VIDEO / "frames")


def _find_inputs(
    named: Sequence[Path],
    masks: Path | None,
    silhouettes: str | None,
    cameras: str | None,
    others: Sequence[Path | None],
    several: bool,
) -> tuple[list[Path], list[Path]]:
    """The photographs and their masks, if these are wanted; says what lies there and is not used.

    Args:
        named: a folder, or several, or files
        others: what else is named, which is no photograph that was overlooked
        several: they are said to be of several sets
    """
    besides = [path for path in (*others, masks, _path_of(cameras)) if path]
    files, notes = find_photographs(named, besides, several)
    found, lacking = _find_masks(files, masks, silhouettes)
    known = [] if _path_of(cameras) else find_cameras(files)
    _say(describe_count(files), *notes, *lacking, *known)
    return files, found


def _find_masks(
    files: Sequence[Path], given: Path | None, silhouettes: str | None
) -> tuple[list[Path], list[str]]:
    """The mask of each photograph if they are wanted, and what is said of those that are not used.

    Raises:
        InputError: masks are given, and a photograph has none or the silhouettes are others
    """
    if silhouettes in (None, MASK):
        return find_masks(files, given)
    if given:
        raise InputError(
            f"--masks {given}: --silhouettes {silhouettes} takes no masks; leave one of the two out"
        )
    found, _ = find_masks(files)
    if not found:
        return [], []
    return [], [f"not used: the masks in {found[0].parent}, because of --silhouettes {silhouettes}"]


def _choose(
    files: Sequence[Path], masks: Sequence[Path], silhouettes: str | None, cameras: str | None
) -> tuple[str, tuple[str, ...]]:
    """The source of silhouettes and those of cameras, given or chosen, which is said."""
    if silhouettes and cameras:
        return silhouettes, (cameras,)
    seen = look(files)
    tries = (cameras,) if cameras else ()
    if not silhouettes:
        silhouettes, why = choose_silhouettes(seen, masks, str(files[0].parent))
        _say(f"silhouettes: {silhouettes} ({why})")
    if not tries:
        tries, why = choose_cameras(seen)
        _say(f"cameras: {tries[0]} ({why})")
    return silhouettes, tries


def _choose_detail(
    files: Sequence[Path], options: Mapping[str, Any], cores: int
) -> Mapping[str, Mapping[str, Any]]:
    """The settings of a level of detail; if it is asked for, what they will cost is said."""
    detail, size, preset = (options[name] for name in ("detail", "size", "preset"))
    longest = find_longest(files) if detail else 0
    chosen = choose_detail(detail or NORMAL, longest, len(files), size, cores, preset)
    if detail:
        _say(*chosen.said)
    return chosen.settings


def _try(
    work: Workspace,
    runner: Runner,
    bar: Bar,
    silhouettes: str,
    tries: Sequence[str],
    options: dict[str, Any],
    besides: Sequence[str],
) -> tuple[str, tuple[str, ...]]:
    """Try sources of cameras until the silhouettes agree with one.

    Returns:
        the variant that came of it, and the sources that were tried

    Raises:
        RunError: none gave a mesh
    """
    made, failure, tried = None, None, []
    for cameras, then in zip(tries, [*tries[1:], None], strict=True):
        tried.append(cameras)
        try:
            again = {**options, "calibrated": CALIBRATE in tried[:-1]}
            variant = _run(work, runner, bar, silhouettes, cameras, again, besides)
        except RunError as error:
            failure = RunError(_as_written(work.restore(str(error)), cameras), error.step)
            if error.step in BEFORE_CAMERAS:
                break
        else:
            made = variant
            coherence = _read(work, made)["hull_iou_mean"]
            if coherence >= CONVINCING:
                break
        if then:
            why, *measured = (
                str(failure).splitlines() if made is None else [f"hull IoU {coherence:.2f}"]
            )
            bar.say(f"silmesh: cameras: {then} (not {cameras}: {why})")
            for line in measured:
                bar.say(f"silmesh: {line.strip()}")
    if made is None and failure.step == "scene" and not tries[-1].startswith(f"{FILE}:"):
        from silmesh.scene.diagnosis import MEASURED, describe_masks  # loads torch, for failures

        found = work.folder / "results" / work.object / "stages" / "silhouettes"
        advice = advise_on_cameras(found, tried, measured=MEASURED in str(failure))
        lines = [f"{MEASURED}{said}" for said in describe_masks(work.masks)]
        whole = "\n  ".join([str(failure), *lines])
        raise RunError(f"{whole}\nsilmesh: {advice}", failure.step)
    if made is None:
        raise failure
    return made, tuple(tried)


def _run(
    work: Workspace,
    runner: Runner,
    bar: Bar,
    silhouettes: str,
    cameras: str,
    options: dict[str, Any],
    besides: Sequence[str],
) -> str:
    """Run the workflow with a source of cameras: the variant, which is named after it.

    Args:
        besides: what is to be made beside the results of a variant
    """
    variant, row, values = _configure(silhouettes, cameras, options)
    try:
        work.configure(row, values)
    except InputError as error:
        raise InputError(work.restore(str(error))) from error
    names = RESULTS if options["texture"] == NONE else (*RESULTS, *TEXTURED)
    runner.run([*(work.result(variant, name) for name in names), *besides], bar)
    return variant


def _configure(
    silhouettes: str, cameras: str, options: dict[str, Any]
) -> tuple[str, dict[str, str], dict[str, Any]]:
    """The name of a variant, what the object's row says, and the configuration."""
    kind, _, _ = cameras.partition(":")
    file = _path_of(cameras)
    where = f"{kind}:{usable(file.absolute())}" if file else cameras
    variant = kind if kind.isidentifier() else "mesh"
    init, preset = _from_anywhere(options["init"]), _from_anywhere(options["preset"])
    photometric = PHOTOMETRIC[options["photometric"]]
    row = {
        "silhouettes": _from_anywhere(silhouettes),
        "cameras": where,
        "turntable": options["turntable"],
        "sets": options["sets"],
    }
    chosen = options["chosen"]
    fit = {**name_fit(preset, photometric), **chosen.get("fit", {})}
    values = {
        "views": chosen["views"],
        "quality": {"policy": options["quality"]},
        "variants": {variant: {"init": {"shape": init}, "fit": fit}},
        "texture": {"size": options["texture"]},
        # an attempt that is there already costs nothing, whatever COLMAP finds
        **({"calibrate": {"always": True}} if options.get("calibrated") else {}),
    }
    return variant, row, values


def _name_sets(cell: str, files: Sequence[Path]) -> str:
    """The same sets by the names that the photographs have in the folder to work in."""
    views = name_views(files)
    sets = find_sets(cell, views, [file.absolute().parent.name for file in files])
    links = dict(zip(views, name_links(files), strict=True))
    return ";".join(",".join(escape(links[view]) for view in views) for views in sets)


def _from_anywhere(method: str) -> str:
    """A method's name, the path of a person's own made absolute: the workflow runs elsewhere."""
    if mesh := mesh_file(method):
        return f"file:{usable(mesh.absolute())}"
    return str(Path(method).absolute()) if own_file(method) else method


def _as_written(said: str, cameras: str) -> str:
    """A message with the path of a file of cameras as the person wrote it."""
    kind, _, path = cameras.partition(":")
    if kind != FILE or not path:
        return said
    return said.replace(str(_path_of(cameras).absolute()), path)


def _read(work: Workspace, variant: str) -> dict[str, Any]:
    return json.loads(
        (work.folder / work.result(variant, "metrics.json")).read_text(encoding="utf-8")
    )


def _say(*lines: str) -> None:
    for line in lines:
        click.echo(f"silmesh: {line}", err=True)
