"""A wrong configuration is refused in a line that says what is right; a right one is filled in."""

from pathlib import Path

import pytest
import yaml

from silmesh.errors import InputError
from silmesh.planning.config import parse_config
from silmesh.settings.views import Views


def parse(text: str):
    return parse_config(yaml.safe_load(text) or {}, "my.yaml")


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse(text)
    return str(caught.value)


def in_variant(text: str) -> str:
    return f"datasets: t.tsv\nvariants: {{a: {{{text}}}}}\n"


def test_defaults():
    config = parse("datasets: t.tsv\nvariants: {a: {}}")
    fit, init = config.variants["a"].fit, config.variants["a"].init
    assert config.datasets == Path("t.tsv")
    assert config.views == Views(size=256, resize="pad")
    assert (fit.preset, fit.iterations, fit.learning_rate) == ("fast", 600, 0.5)
    assert (fit.betas, fit.sigma, fit.holdout) == ((0.9, 0.999), "auto", 0)
    assert (fit.weights.laplacian, fit.weights.flatten) == (0.1, 0.00005)
    assert (init.shape, init.vertices, init.align) == ("sphere", "auto", "bbox")
    assert config.variants["a"].silhouettes is None
    assert config.variants["a"].views == config.views


def test_the_designs_example_is_right():
    config = parse(
        "datasets: config/datasets.tsv\n"
        "views: {size: 256, resize: pad}\n"
        "variants:\n"
        "  uninitialised:\n"
        "    init: {shape: sphere, vertices: 1352, align: none}\n"
        "    fit: {preset: softras, iterations: 2000}\n"
        "  other:\n"
        "    silhouettes: alpha\n"
        "    cameras: file:cameras.json\n"
        "    views: {size: 128}\n"
        "    fit: {learning_rate: 1e-3, weights: {laplacian: 0}}\n"
    )
    assert list(config.variants) == ["uninitialised", "other"]
    assert config.variants["uninitialised"].init.vertices == 1352
    assert config.variants["other"].fit.learning_rate == 0.001  # YAML reads 1e-3 as a string
    assert config.variants["other"].fit.weights.flatten == 0.00005


@pytest.mark.parametrize(
    "text",
    [
        "datasets: t\nviews:\nvariants:\n  a:\n",
        "datasets: t\nvariants:\n  a:\n    init:\n    fit:\n    views:\n",
        "datasets: t\nvariants:\n  a:\n    fit:\n      weights:\n    silhouettes:\n    cameras:\n",
    ],
)
def test_an_empty_section_stands_for_all_defaults(text):
    assert parse(text) == parse("datasets: t\nvariants: {a: {}}")


def test_a_variants_section_is_laid_over_the_runs():
    config = parse(
        "datasets: t\nviews: {size: 64}\ncolmap: {seed: 3}\n"
        "variants: {7: {views: {resize: stretch}, colmap: {masks: none, features: }}, b: }"
    )
    a, b = config.variants["7"], config.variants["b"]
    assert a.views == Views(size=64, resize="stretch")
    assert (a.colmap.seed, a.colmap.masks, a.colmap.features) == (3, "none", 4096)
    assert (b.views, b.colmap) == (config.views, config.colmap)


def test_a_wrong_value_of_the_run_is_told_once():
    assert refusal("datasets: t\nviews: {size: 8}\nvariants: {7: {views: {resize: pad}}, b: }") == (
        "my.yaml: views.size: should be a whole number from 16 to 4,096, not 8"
    )
    both = refusal("datasets: t\nviews: {size: 8}\nvariants: {7: {views: {size: 9}}}")
    assert both.splitlines()[1].startswith("my.yaml: variants.7.views.size: should be ")


def test_a_variant_may_be_named_by_a_number():
    assert list(parse("datasets: t\nvariants: {600: {}, 1300: {}}").variants) == ["600", "1300"]


@pytest.mark.parametrize(
    ("text", "key", "meant"),
    [
        ("datasets: t\nvaraints: {a: {}}", "varaints", "variants"),
        ("datasets: t\nvariants: {a: {}}\nveiws: {}", "veiws", "views"),
        ("datasets: t\nvariants: {a: {}}\nviews: {sise: 32}", "views.sise", "size"),
        (in_variant("silhouette: mask"), "variants.a.silhouette", "silhouettes"),
        (in_variant("views: {resise: pad}"), "variants.a.views.resise", "resize"),
        (in_variant("init: {vertexes: 12}"), "variants.a.init.vertexes", "vertices"),
        (in_variant("fit: {learning-rate: 1}"), "variants.a.fit.learning-rate", "learning_rate"),
        (in_variant("fit: {lr: 1}"), "variants.a.fit.lr", None),
        (
            in_variant("fit: {weights: {laplacain: 1}}"),
            "variants.a.fit.weights.laplacain",
            "laplacian",
        ),
    ],
)
def test_an_unknown_key_names_the_nearest_known_one(text, key, meant):
    message = refusal(text)
    assert message.startswith(f"my.yaml: {key}: unknown key; ")
    assert (f"did you mean {meant!r}?" in message) == (meant is not None)
    assert "known are " in message
    assert "\n" not in message


def test_every_unknown_key_has_its_line():
    lines = refusal(in_variant("fit: {sigmma: 1, iteration: 2}, innit: {}")).splitlines()
    keys = {line.split(": ")[1] for line in lines}
    assert keys == {"variants.a.fit.sigmma", "variants.a.fit.iteration", "variants.a.innit"}


@pytest.mark.parametrize(
    ("text", "key", "right", "value"),
    [
        ("init: {vertices: many}", "init.vertices", "12 to 200,000 or 'auto'", "'many'"),
        ("init: {vertices: 11}", "init.vertices", "12 to 200,000 or 'auto'", "11"),
        ("init: {vertices: 12.5}", "init.vertices", "a whole number", "12.5"),
        ("init: {shape: cone}", "init.shape", "'sphere'", "'cone'"),
        ("calibrate: {above_table: 1}", "calibrate.above_table", "true or false", "1"),
        ("init: {align: yes}", "init.align", "'none' or 'bbox'", "True"),
        ("init: 3", "init", "keys of shape, vertices, align", "3"),
        ("fit: {iterations: 0}", "fit.iterations", "from 1 to 1,000,000", "0"),
        ("fit: {iterations: ten}", "fit.iterations", "a whole number", "'ten'"),
        ("fit: {iterations: 2.5}", "fit.iterations", "a whole number", "2.5"),
        ("fit: {iterations: yes}", "fit.iterations", "a whole number", "True"),
        ("fit: {iterations: }", "fit.iterations", "a whole number", "empty"),
        ("fit: {learning_rate: 0}", "fit.learning_rate", "a number above 0", "0"),
        ("fit: {learning_rate: fast}", "fit.learning_rate", "a number above 0", "'fast'"),
        ("fit: {betas: [1, 2, 3]}", "fit.betas", "two numbers", "[1, 2, 3]"),
        ("fit: {betas: [0.5]}", "fit.betas", "two numbers", "[0.5]"),
        ("fit: {betas: 0.5}", "fit.betas", "two numbers", "0.5"),
        ("fit: {betas: [0.5, 1.0]}", "fit.betas", "below 1", "[0.5, 1.0]"),
        ("fit: {betas: [.nan, 0.9]}", "fit.betas", "two numbers", "[nan, 0.9]"),
        ("fit: {sigma: 0}", "fit.sigma", "a number above 0", "0"),
        ("fit: {sigma: .nan}", "fit.sigma", "a number above 0", "nan"),
        ("fit: {sigma: .inf}", "fit.sigma", "a number above 0", "inf"),
        ("fit: {weights: {laplacian: -1}}", "fit.weights.laplacian", "0 or above", "-1"),
        ("fit: {weights: 3}", "fit.weights", "keys of laplacian, flatten", "3"),
        ("fit: {holdout: 1}", "fit.holdout", "0 or a whole number from 2", "1"),
        ("fit: {holdout: -2}", "fit.holdout", "0 or a whole number from 2", "-2"),
        ("fit: {device: gpu}", "fit.device", "'cpu', 'cuda' or 'auto'", "'gpu'"),
        ("fit: {preset: quick}", "fit.preset", "'softras' or 'fast'", "'quick'"),
        ("fit: {remesh: 1}", "fit.remesh", "true or false", "1"),
        ("fit: {preset: softras, sigma: auto}", "fit.sigma", "a number above 0", "'auto'"),
        ("views: {size: 8}", "views.size", "from 16 to 4,096", "8"),
        ("views: {resize: crop}", "views.resize", "'pad' or 'stretch'", "'crop'"),
        ("silhouettes: masks", "silhouettes", "'deeplab' or 'matting'", "'masks'"),
        ("deeplab: {model: vgg}", "deeplab.model", "'resnet101'", "'vgg'"),
        ("deeplab: {size: big}", "deeplab.size", "from 16 to 4,096 or 'auto'", "'big'"),
        ("cameras: sfm", "cameras", "'colmap', 'auto' or 'file:<path>'", "'sfm'"),
        ("cameras: 'file:'", "cameras", "'colmap', 'auto' or 'file:<path>'", "'file:'"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_right(text, key, right, value):
    message = refusal(in_variant(text))
    assert message.startswith(f"my.yaml: variants.a.{key}: should be ")
    assert right in message
    assert message.endswith(f", not {value}")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "datasets: is missing; should be the path of a table"),
        ("datasets: t", "variants: is missing; should be names, each with its settings"),
        ("datasets: \nvariants: {a: {}}", "datasets: should be the path of a table, not empty"),
        ("datasets: t\nvariants: ", "variants: should be names, each with its settings, not empty"),
        ("datasets: t\nvariants: {}", "variants: should be names, each with its settings, not {}"),
        (
            "datasets: t\nvariants: [a]",
            "variants: should be names, each with its settings, not ['a']",
        ),
        ("datasets: t\nvariants: 3", "variants: should be names, each with its settings, not 3"),
        ("datasets: t\nvariants: {a: 3}", "variants.a: should be a section with keys of "),
        ("datasets: t\nvariants: {a: [fit]}", "variants.a: should be a section with keys of "),
        ("datasets: t\nvariants: {stages: {}}", "variants.stages: this name is taken by "),
        ("datasets: t\nviews: 64\nvariants: {a: {}}", "views: should be a section with keys of "),
        (
            "datasets: t\nvariants: {a: {}}\ntrain: {}",
            "train.holdout: is missing; should be a list",
        ),
        (
            "datasets: t\nvariants: {a: {}}\ntrain: {holdout: [a], batch: 1}",
            "train.batch: should be a whole number from 2 to 1,024, not 1",
        ),
        (
            "datasets: t\nvariants: {a: {}}\ntrain: {holdout: [a], epoch: 1}",
            "train.epoch: unknown key; did you mean 'epochs'?",
        ),
        ("datasets: t\nvariants: {a: {}}\n3: 4", "all of it: should be a section with keys of "),
    ],
)
def test_a_wrong_section_is_named(text, message):
    assert refusal(text).startswith(f"my.yaml: {message}")


@pytest.mark.parametrize("name", ["a/b", "a b", "", ".a", "a\n", "ä", "../a", "yes"])
def test_a_variants_name_makes_a_folder(name):
    values = {"datasets": "t", "variants": {True if name == "yes" else name: {}}}
    with pytest.raises(
        InputError, match="this name should be made of at most 80 letters, digits, '_' and '-'"
    ):
        parse_config(values, "my.yaml")
