"""Text is UTF-8 in every locale, in files and where it is said; and names may have any bytes."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from silmesh.planning.provenance import SOURCE

COMMAND = [sys.executable, "-c", "from silmesh.cli.main import main; main(prog_name='silmesh')"]
NOT_UTF8 = b"K\xf6nig".decode("utf-8", "surrogateescape")


def calls(file: Path) -> list[ast.Call]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


def reads_text(call: ast.Call) -> bool:
    """Whether a call reads or writes text, as far as its form tells."""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    words = [value.value for value in call.args if isinstance(value, ast.Constant)]
    keys = {key.arg: getattr(key.value, "value", None) for key in call.keywords}
    if name in ("read_text", "write_text"):
        return isinstance(call.func, ast.Attribute) and len(call.args) == (name == "write_text")
    if name == "open" and isinstance(call.func, ast.Name):
        return not any("b" in str(word) for word in [*words, keys.get("mode")] if word)
    return keys.get("text") is True or keys.get("universal_newlines") is True


@pytest.mark.parametrize("file", sorted(SOURCE.rglob("*.py")), ids=lambda file: file.stem)
def test_text_is_read_and_written_with_its_encoding(file):
    bare = [
        call.lineno
        for call in calls(file)
        if reads_text(call) and "encoding" not in {key.arg for key in call.keywords}
    ]
    assert bare == []


LOCALES = {
    "C": {"LC_ALL": "C"},
    "POSIX, ASCII": {"LC_ALL": "POSIX", "PYTHONIOENCODING": "ascii"},
    "no coercion": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    "UTF-8": {"LC_ALL": "C.UTF-8"},
}


@pytest.mark.parametrize("locale", LOCALES)
@pytest.mark.parametrize("name", ["K\u00f6ln", NOT_UTF8])
def test_what_is_wrong_is_said_in_any_locale(tmp_path, locale, name):
    (tmp_path / name).mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / name / f"{name}.png")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("LC_", "LANG", "PYTHON"))}
    done = subprocess.run(
        [*COMMAND, name],
        cwd=tmp_path,
        env=kept | {"PYTHONPATH": str(SOURCE)} | LOCALES[locale],
        capture_output=True,
    )
    assert done.returncode == 2, done.stderr
    assert b"Traceback" not in done.stderr
    assert b"holds 1 photograph; a mesh needs at least 2" in done.stderr
    assert done.stderr.startswith(b"silmesh: K")
