"""README and docs: every link leads somewhere, and the code that they name is there."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
GENERATED = {"configuration.md"}  # by docs/hooks.py, as the site is built, which checks its links
HOUSE = ROOT / "src/silmesh"
FENCE = re.compile(r"^( *)```.*?^\1```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)|\b(?:href|src)=\"([^\"]+)\"")


def every_page(test):
    return pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)(test)


def anchors_of(page: Path) -> set[str]:
    """What a heading is called in a link: as GitHub and mkdocs do, repeated ones numbered."""
    found: dict[str, int] = {}
    for heading in re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text()), re.MULTILINE):
        words = re.sub(r"[^\w\s-]", "", heading.lower()).strip()
        slug = re.sub(r"\s", "-", words)
        found[slug] = found.get(slug, -1) + 1
    numbered = {f"{slug}_{n}" for slug, last in found.items() for n in range(1, last + 1)}
    return set(found) | numbered


def find_dead(page: Path) -> list[str]:
    """Relative links of a page that lead to no file or no heading."""
    dead = []
    for link in ("".join(groups) for groups in LINK.findall(FENCE.sub("", page.read_text()))):
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if re.match(r"[a-z]+:", link) or name in GENERATED:
            continue
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            dead.append(link)
    return dead


@every_page
def test_every_link_leads_somewhere(page):
    assert find_dead(page) == []


def test_a_dead_link_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Two words\n[a](page.md#two-words) [b](#none) [c](d.md)\n```\n[e](f)\n```\n")
    assert find_dead(page) == ["#none", "d.md"]


@every_page
def test_the_files_and_modules_that_are_named_are_there(page):
    text = page.read_text()
    files = re.findall(r"\b(?:benchmarks|tests|workflow|src/silmesh)/[\w./]+\.(?:py|smk)\b", text)
    files += [f"src/{name}" for name in re.findall(r"`(silmesh/[\w./]+\.py)`", text)]
    added = {f"src/{name}" for name in re.findall(r"A new file `([\w./]+)`", text)}
    assert [name for name in files if not (ROOT / name).exists() and name not in added] == []
    modules = re.findall(r"\bsilmesh\.steps\.\w+", text)
    assert [name for name in modules if not find_spec(name)] == []


def test_the_architecture_shows_every_room():
    text = (ROOT / "docs/architecture.md").read_text()
    rooms = [entry.name for entry in HOUSE.iterdir() if not entry.name.startswith("_")]
    assert [room for room in rooms if room not in text] == []
    named = set(re.findall(r"\w+\.py\b", text))
    there = {file.name for folder in ("src", "tests") for file in (ROOT / folder).rglob("*.py")}
    assert named - there == set()


def test_the_pages_that_code_and_configuration_name_are_there():
    files = [f for folder in ("src", "config", "benchmarks") for f in (ROOT / folder).rglob("*.*")]
    texts = [f.read_text() for f in files if f.suffix in {".py", ".yaml", ".tsv", ".j2"}]
    named = {name for text in texts for name in re.findall(r"\bdocs/[\w-]+\.\w+", text)}
    assert "docs/cameras.md" in named
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
