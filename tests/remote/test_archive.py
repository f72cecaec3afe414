import io
import tarfile
import zipfile

import pytest
from afar import png, tarred, zipped

from silmesh.errors import InputError
from silmesh.remote import archive
from silmesh.remote.archive import unpack

FILES = {
    **{f"png2/{n}/{n}_r{a}.png": png(n + a) for n in (1, 17) for a in (0, 5, 10)},
    **{f"mask2/17/17_{kind}.png": png(7) for kind in ("r0", "r5", "c1")},
    "png2/17/notes.txt": b"notes",
    "png2/17/.hidden.png": b"",
    "README": b"of all",
}
PACKED = {
    "zip": zipped,
    **{f"tar {k}".strip(): lambda f, k=k: tarred(f, k) for k in ("", "gz", "xz")},
}


def unpacked(tmp_path, content, wanted):
    file = tmp_path / "packed"
    file.write_bytes(content)
    (tmp_path / "out").mkdir(exist_ok=True)
    return [path.name for path in unpack(file, "cups.tar", wanted, tmp_path / "out")]


@pytest.mark.parametrize("pack", PACKED.values(), ids=PACKED)
@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ("png2/17", ["17_r0.png", "17_r5.png", "17_r10.png"]),
        ("mask2/17/17_r*.png", ["17_r0.png", "17_r5.png"]),
        ("README", ["README"]),
    ],
)
def test_only_what_is_meant_is_unpacked(tmp_path, pack, wanted, names):
    assert unpacked(tmp_path, pack(FILES), wanted) == names
    found = {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()}
    assert found == {
        n: c
        for n, c in FILES.items()
        for n in [n.rpartition("/")[2]]
        if n in names and c == found[n]
    }
    assert sorted(found) == sorted(names)


def test_names_with_a_dot_before_them(tmp_path):
    content = tarred({f"./{name}": content for name, content in FILES.items()})
    assert unpacked(tmp_path, content, "png2/1") == ["1_r0.png", "1_r5.png", "1_r10.png"]


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("png2/18", "has no 'png2/18'; it has images in png2/1"),
        ("", "has images in 3 folders, .* should say which is meant: 'cups.tar#png2/1'"),
    ],
)
def test_what_is_not_there_or_not_one_object_s(tmp_path, wanted, said):
    with pytest.raises(InputError, match=said):
        unpacked(tmp_path, zipped(FILES), wanted)


@pytest.mark.parametrize(
    "name", ["../evil.png", "a/../../evil.png", "/tmp/evil.png", "a\\..\\..\\evil.png"]
)
@pytest.mark.parametrize("pack", [zipped, tarred])
def test_a_path_that_climbs_out_is_refused(tmp_path, pack, name):
    with pytest.raises(InputError, match="leads out of the archive"):
        unpacked(tmp_path, pack({name: png()}), "")
    assert not list(tmp_path.rglob("evil*"))
    assert not list(tmp_path.parent.glob("evil*"))


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE])
def test_links_are_refused(tmp_path, kind):
    written = io.BytesIO()
    with tarfile.open(fileobj=written, mode="w") as made:
        entry = tarfile.TarInfo("cup/0.png")
        entry.type, entry.linkname = kind, "/etc/passwd"
        made.addfile(entry)
    with pytest.raises(InputError, match="is a link or a device"):
        unpacked(tmp_path, written.getvalue(), "cup")


@pytest.mark.parametrize("pack", [zipped, PACKED["tar gz"]])
def test_a_bomb_is_bounded(tmp_path, pack, monkeypatch):
    monkeypatch.setattr(archive, "FREE", 100_000)
    monkeypatch.setattr(archive, "PIECE", 1000)
    bomb = pack({"cup/0.png": png(), "cup/1.png": bytes(10_000_000)})
    with pytest.raises(InputError, match="unpacks to more than"):
        unpacked(tmp_path, bomb, "cup")
    assert sum(p.stat().st_size for p in (tmp_path / "out").iterdir()) < 2_000_000


@pytest.mark.parametrize("pack", PACKED.values(), ids=PACKED)
def test_an_archive_cut_short_is_refused(tmp_path, pack):
    content = pack({f"cup/{i}.png": png(i, (60, 60)) + bytes(range(256)) * 9 for i in range(9)})
    with pytest.raises(InputError, match=r"cups\.tar: "):
        unpacked(tmp_path, content[: len(content) * 2 // 3], "cup")


def noted(notes, kind=""):
    """A tar of a photograph with notes before it."""
    written = io.BytesIO()
    with tarfile.open(fileobj=written, mode=f"w:{kind}", format=tarfile.PAX_FORMAT) as made:
        entry = tarfile.TarInfo("cup/0.png")
        entry.pax_headers = notes
        made.addfile(entry)
    return written.getvalue()


def burst():
    """A zip that is packed by bzip2, of which a few bytes are gigabytes in memory."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_BZIP2) as made:
        made.writestr("cup/0.png", png())
    return written.getvalue()


def damaged_within():
    content = bytearray(tarred({"cup/0.png": png(), "cup/1.png": png()}))
    content[content.rindex(b"cup/1.png")] ^= 1
    return bytes(content)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (noted({"comment": "x" * 2_000_000}), "has a note of 2,0"),
        (noted({"comment": "x" * 2_000_000}, "gz"), "is no archive"),
        (noted({"size": "-1024"}), "has -1,024 bytes"),
        (burst(), "it is packed otherwise than by 'deflate'"),
        (damaged_within(), "bad checksum"),
    ],
    ids=["note", "packed note", "size", "bzip2", "header"],
)
def test_what_the_library_reads_without_bounds_or_takes_for_the_end_is_refused(
    tmp_path, content, said
):
    with pytest.raises(InputError, match=said):
        unpacked(tmp_path, content, "cup")


def test_folders_are_no_files_but_count_as_names(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_NAMES", 3)
    written = io.BytesIO()
    with tarfile.open(fileobj=written, mode="w:gz") as made:
        for i in range(4):
            entry = tarfile.TarInfo(f"cup/{i}.png")
            entry.type = tarfile.DIRTYPE
            made.addfile(entry)
    with pytest.raises(InputError, match="has more than 3 files"):
        unpacked(tmp_path, written.getvalue(), "cup")
    monkeypatch.setattr(archive, "MOST_NAMES", 4)
    with pytest.raises(InputError, match="has no 'cup'"):
        unpacked(tmp_path, written.getvalue(), "cup")


def test_no_archive_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no archive; should be a zip or a tar"):
        unpacked(tmp_path, b"<html>please log in</html>", "")
