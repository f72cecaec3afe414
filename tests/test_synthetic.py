"""Made-up objects and their photographs, against what their geometry says."""

import math
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion

from silmesh.errors import InputError
from silmesh.files import MADE, making
from silmesh.steps import synthetic as step
from silmesh.synthetic.dataset import find_paint, make_object, mesh_solid
from silmesh.synthetic.layout import OBJECTS, SIZE, photograph_names, turntable_angles
from silmesh.synthetic.orbit import photograph_cameras
from silmesh.synthetic.paints import coat
from silmesh.synthetic.photograph import photograph
from silmesh.synthetic.solids import ellipsoid, lathe, limb, ring, sphere, subtract, unite

GENUS = dict.fromkeys(OBJECTS, 0) | {"pot": 2}  # one for each handle


def turntable(views: int, size: tuple[int, int] = SIZE, **kwargs):
    return photograph_cameras([str(i) for i in range(views)], size, **kwargs)


@cache
def made(name: str) -> trimesh.Trimesh:
    return make_object(name)


@cache
def photographed(name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Four views, a quarter turn apart, of half the usual size."""
    return list(photograph(made(name), turntable(4, (192, 144)), find_paint(name)))


def white(points: np.ndarray) -> np.ndarray:
    return coat(points, np.ones(3, dtype=np.float32), 0.0)


# --- names -----------------------------------------------------------------------------------


def test_names_are_alois():
    names = photograph_names("apricot")
    assert len(names) == 72
    assert names[:3] == ["apricot_r0.png", "apricot_r5.png", "apricot_r10.png"]
    assert names[-1] == "apricot_r355.png"


def test_fewer_views_go_evenly_around():
    assert turntable_angles(4) == [0, 90, 180, 270]


@pytest.mark.parametrize("views", [0, -1, 7, 720])
def test_views_must_divide_the_circle(views: int):
    with pytest.raises(InputError, match=f"{views} views"):
        turntable_angles(views)


def test_names_import_nothing_heavy():
    code = (
        "import sys, silmesh.synthetic.layout\n"
        "print([m for m in ('torch', 'numpy', 'trimesh', 'skimage') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- solids ----------------------------------------------------------------------------------

AT = np.float32([[0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 0.5]])


@pytest.mark.parametrize(
    ("distances", "expected"),
    [
        (sphere(AT, (0, 0, 0), 1), [-1, 2, 1, -0.5]),
        (limb(AT, (0, -1, 0), (0, 1, 0), (0.5, 0.5)), [-0.5, 2.5, 0.5, 0]),
        (ring(AT, (0, 0, 0), 1, 2.0, 0.5), [1.5, 0.5, math.hypot(2, 2) - 0.5, 1.0]),
        # A cylinder of radius 1 from y = -1 to y = 1.
        (lathe(AT, np.float32([(0, -1), (1, -1), (1, 1), (0, 1)])), [-1, 2, 1, -0.5]),
        (subtract(sphere(AT, (0, 0, 0), 2.5), sphere(AT, (0, 0, 0), 1)), [1, 0.5, -0.5, 0.5]),
        # Two solids that are as far: the blend brings the surface nearer by a quarter of itself.
        (unite(AT[:, 0], AT[:, 0], blend=0.4), [-0.1, 2.9, -0.1, -0.1]),
    ],
)
def test_distances_by_hand(distances: np.ndarray, expected: list[float]):
    np.testing.assert_allclose(distances, expected, atol=1e-5)


def test_ellipsoid_is_exact_on_its_axes_ends_and_negative_inside():
    ends = np.float32([[2, 0, 0], [0, 1, 0], [0, 0, 0.5], [0, 0, 0]])
    distances = ellipsoid(ends, (0, 0, 0), (2, 1, 0.5))
    np.testing.assert_allclose(distances[:3], 0, atol=1e-5)
    assert distances[3] < -0.05


def test_a_meshed_ball_has_a_balls_volume_and_lies_on_it():
    mesh = mesh_solid(lambda p: sphere(p, (0.1, 0, 0), 0.3), (-0.3,) * 3, (0.5, 0.4, 0.4), 0.02)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * math.pi * 0.3**3, rel=0.005)
    radii = np.linalg.norm(mesh.vertices - [0.1, 0, 0], axis=1)
    np.testing.assert_allclose(radii, 0.3, atol=2e-5)


# --- objects ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OBJECTS)
def test_objects_are_one_closed_surface_oriented_outwards(name: str):
    mesh = made(name)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.body_count == 1
    assert mesh.euler_number == 2 - 2 * GENUS[name]
    assert 10_000 <= len(mesh.faces) <= 40_000
    assert np.linalg.norm(mesh.vertices, axis=1).max() <= 0.52


@pytest.mark.parametrize("name", OBJECTS)
def test_vertices_carry_more_than_one_colour(name: str):
    colours = made(name).visual.vertex_colors[:, :3]
    assert len(colours) == len(made(name).vertices)
    assert colours.std(axis=0).max() > 20


@pytest.mark.parametrize("name", OBJECTS)
def test_every_view_holds_the_whole_object_with_a_margin(name: str):
    points = turntable(72).project(torch.from_numpy(np.array(made(name).vertices)))
    width, height = SIZE
    assert points.min() > 8
    assert points[..., 0].max() < width - 8
    assert points[..., 1].max() < height - 8


def test_an_unknown_object_is_named_with_those_there_are():
    with pytest.raises(InputError, match=r"'teapot'.*apricot.*tube"):
        make_object("teapot")


def test_the_apricot_is_small_and_beside_the_axis_and_low():
    x, y, z = made("apricot").centroid
    assert math.hypot(x, z) == pytest.approx(0.1, abs=0.02)
    assert y == pytest.approx(-0.28, abs=0.03)
    assert max(made("apricot").extents) < 0.3


def test_the_pot_is_large_and_low():
    (_, low, _), (_, high, _) = made("pot").bounds
    assert made("pot").extents[0] > 0.9
    assert (low + high) / 2 < -0.05


def test_the_tube_is_round_below_and_flat_above():
    verts = made("tube").vertices
    below = np.ptp(verts[np.abs(verts[:, 1] + 0.33) < 0.02], axis=0)
    above = np.ptp(verts[verts[:, 1] > 0.36], axis=0)
    assert below[2] / below[0] == pytest.approx(1, abs=0.03)
    assert above[2] / above[0] < 0.1


def test_the_bear_stands_with_a_gap_between_its_legs():
    mask = photographed("bear")[0][1]
    column = mask[:, mask.shape[1] // 2]
    crotch = np.flatnonzero(column).max()
    feet = np.flatnonzero(mask.any(axis=1)).max()
    rows = mask[crotch + 2 : feet - 1]
    assert len(rows) >= 5
    assert ((np.diff(rows.astype(int), axis=1) == 1).sum(axis=1) == 2).all()  # two runs each


# --- photographs -----------------------------------------------------------------------------


def test_turntable_cameras_by_hand():
    cameras = turntable(4, elevation=30.0, distance=2.0)
    up, out = 1.0, math.sqrt(3)  # 2 sin 30, 2 cos 30
    expected = [[0, up, out], [out, up, 0], [0, up, -out], [-out, up, 0]]
    np.testing.assert_allclose(cameras.centres, expected, atol=1e-12)
    focal = 192 / math.tan(math.radians(15))
    for K in cameras.K:
        np.testing.assert_allclose(K, [[focal, 0, 192], [0, focal, 144], [0, 0, 1]])
    # From the z axis, x is to the right in the picture and y is up.
    right, above = cameras.project(torch.eye(3, dtype=torch.float64))[0, :2] - K[:2, 2]
    assert right[0] > 0
    assert above[1] < 0
    assert torch.allclose(cameras.R.det(), torch.ones(4, dtype=torch.float64))


@pytest.mark.parametrize("name", OBJECTS)
def test_masks_are_as_wide_and_high_as_the_projected_vertices(name: str):
    verts = torch.from_numpy(np.array(made(name).vertices))
    points = turntable(4, (192, 144)).project(verts).numpy()
    for (_, mask), projected in zip(photographed(name), points, strict=True):
        v, u = np.nonzero(mask)
        box = [u.min(), v.min(), u.max() + 1, v.max() + 1]
        expected = [*projected.min(axis=0), *projected.max(axis=0)]
        np.testing.assert_allclose(box, expected, atol=1.0)


def test_a_ball_covers_the_ellipse_that_it_should():
    """Off the axis, a ball of radius r at c is seen as the conic of the cone around it.

    A ray d meets it when (c.d)^2 >= (c.c - r^2) d.d: decided here for each pixel's centre.
    """
    centre, radius = np.array([0.2, -0.1, 0.15]), 0.25
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    ball.apply_translation(centre)
    cameras = turntable(3, (96, 72))
    for i, (_, mask) in enumerate(photograph(ball, cameras, white)):
        v, u = np.mgrid[:72, :96] + 0.5
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(cameras.K[i].numpy()).T
        c = cameras.R[i].numpy() @ centre + cameras.t[i].numpy()
        inside = (rays @ c) ** 2 >= (c @ c - radius**2) * (rays**2).sum(axis=-1)
        assert (inside & mask).sum() / (inside | mask).sum() > 0.98
        assert mask.sum() == pytest.approx(inside.sum(), rel=0.01)


@pytest.mark.parametrize("name", OBJECTS)
def test_a_threshold_finds_the_mask(name: str):
    """To the pixels that the outline crosses, which are a larger part of the thin plane."""
    for image, mask in photograph(made(name), turntable(3), find_paint(name)):
        bright = image.max(axis=2) > 50
        assert (bright & mask).sum() / (bright | mask).sum() > (0.96 if name == "plane" else 0.98)
        assert bright[binary_erosion(mask, np.ones((3, 3)))].all()
        assert not bright[~binary_dilation(mask, np.ones((3, 3)))].any()


@pytest.mark.parametrize("name", OBJECTS)
def test_the_background_is_black(name: str):
    for image, mask in photographed(name):
        assert image[~binary_dilation(mask, np.ones((3, 3)))].max() <= 4


def test_the_lamp_stands_above_on_the_left_whatever_the_turn():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    for image, _ in photograph(ball, turntable(3, (96, 72)), white):
        grey = image.mean(axis=2)
        assert grey[:, :48].sum() > 1.05 * grey[:, 48:].sum()
        assert grey[:36].sum() > 1.05 * grey[36:].sum()


def test_one_thing_shades_another():
    """A second ball, between the lamp and the first one but beside it in the picture."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.15)
    other = ball.copy().apply_translation([-0.23, 0.25, 0.2])
    camera = turntable(1, (96, 72), elevation=0.0)
    (alone, mask), (shaded, _) = (
        next(photograph(mesh, camera, white))
        for mesh in (ball, trimesh.util.concatenate(ball, other))
    )
    assert shaded[mask].mean() < 0.9 * alone[mask].mean()


def test_the_same_seed_gives_the_same_bytes_and_another_one_other_noise():
    def bytes_of(seed: int) -> tuple[bytes, bytes]:
        picture = photograph(made("tube"), turntable(1, (96, 72)), find_paint("tube"), seed)
        return tuple(part.tobytes() for part in next(picture))

    first = bytes_of(0)
    assert bytes_of(0) == first
    assert bytes_of(1)[0] != first[0]
    assert bytes_of(1)[1] == first[1]


def test_views_do_not_depend_on_those_before(monkeypatch):
    cameras = turntable(3, (48, 36))
    monkeypatch.setattr("silmesh.synthetic.photograph.SENSOR_NOISE", (0.0, 0.0))
    third = list(photograph(made("bear"), cameras, find_paint("bear")))[2]
    alone = next(photograph(made("bear"), cameras.select([2]), find_paint("bear")))
    np.testing.assert_array_equal(third[0], alone[0])


# --- the step --------------------------------------------------------------------------------


def arguments(folder, name: str = "apricot") -> list[str]:
    places = {
        "--images": folder / "png2" / name,
        "--masks": folder / "mask2" / name,
        "--truth": folder / f"{name}.ply",
    }
    flags = [str(word) for pair in places.items() for word in pair]
    return [name, *flags, "--views", "2"]


def test_the_step_writes_alois_layout_and_the_truth(tmp_path):
    step.main(arguments(tmp_path))
    names = ["apricot_r0.png", "apricot_r180.png"]
    files = sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file())
    folders = ("mask2", "png2")
    listed = [MADE, *names]  # and the list of what was made, which lets it be made anew
    assert files == ["apricot.ply", *(f"{f}/apricot/{n}" for f in folders for n in listed)]
    image = Image.open(tmp_path / "png2/apricot" / names[0])
    mask = Image.open(tmp_path / "mask2/apricot" / names[0])
    assert (image.mode, image.size) == ("RGB", SIZE)
    assert (mask.mode, mask.size) == ("1", SIZE)
    truth = trimesh.load(tmp_path / "apricot.ply")
    assert truth.is_watertight
    np.testing.assert_allclose(truth.bounds, made("apricot").bounds, atol=1e-6)
    np.testing.assert_array_equal(truth.visual.vertex_colors, made("apricot").visual.vertex_colors)


def test_the_step_turns_as_far_as_the_names_say(tmp_path):
    """The apricot, on the side of positive x, is on the left when it has turned half way."""
    step.main(arguments(tmp_path))
    columns = [
        np.nonzero(np.asarray(Image.open(tmp_path / f"mask2/apricot/apricot_r{a}.png")))[1]
        for a in (0, 180)
    ]
    assert columns[0].mean() > 192 + 10
    assert columns[1].mean() < 192 - 10


def test_the_step_makes_the_same_bytes_again(tmp_path):
    for run in ("a", "b"):
        step.main(arguments(tmp_path / run))
    for path in (tmp_path / "a").rglob("*.p*"):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()


def test_a_step_that_fails_half_way_leaves_what_was_there(tmp_path, monkeypatch):
    def fail_at_the_second(*args):
        yield np.zeros((4, 4, 3), dtype=np.uint8), np.zeros((4, 4), dtype=bool)
        raise RuntimeError("the lamp broke")

    before = tmp_path / "png2" / "apricot" / "old.png"
    with making(before.parent) as part:
        (part / before.name).touch()
    monkeypatch.setattr(step, "photograph", fail_at_the_second)
    with pytest.raises(RuntimeError, match="the lamp broke"):
        step.main(arguments(tmp_path))
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(files) == [before.with_name(MADE), before]


def test_the_step_names_the_objects_that_it_knows(tmp_path, capsys):
    with pytest.raises(SystemExit):
        step.main(["teapot", *arguments(tmp_path)[1:]])
    assert "apricot" in capsys.readouterr().err
