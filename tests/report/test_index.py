"""The index of many objects, the page of each, and what is said of those that failed."""

import re

import pytest
from pages import GALLERY, gallery, result

from silmesh.errors import InputError
from silmesh.report.index import write_index

SETTINGS = {"configuration": {"views": {}, "variants": {"plain": {}, "fine": {}}}, "objects": {}}
FAILED = [{"object": "jar", "variant": "plain", "stage": "fit", "reason": "no <view> is left"}]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("index")
    told, asked = gallery(folder), []

    def read_each():
        for i, object_ in enumerate(("pot", "cup")):
            asked.append(object_)
            results = {
                (object_, variant): result(folder, {"iou_mean": 0.9 - 0.1 * i})
                for variant in ("plain", "fine")
            }
            yield object_, (results, {(object_, GALLERY): told}, {})

    pages = folder / "report" / "objects"
    text = write_index(read_each(), pages, SETTINGS, ["fine is better"], FAILED, "report.html")
    (folder / "report/report.html").write_text(text, encoding="utf-8")
    assert asked == ["pot", "cup"]
    return folder / "report", text


def test_every_link_and_picture_of_the_index_is_a_file_beside_it(made):
    folder, text = made
    links = [link for link in re.findall(r'(?:href|src)="([^"#]+)"', text) if "data:" not in link]
    assert set(links) == {
        *(f"objects/{name}.html" for name in ("pot", "cup")),
        *(f"objects/{n}/{v}.webp" for n in ("pot", "cup") for v in ("plain", "fine")),
    }
    assert all((folder / link).is_file() for link in links)


def test_the_index_has_the_numbers_and_the_pages_the_rest(made):
    folder, text = made
    assert "2 objects" in text
    assert "4 fitted meshes" in text
    assert text.count(">0.900<") == 2
    assert 'type="text/plain"' not in text  # neither meshes nor photographs
    page = (folder / "objects/cup.html").read_text(encoding="utf-8")
    assert '<a href="../report.html">All objects</a>' in page
    assert 'id="mesh-0-1-fitted"' in page
    assert "object-pot" not in page
    assert "All objects" not in text


def test_what_failed_is_listed_with_its_reason(made):
    text = re.sub(r"\s+", " ", made[1])
    assert "1 mesh could not be made" in text
    assert "jar, plain</th>" in text
    assert "no &lt;view&gt; is left</td>" in text
    assert "fine is better" in text


def test_pages_do_not_take_the_place_of_a_folder_of_somebody(tmp_path):
    mine = tmp_path / "objects" / "mine.txt"
    mine.parent.mkdir()
    mine.write_text("mine")
    with pytest.raises(InputError, match=r"objects: holds mine\.txt"):
        write_index([], mine.parent, SETTINGS, [], [], "report.html")
    assert mine.read_text() == "mine"
