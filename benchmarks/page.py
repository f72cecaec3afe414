"""How large the page is and how soon it can be used with many objects, as JSON.

bin/run
python benchmarks/page.py --objects 20 100

The runs of ``results/`` stand for as many objects as are asked for. Needs Chromium and playwright.
"""

import argparse
import json
import re
import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import sync_playwright

from silmesh.steps import report

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SORT = ".overview thead button"


def main() -> None:
    """Write pages and open them."""
    args = argparse.ArgumentParser(description=__doc__)
    args.add_argument("--objects", type=int, nargs="+", default=[20, 100])
    args.add_argument("--plan", type=Path, default=Path("results/report/plan.json"))
    args.add_argument("--keep", type=Path, help="folder to leave the pages in")
    given = args.parse_args()
    with TemporaryDirectory() as folder:
        for objects in given.objects:
            page = (given.keep or Path(folder)) / f"page-{objects}.html"
            start = time.perf_counter()
            _write(json.loads(given.plan.read_text()), objects, page)
            told = {"objects": objects, "written_seconds": time.perf_counter() - start}
            print(json.dumps(told | _weigh(page) | _open(page)))


def _write(plan: dict, objects: int, page: Path) -> None:
    """Write the page of the first object's runs, as if there were so many objects."""
    first = plan["runs"][0]["object"]
    runs = [run for run in plan["runs"] if run["object"] == first]
    names = [f"{first}_{i}" for i in range(objects)]
    with TemporaryDirectory() as folder:
        copies = Path(folder)
        (copies / "report").mkdir()
        for name in names:
            (copies / name).symlink_to(Path("results", first).resolve())
            for kind in ("pictures", "exhibits", "cameras", "galleries"):
                (copies / "report" / kind).mkdir(exist_ok=True)
                made = Path("results/report", kind, first).resolve()
                (copies / "report" / kind / name).symlink_to(made)
        plan["runs"] = [run | {"object": name} for name in names for run in runs]
        plan["truths"] = names if first in plan["truths"] else []
        (copies / "plan.json").write_text(json.dumps(plan))
        written = copies / "report" / "report.html"
        tables = [f"--{name}={copies / name}.csv" for name in ("losses", "summary")]
        report.main(
            [f"--plan={copies}/plan.json", f"--results={copies}", *tables, f"--page={written}"]
        )
        shutil.copyfile(written, page)


def _weigh(page: Path) -> dict[str, float]:
    """Millions of bytes of the meshes, and of all else."""
    text = page.read_text(encoding="utf-8")
    meshes = re.findall(r'<script type="text/plain" id="(?:mesh|truth)-[^>]*>([^<]*)<', text)
    bytes_of_meshes = sum(map(len, meshes))
    rest = len(text.encode()) - bytes_of_meshes
    return {"megabytes": rest / 1e6, "megabytes_of_meshes": bytes_of_meshes / 1e6}


def _open(page: Path) -> dict[str, float]:
    """Seconds until the page sorts, until all of it is read, and until an object is open."""
    with sync_playwright() as play:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = play.chromium.launch(executable_path=path, args=FLAGS)
        shown = browser.new_page()
        start = time.perf_counter()
        shown.goto(page.resolve().as_uri(), wait_until="commit")
        shown.locator(SORT, has_text="Final loss").click()  # by role it would look at every node
        shown.locator(".overview [aria-sort]").wait_for()
        sorts = time.perf_counter() - start
        shown.wait_for_load_state("domcontentloaded")
        parsed = time.perf_counter() - start
        start = time.perf_counter()
        details = shown.locator("details.object").nth(1)
        details.locator("> summary").click()
        details.locator(".gallery .view").first.wait_for()
        read = time.perf_counter() - start
        details.locator("canvas[data-turn]").wait_for()
        opened = time.perf_counter() - start
        browser.close()
    return {"sorts": sorts, "parsed": parsed, "opened": read, "opened_with_3d": opened}


if __name__ == "__main__":
    main()
