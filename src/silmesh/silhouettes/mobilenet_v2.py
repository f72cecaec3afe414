"""DeepLabv3 on MobileNetV2 of half width (Sandler et al. 2018, arXiv:1801.04381), from TFLite.

It is DeepLab's own network for telephones: the head has no holes, only the mean of the photograph
beside each feature, and batch normalisation is part of the convolutions. Features are 8 pixels
apart, the first at the first pixel and the last at the last: sides are of 8 k + 1 pixels.
"""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from silmesh.errors import InputError
from silmesh.silhouettes.tflite import Convolution, read_convolutions

NAME = "mobilenet_v2"
LAST = "classifier"  # the layer that has a row for each class
STRIDE = 8  # pixels of the photograph to one of the features
# Channels, stride and dilation of each block; each but the first widens its input by EXPANSION.
BLOCKS = (
    *((8, 1, 1), (12, 2, 1), (12, 1, 1), (16, 2, 1), (16, 1, 1), (16, 1, 1), (32, 1, 1)),
    *[(32, 1, 2)] * 3,
    *[(48, 1, 2)] * 3,
    *((80, 1, 2), (80, 1, 4), (80, 1, 4), (160, 1, 4)),
)
FIRST, EXPANSION, HEAD = 16, 6, 256
HALF = (0.5,) * 3  # mean and standard deviation that make (rgb / 127.5) - 1 of colours in 0..1
ACTIVATIONS = {nn.ReLU: 1, nn.ReLU6: 3}  # TFLite's numbers
SHOULD = "should be DeepLabv3 with MobileNetV2 of width 0.5 and float32"


class Block(nn.Sequential):
    """An inverted residual: widen, look around in each channel, narrow."""

    def __init__(self, channels: int, out: int, stride: int, dilation: int, expansion: int):
        wide = channels * expansion
        widen = [nn.Conv2d(channels, wide, 1), nn.ReLU6()] if expansion > 1 else []
        around = nn.Conv2d(wide, wide, 3, stride, dilation, dilation, groups=wide)
        super().__init__(*widen, around, nn.ReLU6(), nn.Conv2d(wide, out, 1))
        self.residual = stride == 1 and channels == out

    def forward(self, features: Tensor) -> Tensor:
        """[batch, channels, rows, columns] to as many rows and columns, divided by the stride."""
        found = super().forward(features)
        return features + found if self.residual else found


class DeepLabMobileNetV2(nn.Module):
    """The network, with layers in the order of TFLite's operators."""

    def __init__(self, classes: int):
        super().__init__()
        self.features = nn.Sequential(nn.Conv2d(3, FIRST, 3, 2, 1), nn.ReLU6())
        channels = FIRST
        for number, (out, stride, dilation) in enumerate(BLOCKS):
            expansion = EXPANSION if number else 1
            self.features.append(Block(channels, out, stride, dilation, expansion))
            channels = out
        self.whole = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Conv2d(channels, HEAD, 1), nn.ReLU())
        self.each = nn.Sequential(nn.Conv2d(channels, HEAD, 1), nn.ReLU())
        self.both = nn.Sequential(nn.Conv2d(2 * HEAD, HEAD, 1), nn.ReLU())
        self.classifier = nn.Conv2d(HEAD, classes, 1)

    def forward(self, images: Tensor) -> dict[str, Tensor]:
        """The scores of images [batch, 3, h, w]: [batch, classes, h, w], by torchvision's name."""
        rows, columns = images.shape[2:]
        more = (0, -(columns - 1) % STRIDE, 0, -(rows - 1) % STRIDE)
        padded = functional.pad(images, more, mode="replicate")
        features = self.features(padded)
        each = self.each(features)
        scores = self.classifier(
            self.both(torch.cat([self.whole(features).expand_as(each), each], dim=1))
        )
        extent = padded.shape[2:]
        large = functional.interpolate(scores, extent, mode="bilinear", align_corners=True)
        return {"out": large[:, :, :rows, :columns]}


def read_tflite(path: Path) -> dict[str, Any]:
    """What a TFLite file holds, as our own files of weights hold it.

    Raises:
        InputError: it cannot be read, or is of another network
    """
    shape, convolutions = read_convolutions(path)
    classes = len(convolutions[-1].bias) if convolutions else 0
    with torch.device("meta"):
        layers = _layers(DeepLabMobileNetV2(max(classes, 1)))
    if len(layers) != len(convolutions):
        raise InputError(
            f"{path}: is another network: has {len(convolutions)} convolutions, not {len(layers)}; "
            f"{SHOULD}"
        )
    state = {}
    for (name, layer, activation), held in zip(layers, convolutions, strict=True):
        _refuse_other(path, name, _describe(layer, activation), _describe_held(held))
        state[f"{name}.weight"] = torch.from_numpy(held.weight.copy())
        state[f"{name}.bias"] = torch.from_numpy(held.bias.copy())
    size = max(shape[1:3], default=0)
    names = tuple(map(str, range(classes)))
    told = {"model": NAME, "classes": names, "mean": HALF, "std": HALF, "size": size}
    return {**told, "state": state}


def _layers(network: nn.Module) -> list[tuple[str, nn.Conv2d, int]]:
    """Name of each convolution, itself, and TFLite's number of the activation after it."""
    kinds = (nn.Conv2d, *ACTIVATIONS)
    parts = [pair for pair in network.named_modules() if isinstance(pair[1], kinds)]
    after = [*(ACTIVATIONS.get(type(part), 0) for _, part in parts[1:]), 0]
    pairs = zip(parts, after, strict=True)
    return [(name, part, act) for (name, part), act in pairs if isinstance(part, nn.Conv2d)]


def _describe(layer: nn.Conv2d, activation: int) -> str:
    return _words(layer.weight.shape, layer.stride, layer.dilation, activation)


def _describe_held(held: Convolution) -> str:
    return _words(held.weight.shape, held.stride, held.dilation, held.activation)


def _words(shape: tuple, stride: tuple, dilation: tuple, activation: int) -> str:
    extent = " x ".join(map(str, shape))
    return f"{extent}, stride {stride[0]}, dilation {dilation[0]}, activation {activation}"


def _refuse_other(path: Path, name: str, wanted: str, found: str) -> None:
    if found != wanted:
        raise InputError(
            f"{path}: is another network: its {name} is {found}, not {wanted}; {SHOULD}"
        )
