"""torchvision's models come in beside any build of torch. Each test is a process of its own, for a
failed or finished import cannot be undone."""

import subprocess
import sys

import pytest

BUILD = """
build = segmentation.deeplabv3_mobilenet_v3_large
print(build(weights=None, weights_backbone=None, num_classes=2).classifier[4].out_channels)
"""
WITH_OPERATORS = "segmentation = module.import_segmentation()" + BUILD


def loads_operators() -> bool:
    code = "from silmesh.silhouettes.torchvision_import import _load_operators as load\n"
    return run(code + "print(load())") == "True"


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_segmentation_is_imported():
    assert run(f"import silmesh.silhouettes.torchvision_import as module\n{WITH_OPERATORS}") == "2"


@pytest.mark.slow
def test_names_alone_are_enough_where_the_operators_do_not_load():
    if loads_operators():
        pytest.skip("this torchvision suits this torch, whose operators have their names already")
    assert "nms does not exist" in subprocess.run(
        [sys.executable, "-c", "import torchvision"], capture_output=True, text=True, check=False
    ).stderr  # fmt: skip
    code = f"import silmesh.silhouettes.torchvision_import as module\n{WITH_OPERATORS}"
    assert run(code + "import torchvision.transforms.v2, torchvision.ops") == "2"
