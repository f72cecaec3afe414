"""The page: well-formed, self-contained, with every number, and nothing unescaped."""

import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from pages import GALLERY, box, gallery, result

from silmesh.report.measures import LACKING, METRICS, show
from silmesh.report.packing import unpack
from silmesh.report.page import run_settings, write_page

VOID = {"meta", "link", "img", "br", "hr", "input"}
SETTINGS = {
    "configuration": {
        "datasets": "<b>&.tsv",
        "views": {"size": 256, "resize": "pad"},
        "variants": {
            "plain": {"silhouettes": None, "cameras": None, "fit": {"sigma": 1e-4, "holdout": 0}},
            "fine-2": {"silhouettes": "alpha", "views": {"size": 128, "resize": None}},
        },
    },
    "objects": {"pot": {"silhouettes": "mask", "cameras": "turntable"}, "cup": {}},
}
METRICS_OF = {
    ("pot", "plain"): {
        "iou_mean": 0.98765,
        "iou_min": 0.9111,
        "iou_holdout": None,
        "hull_iou_mean": 0.899,
        "loss_final": 0.01234567,
        "iterations": 2000,
        "fit_seconds": 1234.5,
        "silhouettes": "pot/stages/silhouettes/256-pad-mask",
        "iou": {"r0": 0.98765},
        "hull_doubtful": "r5, r<10>",
        "first": {
            "shape": "cube",
            "scores": {
                "cube": {"before": 0.31, "after": 0.0123},
                "hull": {"before": 0.2, "after": 0.0204},
            },
            "warnings": ["the frame cuts the object in r<35>"],
        },
    },
    ("pot", "fine-2"): {"iou_mean": 0.5432, "hull_iou_mean": 0.9},
    ("cup", "plain"): {"iou_mean": 0.7654, "hull_iou_mean": 0.95, "chamfer": 0.0123},
}


class Reader(HTMLParser):
    """Keeps the open tags, to see that each is closed in turn, and every attribute."""

    def __init__(self, page):
        super().__init__()
        self.open, self.tags, self.packed = [], [], {}
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if dict(attrs).get("type") == "text/plain":
            self.packed[dict(attrs)["id"]] = ""

    def handle_data(self, data):
        if self.open and self.open[-1] == "script" and self.tags[-1][1].get("type") == "text/plain":
            self.packed[self.tags[-1][1]["id"]] += data

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def attributes(self, name):
        return [attrs[name] for _, attrs in self.tags if name in attrs]


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    results = {run: result(folder, metrics) for run, metrics in METRICS_OF.items()}
    run = ("pot", "fine-2")
    results[run] = result(folder, METRICS_OF[run], scene="128-pad-alpha-turntable", gallery="128")
    told = gallery(folder)
    return results, {("pot", GALLERY): told, ("pot", "128"): told, ("cup", GALLERY): told}


@pytest.fixture(scope="module")
def page(parts):
    return write_page(*parts, SETTINGS)


def test_every_tag_is_closed_and_every_link_leads_somewhere(page):
    reader = Reader(page)
    assert page.startswith("<!doctype html>")
    assert reader.open == []
    ids = reader.attributes("id")
    assert len(ids) == len(set(ids))
    targets = [h[1:] for h in reader.attributes("href") if h.startswith("#")]
    assert {"object-pot", "object-cup"} <= set(targets) <= set(ids)
    assert set(reader.attributes("aria-labelledby")) <= set(ids)


def test_nothing_is_fetched(page):
    reader = Reader(page)
    links = reader.attributes("src") + reader.attributes("href")
    assert all(link.startswith(("data:", "#")) for link in links)
    ours = re.sub(r'<script type="text/plain".*?</script>', "", page)
    named = set(re.findall(r"https?://[^\s\"']*", ours))
    assert named == {"http://www.w3.org/2000/svg"}  # a name, not an address
    assert not re.search(r"url\(|@import|<script src|fetch\(", ours)


def test_the_libraries_are_in_the_page_with_their_licences(page):
    packed = Reader(page).packed
    assert "uPlot" in unpack(packed["library-uplot"]).decode()
    assert "SPDX-License-Identifier: MIT" in unpack(packed["library-three"]).decode()


def test_what_is_drawn_is_packed(page, parts):
    packed = Reader(page).packed
    data = json.loads(unpack(packed["data-0"]))
    assert [run["variant"] for run in data["runs"]] == ["plain", "fine-2"]
    assert data["runs"][0]["iou"] == {"r0": 0.9877}
    gallery = data["galleries"][data["runs"][0]["gallery"]]
    assert {view["name"] for view in gallery["views"]} > set(data["runs"][0]["outlines"])
    curve = data["runs"][0]["curve"]
    assert (curve["iteration"][0], curve["iteration"][-1]) == (0, 299)
    assert curve["loss"][0] == pytest.approx(0.7)
    assert unpack(packed["mesh-0-1-fitted"])[:4] == b"glTF"
    assert data["runs"][0]["placed"] is None


def test_a_published_curve_is_drawn_and_told_up_to_where_ours_ends(parts):
    results, galleries = parts
    run = ("cup", "plain")
    published = pd.DataFrame({"iteration": [0, 50, 2000], "loss": [0.9, 0.6, 0.1]})
    repeated = dataclasses.replace(results[run], published=published)
    page = write_page({run: repeated}, galleries, SETTINGS)
    data = json.loads(unpack(Reader(page).packed["data-0"]))
    assert data["runs"][0]["published"] == {"iteration": [0, 50, 2000], "loss": [0.9, 0.6, 0.1]}
    row = re.search(r"plain, published</th>(.*?)</tr>", page, re.DOTALL)[1]
    assert re.findall("<td>(.*?)</td>", row) == ["0.9000", "0.6000", "", "", "", "", ""]


def test_the_truth_lies_in_the_normalised_world(parts):
    results, galleries = parts
    truth = box((0.5, 0.8, 0.4))  # in the input's world; the normalised one has it about the origin
    page = write_page(results, galleries, SETTINGS, {"cup": truth})
    data = json.loads(unpack(Reader(page).packed["data-1"]))
    placed = np.array(data["runs"][0]["placed"]).reshape(4, 4).T
    np.testing.assert_allclose(
        placed[:3, :3] @ truth.bounds.mean(axis=0) + placed[:3, 3], 0, atol=1e-9
    )
    assert "truth-1" in Reader(page).packed
    assert page.count(">truth</option>") == 2


def test_a_truth_that_a_mesh_was_laid_on_comes_back_to_it(parts):
    results, galleries = parts
    turn = [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    laid = {"scale": 3.0, "R": turn, "t": [1.0, 2, 3]}
    run = ("cup", "plain")
    moved = dataclasses.replace(results[run], metrics={"placement": laid})
    truth = box((0.5, 0.8, 0.4))
    truth.vertices = 3 * truth.vertices @ np.array(turn).T + [1, 2, 3]
    page = write_page({run: moved}, galleries, SETTINGS, {"cup": truth})
    data = json.loads(unpack(Reader(page).packed["data-0"]))
    placed = np.array(data["runs"][0]["placed"]).reshape(4, 4).T
    back = truth.vertices @ placed[:3, :3].T + placed[:3, 3]
    np.testing.assert_allclose(back.min(axis=0), [-0.25, -0.4, -0.2], atol=1e-9)


def test_the_truth_of_a_left_handed_world_is_mirrored(parts):
    results, galleries = parts
    run = ("cup", "plain")
    told = results[run].scene.notes | {"mirrored": True}
    scene = dataclasses.replace(results[run].scene, notes=told)
    moved = dataclasses.replace(results[run], scene=scene)
    placed = []
    for case in (results[run], moved):
        page = write_page({run: case}, galleries, SETTINGS, {"cup": box((0.5, 0.8, 0.4))})
        data = json.loads(unpack(Reader(page).packed["data-0"]))
        placed.append(np.array(data["runs"][0]["placed"]).reshape(4, 4).T)
    np.testing.assert_allclose(placed[1], placed[0] @ np.diag([1, 1, -1, 1]), atol=1e-12)


def test_every_image_says_what_it_shows(page):
    images = [attrs for tag, attrs in Reader(page).tags if tag == "img"]
    # two thumbnails and a picture a run; a picture of cameras a scene
    assert len(images) == 3 * 3 + 3
    assert all(len(attrs["alt"]) > 10 for attrs in images)


def test_shows_the_numbers_and_a_dash_for_what_lacks(page):
    rows = re.findall(r'<tr role="row">(.*?)</tr>', page, re.DOTALL)[1:]
    cells = [dict(re.findall(r'data-label="(.*?)".*?>(.*?)</td>', row)) for row in rows]
    assert cells[0] == {
        "IoU, mean": "0.988",
        "IoU, least": "0.911",
        "Hull IoU": "0.899",
        "Final loss": "0.0123",
        "Iterations": "2,000",
        "Seconds": "1,234",
        "Chamfer distance": LACKING,
    }
    assert cells[1]["IoU, mean"] == "0.543"
    assert cells[1]["Iterations"] == LACKING == "–"
    assert cells[2]["Chamfer distance"] == "0.0123"
    for metric in ("IoU, mean", "Chamfer distance", "IoU, held out"):
        assert f"<dt>{metric}</dt>" in page
    assert "<dt>F-score</dt>" not in page


def test_low_coherence_is_said_in_words_where_it_is_low(page):
    rows = re.findall(r'<tr role="row">(.*?)</tr>', page, re.DOTALL)[1:]
    assert ["contradict each other" in row for row in rows] == [True, False, False]


def test_the_views_to_doubt_are_named(page):
    assert "Probable outliers: r5, r&lt;10&gt;." in page


def test_the_initial_meshes_scores_and_warnings_are_told(page):
    assert page.count("Why the initial mesh of") == 1
    assert "Why the initial mesh of pot, plain, is the cube" in page
    assert re.search(r"cube</th><td>0.3100</td><td>0.0123", page)
    assert re.search(r"hull</th><td>0.2000</td><td>0.0204", page)
    assert "Initial mesh: the frame cuts the object in r&lt;35&gt;." in page


def test_names_and_values_are_escaped(parts):
    results, galleries = parts
    run = ("<i>x", '"plain"&')
    settings = {
        "configuration": {**SETTINGS["configuration"], "variants": {run[1]: {"a": "</td><u>"}}},
        "objects": {"<i>x": {}},
    }
    page = write_page(
        {run: results["pot", "plain"]}, {("<i>x", GALLERY): galleries["pot", GALLERY]}, settings
    )
    assert not {"i", "u", "b"} & {tag for tag, _ in Reader(page).tags}
    assert "&lt;i&gt;x" in page
    assert "&#34;plain&#34;&amp;" in page
    assert Reader(page).open == []


def test_the_same_page_each_time(page, parts):
    assert page == write_page(*parts, SETTINGS)


def test_settings_are_the_objects_row_under_what_the_variant_says():
    assert run_settings("pot", "plain", SETTINGS) == {
        "views.size": 256,
        "views.resize": "pad",
        "silhouettes": "mask",
        "cameras": "turntable",
        "fit.sigma": 1e-4,
        "fit.holdout": 0,
    }
    told = run_settings("pot", "fine-2", SETTINGS)
    assert told["silhouettes"] == "alpha"
    assert (told["views.size"], told["views.resize"]) == (128, "pad")


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("iou_mean", 1, "1.000"),
        ("iou_mean", float("nan"), LACKING),
        ("iou_mean", None, LACKING),
        ("iterations", 12345.0, "12,345"),
        ("loss_final", 0.12345, "0.1235"),
    ],
)
def test_numbers_are_shown_to_the_digits_that_matter(key, value, text):
    assert show(value, next(metric for metric in METRICS if metric.key == key)) == text
