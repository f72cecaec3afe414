"""The cells of ``stress.py`` as tables in Markdown, and which of them miss the goal."""

from collections.abc import Mapping

import numpy as np

NEAR = 0.01  # of IoU, by which no cell may lie below the best of ``BESIDE``
BESIDE = ("hull", "ellipsoid", "today")
LITTLE = 0.002  # of IoU: where damage costs less, nothing is there to be regained
COLLAPSE = 0.8  # of IoU with the true silhouettes
COLUMNS = ("hull", "ellipsoid", "rival", "today", "silmesh", "drop", "repair")
JUDGED = ("today", "silmesh", "drop", "repair")  # methods that say how good they are

Cells = Mapping[str, Mapping]  # an object's, by methods


def judge_cell(cells: Cells, method: str) -> list[str]:
    """What misses the goal in one cell: ``below`` the best of the others, ``called good``."""
    made = cells.get(method)
    if made is None:
        return []
    others = [cells[name]["iou"] for name in BESIDE if name in cells and name != method]
    missed = ["below"] * (max(others, default=0.0) - made["iou"] > NEAR)
    return missed + ["called good"] * (made["iou"] < COLLAPSE and made["verdict"] == "good")


def tabulate(kept: Mapping[str, Mapping[str, Mapping[str, Cells]]]) -> str:
    """All tables: one for each set of views, size, cameras and seed."""
    return "\n\n".join(_tabulate_one(about, rows) for about, rows in kept.items())


def _tabulate_one(about: str, rows: Mapping[str, Mapping[str, Cells]]) -> str:
    there = {m for objects in rows.values() for cells in objects.values() for m in cells}
    methods = [method for method in COLUMNS if method in there]
    judged = [method for method in JUDGED if method in there]
    heads = ["damage", *methods, *(f"{method}: verdicts" for method in judged)]
    heads += [f"{method}: wrong named / others" for method in judged]
    turned = [method for method in judged if _find_turned(rows, method)]
    heads += [f"{method}: axis / elevation off" for method in turned]
    heads += [f"{method}: missed" for method in judged]
    objects = sorted({name for row in rows.values() for name in row})
    lines = [f"{about}; {', '.join(objects)}", ""]
    lines += ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    lines += [
        _row(cell, row, methods, judged, turned) for cell, row in rows.items() if any(row.values())
    ]
    return "\n".join(lines)


def tabulate_objects(kept: Mapping[str, Mapping[str, Mapping[str, Cells]]], method: str) -> str:
    """The tables of one method, object by object, as ``_show_cell`` shows each."""
    return "\n\n".join(_tabulate_objects(*one, method) for one in kept.items())


def _tabulate_objects(about: str, rows: Mapping[str, Mapping[str, Cells]], method: str) -> str:
    objects = sorted({name for row in rows.values() for name in row if method in row[name]})
    lines = [f"{about}; {method}", "", f"| damage | {' | '.join(objects)} |"]
    lines += ["|---" * (1 + len(objects)) + "|"]
    for cell, row in rows.items():
        shown = [_show_cell(row.get(name, {}), method) for name in objects]
        if any(word != "–" for word in shown):
            lines += [f"| {cell} | {' | '.join(shown)} |"]
    return "\n".join(lines)


def tabulate_regained(kept: Mapping[str, Mapping[str, Mapping[str, Cells]]]) -> str:
    """Of what damage costs the mesh, which share the other policies regain, object by object."""
    return "\n\n".join(_tabulate_regained(*one) for one in kept.items())


def _tabulate_regained(about: str, rows: Mapping[str, Mapping[str, Cells]]) -> str:
    clean = {name: cells["silmesh"] for name, cells in rows["clean"].items()}
    lines = [about, ""]
    for measure in ("iou", "volume_iou"):
        lines += [f"| {measure} | {' | '.join(clean)} |", "|---" * (1 + len(clean)) + "|"]
        for cell, row in rows.items():
            shown = [_show_regained(row.get(name, {}), clean[name], measure) for name in clean]
            lines += [f"| {cell} | {' | '.join(shown)} |"]
        lines += [""]
    return "\n".join(lines)


def _show_regained(cells: Cells, clean: Mapping, measure: str) -> str:
    """What is left of the clean value, and after each policy, with the share that it regains."""
    if "silmesh" not in cells or cells["silmesh"].get(measure) is None:
        return "–"
    kept, whole = cells["silmesh"][measure], clean[measure]
    word = f"{kept:.3f} of {whole:.3f}"
    for policy in ("drop", "repair"):
        if policy in cells:
            gain = cells[policy][measure] - kept
            share = f" ({gain / (whole - kept):.0%})" if whole - kept >= LITTLE else ""
            word += f", {policy} {cells[policy][measure]:.3f}{share}"
    return word


def _show_cell(cells: Cells, method: str) -> str:
    """IoU, the best of the others' in brackets, volume IoU, a ``d`` if doubtful; bold if missed.

    Of a case of few views also the IoU with the silhouettes of those that were not given.
    """
    made = cells.get(method)
    if made is None:
        return "–"
    if made["verdict"] in ("refused", "crashed"):
        return f"**{made['verdict']}**"
    others = [cells[name]["iou"] for name in BESIDE if name in cells and name != method]
    word = f"{made['iou']:.3f}" + (f" ({max(others):.3f})" if others else "")
    word += f" / {made['volume_iou']:.3f}" if made.get("volume_iou") is not None else ""
    if "iou_unseen" in made:
        unseen = [
            cells[name]["iou_unseen"] for name in BESIDE if "iou_unseen" in cells.get(name, {})
        ]
        word += f", unseen {made['iou_unseen']:.3f}"
        word += f" ({max(unseen):.3f})" if unseen else ""
    word += " d" * (made["verdict"] == "doubtful")
    return f"**{word}**" if judge_cell(cells, method) else word


def _find_turned(rows: Mapping[str, Mapping[str, Cells]], method: str) -> bool:
    """Whether a turntable was found in any cell of a method."""
    return any("axis_off" in c.get(method, {}) for row in rows.values() for c in row.values())


def _row(
    cell: str,
    row: Mapping[str, Cells],
    methods: list[str],
    judged: list[str],
    turned: list[str],
) -> str:
    words = [cell]
    words += [_figures([cells[m] for cells in row.values() if m in cells]) for m in methods]
    for say in (_verdicts, _named):
        words += [say([cells[m] for cells in row.values() if m in cells]) for m in judged]
    words += [_turntable([cells[m] for cells in row.values() if m in cells]) for m in turned]
    for method in judged:
        missed = [
            f"{name} {word}" for name, cells in row.items() for word in judge_cell(cells, method)
        ]
        words.append("; ".join(missed) or "–")
    return "| " + " | ".join(words) + " |"


def _figures(made: list[Mapping]) -> str:
    """Mean IoU with the true silhouettes, the least of the objects', and the mean volume IoU."""
    if not made:
        return "–"
    values = [one["iou"] for one in made]
    volumes = [one["volume_iou"] for one in made if one.get("volume_iou") is not None]
    volume = f" / {np.mean(volumes):.3f}" if volumes else ""
    return f"{np.mean(values):.3f} ({min(values):.3f}){volume}"


def _verdicts(made: list[Mapping]) -> str:
    words = [one["verdict"] for one in made]
    return ", ".join(f"{words.count(word)} {word}" for word in sorted(set(words))) or "–"


def _named(made: list[Mapping]) -> str:
    """The share of the wrong views that is named, and of the others, over what was not refused."""
    made = [one for one in made if "named" in one]
    shares = [
        [one[name] for one in made if one.get(name) is not None]
        for name in ("recall", "false_alarms")
    ]
    return " / ".join(f"{np.mean(share):.0%}" if share else "–" for share in shares)


def _turntable(made: list[Mapping]) -> str:
    """The largest errors of the objects' axes, in pixels, and elevations, in degrees."""
    made = [one for one in made if "axis_off" in one]
    if not made:
        return "–"
    axis, elevation = (max(one[k] for one in made) for k in ("axis_off", "elevation_off"))
    return f"{axis:.2f} / {elevation:.2f}"
