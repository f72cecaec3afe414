"""The configuration's file: what Snakemake would take in silence, or stumble over, is refused."""

import subprocess
import sys

import pytest

from silmesh.errors import InputError
from silmesh.planning.config import parse_config
from silmesh.planning.yamls import main, read_configuration

GOOD = "datasets: d.tsv\nviews: &v {size: 64}\nvariants:\n  a: {views: *v}\n  b: {}\n"
BOMB = "datasets: d.tsv\nx0: &x0 [a,a,a,a,a,a,a,a,a]\n" + "".join(
    f"x{i}: &x{i} [{','.join([f'*x{i - 1}'] * 9)}]\n" for i in range(1, 9)
)


def write(tmp_path, content):
    path = tmp_path / "config.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_configuration_is_read(tmp_path, mark):
    path = write(tmp_path, mark + GOOD)
    assert read_configuration(path)["variants"] == {"a": {"views": {"size": 64}}, "b": {}}
    assert read_configuration(write(tmp_path, '{"a":\t1}')) == {"a": 1}  # JSON, with a tab


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (GOOD + "  a: {fit: {preset: softras}}\n", "line 6: 'a' is also on line 4; each name"),
        (GOOD + "views: {size: 32}\n", "line 6: 'views' is also on line 2"),
        ("variants: {a: {}, b: {}, a: {}}\n", "line 1: 'a' is also on line 1"),
        ('{"a": 1, "b": {"c": 1, "c": 2}}', "key 'c' comes twice"),
        (BOMB, r"has 490,\d+,\d+ values, those counted that its aliases repeat"),
        ("a: &a [*a]\n", "line 1: an alias holds itself"),
        ("a: 1\nb: \xe4\n".encode("latin-1"), r"line 2: is not in UTF-8 \(byte 0xe4\)"),
        ("datasets: d.tsv\n".encode("utf-16"), "line 1: is not in UTF-8"),
        ("", "should hold keys with their values.* not nothing"),
        ("- a\n- b\n", "should hold keys with their values.* not a list"),
        ("[" * 20_000, "cannot be read as YAML: it is nested too deeply"),
        ("a:\n\t- 1\n", "line 2: cannot be read as YAML: found character '.t'"),
        ("a: *b\n", "line 1: cannot be read as YAML: found undefined alias 'b'"),
        ("a: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
        ("__use_yte__: true\na: ?open('x', 'w')\n", "__use_yte__: would run code that the file"),
        (b"a: b\0c\n", "cannot be read as YAML"),
        ("a: 1\nb: {c: 1, d: 2, c: 3}\n", "line 2: 'c' is also on line 2; each name comes once"),
        ("a: " + "x" * 300_000, "has 300,003 bytes; a configuration has at most 262,144"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(InputError, match=message) as error:
        read_configuration(path)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 500


def test_a_value_is_shortened_in_the_message(tmp_path):
    """400 bytes of aliases made a message of 28 MB."""
    values = ["x" * 50] * 9
    for _ in range(6):
        values = [values] * 9
    with pytest.raises(InputError, match=r"views: should be .*, not \[") as error:
        parse_config({"datasets": "d", "views": values, "variants": {"a": {}}}, "c.yaml")
    assert len(str(error.value)) < 1000


@pytest.mark.parametrize("key", ["datasets", "published"])
@pytest.mark.parametrize("path", ["a\0b", "a" * 256, "a/" * 3000])
def test_a_path_that_no_file_can_have(key, path):
    values = {"datasets": "d", "variants": {"a": {}}} | {key: path}
    with pytest.raises(InputError, match=rf"c\.yaml: {key}: should be the path of a table"):
        parse_config(values, "c.yaml")


def test_the_files_that_snakemakes_arguments_name_are_looked_at(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, GOOD + "views: {}\n")
    main(["--cores", "2", "-n"])
    for words in (["--configfile", "config.yaml"], ["-n", "--configfiles=config.yaml"]):
        with pytest.raises(SystemExit, match=r"^silmesh: config\.yaml, line 6: 'views' is also on"):
            main(words)


def test_as_bin_run_calls_it(tmp_path):
    write(tmp_path, b"\xff\xfe")
    command = [sys.executable, "-m", "silmesh.planning.yamls", "--configfile", "config.yaml", "-c1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("silmesh: config.yaml, line 1: is not in UTF-8")
