"""Every step once, from photographs to metrics, without Snakemake."""

import errno
import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
import trimesh
from PIL import Image
from scenes import behind_lenses, save, silhouettes, turntable

from silmesh.cameras.attempt import Attempt, read_attempt, write_attempt
from silmesh.cameras.turntable import turntable_cameras
from silmesh.errors import InputError
from silmesh.files import replacing
from silmesh.geometry.camera import Similarity, read_cameras, write_cameras
from silmesh.geometry.lens import Lens
from silmesh.geometry.mesh_files import read_mesh
from silmesh.silhouettes import read_silhouettes
from silmesh.steps import calibrate as calibrate_step
from silmesh.steps import cameras as cameras_step
from silmesh.steps import colour, evaluate, fit, gallery, initial, judge, scene, truth, views
from silmesh.steps import silhouettes as silhouettes_step
from silmesh.steps.command import run

WIDTH, HEIGHT, SIZE, COUNT = 64, 48, 32, 8
SETTINGS = {
    "preset": "softras",
    "iterations": 40,
    "learning_rate": 0.03,
    "betas": (0.5, 0.99),
    "sigma": 1e-4,
    "weights": {"laplacian": 0.03, "flatten": 0.0003},
    "holdout": 4,
    "device": "cpu",
}
AXES, CENTRE = (30.0, 15.0, 20.0), (5.0, -3.0, 2.0)


def photographed():
    """Cameras of photographs of an ellipsoid, far off in a world of its own."""
    square = turntable(COUNT, WIDTH, elevation=20)
    up = torch.tensor([[1.0, 0, 0], [0, 1, -(WIDTH - HEIGHT) / 2], [0, 0, 1]])
    sizes = torch.tensor([[WIDTH, HEIGHT]] * COUNT)
    elsewhere = Similarity(-torch.tensor(CENTRE, dtype=torch.float64) / 60, 60.0)
    return square.in_pixels_of(up.expand(COUNT, 3, 3), sizes).in_world_of(elsewhere)


def call(step, **options):
    """``main`` with options by their names; a list becomes several values, a mapping JSON."""
    argv = []
    for name, value in options.items():
        value = json.dumps(value) if isinstance(value, dict) else value
        values = value if isinstance(value, list | tuple) else [value]
        argv += [f"--{name.replace('_', '-')}", *map(str, values)]
    step.main(argv)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Everything that a run makes of the ellipsoid, and what it was made from."""
    root = tmp_path_factory.mktemp("run")
    made = photographed()
    seen = silhouettes(made, AXES, CENTRE)
    images, masks = [], []
    for name, mask in zip(made.views, seen, strict=True):
        images.append(
            save(root / "png2" / f"{name}.png", np.repeat(mask[..., None] * np.uint8(200), 3, 2))
        )
        masks.append(save(root / "mask2" / f"{name}.png", mask))
    write_cameras(root / "given.json", made)
    truth = trimesh.creation.icosphere(subdivisions=3)
    truth.apply_scale(AXES)
    truth.apply_translation(CENTRE)
    truth.export(root / "truth.ply")

    out = root / "results"
    call(views, images=images, settings={"size": SIZE}, output=out / "views")
    call(
        silhouettes_step,
        views=out / "views",
        source="mask",
        masks=masks,
        output=out / "silhouettes",
    )
    call(cameras_step, views=out / "views", file=root / "given.json", output=out / "cameras")
    pictures = {"views": out / "views", "silhouettes": out / "silhouettes"}
    call(scene, **pictures, cameras=out / "cameras", threads=1, output=out / "found")
    call(
        judge,
        scene=out / "found",
        settings={"policy": "keep"},
        threads=1,
        output=out / "scene",
    )
    call(
        gallery,
        views=out / "views",
        scene=out / "found",
        judged=out / "scene",
        sheet=out / "sheet.png",
        output=out / "gallery.json",
    )
    call(
        initial,
        scene=out / "scene",
        settings={"shape": "sphere", "vertices": 162, "align": "none"},
        output=out / "first.ply",
        report=out / "init.json",
    )
    variant = out / "object" / "variant"
    call(
        fit,
        initial=out / "first.ply",
        scene=out / "scene",
        settings=SETTINGS,
        threads=1,
        meshes=variant / "mesh.ply",
        cameras=variant / "cameras.json",
        loss=variant / "loss.csv",
        notes=variant / "fit.json",
    )
    call(
        colour,
        mesh=variant / "mesh.ply",
        cameras=variant / "cameras.json",
        scene=out / "scene",
        meshes=[variant / "mesh.obj", variant / "mesh.glb"],
    )
    call(
        evaluate,
        mesh=variant / "mesh.ply",
        cameras=variant / "cameras.json",
        loss=variant / "loss.csv",
        notes=variant / "fit.json",
        scene=out / "scene",
        initial=out / "init.json",
        truth=root / "truth.ply",
        settings=SETTINGS,
        threads=1,
        results=out,
        output=variant / "metrics.json",
    )
    return out


def test_silhouettes_are_those_of_the_working_images(results):
    cameras = read_cameras(results / "cameras" / "cameras.json")
    assert cameras.sizes.tolist() == [[SIZE, SIZE]] * COUNT
    found = read_silhouettes(results / "silhouettes", cameras.views)
    expected = silhouettes(cameras, AXES, CENTRE)
    assert (found & expected).sum() / (found | expected).sum() > 0.97


def test_the_scene_is_normalised_and_coherent(results):
    scene = json.loads((results / "scene" / "scene.json").read_text())
    np.testing.assert_allclose(
        scene["centre"], CENTRE, atol=2
    )  # a box is not centred on what it is a picture of
    assert scene["scale"] * max(AXES) == pytest.approx(0.5, rel=0.1)
    assert scene["hull_iou_mean"] > 0.93
    assert scene["frames"] == {f"v{i}": [0, 4, SIZE, 28] for i in range(COUNT)}


def test_the_scene_says_where_the_photographs_lie_in_their_images(results):
    told = json.loads((results / "scene" / "scene.json").read_text())
    assert told["frame"] == [0, 4, SIZE, 28]  # 64x48 in 32x32


def test_the_initial_mesh_is_the_unit_sphere(results):
    mesh = trimesh.load_mesh(results / "first.ply", process=False)
    assert len(mesh.vertices) == 162
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=1e-6)


def test_losses_have_the_contracts_columns_and_fall(results):
    loss = pd.read_csv(results / "object" / "variant" / "loss.csv")
    columns = ["iteration", "loss", "iou_loss", "laplacian", "flatten", "seconds"]
    assert list(loss.columns) == columns
    assert loss["iteration"].tolist() == list(range(40))
    weighted = loss["iou_loss"] + 0.03 * loss["laplacian"] + 0.0003 * loss["flatten"]
    np.testing.assert_allclose(loss["loss"], weighted, rtol=1e-5)
    assert loss["iou_loss"].iloc[-1] < 0.6 * loss["iou_loss"].iloc[0]


@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_the_mesh_is_in_the_worlds_own_frame(results, ending):
    mesh = trimesh.load_mesh(results / "object" / "variant" / f"mesh.{ending}", process=False)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), CENTRE, atol=4)
    np.testing.assert_allclose(mesh.extents / 2, AXES, rtol=0.35)


def test_the_mesh_has_the_photographs_grey(results):
    mesh = trimesh.load_mesh(results / "object" / "variant" / "mesh.obj", process=False)
    assert np.median(mesh.visual.vertex_colors[:, :3]) == pytest.approx(200, abs=2)


def test_the_meshs_cameras_are_those_given_in_working_pixels(results):
    fitted = read_cameras(results / "object" / "variant" / "cameras.json")
    given = read_cameras(results / "cameras" / "cameras.json")
    assert fitted.views == given.views
    torch.testing.assert_close(fitted.centres, given.centres)
    torch.testing.assert_close(fitted.K, given.K)


def test_metrics_have_the_contracts_keys(results):
    metrics = json.loads((results / "object" / "variant" / "metrics.json").read_text())
    assert metrics["iou_min"] <= metrics["iou_mean"] <= 1
    held = [metrics["iou"][name] for name in ("v3", "v7")]
    assert metrics["iou_holdout"] == pytest.approx(np.mean(held))
    assert metrics["iou_mean"] > 0.7
    assert metrics["hull_iou_mean"] > 0.93
    assert metrics["iterations"] == 40
    assert (metrics["views"], metrics["views_dropped"]) == (COUNT, 0)
    assert metrics["cameras"]["source"] == "file"
    assert metrics["silhouettes"] == "scene/silhouettes"
    assert metrics["volume_iou"] > 0.5
    assert (metrics["components"], metrics["genus"], metrics["manifold"]) == (1, 0, True)
    assert {"self_intersections", "edge_length_spread", "smallest_angle"} <= set(metrics)
    assert "aligned" not in metrics  # the cameras were given
    assert {"loss_final", "fit_seconds", "chamfer", "f_score", "normal_consistency"} <= set(metrics)


def test_silhouettes_may_lie_outside_the_results(results, tmp_path):
    variant = results / "object" / "variant"
    call(
        evaluate,
        mesh=variant / "mesh.ply",
        cameras=variant / "cameras.json",
        loss=variant / "loss.csv",
        notes=variant / "fit.json",
        settings=SETTINGS,
        scene=results / "scene",
        initial=results / "init.json",
        results=results / "object",
        output=tmp_path / "metrics.json",
    )
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["silhouettes"] == "../scene/silhouettes"
    assert "chamfer" not in metrics  # there is no truth


def test_a_mesh_of_estimated_cameras_is_aligned_with_its_truth(results, tmp_path):
    variant = results / "object" / "variant"
    truth = trimesh.load_mesh(variant / "mesh.ply", process=False)
    truth.apply_transform(trimesh.transformations.rotation_matrix(1.0, [0, 1, 0]))
    truth.apply_scale(0.25)
    truth.export(tmp_path / "truth.ply")
    argv = ["--mesh", variant / "mesh.ply", "--cameras", variant / "cameras.json", "--align"]
    argv += ["--loss", variant / "loss.csv", "--settings", json.dumps(SETTINGS)]
    argv += ["--results", results]
    argv += ["--scene", results / "scene", "--initial", results / "init.json"]
    argv += ["--truth", tmp_path / "truth.ply"]
    evaluate.main([*map(str, argv), "--output", str(tmp_path / "metrics.json")])
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["aligned"]
    assert metrics["scale"] == pytest.approx(0.25, rel=0.02)
    assert metrics["f_score"] > 0.9


def test_matrices_of_a_left_handed_world_and_its_truth_are_mirrored(results, tmp_path, capsys):
    """The mirror image of the mirrored world is the one that all else was made in."""
    for view, matrix in zip(photographed().views, photographed().projections, strict=True):
        path = tmp_path / "P" / f"{view}.txt"
        path.parent.mkdir(exist_ok=True)
        np.savetxt(path, matrix.numpy() @ np.diag([1, 1, -1, 1]))
    call(cameras_step, views=results / "views", file=tmp_path / "P", output=tmp_path / "c")
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    call(scene, **pictures, cameras=tmp_path / "c", output=tmp_path / "scene")
    assert f"silmesh: {tmp_path / 'P'}: the cameras are of a left-handed" in capsys.readouterr().err
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    own = json.loads((results / "found" / "scene.json").read_text())
    assert told["mirrored"]
    assert not own["mirrored"]
    assert told["hull_iou_mean"] == pytest.approx(own["hull_iou_mean"], abs=1e-3)
    np.testing.assert_allclose(told["centre"], own["centre"], atol=1e-6)

    truth = trimesh.load_mesh(results.parent / "truth.ply", process=False)
    truth.vertices[:, 2] *= -1
    truth.invert()
    truth.export(tmp_path / "truth.ply")
    variant = results / "object" / "variant"
    measured = {}
    for name, folder, true in (
        ("left", tmp_path / "scene", tmp_path / "truth.ply"),
        ("own", results / "scene", results.parent / "truth.ply"),
    ):
        call(
            evaluate,
            mesh=variant / "mesh.ply",
            cameras=variant / "cameras.json",
            loss=variant / "loss.csv",
            notes=variant / "fit.json",
            settings=SETTINGS,
            scene=folder,
            truth=true,
            results=results,
            output=tmp_path / f"{name}.json",
        )
        measured[name] = json.loads((tmp_path / f"{name}.json").read_text())
    for key in ("chamfer", "volume_iou", "normal_consistency"):
        assert measured["left"][key] == pytest.approx(measured["own"][key], rel=0.02)
    assert measured["left"]["cameras"]["mirrored"]
    assert "left-handed world" in measured["left"]["cameras"]["warnings"][0]


def test_no_part_is_left(results):
    assert not list(results.rglob(".part-*"))


def test_cameras_found_from_silhouettes(results, tmp_path):
    views, seen = results / "views", results / "silhouettes"
    arguments = ["--views", views, "--silhouettes", seen, "--step", 45, "--threads", 1]
    calibrate_step.main([*map(str, arguments), "--output", str(tmp_path / "found")])
    found = read_attempt(tmp_path / "found")
    assert found.cameras.views == read_cameras(results / "cameras" / "cameras.json").views
    assert abs(found.figures["estimates"]["step"]["value"]) == 45
    assert found.figures["estimates"]["elevation"]["value"] == pytest.approx(20, abs=5)


def test_a_turntable_needs_no_file(results, tmp_path):
    call(cameras_step, views=results / "views", turntable=[2.732, 0, -45], output=tmp_path / "c")
    expected = turntable(COUNT, SIZE).centres * torch.tensor([-1, 1, 1])  # the other way round
    torch.testing.assert_close(read_attempt(tmp_path / "c").cameras.centres, expected)


def keep_world(results, cameras, output):
    """The scene of these cameras, whose world is normalised already."""
    argv = ["--views", results / "views", "--silhouettes", results / "silhouettes"]
    scene.main([*map(str, [*argv, "--cameras", cameras, "--output", output]), "--keep-world"])


def test_a_scene_holds_just_the_views_that_have_a_camera(results, tmp_path):
    given = read_cameras(results / "cameras" / "cameras.json")
    some = Attempt("colmap", given.select([0, 1, 3, 4, 6, 7]), dropped={"v2": "blurred", "v5": ""})
    write_attempt(tmp_path / "some", some)
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    call(scene, **pictures, cameras=tmp_path / "some", output=tmp_path / "scene")
    for folder in ("views", "silhouettes"):
        names = sorted(path.stem for path in (tmp_path / "scene" / folder).iterdir())
        assert names == ["v0", "v1", "v3", "v4", "v6", "v7"]
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert (told["cameras"], told["dropped"]) == ("colmap", {"v2": "blurred", "v5": ""})


def test_of_two_attempts_the_more_coherent_is_taken(results, tmp_path):
    wrong = turntable_cameras([f"v{i}" for i in range(COUNT)], SIZE, 30, 0, 45)
    write_attempt(tmp_path / "wrong", Attempt("colmap", wrong))
    write_attempt(tmp_path / "none", Attempt("calibrate", None, refusal="no turntable"))
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    attempts = [tmp_path / "none", tmp_path / "wrong", results / "cameras"]
    call(scene, **pictures, cameras=attempts, output=tmp_path / "scene")
    assert json.loads((tmp_path / "scene" / "scene.json").read_text())["cameras"] == "file"


def test_a_lens_is_taken_away_in_the_scene(results, tmp_path):
    straight = read_cameras(results / "cameras" / "cameras.json")
    lens = Lens("OPENCV", (0, 0, 0.3, -0.25))
    pictures = {name: tmp_path / name for name in ("views", "silhouettes")}
    for name, folder in pictures.items():
        shutil.copytree(results / name, folder)
        for view, K in zip(straight.views, straight.K, strict=True):
            bend(results / name / f"{view}.png", folder / f"{view}.png", K, lens)
    write_attempt(tmp_path / "cameras", Attempt("file", behind_lenses(straight, [lens] * COUNT)))
    call(scene, **pictures, cameras=tmp_path / "cameras", output=tmp_path / "scene")
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert told["undistorted"] == COUNT
    assert told["displacement"] > 2
    kept = read_cameras(tmp_path / "scene" / "cameras.json")
    assert kept.lenses == (None,) * COUNT
    expected = read_silhouettes(results / "silhouettes", kept.views)
    agreement = []
    for folder in (tmp_path / "silhouettes", tmp_path / "scene" / "silhouettes"):
        seen = read_silhouettes(folder, kept.views)
        agreement.append((seen & expected).sum() / (seen | expected).sum())
    assert agreement[0] < 0.93
    assert agreement[1] > 0.94
    shown = [bright(folder / "views" / "v1.png") for folder in (tmp_path, tmp_path / "scene")]
    agreement = [(s & seen[1]).sum() / (s | seen[1]).sum() for s in shown]
    assert agreement[0] < 0.88
    assert agreement[1] > 0.92  # of 189 pixels the edge's are resampled three times


def bright(path):
    """What is at least half as bright in a picture as it gets."""
    pixels = np.asarray(Image.open(path).convert("L"))
    return pixels > pixels.max() / 2


def bend(old, new, K, lens):
    """What the pinhole's picture is behind a lens: each pixel from where it looks."""
    K = K.numpy()
    pixels = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), axis=-1) + 0.5
    at = lens.undistort((pixels - K[:2, 2]) / K[[0, 1], [0, 1]]) * K[[0, 1], [0, 1]] + K[:2, 2]
    at = np.nan_to_num(at.clip(0, SIZE - 1)).astype(int)  # NaN where the lens does not look
    save(new, np.asarray(Image.open(old))[at[..., 1], at[..., 0]])


def test_a_file_that_lacks_views_says_so(results, tmp_path, capsys):
    given = read_cameras(results / "cameras" / "cameras.json")
    write_cameras(tmp_path / "c.json", given.select(range(5)))
    call(cameras_step, views=results / "views", file=tmp_path / "c.json", output=tmp_path / "c")
    attempt = read_attempt(tmp_path / "c")
    assert attempt.cameras.views == given.views[:5]
    assert set(attempt.dropped) == {"v5", "v6", "v7"}
    said = capsys.readouterr().err
    assert said == f"silmesh: {attempt.warnings[0]}\n"
    assert "c.json: 3 of 8 photographs have no camera" in said


def test_a_refusal_is_told_when_there_is_no_other_attempt(results, tmp_path):
    write_attempt(tmp_path / "none", Attempt("calibrate", None, refusal="no turntable fits"))
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    with pytest.raises(InputError, match=r"^no turntable fits$"):
        call(scene, **pictures, cameras=tmp_path / "none", output=tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_all_reasons_are_told_when_every_attempt_fails(results, tmp_path):
    write_attempt(tmp_path / "a", Attempt("colmap", None, refusal="no texture"))
    still = turntable(COUNT, SIZE).select([0] * COUNT)
    names = tuple(f"v{i}" for i in range(COUNT))
    write_attempt(tmp_path / "b", Attempt("calibrate", replace(still, views=names)))
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    with pytest.raises(InputError, match=r"no texture\n  .*/b: (the cameras|view 'v0':)"):
        call(scene, **pictures, cameras=[tmp_path / "a", tmp_path / "b"], output=tmp_path / "s")


def test_reasons_that_differ_in_figures_alone_are_told_once(results, tmp_path):
    reasons = {"a": "4 pairs fit", "b": "no turntable", "c": "9 pairs fit"}
    for name, reason in reasons.items():
        write_attempt(tmp_path / name, Attempt("colmap", None, refusal=reason))
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    cameras = [tmp_path / name for name in reasons]
    with pytest.raises(InputError, match=r"found:\n  9 pairs fit\n  no turntable$"):
        call(scene, **pictures, cameras=cameras, output=tmp_path / "s")


def test_why_an_attempt_is_taken_is_told(results, tmp_path, capsys):
    write_attempt(tmp_path / "none", Attempt("colmap", None, refusal="no texture"))
    pictures = {"views": results / "views", "silhouettes": results / "silhouettes"}
    call(
        scene,
        **pictures,
        cameras=[tmp_path / "none", results / "cameras"],
        output=tmp_path / "scene",
    )
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert told["cameras_because"].startswith("file: hull IoU ")
    assert told["cameras_because"].endswith("colmap: no cameras (no texture)")
    assert [a["source"] for a in told["attempts"]] == ["colmap", "file"]
    assert "cameras from file are taken" in capsys.readouterr().out


def test_cameras_that_hardly_agree_are_told_of_before_the_fit(results, tmp_path, capsys):
    seen = results / "silhouettes"
    pictures = {"views": results / "views", "silhouettes": seen}
    call(scene, **pictures, cameras=results / "cameras", output=tmp_path / "own")
    assert capsys.readouterr().out == ""
    wrong = turntable_cameras([f"v{i}" for i in range(COUNT)], SIZE, 30, 0, 45)
    write_attempt(tmp_path / "wrong", Attempt("turntable", wrong))
    keep_world(results, tmp_path / "wrong", tmp_path / "s")
    said = capsys.readouterr().out
    assert said.startswith(f"warning: {seen} and {tmp_path / 'wrong'} hardly agree: hull IoU 0")


def test_a_truth_is_read_in_any_format(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    box.export(tmp_path / "truth.glb")
    call(truth, mesh=tmp_path / "truth.glb", output=tmp_path / "stages" / "truth.ply")
    read = read_mesh(tmp_path / "stages" / "truth.ply")
    np.testing.assert_allclose(read.extents, (1, 2, 3))
    assert len(read.faces) == 12


@pytest.fixture
def outlier(results, tmp_path):
    """A scene of which one view has an empty silhouette, and the arguments that judge it."""
    shutil.copytree(results / "silhouettes", tmp_path / "silhouettes")
    save(tmp_path / "silhouettes" / "v2.png", np.zeros((SIZE, SIZE, 4), np.uint8))
    pictures = {"views": results / "views", "silhouettes": tmp_path / "silhouettes"}
    call(scene, **pictures, cameras=results / "cameras", threads=1, output=tmp_path / "found")
    return {"scene": tmp_path / "found", "threads": 1, "output": tmp_path / "judged"}


def test_a_scene_in_which_nothing_is_doubtful_stays_as_it_is(results):
    for name in ("cameras.json", "silhouettes/v3.png", "views/v3.png"):
        assert (results / "scene" / name).read_bytes() == (results / "found" / name).read_bytes()
    told = json.loads((results / "scene" / "scene.json").read_text())
    assert told["weights"] == {f"v{i}": 1.0 for i in range(COUNT)}
    table = pd.read_csv(results / "scene" / "quality.csv")
    assert table["fate"].tolist() == ["kept"] * COUNT
    assert table["unexplained"].max() < 0.1


def test_a_dropped_view_leaves_the_scene_and_is_listed(outlier, capsys):
    call(judge, settings={"policy": "drop"}, **outlier)
    out = outlier["output"]
    told = json.loads((out / "scene.json").read_text())
    assert told["dropped"] == told["doubtful"] == {"v2": "empty"}
    left = [f"v{i}" for i in range(COUNT) if i != 2]
    assert list(told["weights"]) == left == list(read_cameras(out / "cameras.json").views)
    assert sorted(path.stem for path in (out / "silhouettes").iterdir()) == left
    assert (out / "originals" / "v2.png").is_file()
    table = pd.read_csv(out / "quality.csv", index_col="view")
    assert (table.loc["v2", "fate"], table.loc["v2", "weight"]) == ("dropped", 0)
    assert told["hull_iou_mean"] > 0.93
    assert "view 'v2' is dropped: empty" in capsys.readouterr().err


def test_a_repaired_view_is_fitted_and_its_original_kept(results, outlier):
    call(judge, settings={"policy": "repair"}, **outlier)
    told = json.loads((outlier["output"] / "scene.json").read_text())
    assert (told["repaired"], told["dropped"], told["weights"]["v2"]) == (["v2"], {}, 0.5)
    new, true = (
        read_silhouettes(folder, ["v2"])[0]
        for folder in (outlier["output"] / "silhouettes", results / "silhouettes")
    )
    # It is 14 pixels wide, and the hull of seven views shows one more all around.
    assert (new & true).sum() / (new | true).sum() > 0.8
    assert not read_silhouettes(outlier["output"] / "originals", ["v2"]).any()


def test_an_object_that_leaves_its_photograph_is_told_of(results, tmp_path, capsys):
    shutil.copytree(results / "found", tmp_path / "found")
    tall = np.zeros((SIZE, SIZE, 4), np.uint8)
    tall[4:20, 14:17] = 255  # from the photograph's upper edge on, below the padding
    save(tmp_path / "found/silhouettes/v5.png", tall)
    call(
        judge,
        scene=tmp_path / "found",
        settings={"policy": "keep"},
        threads=1,
        output=tmp_path / "judged",
    )
    told = capsys.readouterr().err
    assert "view 'v5': the object leaves the photograph (3 pixels on its edge)" in told
    assert told.count("leaves the photograph") == 1
    table = pd.read_csv(tmp_path / "judged/quality.csv", index_col="view")
    assert table["on_frame"].tolist() == [3 if i == 5 else 0 for i in range(COUNT)]


def test_silhouettes_that_the_photographs_contradict_are_listed(results, tmp_path):
    shutil.copytree(results / "found", tmp_path / "found")
    for name in ("v2", "v5"):
        file = tmp_path / "found/silhouettes" / f"{name}.png"
        save(file, np.roll(np.asarray(Image.open(file)), 8, axis=1))
    call(
        judge,
        scene=tmp_path / "found",
        settings={"policy": "keep"},
        threads=1,
        output=tmp_path / "judged",
    )
    for folder, expected in ((tmp_path / "judged", ["v2", "v5"]), (results / "scene", [])):
        assert json.loads((folder / "scene.json").read_text())["contradicted"] == expected
        table = pd.read_csv(folder / "quality.csv", index_col="view")
        assert table.index[(table["edges"] < 0.9) | (table["in_place"] < 0.9)].tolist() == expected


FAST = SETTINGS | {"preset": "fast", "learning_rate": 1, "smoothing": 4}
FAST |= {"weights": {"laplacian": 0.003, "flatten": 0.0003}}


def fit_weighed(results, folder, settings, weights=None, without=()):
    """Vertices fitted to the scene with a wrong silhouette of v2, which counts what is told."""
    shutil.copytree(results / "scene", folder)
    save(folder / "silhouettes" / "v2.png", np.full((SIZE, SIZE, 4), 255, np.uint8))
    cameras = read_cameras(folder / "cameras.json")
    left = [i for i, view in enumerate(cameras.views) if view not in without]
    write_cameras(folder / "cameras.json", cameras.select(left))
    told = json.loads((folder / "scene.json").read_text())
    del told["weights"]
    told |= {} if weights is None else {"weights": weights}
    (folder / "scene.json").write_text(json.dumps(told))
    outputs = {"meshes": folder / "m.ply", "cameras": folder / "c.json", "loss": folder / "l.csv"}
    outputs |= {"notes": folder / "fit.json"}
    told = settings | {"iterations": 6, "holdout": 0}
    told |= {"batch": 0, "judge_views": False} if told["preset"] == "fast" else {}
    call(fit, initial=results / "first.ply", scene=folder, settings=told, threads=1, **outputs)
    return read_mesh(folder / "m.ply").vertices


@pytest.mark.parametrize("settings", [SETTINGS, FAST], ids=["softras", "fast"])
def test_a_view_counts_in_the_fit_as_much_as_its_weight(results, tmp_path, settings):
    def fitted(name, *arguments):
        return fit_weighed(results, tmp_path / name, settings, *arguments)

    whole = {f"v{i}": 1.0 for i in range(COUNT)}
    plain = fitted("plain")
    np.testing.assert_array_equal(fitted("ones", whole), plain)
    without = fitted("without", None, ["v2"])
    np.testing.assert_array_equal(fitted("none", whole | {"v2": 0.0}), without)
    far = [np.abs(fitted(str(w), whole | {"v2": w}) - without).max() for w in (0.01, 0.5)]
    assert 0 < far[0] < far[1] < np.abs(plain - without).max()


def test_an_empty_silhouette_is_in_nothing_that_is_fitted_or_measured(results, tmp_path):
    """A policy that keeps views fits the scene as it was found, beside its judging."""
    shutil.copytree(results / "found", tmp_path / "found")
    save(tmp_path / "found" / "silhouettes" / "v2.png", np.zeros((SIZE, SIZE, 4), np.uint8))
    found, judged = {"scene": tmp_path / "found"}, tmp_path / "judged"
    call(judge, **found, settings={"policy": "keep"}, threads=1, output=judged)
    made = {"output": tmp_path / "first.ply", "report": tmp_path / "init.json"}
    call(initial, **found, settings={"shape": "hull", "vertices": 162}, **made)
    outputs = {"cameras": tmp_path / "c.json", "loss": tmp_path / "l.csv"}
    outputs |= {"notes": tmp_path / "fit.json"}
    told = FAST | {"iterations": 3, "holdout": 0}
    mesh = tmp_path / "m.ply"
    call(fit, initial=made["output"], **found, settings=told, threads=1, meshes=mesh, **outputs)
    told = {"initial": made["report"], "settings": told, "results": tmp_path}
    measured = tmp_path / "metrics.json"
    call(evaluate, mesh=mesh, scene=judged, **outputs, **told, threads=1, output=measured)
    left = [f"v{i}" for i in range(COUNT) if i != 2]
    assert list(read_cameras(outputs["cameras"]).views) == left
    metrics = json.loads(measured.read_text())
    assert list(metrics["iou"]) == left
    assert metrics["iou_min"] > 0.8


def test_too_few_views_are_refused(outlier):
    with pytest.raises(InputError, match=r"found: only 7 views are left, and quality\.fewest is 8"):
        call(judge, settings={"policy": "drop", "fewest": 8}, **outlier)


def test_a_world_is_kept_if_asked(results, tmp_path):
    write_attempt(tmp_path / "c", Attempt("turntable", turntable(COUNT, SIZE)))
    keep_world(results, tmp_path / "c", tmp_path / "scene")
    kept = read_cameras(tmp_path / "scene" / "cameras.json")
    assert torch.equal(kept.t, turntable(COUNT, SIZE).t)


def test_a_camera_inside_the_object_is_named_with_its_file(results, tmp_path):
    shutil.copytree(results / "silhouettes", tmp_path / "silhouettes")
    save(tmp_path / "silhouettes" / "v0.png", np.full((SIZE, SIZE, 4), 255, np.uint8))
    given = turntable(COUNT, SIZE, elevation=20)
    t = given.t.clone()
    t[0] *= 0.05  # into the middle of the object, which fills what it sees
    write_attempt(tmp_path / "near", Attempt("turntable", replace(given, t=t)))
    argv = ["--views", results / "views", "--silhouettes", tmp_path / "silhouettes"]
    argv += ["--cameras", tmp_path / "near", "--output", tmp_path / "scene"]
    for world in ([], ["--keep-world"]):
        with pytest.raises(InputError, match=r"near: the camera of view 'v0' stands inside"):
            scene.main([*map(str, argv), *world])
        assert not (tmp_path / "scene").exists()


def test_a_camera_near_a_small_object_is_not_inside_it(results, tmp_path):
    near = turntable(COUNT, SIZE, 20).in_world_of(Similarity(torch.zeros(3), 0.1))
    write_attempt(tmp_path / "near", Attempt("turntable", near))  # 0.27 from one of radius 0.05
    keep_world(results, tmp_path / "near", tmp_path / "scene")
    told = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert told["hull_iou_mean"] > 0.9


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_an_input_error(results, tmp_path):
    with pytest.raises(InputError, match="no GPU"):
        call(
            fit,
            initial=results / "first.ply",
            scene=results / "scene",
            settings=SETTINGS | {"device": "cuda"},
            meshes=[tmp_path / "m.ply"],
            cameras=tmp_path / "c.json",
            loss=tmp_path / "l.csv",
            notes=tmp_path / "fit.json",
        )
    assert list(tmp_path.iterdir()) == []


def test_an_input_error_is_shown_without_a_traceback(capsys):
    def main(argv):
        raise InputError("a.png: is not there")

    with pytest.raises(SystemExit) as stop:
        run(main)
    assert stop.value.code == 1
    assert capsys.readouterr().err == "silmesh: a.png: is not there\n"


def test_a_full_disk_is_told_of_without_a_traceback(tmp_path, capsys):
    def main(argv):
        with replacing(tmp_path / "out") as part:
            part.write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(SystemExit):
        run(main)
    assert capsys.readouterr().err == f"silmesh: {tmp_path / 'out'}: No space left on device\n"
    assert list(tmp_path.iterdir()) == []


def test_another_error_keeps_its_traceback(tmp_path):
    def main(argv):
        with replacing(tmp_path / "out") as part:
            part.write_text("half")
            raise KeyError("ours")

    with pytest.raises(KeyError):
        run(main)
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_is_no_success_and_shows_no_traceback(capsys):
    def stopped(argv):
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as ended:
        run(stopped)
    assert ended.value.code == 130
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("silmesh: interrupted in ")
    assert "test_steps.py, line " in said
