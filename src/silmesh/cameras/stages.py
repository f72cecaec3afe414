"""The stages of structure from motion on disk: a folder each, with what is known so far beside it.

A stage that is refused leaves its reason in ``report.json`` and nothing else, and those after it
hand the reason on, so that another source of cameras may be tried.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from silmesh.cameras.attempt import REPORT
from silmesh.errors import InputError
from silmesh.files import making

DATABASE, MODEL = "database.db", "model"
LARGEST = "largest"  # the model that the mapper found, where another was made of it
APART = "apart"  # models of other views that share too little with it to be joined, by numbers


@dataclass(frozen=True)
class Report:
    """What is known after a stage.

    Attributes:
        refusal: why it went no further, with figures and what to try; None if it did
        dropped: why each view that was left out was
        warnings: what a person should know, in sentences
        figures: what else there is to say, for JSON
    """

    refusal: str | None = None
    dropped: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)

    def tell(self, *warnings: str, **figures: Any) -> "Report":
        """The same with more warnings and figures."""
        return replace(
            self, warnings=(*self.warnings, *warnings), figures={**self.figures, **figures}
        )


def make_stage(folder: Path, before: Report, work: Callable[[Path, Report], Report]) -> None:
    """Make a stage's folder; keep its refusal, or the one before it.

    Args:
        before: of the stage that this one stands on
        work: fills the folder that it is given and says what is known then; it may raise
            ``InputError``, which is a refusal
    """
    report = before
    if report.refusal is None:
        try:
            with making(folder) as part:
                _write_report(part, work(part, before))
            return
        except InputError as error:
            report = replace(before, refusal=str(error))
    with making(folder) as part:
        _write_report(part, report)


def _write_report(folder: Path, report: Report) -> None:
    (folder / REPORT).write_text(json.dumps(asdict(report), indent=1) + "\n", encoding="utf-8")


def read_report(folder: Path) -> Report:
    """What a stage left."""
    values = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    return Report(**{**values, "warnings": tuple(values["warnings"])})
