"""Answers to the report's questions, from what ``config/benchmark.yaml`` left: a page and a figure.

bin/run --configfile config/benchmark.yaml
python benchmarks/findings.py --results results

With ``--full`` and the results of ``config/benchmark-full.yaml`` it says, too, whether 256 pixels
and 2,000 steps tell the same.
"""

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from silmesh.files import replacing
from silmesh.report.conclusions import TIE, Fit, draw_conclusions
from silmesh.report.figures import write_figure
from silmesh.report.statistics import LEVEL, correct_by_holm
from silmesh.steps.conclude import read_fit

SIZES = (642, 1352, 1922)
SHAPES = ("ellipsoid", "cylinder", "cube", "prism", "hull", "auto")
PLACED, LEVEL_PLACED = "placed-vertices_1352", "level-placed-vertices_1352"
SHOWN = {
    "steps": ("steps", 0),
    "area": ("mean loss", 4),
    "loss": ("final loss", 4),
    "iou": ("1 - IoU", 4),
    "chamfer": ("chamfer", 4),
}
DRAWN = ("steps", "area", "loss")

Pair = tuple[str, str]  # a baseline, and what is compared with it


@dataclass(frozen=True)
class Question:
    """A question of the report, and the pairs that answer it.

    Attributes:
        title: of the section
        asked: in a sentence
        pairs: of them
        objects: whether each object's own difference is shown
    """

    title: str
    asked: str
    pairs: tuple[Pair, ...]
    objects: bool = False


def _against(baseline: str, variants: Iterable[str]) -> tuple[Pair, ...]:
    return tuple((baseline, variant) for variant in variants)


QUESTIONS = (
    Question(
        "Does placing the sphere help?",
        "The report scales and shifts the sphere to the first silhouette.",
        tuple(
            (f"{cameras}unplaced-vertices_{n}", f"{cameras}placed-vertices_{n}")
            for cameras in ("", "level-")
            for n in SIZES
        ),
        objects=True,
    ),
    Question(
        "Do more polygons help?",
        "The placed sphere of 1,352 vertices against the smaller and the larger one.",
        _against(PLACED, (f"placed-vertices_{n}" for n in (642, 1922)))
        + _against(LEVEL_PLACED, (f"level-placed-vertices_{n}" for n in (642, 1922))),
    ),
    Question(
        "Does another initial mesh help?",
        "The placed sphere against other shapes of 1,352 vertices, cylinders among them.",
        _against(PLACED, (f"from-shape_{shape}" for shape in SHAPES)),
        objects=True,
    ),
    Question(
        "And on wrong cameras?",
        "The same on the report's level cameras.",
        _against(LEVEL_PLACED, (f"level-from-shape_{shape}" for shape in SHAPES)),
    ),
    Question(
        "What do wrong cameras cost, against wrong initialisation?",
        "Right cameras against the report's, level and aimed at the origin; beside them the cost "
        "of a sphere that is not placed, and the gain of a hull.",
        (
            (PLACED, LEVEL_PLACED),
            ("from-shape_hull", "level-from-shape_hull"),
            (PLACED, "unplaced-vertices_1352"),
            (PLACED, "from-shape_hull"),
        ),
        objects=True,
    ),
    Question(
        "Do more pixels help?",
        "256 pixels along a side against 64. Losses are of images of their own size.",
        ((PLACED, "fine"),),
    ),
    Question(
        "Do Adam's usual betas do as well?",
        "(0.9, 0.999) against the report's (0.5, 0.99).",
        ((PLACED, "adam"),),
    ),
)


def main() -> None:
    """Read the fits, compare, and write the page and its figure."""
    args = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    args.add_argument("--results", type=Path, default=Path("results"))
    args.add_argument("--full", type=Path, help="results of config/benchmark-full.yaml")
    args.add_argument("--page", type=Path, default=Path("docs/findings.md"))
    args.add_argument("--figure", type=Path, default=Path("docs/findings.png"))
    given = args.parse_args()
    small = read_fits(given.results)
    tables = [compare(question, small) for question in QUESTIONS]
    lines = _open(small, given.figure.name)
    for question, table in zip(QUESTIONS, tables, strict=True):
        lines += _answer(question, table)
        if question.objects:
            lines += _by_object(question.pairs, small)
    if given.full:
        lines += _confirm(small, read_fits(given.full))
    with replacing(given.page) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_figure(given.figure, _draw(tables))


def read_fits(results: Path) -> list[Fit]:
    """All fits that a run has planned and made."""
    plan = json.loads((results / "report" / "plan.json").read_text(encoding="utf-8"))
    return [read_fit(results, planned) for planned in plan["runs"]]


def compare(question: Question, fits: Sequence[Fit]) -> pd.DataFrame:
    """A row a pair and measure, p corrected over the question's pairs of each measure.

    Chamfer distances on level cameras, whose frame is not that of the truth, are left out.
    """
    tables = [
        draw_conclusions([f for f in fits if f.experiment in pair], pair, pair[0])
        for pair in question.pairs
    ]
    table = pd.concat(tables, ignore_index=True)
    for _, rows in table.groupby("measure"):
        ps = [None if pd.isna(p) else p for p in rows["p"]]
        table.loc[rows.index, "p_holm"] = pd.Series(correct_by_holm(ps), rows.index, dtype=float)
    level = table["baseline"].str.startswith("level") | table["variant"].str.startswith("level")
    return table[~(level & (table["measure"] == "chamfer"))]


def _open(fits: Sequence[Fit], figure: str) -> list[str]:
    objects = list(dict.fromkeys(fit.object for fit in fits))
    experiments = list(dict.fromkeys(fit.experiment for fit in fits))
    replicates = max(fit.replicate for fit in fits)
    minutes = sum(fit.seconds[-1] for fit in fits) / 60
    steps = max(len(fit.loss) for fit in fits)
    return [
        "# What can be concluded",
        "",
        "The report's questions, asked of more objects, with repetitions. This page is made by",
        "",
        "```sh",
        "python benchmarks/initialisation_objects.py --data <folder of photographs and scans>",
        f"bin/run --configfile config/benchmark.yaml --config replicates={replicates}",
        "python benchmarks/findings.py --results results",
        "```",
        "",
        f"{len(objects)} objects ({', '.join(objects)}), {len(experiments)} variants, {replicates} "
        f"replicates: {len(fits):,} fits of {steps} steps of the report's procedure, "
        f"{minutes:,.0f} minutes of fitting.",
        "",
        "Each cell is the median over the objects of the variant's difference from its baseline, "
        "with its 95 % interval; lower is better everywhere. **Bold** is what Wilcoxon's "
        f"signed-rank test shows (p ≤ {LEVEL}, corrected by Holm over the question's pairs). "
        "*Steps* are those until the loss is within 1 % of the baseline's final one, all of them "
        "where it never is; *mean loss* is the area under the curve over its steps; *chamfer* is "
        "of objects with a truth. [Comparing variants](comparing.md) defines all of them. On level "
        "cameras the truth and the mesh are in different frames, so no chamfer is given.",
        "",
        f"![Differences of each pair with their intervals]({figure})",
    ]


def _answer(question: Question, table: pd.DataFrame) -> list[str]:
    """The section of a question."""
    lines = ["", f"## {question.title}", "", question.asked, "", *_say(question, table), ""]
    shown = [measure for measure in SHOWN if measure in set(table["measure"])]
    lines.append(_row(["", *(SHOWN[measure][0] for measure in shown), "failed"]))
    lines.append("|---|" + "---:|" * (len(shown) + 1))
    for pair in question.pairs:
        rows = _rows_of(table, pair)
        failed = rows["loss"]
        cells = [_cell(rows[measure], measure) if measure in rows else "–" for measure in shown]
        failures = f"{failed['failures_baseline']} → {failed['failures_variant']}"
        lines.append(_row([_title(pair), *cells, failures]))
    return lines


def _rows_of(table: pd.DataFrame, pair: Pair) -> dict[str, dict]:
    both = (table["baseline"] == pair[0]) & (table["variant"] == pair[1])
    return {row["measure"]: row for row in table[both].to_dict("records")}


def _title(pair: Pair) -> str:
    return f"{_name(pair[0])} → {_name(pair[1])}"


def _name(variant: str) -> str:
    for words in ("vertices_", "shape_"):
        variant = variant.replace(words, "")
    return variant.replace("-", " ")


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(row: dict, measure: str) -> str:
    digits = SHOWN[measure][1]
    said = f"{row['difference']:+.{digits}f}"
    if pd.notna(row["low"]):
        said += f" [{row['low']:+.{digits}f}, {row['high']:+.{digits}f}]"
    return f"**{said}**" if _is_shown(row) else said


def _is_shown(row: dict) -> bool:
    return pd.notna(row["p_holm"]) and row["p_holm"] <= LEVEL


def _say(question: Question, table: pd.DataFrame) -> list[str]:
    """What the tests show of each measure, a line each."""
    lines = []
    found = {pair: _rows_of(table, pair) for pair in question.pairs}
    for measure, (label, digits) in SHOWN.items():
        rows = {pair: of[measure] for pair, of in found.items() if measure in of}
        if not rows:
            continue
        better = [p for p, row in rows.items() if _is_shown(row) and row["difference"] < 0]
        worse = [p for p, row in rows.items() if _is_shown(row) and row["difference"] > 0]
        alike = [p for p in rows if p not in better and p not in worse]
        parts = [
            f"{word} for {_list(these, rows, digits)}"
            for word, these in (("lower", better), ("higher", worse))
            if these
        ]
        if alike:
            others = " the others" if len(alike) < len(rows) else " any pair"
            parts.append("no difference shown for" + others)
        lines.append(f"- *{label}*: {'; '.join(parts)}.")
    return lines


def _list(pairs: Sequence[Pair], rows: dict[Pair, dict], digits: int) -> str:
    return ", ".join(f"{_title(p)} ({rows[p]['difference']:+.{digits}f})" for p in pairs)


def _by_object(pairs: Sequence[Pair], fits: Sequence[Fit]) -> list[str]:
    """The difference of the final and of the mean loss of each object."""
    lines = [
        "",
        "By object, difference of final loss (difference of mean loss), medians of the replicates:",
        "",
        _row(["", *map(_title, pairs)]),
        "|---|" + "---:|" * len(pairs),
    ]
    differences = {pair: difference_by_object(fits, pair) for pair in pairs}
    for name in dict.fromkeys(fit.object for fit in fits):
        cells = [_pair_of(f[name]) if name in f else "–" for f in differences.values()]
        lines.append(_row([name, *cells]))
    return lines


def difference_by_object(fits: Sequence[Fit], pair: Pair) -> dict[str, tuple[float, float]]:
    """Of a pair, each object's median difference of the final and of the mean loss."""
    rows = [
        (fit.object, fit.replicate, fit.experiment, float(fit.loss[-1]), float(fit.loss.mean()))
        for fit in fits
        if fit.experiment in pair
    ]
    table = pd.DataFrame(rows, columns=["object", "replicate", "experiment", "loss", "mean"])
    table = table.pivot_table(["loss", "mean"], ["object", "replicate"], "experiment")
    table = table.reindex(columns=pd.MultiIndex.from_product([["loss", "mean"], pair]))
    found = pd.DataFrame({m: table[m, pair[1]] - table[m, pair[0]] for m in ("loss", "mean")})
    medians = found.groupby("object").median().dropna()
    return {name: (row["loss"], row["mean"]) for name, row in medians.iterrows()}


def _confirm(small: Sequence[Fit], full: Sequence[Fit]) -> list[str]:
    """Whether the full benchmark has the same signs, object by object."""
    objects = list(dict.fromkeys(fit.object for fit in full))
    there = {fit.experiment for fit in full}
    pairs = dict.fromkeys(pair for question in QUESTIONS for pair in question.pairs)
    found = {
        pair: [difference_by_object(fits, pair) for fits in (small, full)]
        for pair in pairs
        if there.issuperset(pair)
    }
    steps = max(len(fit.loss) for fit in full)
    replicates = max(fit.replicate for fit in full)
    return [
        "",
        "## Do 256 pixels and 2,000 steps tell the same?",
        "",
        "```sh",
        f"bin/run --configfile config/benchmark-full.yaml --config replicates={replicates} \\",
        "    datasets=<a table of some of its rows>",
        "python benchmarks/findings.py --results results --full <the results of that>",
        "```",
        "",
        f"`config/benchmark-full.yaml` on {', '.join(objects)}: {len(full)} fits of {steps:,} "
        f"steps, {sum(fit.seconds[-1] for fit in full) / 60:,.0f} minutes of fitting. "
        f"{_say_agreement(found.values())} Differences of final loss (of mean loss), small → full:",
        "",
        _row(["", *objects]),
        "|---|" + "---:|" * len(objects),
        *(
            _row([_title(pair), *(_both(ours.get(o), theirs.get(o)) for o in objects)])
            for pair, (ours, theirs) in found.items()
        ),
    ]


def _say_agreement(found: Iterable[Sequence[dict[str, tuple[float, float]]]]) -> str:
    """How often two runs' differences have one sign, of those that both are more than a tie."""
    cases = [(ours[o], theirs[o]) for ours, theirs in found for o in ours if o in theirs]
    both = np.array(cases).reshape(-1, 2, 2)  # [cases, runs, final and mean loss]
    differ = (np.abs(both) > TIE).all(axis=1)
    alike = differ & (np.sign(both[:, 0]) == np.sign(both[:, 1]))
    (final, mean), (finals, means) = alike.sum(axis=0), differ.sum(axis=0)
    (ours, ours_mean), (theirs, theirs_mean) = np.median(np.abs(both), axis=0)
    return (
        f"Where both differ by more than {TIE}, they have the same sign in {final} of {finals} "
        f"final losses and {mean} of {means} mean losses. How large they are is another matter: "
        f"the median difference of final loss is {ours:.3f} in the small one and {theirs:.3f} in "
        f"the full one, of mean loss {ours_mean:.3f} and {theirs_mean:.3f}."
    )


def _both(ours: tuple[float, float] | None, theirs: tuple[float, float] | None) -> str:
    return f"{_pair_of(ours)} → {_pair_of(theirs)}" if ours and theirs else "–"


def _pair_of(losses: tuple[float, float]) -> str:
    return f"{losses[0]:+.3f} ({losses[1]:+.3f})"


def _draw(tables: Sequence[pd.DataFrame]) -> Figure:
    """Every pair's differences of a few measures, with their intervals, a row a pair."""
    count = sum(len(question.pairs) + 1 for question in QUESTIONS)
    figure = Figure(figsize=(11, 0.26 * count + 1), layout="constrained")
    panels = figure.subplots(1, len(DRAWN), sharey=True)
    ticks: dict[float, str] = {}
    place = 0
    for question, table in zip(QUESTIONS, tables, strict=True):
        ticks[place] = question.title
        for pair in question.pairs:
            place += 1
            ticks[place] = _title(pair)
            rows = _rows_of(table, pair)
            for axes, measure in zip(panels, DRAWN, strict=True):
                _draw_row(axes, rows[measure], place)
        place += 1
    for axes, measure in zip(panels, DRAWN, strict=True):
        axes.axvline(0, color="0.3", linewidth=0.8)
        axes.set_xlabel(f"{SHOWN[measure][0]}: difference")
        axes.grid(axis="x", color="0.88")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks(list(ticks), list(ticks.values()), fontsize=8)
    titles = {question.title for question in QUESTIONS}
    for label in panels[0].get_yticklabels():
        label.set_fontweight("bold" if label.get_text() in titles else "normal")
    panels[0].set_ylim(place, -0.8)
    return figure


def _draw_row(axes, row: dict, place: int) -> None:
    colour = "0.55" if not _is_shown(row) else "#0072b2" if row["difference"] < 0 else "#d55e00"
    if pd.notna(row["low"]):
        axes.plot([row["low"], row["high"]], [place, place], color=colour, linewidth=1.6)
    axes.plot(row["difference"], place, "o", color=colour, ms=4)


if __name__ == "__main__":
    main()
