import os
import subprocess
import sys
from pathlib import Path

import pytest

from silmesh.errors import InputError
from silmesh.files import MADE, making, remove, replacing, try_file, try_folder, try_inside

KINDS = {"file": replacing, "folder": making}


def fill(path, kind, content):
    """Make a file, or fill a folder."""
    if kind == "folder":
        (path / "deep").mkdir(parents=True)
        (path / "deep" / "inside").write_text(content)
    else:
        path.write_text(content)


def make(path, kind, content):
    """Write a file, or make a folder, as the code does."""
    with KINDS[kind](path) as part:
        if kind == "folder":
            part.rmdir()
        fill(part, kind, content)


def content(path):
    return (path / "deep" / "inside").read_text() if path.is_dir() else path.read_text()


def state(folder):
    """All that is in a folder: names, kinds, modes, targets, bytes."""
    return {
        path: (
            path.lstat().st_mode,
            os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else "",
        )
        for path in folder.rglob("*")
    }


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_takes_the_place_of_its_like(tmp_path, kind):
    path = tmp_path / "deep" / "out.png"
    for text in ("old", "new"):
        with KINDS[kind](path) as part:
            assert part.parent == path.parent
            assert part.suffix == path.suffix
            if kind == "folder":
                part.rmdir()
            fill(part, kind, text)
        assert content(path) == text
        assert list(path.parent.iterdir()) == [path]


def test_an_empty_folder_is_filled_and_keeps_its_mode(tmp_path):
    path = tmp_path / "out"
    path.mkdir(mode=0o700)
    make(path, "folder", "new")
    assert content(path) == "new"
    assert path.stat().st_mode & 0o777 == 0o700


def test_what_snakemake_puts_into_a_folder_is_nobodys(tmp_path):
    make(tmp_path / "out", "folder", "old")
    (tmp_path / "out" / ".snakemake_timestamp").touch()
    make(tmp_path / "out", "folder", "new")
    assert content(tmp_path / "out") == "new"


def full(path):
    fill(path, "folder", "a person's")


def added_to(path):
    make(path, "folder", "ours")
    (path / "deep" / "notes.txt").write_text("a person's")


def empty_folder_added_to(path):
    make(path, "folder", "ours")
    (path / "mine").mkdir()


def a_file(path):
    path.write_text("a person's")


def link_to_a_full_folder(path):
    full(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


def link_to_an_empty_folder(path):
    path.with_name("elsewhere").mkdir()
    path.symlink_to("elsewhere")


def an_empty_folder(path):
    path.mkdir()


def a_pipe(path):
    os.mkfifo(path)


def a_parent_that_is_a_file(path):
    path.parent.rmdir()
    path.parent.write_text("a person's")


def a_link_to_nothing_as_parent(path):
    path.parent.rmdir()
    path.parent.symlink_to("nowhere")


NO_FOLDER = [full, added_to, empty_folder_added_to, a_file, a_pipe]
NO_FOLDER += [link_to_a_full_folder, link_to_an_empty_folder]
NO_FILE = [full, added_to, an_empty_folder, a_pipe, link_to_a_full_folder, link_to_an_empty_folder]
NEITHER = [a_parent_that_is_a_file, a_link_to_nothing_as_parent]
REFUSED = [("folder", p) for p in NO_FOLDER + NEITHER] + [("file", p) for p in NO_FILE + NEITHER]
TRY = {"file": try_file, "folder": try_folder}


@pytest.mark.parametrize(("kind", "prepare"), REFUSED)
def test_what_is_a_persons_stays_and_its_place_is_named(tmp_path, kind, prepare):
    path = tmp_path / "a" / "out"
    path.parent.mkdir()
    prepare(path)
    before = state(tmp_path)
    for attempt in (TRY[kind], lambda path: make(path, kind, "new")):
        with pytest.raises(InputError) as refused:
            attempt(path)
        assert str(refused.value).startswith(f"{path}: ")
        assert state(tmp_path) == before


def test_a_folder_that_was_filled_meanwhile_stays(tmp_path):
    path = tmp_path / "out"
    path.mkdir()
    with pytest.raises(InputError, match="holds mine"), making(path):
        (path / "mine").write_text("a person's")
    assert [p.name for p in tmp_path.rglob("*")] == ["out", "mine"]


def test_a_link_to_a_file_is_replaced_and_its_target_stays(tmp_path):
    (tmp_path / "target").write_text("a person's")
    (tmp_path / "out").symlink_to("target")
    make(tmp_path / "out", "file", "new")
    assert content(tmp_path / "out") == "new"
    assert content(tmp_path / "target") == "a person's"


@pytest.mark.parametrize("place", ["out", "missing/deep/out", "was"])
def test_trying_leaves_nothing(tmp_path, place):
    (tmp_path / "was").write_text("there")
    before = state(tmp_path)
    try_file(tmp_path / place)
    if place != "was":
        try_folder(tmp_path / place)
        try_inside(tmp_path / place)
    assert state(tmp_path) == before


@pytest.mark.parametrize("name", ["a" * 300, f"{'b' * 300}/c", "/proc/out", "/proc/missing/out"])
def test_places_where_nothing_can_be_are_found_by_trying(tmp_path, name):
    for attempt in (try_file, try_folder, try_inside):
        with pytest.raises(InputError, match=r"out|a{300}|c/?.*: cannot be written: "):
            attempt(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_place_without_permission(tmp_path):
    protected = tmp_path / "protected"
    protected.mkdir(mode=0o555)
    (protected / "theirs").write_text("a person's")
    (tmp_path / "open").mkdir(mode=0o777)
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "open" / "theirs").write_text("a person's")
    (tmp_path / "open" / "theirs").chmod(0o444)
    before = state(tmp_path)
    code = """if True:
        import os, sys
        from pathlib import Path
        from silmesh.errors import InputError
        from silmesh.files import making, replacing, try_file, try_folder, try_inside
        if os.getuid() == 0:
            os.setuid(65534)
        root = Path(sys.argv[1])
        for attempt, place in (
            (try_file, "protected/out"), (try_file, "protected/theirs"), (try_file, "open/theirs"),
            (try_folder, "protected/out"), (try_folder, "protected/a/b"), (try_inside, "protected"),
        ):
            try:
                attempt(root / place)
            except InputError as error:
                print(error)
            else:
                sys.exit(f"{place}: was not refused")
        try_file(root / "open/new")
    """
    for folder in [tmp_path, *tmp_path.parents]:
        if (mode := folder.stat().st_mode) & 0o055 != 0o055:  # pytest's own
            folder.chmod(mode | 0o055)
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Permission denied") == 4
    assert done.stdout.count("protected from being written") == 2
    assert state(tmp_path) == before


@pytest.mark.parametrize("kind", KINDS)
def test_an_exception_leaves_the_old_output_and_nothing_else(tmp_path, kind):
    path = tmp_path / "out"
    make(path, kind, "old")

    def stop_half_way():
        with KINDS[kind](path) as part:
            if kind == "folder":
                part.rmdir()
            fill(part, kind, "new")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        stop_half_way()
    assert content(path) == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", KINDS)
def test_what_only_looks_like_a_part_is_a_persons(tmp_path, kind):
    theirs = tmp_path / ".part-out"
    fill(theirs, kind, "a person's")
    with replacing(tmp_path / "out") as part:
        part.write_text("whole")
    assert content(theirs) == "a person's"


WRITE = """
import sys, time
from silmesh.files import replacing
with replacing(sys.argv[1]) as part:
    part.write_text("half")
    print(part, flush=True)
    time.sleep(600)
"""


WRITE_FOLDER = """
import sys, time
from silmesh.files import making
with making(sys.argv[1]) as part:
    (part / "half").write_text("half")
    print(part, flush=True)
    time.sleep(600)
"""


def test_a_folder_that_a_kill_left_half_made_is_removed_first(tmp_path):
    path = tmp_path / "out"
    command, pipe = [sys.executable, "-c", WRITE_FOLDER, str(path)], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, text=True) as other:
        half = Path(other.stdout.readline().strip())
        other.kill()
    assert half.is_dir()
    with making(path) as part:
        (part / "all").write_text("whole")
    assert list(tmp_path.iterdir()) == [path]


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


def test_names_of_every_kind_are_known_again(tmp_path):
    name = os.fsdecode(b"a\nb \xff")
    for text in ("old", "new"):
        with making(tmp_path / "out") as part:
            (part / name).write_text(text)
    assert (tmp_path / "out" / name).read_text() == "new"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {name, MADE}


def test_only_a_file_is_removed(tmp_path):
    full(tmp_path / "out")
    with pytest.raises(OSError, match="out"):
        remove(tmp_path / "out")
    assert content(tmp_path / "out") == "a person's"
    remove(tmp_path / "nothing")


@pytest.mark.parametrize("path", [".", "new/.."])
@pytest.mark.parametrize("act", [try_file, try_folder, *KINDS])
def test_a_path_that_ends_in_no_name_is_refused(tmp_path, monkeypatch, path, act):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"should end in a name|is a folder"):
        make(Path(path), act, "new") if act in KINDS else act(Path(path))
    assert not list(tmp_path.iterdir())


def test_a_parent_that_is_not_there_is_called_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"^new/\.\./mesh\.ply: cannot be written: new/\.\.: "):
        try_file(Path("new/../mesh.ply"))
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="Linux tells what has ended")
def test_what_a_process_left_that_nobody_waited_for_is_removed(tmp_path):
    """It has ended, although the system still knows it."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    with replacing(tmp_path / "out") as part:
        part.write_text("one")
        name = part.name.replace(f"-{os.getpid()}-", f"-{process.pid}-")
    (tmp_path / name).write_text("half")
    with replacing(tmp_path / "out") as part:
        part.write_text("two")
    process.wait()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
