"""Show what a run made before something in it failed, and say of the rest why it is not there.

A page as the report's, of the meshes that are whole. It takes nobody's place: the report itself is
of all meshes or not at all.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from silmesh.files import replacing
from silmesh.report.failures import find_unfinished
from silmesh.report.run_files import RunFiles
from silmesh.steps.command import output_file, output_folder, parser, run


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, load, call, save."""
    args = parser(__doc__)
    args.add_argument("--plan", type=Path, required=True, help="JSON: runs, settings, objects")
    args.add_argument("--results", type=Path, default=Path("results"), help="their folder")
    args.add_argument("--said", type=Path, required=True, help="what Snakemake said: its log")
    args.add_argument("--page", type=output_file, required=True, help="unfinished.html to write")
    args.add_argument("--pages", type=output_folder, help="of the objects, if they are many")
    given = args.parse_args(argv)
    plan = json.loads(given.plan.read_text(encoding="utf-8"))
    said = given.said.read_text(encoding="utf-8", errors="replace")
    unfinished = find_unfinished(plan["runs"], said, given.results, given.page.parent)
    lacking = {(one["object"], one["variant"]) for one in unfinished}
    whole = [r for r in plan["runs"] if (r["object"], r["variant"]) not in lacking]
    if not whole:
        return
    runs = RunFiles(plan | {"runs": whole}, given.results, given.page.parent)
    page = runs.compose(given.page, given.pages, unfinished=unfinished)
    with replacing(given.page) as part:
        part.write_text(page, encoding="utf-8")
    print(
        f"silmesh: {given.page} shows the {len(whole)} meshes that are whole, "
        f"and why {len(unfinished)} are not"
    )


if __name__ == "__main__":
    run(main)
