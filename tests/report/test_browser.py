"""The page in a real browser: headless Chromium opens it from its file."""

import io
import os
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from pages import GALLERY, box, gallery, result
from PIL import Image

from silmesh.report.page import write_page

playwright = pytest.importorskip("playwright.sync_api", reason="the extra dev has playwright")
pytestmark = pytest.mark.slow
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SETTINGS = {
    "configuration": {"views": {}, "variants": {"plain": {"fit": {"seed": 3}}, "fine": {}}},
    "objects": {},
}


@pytest.fixture(scope="module")
def chromium():
    path = os.environ.get("SILMESH_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no Chromium is here; SILMESH_CHROMIUM may name one")
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A page of two objects with two variants each, one with a truth and held-out views."""
    folder = tmp_path_factory.mktemp("page")
    results, told = {}, gallery(folder)
    for i, object_ in enumerate(("pot", "cup")):
        for j, variant in enumerate(("plain", "fine")):
            metrics = {
                "iou_mean": 0.9 - 0.1 * i + 0.01 * j,
                "loss_final": None if (i, j) == (1, 0) else 0.2 + 0.1 * j,
                "iou": {"r0": 0.9, "r45": 0.8, "r90": 0.95},
                "iterations": 300,
            }
            sides = (0.5, 0.8 - 0.3 * j, 0.4)
            results[object_, variant] = result(folder, metrics, sides, held=["r45"])
    galleries = {(object_, GALLERY): told for object_ in ("pot", "cup")}
    page = write_page(results, galleries, SETTINGS, {"pot": box((0.5, 0.8, 0.4))})
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


class Window:
    """The page in a window, with what went wrong in it."""

    def __init__(self, chromium, file: Path, **options):
        self.context = chromium.new_context(**options)
        self.page = self.context.new_page()
        self.wrong, self.asked = [], []
        self.page.on("console", lambda m: self.wrong.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(file.as_uri())

    def open(self, object_: str):
        """Open an object and wait for its parts."""
        section = self.page.locator(f"section:has(> #object-{object_})")
        section.locator("details.object > summary").click()
        section.locator("details.object[data-ready=yes]").wait_for(timeout=60_000)
        section.locator("canvas[data-turn], .viewer.still").first.wait_for()
        return section


@pytest.fixture
def window(chromium, file):
    made = []

    def make(**options) -> Window:
        made.append(Window(chromium, file, **options))
        return made[-1]

    yield make
    for window in made:
        window.context.close()


def wait_for(section, showing):
    section.locator(f'.viewer[data-showing="{showing}"]').wait_for(timeout=30_000)


def test_loads_and_opens_without_an_error_or_a_request_outside(window, file):
    shown = window()
    section = shown.open("pot")
    wait_for(section, "1 fitted | 0 truth")
    assert shown.wrong == []
    outside = [url for url in shown.asked if not url.startswith(("data:", "blob:"))]
    assert outside == [file.as_uri()]
    assert section.locator(".losses canvas").count() == 1
    assert section.locator(".gallery .view").count() == 9
    texts = section.locator(".gallery .fate").all_inner_texts()
    assert texts[:4] == ["good", "outlier, kept", "outlier, repaired", "outlier, dropped"]
    assert texts[-1] == "no camera, left out"


def test_the_mesh_turns_by_mouse_and_keys_and_zooms(window):
    section = window().open("pot")
    wait_for(section, "1 fitted | 0 truth")
    canvas = section.locator(".viewer canvas")
    canvas.scroll_into_view_if_needed()
    before, turn = canvas.screenshot(), float(canvas.get_attribute("data-turn"))
    box = canvas.bounding_box()
    mouse = section.page.mouse
    mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
    mouse.down()
    mouse.move(box["x"] + box["width"] / 4 + 120, box["y"] + box["height"] / 2, steps=4)
    mouse.up()
    dragged = float(canvas.get_attribute("data-turn"))
    assert abs(dragged - turn) > 0.3
    assert canvas.screenshot() != before
    canvas.focus()
    canvas.press("ArrowRight")
    assert float(canvas.get_attribute("data-turn")) == pytest.approx(dragged + 0.15, abs=0.01)
    far = float(canvas.get_attribute("data-far"))
    canvas.press("+")
    assert float(canvas.get_attribute("data-far")) == pytest.approx(far / 1.1, abs=0.01)


def test_variants_are_swapped_in_the_view_and_over_the_photographs(window):
    section = window().open("pot")
    wait_for(section, "1 fitted | 0 truth")
    canvas = section.locator(".viewer canvas")
    before = canvas.screenshot()
    left, right = section.locator(".viewer select").all()
    left.select_option(label="plain, fitted")
    right.select_option(label="plain, initial mesh")
    wait_for(section, "0 fitted | 0 first")
    assert canvas.screenshot() != before
    assert section.locator(".status").inner_text().startswith("plain, fitted mesh: 48 triangles")
    outline = section.locator(".gallery .view").first.locator("path.mesh")
    drawn = outline.get_attribute("d")
    section.locator(".over select").select_option(label="plain")
    assert outline.get_attribute("d") != drawn
    for name in ("wireframe", "cameras", "colours"):
        before = canvas.screenshot()
        section.locator(f".viewer input[name={name}]").click()
        section.page.wait_for_timeout(200)
        assert canvas.screenshot() != before, name


def test_the_view_comes_back_after_its_object_was_closed(window):
    shown = window()
    section = shown.open("cup")
    wait_for(section, "1 fitted | 1 first")
    section.locator("details.object > summary").click()
    section.locator("details.object > summary").click()
    canvas = section.locator(".viewer canvas[data-turn]")
    canvas.wait_for()
    assert shown.wrong == []


def test_the_overview_sorts_and_puts_what_lacks_last(window):
    page = window().page
    names = page.locator(".overview tbody th")

    def order():
        return [" ".join(text.split()) for text in names.all_inner_texts()]

    page.get_by_role("button", name="Final loss").click()
    assert order() == ["pot plain", "pot fine", "cup fine", "cup plain"]
    assert page.locator("[aria-sort=ascending]").inner_text().strip().startswith("Final loss")
    page.get_by_role("button", name="Final loss").click()
    assert order() == ["pot fine", "cup fine", "pot plain", "cup plain"]
    page.get_by_role("button", name="Object, variant").click()
    assert order() == ["cup fine", "cup plain", "pot fine", "pot plain"]


def test_a_phone_sorts_by_a_list_and_nothing_is_wider_than_it(window):
    shown = window(viewport={"width": 390, "height": 800})
    shown.page.locator(".sort select").select_option(label="Final loss, largest first")
    assert shown.page.locator(".overview tbody th").first.inner_text().split() == ["pot", "fine"]
    shown.open("pot")
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= 390


def test_losses_are_read_with_the_keys_and_on_logarithmic_axes(window):
    section = window().open("pot")
    chart = section.locator(".losses")
    chart.focus()
    chart.press("ArrowRight")
    (plain,) = chart.locator(".u-series", has_text="plain").all()
    assert plain.locator(".u-value").inner_text() == "0.7000"
    before = chart.screenshot()
    section.locator(".axes input").first.check()
    assert chart.screenshot() != before


def test_a_link_opens_its_object(window):
    page = window().page
    page.locator('.overview a[href="#object-cup"]').first.click()
    page.locator("section:has(> #object-cup) details.object[data-ready=yes]").wait_for()


def test_without_webgl_still_pictures_stand_in(window, file):
    shown = window()
    shown.page.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        " return kind.startsWith('webgl') ? null : get.call(this, kind, ...more); }"
    )
    shown.page.goto(file.as_uri())
    section = shown.open("pot")
    assert "no WebGL" in section.locator(".instead .warning").inner_text()
    assert section.locator(".instead img").first.is_visible()
    assert not section.locator("canvas[role=application]").is_visible()
    assert shown.wrong == []


def test_a_texture_is_shown_and_colours_of_vertices_where_it_has_no_room(
    chromium, tmp_path, monkeypatch
):
    """The box's vertices are brown, its texture is blue."""
    results = {
        ("pot", "plain"): result(
            tmp_path, {"iou_mean": 1, "loss_final": 0.1, "iou": {}}, texture=(20, 60, 220)
        )
    }
    told = {("pot", GALLERY): gallery(tmp_path)}
    bluest = {}
    for room in (1_000_000, 0):
        monkeypatch.setattr("silmesh.report.page.ROOM", room)
        file = tmp_path / f"{room}.html"
        file.write_text(write_page(results, told, SETTINGS), encoding="utf-8")
        shown = Window(chromium, file)
        section = shown.page.locator("section:has(> #object-pot)")
        wait_for(section, "0 fitted | 0 first")
        section.page.wait_for_timeout(300)
        with Image.open(io.BytesIO(section.locator(".viewer canvas").screenshot())) as image:
            pixels = np.asarray(image.convert("RGB")).astype(int)
        shown.context.close()
        assert shown.wrong == []
        bluest[room] = (pixels[..., 2] - pixels[..., 0]).max()
        if not room:
            assert (pixels[..., 0] - pixels[..., 2]).max() > 60
    assert bluest[1_000_000] > 100
    assert bluest[0] < 60


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault(window, scheme):
    spec = find_spec("axe_playwright_python")
    if spec is None:
        pytest.skip("axe-playwright-python is not installed: the extra dev has it")
    shown = window(color_scheme=scheme)
    section = shown.open("pot")
    for summary in section.locator("details details > summary").all():
        summary.click()
    (script,) = Path(spec.origin).parent.rglob("axe.min.js")
    shown.page.evaluate(script.read_text(encoding="utf-8"))
    found = shown.page.evaluate("axe.run()")["violations"]
    grave = [f for f in found if f["impact"] in ("serious", "critical")]
    assert [(f["id"], [node["html"][:150] for node in f["nodes"][:3]]) for f in grave] == []
