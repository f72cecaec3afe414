"""A person's own functions: called, and blamed by file and line for what they raise."""

import numpy as np
import pytest
from scenes import silhouettes, turntable

from silmesh.errors import InputError
from silmesh.own_code import call, own_file, refuse_lacking
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh

BALL = """\
import trimesh

def ball(silhouettes, cameras, vertices):
    return trimesh.creation.icosphere(subdivisions=2, radius=0.3)

def wrong(silhouettes, cameras, vertices):
    return len(cameras) / 0

def open_(silhouettes, cameras, vertices):
    whole = ball(silhouettes, cameras, vertices)
    return trimesh.Trimesh(whole.vertices, whole.faces[1:])

def nothing(silhouettes, cameras, vertices):
    pass
"""


@pytest.fixture
def own(tmp_path):
    (tmp_path / "mine.py").write_text(BALL)
    return f"{tmp_path / 'mine.py'}:"


@pytest.fixture(scope="module")
def scene():
    cameras = turntable(4, 32)
    return silhouettes(cameras, [0.3] * 3), cameras


def test_a_name_is_told_from_a_method_of_ours(own):
    assert own_file(own + "ball").name == "mine.py"
    assert own_file("hull") is own_file("mine.py") is own_file("mine.py:") is None


def test_the_mesh_of_a_function_is_fitted_as_it_stands_in_the_world(own, scene):
    first = make_initial_mesh(Init(shape=own + "ball"), *scene)
    np.testing.assert_allclose(np.linalg.norm(first.mesh.vertices, axis=1), 0.6)  # is halved
    assert first.notes["shape"] == own + "ball"
    plain = make_initial_mesh(Init(shape=own + "ball", align="none"), *scene)
    assert np.linalg.norm(plain.mesh.vertices, axis=1).max() == pytest.approx(1)


def test_what_is_named_differs_by_what_a_stage_is_called(own):
    keys = [Init(shape=own + name).key for name in ("ball", "wrong")]
    assert keys[0] != keys[1]
    assert "/" not in keys[0]


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("wrong", r"mine\.py, line 7: ZeroDivisionError: division by zero"),
        ("open_", "gives a mesh that is not closed"),
        ("nothing", "gives NoneType; should give a trimesh.Trimesh"),
        ("lacking", r"mine\.py: defines no function 'lacking'"),
    ],
)
def test_what_goes_wrong_names_the_file(own, scene, function, message):
    with pytest.raises(InputError, match=message):
        make_initial_mesh(Init(shape=own + function), *scene)


def test_a_file_that_cannot_be_read_is_refused_before_it_is_run(tmp_path):
    (tmp_path / "bad.py").write_text("x = 1\ndef f(:\n")
    with pytest.raises(InputError, match=r"bad\.py, line 2: "):
        call(f"{tmp_path / 'bad.py'}:f")
    with pytest.raises(InputError, match=r"init.shape: .*no\.py: is not there"):
        refuse_lacking("init.shape", f"{tmp_path / 'no.py'}:f")
