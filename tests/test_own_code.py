"""A person's own functions: called, and blamed by file and line for what they raise."""

import sys
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from PIL import Image
from scenes import silhouettes, turntable

import silmesh
from silmesh.errors import InputError
from silmesh.fitting.presets import find_procedure
from silmesh.fitting.renderers import find_renderer
from silmesh.own_code import call, own_file, refuse_lacking
from silmesh.settings.check import check
from silmesh.settings.fit import RENDERERS, Fit, OwnFit
from silmesh.settings.init import Init
from silmesh.shapes.initial import make_initial_mesh
from silmesh.softras import soft_silhouettes

ON_THE_CPU = [renderer for renderer in RENDERERS if renderer != "gpu"]
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


def test_a_file_may_import_what_lies_in_the_folder_of_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "silmesh_test_beside.py").write_text("ANSWER = 42\n")
    text = "from silmesh_test_beside import ANSWER\n\ndef ask():\n    return ANSWER\n"
    (tmp_path / "asks.py").write_text(text)
    assert call("asks.py:ask") == 42


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


FILES = {  # what a file that defines ``ball`` holds, and what is said of it
    "exits": (b"import sys\ndef f(*given):\n    sys.exit(0)\n", r"own\.py, line 3: SystemExit: 0"),
    "exits as it is loaded": (b"def f(): pass\nraise SystemExit\n", r"own\.py, line 2: System"),
    "is no function in the end": (b"def f(): pass\ndel f\n", r"own\.py: AttributeError"),
    "cannot say what is wrong": (
        b"class E(Exception):\n    def __str__(self): return 1 / 0\ndef f(*given):\n    raise E\n",
        r"own\.py, line 4: E$",
    ),
    "says it in lines": (b"def f(*given):\n    raise ValueError('a\\nb')\n", r"line 2: a b$"),
    "yields": (b"def f(*given):\n    yield 1\n", "gives generator; should give a trimesh"),
    "is of UTF-16": ("def f(): pass\n".encode("utf-16"), r"own\.py: "),
}


@pytest.mark.parametrize(("content", "message"), FILES.values(), ids=FILES)
def test_a_file_that_is_of_no_use_is_named(tmp_path, scene, content, message):
    (tmp_path / "own.py").write_bytes(content)
    with pytest.raises(InputError, match=message):
        make_initial_mesh(Init(shape=f"{tmp_path / 'own.py'}:f"), *scene)


def test_an_interruption_is_a_persons(tmp_path):
    (tmp_path / "own.py").write_text("def f():\n    raise KeyboardInterrupt\n")
    with pytest.raises(KeyboardInterrupt):
        call(f"{tmp_path / 'own.py'}:f")


@pytest.mark.parametrize(
    "prefix", [b"\xef\xbb\xbf", "# -*- coding: latin-1 -*- \xe9\n".encode("latin-1")]
)
def test_files_are_read_as_python_reads_them(tmp_path, prefix):
    (tmp_path / "it's my: own.py").write_bytes(prefix + b"def f(x):\r\n    return x + 1\r\n")
    assert call(f"{tmp_path}/it's my: own.py:f", 1) == 2


BODIES = """\
import trimesh

def inward(silhouettes, cameras, vertices):
    silhouettes[:] = False
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    mesh.invert()
    return mesh

def flat(silhouettes, cameras, vertices):
    mesh = inward(silhouettes, cameras, vertices)
    mesh.vertices[:, 1] = 0
    return mesh

def far(silhouettes, cameras, vertices):
    mesh = inward(silhouettes, cameras, vertices)
    mesh.vertices *= 1e6
    return mesh
"""


def test_a_body_is_turned_outside_out_and_silhouettes_stay(scene, code):
    before = scene[0].copy()
    first = make_initial_mesh(Init(shape=code(BODIES) + "inward"), *scene)
    assert first.mesh.volume == pytest.approx(4 / 3 * np.pi * 0.6**3, rel=0.05)
    np.testing.assert_array_equal(scene[0], before)


@pytest.mark.parametrize(
    ("function", "message"),
    [("flat", "without volume"), ("far", r"reaches 3e\+05 from the origin")],
)
def test_a_mesh_that_is_no_body_of_the_object_is_refused(scene, code, function, message):
    with pytest.raises(InputError, match=message):
        make_initial_mesh(Init(shape=code(BODIES) + function), *scene)


RED = """\
def red(photograph):
    return photograph[..., 0] > 100

def soft(photograph):
    return photograph[..., 0] / 255

def blind(photograph):
    return photograph[:, 10_000]

def none():
    pass
"""
RENDERER = """\
from silmesh.softras import soft_silhouettes

called = []

def ours(points, faces, size, sigma):
    called.append(size)
    return soft_silhouettes(points, faces, size, sigma)

def flat(points, faces, size, sigma):
    return ours(points, faces, size, sigma)[0]

def dead(points, faces, size, sigma):
    return ours(points.detach(), faces, size, sigma)

def wrong(points, faces, size, sigma):
    return points.nothing
"""
PRESET = """\
from silmesh.fitting.softras import SoftRas

class Mine(SoftRas):
    def step(self):
        if self._settings.options.get("fail"):
            raise RuntimeError("as told")
        losses = super().step()
        if self._settings.options.get("name"):
            return {"mine": losses["loss"]}
        return losses

def number(*parts):
    return 7
"""
POINTS = torch.tensor([[[2.0, 2.0], [12.0, 3.0], [5.0, 11.0]]], requires_grad=True)
FACES = torch.tensor([[0, 1, 2]])


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """An orange ellipsoid on a turntable: its photographs, and its silhouettes in them."""
    folder = tmp_path_factory.mktemp("photographs")
    shown = silhouettes(turntable(6, 48, elevation=10), (0.45, 0.3, 0.2))
    for i, silhouette in enumerate(shown):
        pixels = np.full((48, 48, 3), 20, np.uint8)
        pixels[silhouette] = (200, 120, 40)
        Image.fromarray(pixels).save(folder / f"r{i}.png")
    return silmesh.read_photographs(folder, size=48), shown


@pytest.fixture(scope="module")
def fitted_scene(photographs):
    found = silmesh.find_silhouettes(photographs[0])
    return silmesh.find_cameras(photographs[0], found, "turntable", turntable="2.732,10,60")


@pytest.fixture
def code(tmp_path):
    """Writes a file of one's own; gives what its functions' names follow."""

    def write(text):
        (tmp_path / "code.py").write_text(text)
        return f"{tmp_path / 'code.py'}:"

    return write


def test_silhouettes_are_those_that_a_function_gives(photographs, code):
    found = silmesh.find_silhouettes(photographs[0], source=code(RED) + "red")
    np.testing.assert_array_equal(found.silhouettes, photographs[1])
    assert found.policy == "repair"


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("soft", r"r0\.png: gives float64 \[48, 48\]; should give a numpy array, bool \[48, 48\]"),
        ("blind", r"code\.py, line 8: IndexError"),
        ("none", r"code\.py: TypeError: none\(\) takes 0"),
        ("lacking", "defines no function 'lacking'"),
    ],
)
def test_silhouettes_that_cannot_be_are_refused(photographs, code, function, message):
    with pytest.raises(InputError, match=message):
        silmesh.find_silhouettes(photographs[0], source=code(RED) + function)


def test_an_unknown_source_is_refused_with_those_that_are(photographs):
    with pytest.raises(InputError, match="mask, alpha, threshold, deeplab, matting, not 'magic'"):
        silmesh.find_silhouettes(photographs[0], source="magic")


def fit_ball(scene, **settings):
    return silmesh.fit(silmesh.initial_mesh(scene, "sphere", vertices=162), scene, **settings)


@pytest.mark.parametrize("preset", ["softras", "fast"])
def test_each_renderer_fits_as_the_default_does(fitted_scene, code, preset):
    told = {"preset": preset, "iterations": 3, "device": "cpu"}
    usual = fit_ball(fitted_scene, **told)
    for renderer in (*ON_THE_CPU, code(RENDERER) + "ours"):
        fitted = fit_ball(fitted_scene, renderer=renderer, **told)
        most = 1e-3 if renderer == "reference" else 0
        assert np.abs(fitted.mesh.vertices - usual.mesh.vertices).max() <= most


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("flat", r"code\.py:flat: gives torch\.float32 \[16, 14\] on cpu; should give alpha, "),
        ("dead", "no gradient with respect to the points"),
        ("wrong", r"code\.py, line 16: AttributeError"),
    ],
)
def test_a_renderer_that_cannot_be_is_refused(code, function, message):
    render = find_renderer(code(RENDERER) + function)
    with pytest.raises(InputError, match=message):
        render(POINTS, FACES, (16, 14), 1e-4)


def test_a_renderer_gives_what_ours_gives(code):
    expected = soft_silhouettes(POINTS, FACES, (16, 14), 1e-4)
    for name in (*ON_THE_CPU, code(RENDERER) + "ours"):
        alpha = find_renderer(name)(POINTS, FACES, (16, 14), sigma=1e-4)
        torch.testing.assert_close(alpha, expected, atol=1e-5, rtol=0)


def test_a_renderer_of_the_cpu_is_no_renderer_of_a_gpu(fitted_scene):
    for renderer, device in (("cpu", "cuda"), ("gpu", "cpu")):
        with pytest.raises(InputError, match=f"'{renderer}' does not render on .* '{device}'"):
            fit_ball(fitted_scene, renderer=renderer, device=device)


def test_a_procedure_of_ones_own_fits(fitted_scene, code):
    told = {"iterations": 3, "device": "cpu"}
    usual = fit_ball(fitted_scene, preset="softras", **told)
    own = fit_ball(fitted_scene, preset=code(PRESET) + "Mine", options={"step": 2}, **told)
    np.testing.assert_array_equal(own.mesh.vertices, usual.mesh.vertices)
    assert isinstance(own.settings, OwnFit)


@pytest.mark.parametrize(
    ("function", "options", "message"),
    [
        ("Mine", {"fail": True}, r"code\.py, line 6: RuntimeError: as told"),
        ("Mine", {"name": 1}, "a step gives mine; should give flatten, iou_loss, laplacian, loss"),
        ("number", {}, r"code\.py:number: gives int, which lacks verts, faces, done"),
    ],
)
def test_a_procedure_that_cannot_be_is_refused(fitted_scene, code, function, options, message):
    with pytest.raises(InputError, match=message):
        fit_ball(fitted_scene, preset=code(PRESET) + function, options=options, iterations=2)


WRONG = """\
import torch
from silmesh.fitting.softras import SoftRas

class NoLoss(SoftRas):
    def step(self):
        return super().step() | {"loss": float("nan")}

class Exits(SoftRas):
    def step(self):
        raise SystemExit(0)

class Ended(SoftRas):
    done = True

class Blind(SoftRas):
    def correct(self, cameras, fitted):
        return None

class Fewer(SoftRas):
    def correct(self, cameras, fitted):
        return cameras.select(fitted[:2])

class Lost(SoftRas):
    @property
    def verts(self):
        return super().verts / (0 if self._steps else 1)

class Holed(SoftRas):
    def __init__(self, *given):
        super().__init__(*given)
        self.faces = self.faces + 1

class Back(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, size):
        return points.new_zeros(len(points), *size)

    @staticmethod
    def backward(ctx, gradient):
        return gradient[0], None

def shallow(points, faces, size, sigma):
    return Back.apply(points, size)

def void(points, faces, size, sigma):
    return Back.apply(points, size) + float("nan")
"""


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("NoLoss", "a step gives loss nan; should give a finite number"),
        ("Exits", r"code\.py, line 10: SystemExit: 0"),
        ("Ended", "is done before a step"),
        ("Blind", "its correct gives NoneType; should give Cameras of all 6 views"),
        ("Fewer", "its correct gives 2 cameras; should give Cameras of all 6 views"),
        ("Lost", "should have finite floats"),
        ("Holed", "should have one or more, int64, which number vertices from 0 to 161"),
    ],
)
def test_what_a_procedure_ends_with_is_looked_at(fitted_scene, code, function, message):
    with pytest.raises(InputError, match=message):
        fit_ball(fitted_scene, preset=code(WRONG) + function, iterations=2)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("shallow", r"code\.py: at .*, line \d+: RuntimeError"),
        ("void", "void: gives alpha that is not"),
    ],
)
def test_a_renderer_is_named_where_torch_fails_over_it(fitted_scene, code, function, message):
    with pytest.raises(InputError, match=message):
        fit_ball(fitted_scene, renderer=code(WRONG) + function, iterations=2, device="cpu")


def test_vertices_that_are_no_points_are_refused(code):
    @dataclass
    class Flat:
        verts = torch.zeros(4, 2)
        faces = torch.zeros(4, 3, dtype=torch.int64)
        done, halvings = True, 0
        step = correct = state = restore = None

    own = code("def give(fit):\n    return fit\n") + "give"
    with pytest.raises(InputError, match=r"has \[4, 2\]; should have verts, float \[verts, 3\]"):
        find_procedure(own)(Flat())


def test_settings_of_a_fit_of_ones_own_are_checked():
    fit = check(Fit, {"preset": "mine.py:fit", "options": {"a": 1, "b": 0.5, "c": "x"}}, "here")
    assert (fit.options, fit.iterations) == ({"a": 1, "b": 0.5, "c": "x"}, 2000)
    wrong = {
        r"here: option: unknown key; did you mean 'options'\?": {"option": {}},
        "here: options: should be names, each with ": {"options": 3},
        "here: iterations: should be a whole number": {"iterations": 0},
        "here: renderer: should be 'auto', 'cpu', 'gpu' or 'reference' or 'path": {
            "renderer": "cup"
        },
    }
    for message, values in wrong.items():
        with pytest.raises(InputError, match=message):
            check(Fit, {"preset": "mine.py:fit", **values}, "here")
    with pytest.raises(InputError, match="preset: should be 'softras' or 'fast' or 'path"):
        check(Fit, {"preset": "fats"}, "here")
