import subprocess
import sys
from pathlib import Path

import pytest

from silmesh.files import replacing


def fill(path, content):
    """Make a file, or a folder with a file in it."""
    if content.startswith("folder"):
        path.mkdir()
        (path / "inside").write_text(content)
    else:
        path.write_text(content)


def content(path):
    return (path / "inside").read_text() if path.is_dir() else path.read_text()


KINDS = ["file", "folder"]


@pytest.mark.parametrize("new", KINDS)
@pytest.mark.parametrize("old", [None, *KINDS])
def test_what_is_written_takes_the_place_of_what_was_there(tmp_path, old, new):
    path = tmp_path / "deep" / "out.png"
    path.parent.mkdir()
    if old:
        fill(path, f"{old} old")
    with replacing(path) as part:
        assert part.parent == path.parent
        assert part.suffix == path.suffix
        fill(part, f"{new} new")
    assert content(path) == f"{new} new"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("kind", KINDS)
def test_an_exception_leaves_the_old_output_and_nothing_else(tmp_path, kind):
    path = tmp_path / "out"
    fill(path, f"{kind} old")

    def stop_half_way():
        with replacing(path) as part:
            fill(part, f"{kind} new")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        stop_half_way()
    assert content(path) == f"{kind} old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", KINDS)
def test_a_part_that_a_kill_left_is_removed_first(tmp_path, kind):
    path = tmp_path / "out"
    fill(tmp_path / ".part-out", f"{kind} left over")
    with replacing(path) as part:
        assert not part.exists()
        fill(part, "whole")
    assert list(tmp_path.iterdir()) == [path]


WRITE = """
import sys, time
from silmesh.files import replacing
with replacing(sys.argv[1]) as part:
    part.write_text("half")
    print(part, flush=True)
    time.sleep(600)
"""


def test_a_part_of_a_process_that_lives_stays_and_goes_when_it_is_killed(tmp_path):
    path = tmp_path / "out"
    command, pipe = [sys.executable, "-c", WRITE, str(path)], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, text=True) as other:
        half = Path(other.stdout.readline().strip())
        with replacing(path) as part:
            assert part != half
            part.write_text("whole")
        assert (half.read_text(), path.read_text()) == ("half", "whole")
        other.kill()
    with replacing(path) as part:
        assert not half.exists()
        part.write_text("again")
    assert list(tmp_path.iterdir()) == [path]
