"""What is run: every object with every variant, and which stages variants share."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from silmesh.errors import InputError
from silmesh.plan import Plan

HEADER = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\tvariants\n"
STAGES = ("views", "silhouettes", "cameras", "scene", "first")


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
    np.save("source.npy", np.zeros((2, 4, 4, 4), np.uint8))

    def of(variants: str, *rows: str, views: str = "{}") -> Plan:
        rows = rows or ("cup\tphotos\tmasks\tmask\tturntable\t2.7,0,5\t",)
        Path("list.tsv").write_text(HEADER + "\n".join(rows) + "\n")
        text = f"datasets: list.tsv\nviews: {views}\nvariants: {{{variants}}}"
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
        "first": "256-pad-mask-turntable-keep-3-sphere-642-none",
    }


@pytest.mark.parametrize(
    ("other", "differing"),
    [
        ("fit: {learning_rate: 1, iterations: 3}", ""),
        ("init: {vertices: 642}", "first"),
        ("init: {align: none}", "first"),
        ("silhouettes: alpha", "silhouettes scene first"),
        ("cameras: file:camera.npy", "cameras scene first"),
        ("cameras: calibrate", "cameras scene first"),
        ("views: {size: 32}", "views silhouettes cameras scene first"),
        ("views: {resize: stretch}", "views silhouettes cameras scene first"),
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
    assert found.with_cameras("cup", b.cameras_keys[0]) == b


def test_two_camera_files_have_two_names(plan):
    found = plan("a: {cameras: 'file:camera.npy'}, b: {cameras: 'file:cameras.json'}")
    a, b = found.runs
    assert a.cameras_keys != b.cameras_keys
    assert (a.keeps_world, b.keeps_world) == (True, False)
    assert found.with_cameras("cup", b.cameras_keys[0]) == b


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
