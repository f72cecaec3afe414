"""DeepLabv3 (Chen et al. 2017, arXiv:1706.05587) as torchvision builds it, and files of weights.

A file of ours holds ``{model, classes, mean, std, size, state}``: torchvision's name of the
network, the names of the classes, the background first, how its input is normalised (in 0..1) and
how large the longer side of the photographs was, and the parameters by torchvision's names. A file
of parameters alone, as torchvision downloads them, is read too, and so is the TFLite file of
``mobilenet_v2``, which torchvision has not.
"""

import io
import math
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from silmesh.errors import WORDS, InputError, cut, shorten
from silmesh.files import replacing
from silmesh.silhouettes import mobilenet_v2
from silmesh.silhouettes.tflite import is_tflite
from silmesh.silhouettes.torchvision_import import import_segmentation

MODELS = ("mobilenet_v3_large", "resnet50", "resnet101", mobilenet_v2.NAME)
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's, which torchvision takes
SIZES = (16, 8192)  # pixels that a network may be made for
SIZE = 520  # pixels, to which torchvision's own transforms resize
STRIDE = 16  # pixels of the photograph to one of the features
COUNTED = ("classifier.4.weight", f"{mobilenet_v2.LAST}.weight")  # has a row for each class
AUXILIARY = "aux_classifier."  # a head that only torchvision's training uses


@dataclass(frozen=True)
class Weights:
    """What a network has learnt, and what it should be shown.

    Attributes:
        model: one of ``MODELS``
        classes: names, the background first
        mean, std: of the colours in 0..1 that its input is normalised by
        size: longer side of the photographs that it is shown, in pixels
        state: parameters by torchvision's names
    """

    model: str
    classes: tuple[str, ...]
    mean: tuple[float, ...]
    std: tuple[float, ...]
    size: int
    state: Mapping[str, Tensor]

    def build(self) -> nn.Module:
        """The network with these weights, ready to look at photographs."""
        network = build_network(self.model, len(self.classes))
        network.load_state_dict(self.state)
        return network.eval()


class AtrousConv2d(nn.Conv2d):
    """A 3x3 convolution with holes that leaves out the taps which see nothing but padding.

    At 16 pixels a feature, a photograph of 192 has 12 rows of features: holes as wide as that, as
    all three of the head's are, leave each tap but the middle one outside. The result is the same.
    """

    def forward(self, features: Tensor) -> Tensor:
        """Convolve [batch, channels, rows, columns]."""
        rate = self.dilation[0]
        padding = [rate if extent > rate else 0 for extent in features.shape[2:]]
        rows, columns = (slice(None) if pad else slice(1, 2) for pad in padding)
        kernel = self.weight[:, :, rows, columns]
        return functional.conv2d(features, kernel, self.bias, 1, padding, self.dilation)


def build_network(model: str, classes: int) -> nn.Module:
    """torchvision's network, or that of a TFLite file, with random parameters."""
    if model == mobilenet_v2.NAME:
        return mobilenet_v2.DeepLabMobileNetV2(classes)
    build = getattr(import_segmentation(), f"deeplabv3_{model}")
    network = build(weights=None, weights_backbone=None, num_classes=classes, aux_loss=False)
    for branch in _atrous_branches(network):
        plain = branch[0]
        channels = plain.in_channels, plain.out_channels
        rate = plain.dilation
        with torch.device("meta"):  # its parameters are the plain one's
            branch[0] = AtrousConv2d(*channels, 3, padding=rate, dilation=rate, bias=False)
        branch[0].weight = plain.weight
    return network


def narrow(network: nn.Module, size: int) -> dict[str, Tensor]:
    """Leave only the middle taps of the convolutions whose others see padding alone at this size.

    Returns:
        the kernels as they were, by torchvision's names, for ``widen``
    """
    whole = {}
    for number, branch in enumerate(_atrous_branches(network), start=1):
        wide = branch[0]
        if wide.dilation[0] >= -(-size // STRIDE):
            branch[0] = nn.Conv2d(wide.in_channels, wide.out_channels, 1, bias=False)
            branch[0].weight.data = wide.weight.data[:, :, 1:2, 1:2].clone()
            whole[f"classifier.0.convs.{number}.0.weight"] = wide.weight.data
    return whole


def widen(state: Mapping[str, Tensor], whole: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Parameters of a narrowed network as those of a whole one, whose other taps are given."""
    wide = {name: kernel.clone() for name, kernel in whole.items()}
    for name, kernel in wide.items():
        kernel[:, :, 1:2, 1:2] = state[name]
    return {**state, **wide}


def _atrous_branches(network: nn.Module) -> list[nn.Sequential]:
    if isinstance(network, mobilenet_v2.DeepLabMobileNetV2):
        return []
    return list(network.classifier[0].convs[1:4])  # between a 1x1 convolution and the mean


def write_weights(path: Path, weights: Weights) -> None:
    """Write a file of weights that ``load_weights`` reads."""
    save_tensors(path, asdict(weights))


def save_tensors(path: Path, values: Any) -> None:
    """Write what ``torch.load`` reads; torch by itself calls a full disk a fault of its own."""
    held = io.BytesIO()
    torch.save(values, held)
    with replacing(path) as part:
        part.write_bytes(held.getbuffer())


def load_weights(source: str, model: str) -> Weights:
    """Weights by torchvision's name, ``DEFAULT`` for its best, or from a file.

    Raises:
        InputError: they cannot be downloaded; the file is not there, is truncated or something
            else, or belongs to another model
    """
    if is_torchvision_name(source):
        return _download(source, model)
    return _fit_to_model(_read(Path(source)), Path(source), model)


def is_torchvision_name(source: str) -> bool:
    """Whether weights are named as torchvision does: in capitals, without a folder or an ending."""
    return source.replace("_", "").isalnum() and source == source.upper()


def list_weights(model: str) -> list[str]:
    """The names that torchvision has for weights of a model; none of one that is not its own."""
    if model == mobilenet_v2.NAME:
        return []
    segmentation = import_segmentation()
    return list(getattr(segmentation, _enumeration(segmentation, model)).__members__)


def _download(name: str, model: str) -> Weights:
    """torchvision's weights, from its cache or the net."""
    if name not in (known := list_weights(model)):
        raise InputError(
            f"deeplab.weights: {name!r} is none of torchvision's for {model!r}; "
            f"there are {', '.join(known) or 'none'}; or should be a file's path"
        )
    segmentation = import_segmentation()
    weights = getattr(segmentation, _enumeration(segmentation, model))[name]
    cached = Path(torch.hub.get_dir()) / "checkpoints" / weights.url.rpartition("/")[2]
    try:
        state = weights.get_state_dict(progress=False, check_hash=True)
    except OSError as error:  # urllib's are, too
        raise InputError(
            f"deeplab.weights: {name!r} cannot be downloaded ({error}). Where there is no network, "
            f"put {cached.name}, got elsewhere, at {cached}, or name a file of weights, "
            "which `bin/run train` makes from photographs with masks"
        ) from error
    except Exception as error:  # whatever torch's unpickler stumbles over
        raise InputError(
            f"{cached}: is truncated or damaged ({_in_short(error)}); delete it, and it is "
            "downloaded again"
        ) from error
    return Weights(model, tuple(weights.meta["categories"]), MEAN, STD, SIZE, _main_part(state))


def _enumeration(segmentation: Any, model: str) -> str:
    """torchvision's name of a model's weights, which has capitals of its own."""
    wanted = f"deeplabv3_{model}_weights".lower()
    return next(name for name in dir(segmentation) if name.lower() == wanted)


def _read(path: Path) -> Mapping[str, Any]:
    if path.is_file() and _is_tflite(path):
        return mobilenet_v2.read_tflite(path)
    _refuse_packed(path)
    try:
        held = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise InputError(f"{path}: is not there; deeplab.weights should name a file") from error
    except Exception as error:  # whatever torch's unpickler stumbles over
        raise InputError(
            f"{path}: cannot be read as weights ({_in_short(error)}); it may be truncated. "
            "Should be a file that `bin/run train` or torchvision made"
        ) from error
    if not isinstance(held, Mapping):
        raise InputError(f"{path}: holds a {type(held).__name__}; should hold a network's weights")
    return held


def _is_tflite(path: Path) -> bool:
    with open(path, "rb") as opened:
        return is_tflite(opened.read(8))


def _fit_to_model(held: Mapping[str, Any], path: Path, model: str) -> Weights:
    """Check what a file holds against the network that it should be for."""
    ours = {field.name for field in fields(Weights)} <= set(held)
    if ours:
        _refuse_wrong(held, path)
    state = _main_part(_tensors(held["state"] if ours else held, path))
    counted = next((name for name in COUNTED if name in state), COUNTED[0])
    if counted not in state or not state[counted].ndim:
        raise InputError(
            f"{path}: holds no weights of DeepLabv3 ({counted} is missing); should be a file that "
            "`bin/run train` or torchvision made for it"
        )
    count = len(state[counted])
    if not _suits(state, model, count):
        others = [name for name in MODELS if _suits(state, name, count)]
        raise InputError(
            f"{path}: does not fit deeplab.model {model!r}; "
            + (f"its weights are of {others[0]!r}" if others else f"nor any of {', '.join(MODELS)}")
        )
    if not ours:
        return Weights(model, tuple(map(str, range(count))), MEAN, STD, SIZE, state)
    own = {field.name: held[field.name] for field in fields(Weights)}
    return Weights(**{**own, "classes": tuple(held["classes"]), "state": state})


def _refuse_packed(path: Path) -> None:
    """Refuse an archive that unpacks to more than it is: torch's are not compressed."""
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(info.file_size for info in archive.infolist())
    except Exception:  # an older format, or damaged, which torch will say
        return
    if unpacked > path.stat().st_size:
        raise InputError(
            f"{path}: its {path.stat().st_size:,} bytes unpack to {unpacked:,}; should be a file "
            "that `bin/run train` or torchvision made"
        )


def _refuse_wrong(held: Mapping[str, Any], path: Path) -> None:
    """Refuse what stands beside the parameters if it is of another kind."""
    mean, std = held["mean"], held["std"]
    sound = (
        isinstance(held["classes"], list | tuple)
        and all(isinstance(name, str) for name in held["classes"])
        and isinstance(held["size"], int)
        and SIZES[0] <= held["size"] <= SIZES[1]
        and all(isinstance(part, list | tuple) and len(part) == 3 for part in (mean, std))
        and all(isinstance(v, float | int) and math.isfinite(v) for v in (*mean, *std))
        and min(std) > 0
    )
    if not sound:
        raise InputError(
            f"{path}: its classes, mean, std or size is of another kind: "
            f"{shorten([held[name] for name in ('classes', 'mean', 'std', 'size')])}; should be a "
            "file that `bin/run train` made"
        )


def _tensors(state: Any, path: Path) -> Mapping[str, Tensor]:
    """Parameters by their names, each a tensor of numbers."""
    if not isinstance(state, Mapping) or not all(
        isinstance(name, str) and isinstance(value, Tensor) for name, value in state.items()
    ):
        raise InputError(f"{path}: holds something else than parameters by their names")
    for name, value in state.items():
        if value.layout != torch.strided or value.is_quantized or value.is_complex():
            raise InputError(f"{path}: {cut(name, 80)}: is no plain tensor of real numbers")
    return state


def _suits(state: Mapping[str, Tensor], model: str, classes: int) -> bool:
    """Whether parameters have the names and the shapes of a model's."""
    with torch.device("meta"):
        wanted = build_network(model, classes).state_dict()
    return {k: v.shape for k, v in wanted.items()} == {k: v.shape for k, v in state.items()}


def _main_part(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: value for name, value in state.items() if not name.startswith(AUXILIARY)}


def _in_short(error: Exception) -> str:
    return cut((str(error).strip() or type(error).__name__).splitlines()[0].split(". ")[0], WORDS)
