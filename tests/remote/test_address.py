import pytest

from silmesh.errors import InputError
from silmesh.remote.address import fetched_folder, is_remote, parse_address

TAR = "https://host.example/tars/aloi_red2_view.tar"
DIGEST = "0123456789abcdef" * 4


def test_parts_behind_the_mark_come_in_any_order():
    for rest in (f"png2/17&sha256={DIGEST}", f"sha256={DIGEST.upper()}&png2/17/"):
        found = parse_address(f"{TAR}#{rest}")
        assert (found.url, found.member, found.sha256) == (TAR, "png2/17", DIGEST)
        assert found.text == f"{TAR}#png2/17&sha256={DIGEST}"


def test_a_folder_is_named_by_all_that_it_depends_on():
    others = [TAR, f"{TAR}#png2/17", f"{TAR}#png2/18", f"{TAR}#png2/17&sha256={DIGEST}"]
    found = [parse_address(other).folder for other in others]
    assert len({*found}) == len(found)
    assert found[1].name.startswith("aloi_red2_view_tar-png2_17-")
    assert fetched_folder(found[1] / "17_r0.png") == fetched_folder(found[1]) == found[1]
    assert fetched_folder(found[1].parent) is None


@pytest.mark.parametrize(
    ("cell", "folder"),
    [
        ("s3://bucket/cups/blue/", True),
        ("s3://bucket/cups/blue", True),
        ("s3://bucket/cups.zip", False),
        ("https://host.example/download/12?name=cups", False),
    ],
)
def test_only_a_store_has_folders(cell, folder, monkeypatch):
    monkeypatch.setattr("silmesh.remote.address.find_spec", lambda name: True)
    assert is_remote(cell)
    assert parse_address(cell).is_folder == folder


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("ftp://host.example/cups.zip", "should be https://<host>/<archive>"),
        ("https://host.example/cups/", "a web server lists no folder"),
        ("s3://bucket", "should be https://<host>/<archive> or s3://"),
        (f"{TAR}#a&b", "at most one folder"),
        (f"{TAR}#sha256=12", "should be 64 hexadecimal digits"),
        (f"s3://bucket/cups/#sha256={DIGEST}", "is a folder, which has no members and no digest"),
        (f"{TAR}#../../etc", r"should have no .* '\.\.'"),
        ("https://[1/cups.zip", "cannot be read"),
        ("s3://bucket/cups/", r"pip install 'silmesh\[remote\]'"),
    ],
)
def test_what_cannot_be_fetched_is_refused(cell, said, monkeypatch):
    monkeypatch.setattr("silmesh.remote.address.find_spec", lambda name: None)
    with pytest.raises(InputError, match=said):
        parse_address(cell)


@pytest.mark.parametrize(
    "cell",
    [
        "https://anna:pa55word@host.example/cups.zip",
        "https://pa55word@host.example/cups.zip#cup",
        "https://host.example/cups.zip?token=pa55word",
        "https://host.example/cups.zip?a=1&X-Amz-Signature=pa55word#cup",
        "s3://AKIA:pa55word@bucket/cups.zip",
    ],
)
def test_a_secret_in_an_address_is_refused_and_not_repeated(cell):
    with pytest.raises(InputError) as refused:
        parse_address(cell)
    assert "pa55word" not in str(refused.value)
    assert "netrc" in str(refused.value) or "=$MY_SECRET" in str(refused.value)


def test_a_secret_may_be_named():
    assert parse_address("https://host.example/cups.zip?token=$CUPS").url.endswith("?token=$CUPS")
