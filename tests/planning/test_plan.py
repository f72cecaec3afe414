"""What is run: every object with every variant, and which stages variants share."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from silmesh.errors import InputError
from silmesh.planning.plan import Plan

HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\tvariants\n"
STAGES = ("views", "silhouettes", "cameras", "scene", "initial")


@pytest.fixture
def plan(tmp_path: Path, monkeypatch):
    """The plan for some variants, of a cup and a jug, or of other rows."""
    monkeypatch.chdir(tmp_path)
    for folder in ("photos", "masks"):
        Path(folder).mkdir()
        for i in range(2):
            Image.new("L", (4, 4)).save(f"{folder}/{i}.png")
    Path("camera.npy").touch()
    Path("cameras.json").touch()
    Path("cup.pt").touch()
    np.save("source.npy", np.zeros((2, 4, 4, 4), np.uint8))

    def of(variants: str, *rows: str, views: str = "{}", more: str = "") -> Plan:
        rows = rows or ("cup\tphotos\tmasks\tmask\tturntable\t2.7,0,5\t",)
        Path("list.tsv").write_text(HEADER + "\n".join(rows) + "\n")
        text = f"datasets: list.tsv\nviews: {views}\nvariants: {{{variants}}}\n{more}"
        return Plan(yaml.safe_load(text), "my.yaml")

    return of


def keys(plan: Plan, variant: str) -> dict[str, str]:
    run = plan.run("cup", variant)
    return {
        stage: run.cameras_keys[0] if stage == "cameras" else getattr(run, f"{stage}_key")
        for stage in STAGES
    }


def test_a_runs_stages_are_named_by_what_they_depend_on(plan):
    assert keys(plan("a: {init: {vertices: 642, align: none}}"), "a") == {
        "views": "256-pad",
        "silhouettes": "256-pad-mask",
        "cameras": "256-pad-turntable",
        "scene": "256-pad-mask-turntable",
        "initial": "256-pad-mask-turntable-keep-3-sphere-642-none",
    }


def matched(plan: Plan, kind: str, wanted: bool, names: str = "abcx") -> list[str]:
    """Which of some variants' folders a rule for those of a kind, or for all others, makes."""
    return [v for v in names if re.match(f"({plan.variants(kind, wanted)})/mesh", f"{v}/mesh")]


def test_a_variant_has_a_texture_as_it_or_the_run_says(plan):
    made = plan("a: {}, b: {texture: {size: 0}}, c: {texture: {size: 512}}")
    assert [matched(made, "textured", w) for w in (True, False)] == [["c"], ["a", "b", "x"]]
    made = plan("a: {}, b: {texture: {size: 0}}", more="texture: {size: auto}")
    assert [matched(made, "textured", w) for w in (True, False)] == [["a"], ["b", "c", "x"]]
    assert matched(plan("a: {}"), "textured", True) == []


def test_photographs_have_a_say_where_a_variant_says_so(plan):
    made = plan("a: {}, b: {fit: {preset: fast, photometric: auto}}")
    assert [matched(made, "photometric", w) for w in (True, False)] == [["b"], ["a", "c", "x"]]


@pytest.mark.parametrize("size", [63, 8193, "large", "true", -1])
def test_a_texture_of_no_possible_size_is_refused(plan, size):
    with pytest.raises(
        InputError, match=r"texture\.size: should be 'auto' or 0 or a whole number "
    ):
        plan("a: {}", more=f"texture: {{size: {size}}}")


def test_a_view_may_be_spared_where_no_run_keeps_all(plan):
    drop = "a: {quality: {policy: drop}}, b: {quality: {policy: repair, fewest: 9}}"
    lenient = plan(drop)
    assert lenient.fewest_photographs("cup", "256-pad") == 3
    assert lenient.spares("cup", "256-pad-mask")
    mixed = plan(f"{drop}, c: , d: {{silhouettes: threshold, views: {{size: 64}}}}")
    assert mixed.fewest_photographs("cup", "256-pad") is None  # c takes the masks as they are
    assert not mixed.spares("cup", "256-pad-mask")
    assert mixed.fewest_photographs("cup", "64-pad") == 3


@pytest.mark.parametrize(
    ("init", "name"),
    [
        ("{shape: hull}", "hull-auto-bbox"),
        ("{shape: hull, genus: sphere}", "hull-auto-bbox-closed"),
        ("{shape: cube, genus: sphere, vertices: 900}", "cube-900-bbox"),  # it has no tunnels
        ("{shape: auto}", "auto-auto-bbox"),  # chosen by a few steps of softras, whatever the fit
    ],
)
def test_a_initial_mesh_is_named_by_what_it_depends_on(plan, init, name):
    made = plan(f"a: {{init: {init}, fit: {{learning_rate: 0.5}}}}")
    assert keys(made, "a")["initial"] == f"256-pad-mask-turntable-keep-3-{name}"


@pytest.mark.parametrize(
    ("other", "differing"),
    [
        ("fit: {learning_rate: 1, iterations: 3}", ""),
        ("init: {vertices: 642}", "initial"),
        ("init: {align: none}", "initial"),
        ("silhouettes: alpha", "silhouettes scene initial"),
        ("cameras: file:camera.npy", "cameras scene initial"),
        ("cameras: calibrate", "cameras scene initial"),
        ("views: {size: 32}", "views silhouettes cameras scene initial"),
        ("views: {resize: stretch}", "views silhouettes cameras scene initial"),
        ("views: {size: 256, resize: pad}, silhouettes: mask, cameras: turntable", ""),
    ],
)
def test_variants_share_the_stages_that_they_agree_on(plan, other, differing):
    found = plan(f"a: {{}}, b: {{{other}}}")
    a, b = keys(found, "a"), keys(found, "b")
    assert {stage for stage in STAGES if a[stage] != b[stage]} == set(differing.split())


def test_a_variant_overrides_a_part_of_the_views(plan):
    found = plan("a: {views: {size: 32}}, b: {views: {resize: pad}}", views="{resize: stretch}")
    assert [run.views_key for run in found.runs] == ["32-stretch", "256-pad"]


def test_a_variant_overrides_the_row(plan):
    a, b = plan("a: {}, b: {silhouettes: threshold, cameras: file:camera.npy}").runs
    assert (len(a.masks), a.camera_file, a.turntable.step) == (2, None, 5)
    assert (b.masks, b.camera_file, b.turntable) == ((), Path("camera.npy"), None)


def test_found_cameras_are_named_by_their_silhouettes_too(plan):
    found = plan("a: {cameras: calibrate}, b: {cameras: calibrate, silhouettes: alpha}")
    a, b = found.runs
    assert a.cameras_keys == ("256-pad-mask-calibrate",)
    assert b.cameras_keys == ("256-pad-alpha-calibrate",)
    assert (a.scene_key, a.keeps_world) == ("256-pad-mask-calibrate", False)
    assert (a.turntable.elevation, a.turntable.step) == (0, 5)
    assert found.with_key("cup", "cameras", b.cameras_keys[0]) == b


def test_cameras_that_may_look_up_have_a_name_of_their_own(plan):
    found = plan(
        "a: {cameras: calibrate}, b: {cameras: calibrate, calibrate: {above_table: false}}"
    )
    a, b = found.runs
    assert (a.settings.calibrate.above_table, b.settings.calibrate.above_table) == (True, False)
    assert b.cameras_keys == ("256-pad-mask-calibrate_anywhere",)
    assert a.scene_key != b.scene_key == "256-pad-mask-calibrate_anywhere"
    assert found.with_key("cup", "cameras", b.cameras_keys[0]) == b


def test_colmaps_attempts_share_the_stages_that_they_agree_on(plan):
    a, b, c, d = plan(
        "a: {cameras: colmap}, b: {cameras: auto}, "
        "c: {cameras: colmap, colmap: {masks: silhouettes, mapping: global}}, "
        "d: {cameras: colmap, colmap: {seed: 1, matching: sequential}, views: {size: 32}}"
    ).runs
    assert (a.features_key, a.matches_key) == ("1600-4096", "1600-4096-exhaustive-0")
    assert a.model_key == "1600-4096-exhaustive-0-incremental"
    masked, fallback = a.cameras_keys
    assert masked.startswith("256-pad-mask-colmap_masked_")
    assert fallback.startswith("256-pad-mask-colmap_fallback_")
    assert b.cameras_keys[:2] == (masked, fallback)
    assert b.cameras_keys[2].startswith("256-pad-mask-calibrate-after-")
    assert b.sparing == b.folders("cameras")[:2]
    assert a.sparing == []
    assert len({a.scene_key, b.scene_key, c.scene_key}) == 3
    assert (c.matches_key, c.model_key) == (a.matches_key, "1600-4096-exhaustive-0-global")
    assert len(c.cameras_keys) == 1
    assert c.cameras_keys[0].startswith("256-pad-mask-colmap_masked_")
    assert (d.features_key, d.matches_key) == (a.features_key, "1600-4096-sequential-1")


def test_silhouettes_are_asked_for_cameras_after_colmap_unless_always(plan):
    after, always, alone = plan(
        "a: {cameras: auto}, b: {cameras: auto, calibrate: {always: true}}, c: {cameras: calibrate}"
    ).runs
    assert always.cameras_keys[2:] == alone.cameras_keys == ("256-pad-mask-calibrate",)
    assert always.sparing == []
    assert after.cameras_keys[:2] == always.cameras_keys[:2]
    assert after.scene_key != always.scene_key


def test_the_runs_colmap_section_is_overridden_in_part(plan):
    a, b = plan("a: {cameras: colmap}, b: {cameras: colmap, colmap: {seed: 3}}").runs
    assert (a.settings.colmap.seed, b.settings.colmap.seed, b.settings.colmap.features) == (
        0,
        3,
        4096,
    )


def test_a_networks_settings_name_its_silhouettes(plan):
    found = plan(
        "a: {silhouettes: deeplab}, b: {silhouettes: deeplab, deeplab: {size: auto}},"
        "c: {silhouettes: deeplab, deeplab: {weights: cup.pt}},"
        "d: {silhouettes: deeplab, deeplab: {classes: dominant}}, e: {deeplab: {size: 64}}",
    )
    runs = {run.variant: run for run in found.runs}
    names = {variant: run.silhouettes_key for variant, run in runs.items()}
    assert names["a"] == names["b"]
    assert len(set(names.values())) == 4
    assert names["e"] == "256-pad-mask"
    assert re.fullmatch(r"256-pad-deeplab_[0-9a-f]{8}", names["c"])
    assert runs["c"].weights_file == Path("cup.pt")
    assert runs["a"].weights_file is None


def test_weights_that_the_run_trains_need_not_be_there(plan):
    learnt = "a: {silhouettes: deeplab, deeplab: {weights: results/train/weights.pt}}"
    row = "{}\tphotos\tmasks\tmask\tturntable\t2.7,0,5\t"
    rows = row.format("cup"), row.format("jug"), "pot\tphotos\t\talpha\tturntable\t2.7,0,5\t"
    found = plan(learnt, *rows, more="train: {holdout: [jug]}")
    assert [dataset.object for dataset in found.trained_on] == ["cup", "jug"]
    assert plan("a: {}").trained_on == []
    with pytest.raises(InputError, match=r"variants.a.deeplab.weights: results/.* is not there"):
        plan(learnt)


@pytest.mark.parametrize(
    ("train", "message"),
    [
        ("holdout: [pot]", "train.holdout: 'pot' is no object with masks of list.tsv, .* cup"),
        ("holdout: [cup]", "train.holdout: leaves no object"),
        ("holdout: [cup], weights: a.pt", "train.holdout: leaves no object"),
    ],
)
def test_training_needs_objects_of_both_kinds(plan, train, message):
    with pytest.raises(InputError, match=f"^my.yaml: {message}"):
        plan("a: {}", more=f"train: {{{train}}}")


def test_two_camera_files_have_two_names(plan):
    found = plan("a: {cameras: 'file:camera.npy'}, b: {cameras: 'file:cameras.json'}")
    a, b = found.runs
    assert a.cameras_keys != b.cameras_keys
    assert (a.keeps_world, b.keeps_world) == (True, False)
    assert found.with_key("cup", "cameras", b.cameras_keys[0]) == b


def test_a_row_names_its_variants(plan):
    rows = [f"{name}\tphotos\tmasks\tmask\tturntable\t2.7,0,5\t{v}" for name, v in
            (("cup", ""), ("jug", "b"), ("pot", "b,a"))]  # fmt: skip
    runs = plan("a: {}, b: {}", *rows).runs
    assert [(run.dataset.object, run.variant) for run in runs] == [
        ("cup", "a"),
        ("cup", "b"),
        ("jug", "b"),
        ("pot", "b"),
        ("pot", "a"),
    ]


@pytest.mark.parametrize(
    ("variants", "row", "message"),
    [
        (
            "a: {}",
            "cup\tphotos\tmasks\tmask\tturntable\t2.7,0,5\tb",
            "list.tsv, line 2 (cup): variants: 'b' is not in my.yaml, which has a",
        ),
        (
            "a: {}",
            "cup\tphotos\t\tmask\tturntable\t2.7,0,5\t",
            "list.tsv, line 2 (cup): silhouettes are 'mask' (variant 'a'), but masks is empty",
        ),
        (
            "a: {silhouettes: alpha}, b: {silhouettes: mask}",
            "cup\tphotos\t\talpha\tturntable\t2.7,0,5\t",
            "list.tsv, line 2 (cup): silhouettes are 'mask' (variant 'b'), but masks is empty",
        ),
        (
            "a: {}",
            "cup\tsource.npy\t\tmask\tturntable\t2.7,0,5\t",
            "list.tsv, line 2 (cup): silhouettes are 'mask' (variant 'a'), but an array of images",
        ),
        (
            "a: {}",
            "cup\tphotos\tmasks\tmask\tturntable\t\t",
            "list.tsv, line 2 (cup): cameras are 'turntable' (variant 'a'), but turntable is empty",
        ),
        (
            "a: {cameras: calibrate}, b: {}",
            "cup\tphotos\tmasks\tmask\tturntable\t,,5\t",
            "list.tsv, line 2 (cup): cameras are 'turntable' (variant 'b'), but turntable is empty",
        ),
        (
            "a: {cameras: 'file:no.npy'}",
            "cup\tphotos\tmasks\tmask\tturntable\t2.7,0,5\t",
            "my.yaml: variants.a.cameras: no.npy: is not there",
        ),
    ],
)
def test_what_a_variant_needs_is_there(plan, variants, row, message):
    with pytest.raises(InputError) as caught:
        plan(variants, row)
    assert str(caught.value).startswith(message)


def test_what_no_variant_needs_may_be_missing(plan):
    found = plan("a: {cameras: 'file:camera.npy'}", "cup\tphotos\t\talpha\tturntable\t\t")
    assert found.runs[0].masks == ()


def test_what_is_not_planned_is_not_found(plan):
    found = plan("a: {}")
    with pytest.raises(InputError, match="no variant of the configuration makes this"):
        found.run("cup", "b")
    with pytest.raises(InputError, match="object 'jug': no variant"):
        found.with_key("jug", "views", "256-pad")


@pytest.mark.parametrize(
    ("cameras", "estimated"),
    [("turntable", False), ("file:cameras.json", False), ("calibrate", True)],
)
def test_estimated_cameras_have_a_frame_of_their_own(plan, cameras, estimated):
    found = plan("a: {}", f"cup\tphotos\tmasks\tmask\t{cameras}\t2.7,0,5\t")
    assert found.run("cup", "a").estimates_cameras == estimated


def test_wildcards_match_just_what_the_stages_are_called(plan):
    found = plan("a: {}, b: {views: {size: 64}, cameras: colmap}").constraints()
    assert found["views"] == r"256\-pad|64\-pad"
    assert found["cameras"] == "turntable"
    assert all(re.fullmatch(found["masks"], masks) for masks in ("masked", "fallback"))
    assert not re.fullmatch(found["calibration"], "calibrate")
    assert not re.fullmatch(found["scene"], "64-pad-mask-turntable")


@pytest.mark.parametrize(
    ("cameras", "said"),
    [
        ("calibrate", []),
        ("auto", []),
        ("colmap", ["sets are not used by cameras 'colmap', whose features tell them apart"]),
        ("file:cameras.json", ["has the cameras of all photographs in one world"]),
    ],
)
def test_a_line_says_where_sets_are_not_used(in_sets, cameras, said):
    notes = in_sets(cameras).runs[0].notes
    assert len(notes) == len(said)
    assert all(
        line in note and "list.tsv, line 2 (cup)" in note
        for line, note in zip(said, notes, strict=True)
    )


def test_sets_and_one_known_turn_are_refused(in_sets):
    with pytest.raises(InputError, match="are of one turn, and sets are of several"):
        in_sets("turntable")


@pytest.fixture
def in_sets(tmp_path: Path, monkeypatch):
    """The plan of a cup in two sets with some cameras."""
    monkeypatch.chdir(tmp_path)
    Path("photos").mkdir()
    Path("cameras.json").touch()
    for name in ("down", "up"):
        for i in range(5):
            Image.new("L", (4, 4)).save(f"photos/{name}_{i}.png")

    def of(cameras: str) -> Plan:
        row = f"cup\tphotos\tthreshold\t{cameras}\t2.7,0,5\tup_*;down_*"
        Path("list.tsv").write_text(
            f"object\timages\tsilhouettes\tcameras\tturntable\tsets\n{row}\n"
        )
        return Plan(yaml.safe_load("datasets: list.tsv\nvariants: {a: {}}"), "my.yaml")

    return of


def test_an_initial_mesh_of_ones_own_is_read_and_told_from_others(plan):
    Path("ball.ply").touch()
    Path("egg.ply").touch()
    made = plan("a: {init: {shape: 'file:ball.ply'}}, b: {init: {shape: 'file:egg.ply'}}")
    first, second = (made.run("cup", name) for name in "ab")
    assert first.initial_key != second.initial_key
    assert [run.initial_own for run in (first, second)] == [[Path("ball.ply")], [Path("egg.ply")]]


def test_an_initial_mesh_that_is_not_there_is_refused(plan):
    with pytest.raises(InputError, match=r"variants.a.init.shape: gone.ply: is not there"):
        plan("a: {init: {shape: 'file:gone.ply'}}")
