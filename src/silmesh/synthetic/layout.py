"""Where the made-up objects' files lie, known before they are made."""

from pathlib import Path

MADE = Path("resources/synthetic")
OBJECTS = ("pot", "tube", "apricot", "bear", "plane", "bottle")


def photograph_names(name, views=72):
    return [f"{name}_r{i * 5}.png" for i in range(views)]


def expected_files(folder):
    if (
        folder.parent.parent == MADE
        and folder.parent.name in ("png2", "mask2")
        and folder.name in OBJECTS
    ):
        return tuple(folder / n for n in photograph_names(folder.name))
    return ()


def is_expected(path):
    return path.parent == MADE / "truth" and path.stem in OBJECTS
