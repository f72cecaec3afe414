"""What a run needs of this machine and of its files, looked at before any work.

A step would refuse it too, but after the work of those before it. What is heavy to import is
imported only for a run that asks for it.
"""

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from silmesh.cameras.sets import CLASH
from silmesh.errors import InputError, blaming
from silmesh.reading import is_array
from silmesh.settings.fit import refuse_clash
from silmesh.settings.train import NEW
from silmesh.silhouettes.tflite import is_tflite
from silmesh.views import find_images

if TYPE_CHECKING:
    from silmesh.planning.plan import Run
    from silmesh.settings.fit import Fit

FEWEST_FITTED = 2  # views
OPAQUE = (".jpg", ".jpeg", ".bmp")  # formats without an alpha channel
MATTING = "openvino"  # the library that runs the foreground model
TRITON = "triton"  # the library that compiles the GPU's kernel
CHECKPOINT = (b"PK\x03\x04", b"\x80")  # how a file of torch's begins: a zip, or a pickle


def refuse_infeasible(run: "Run", where: str) -> None:
    """Refuse a run that cannot come to its end.

    Args:
        where: the configuration's file

    Raises:
        InputError: it names the key, what there is, and what would be right
    """
    _refuse_lacking_gpu(f"{where}: variants.{run.variant}.fit", run.settings.fit)
    with blaming(f"{where}: variants.{run.variant}"):
        refuse_clash(run.settings.fit)
    _refuse_lacking_model(f"{where}: variants.{run.variant}", run.silhouettes)
    with blaming(f"{run.dataset.where} (variant {run.variant!r})"):
        _refuse_opaque(run.silhouettes, run.dataset.images)
        _refuse_few_views(run)
        if run.cameras == "turntable" and run.dataset.sets:
            raise InputError(CLASH)


def _refuse_lacking_gpu(key: str, fit: "Fit") -> None:
    for name, value in (("device", "cuda"), ("renderer", "gpu")):
        if getattr(fit, name) == value and not _has_gpu():
            raise InputError(
                f"{key}.{name}: '{value}', but torch finds no GPU on this machine; should be "
                "'cpu', or 'auto', which takes a GPU where the fit finds one"
            )
    if fit.renderer == "gpu" and find_spec(TRITON) is None:
        raise InputError(
            f"{key}.renderer: 'gpu' needs a library that is not installed: "
            "`pip install 'silmesh[gpu]'`; or should be 'auto'"
        )


@cache
def _has_gpu() -> bool:
    import torch

    return torch.cuda.is_available()


def _refuse_lacking_model(key: str, silhouettes: str) -> None:
    if silhouettes == "matting" and not has_matting():
        raise InputError(
            f"{key}: silhouettes 'matting' needs a library that is not installed: "
            "`pip install 'silmesh[matting]'`; or should be another source"
        )


def has_matting() -> bool:
    """Whether what runs the foreground model is installed."""
    return find_spec(MATTING) is not None


def _refuse_opaque(silhouettes: str, images: tuple[Path, ...]) -> None:
    if silhouettes != "alpha":
        return
    if opaque := [image for image in images if image.suffix.lower() in OPAQUE]:
        raise InputError(
            f"{opaque[0]}: silhouettes are 'alpha', but {opaque[0].suffix} has no alpha channel; "
            "should be PNG, TIFF or WebP, or silhouettes another source"
        )


def _refuse_few_views(run: "Run") -> None:
    images = run.dataset.images
    array = is_array(images[0])
    if array and run.cameras == "colmap":
        raise InputError(
            f"{images[0]}: an array of images, but cameras 'colmap' needs the photographs as "
            "files; should be 'calibrate' or a file of cameras"
        )
    count, every = run.dataset.photographs, run.settings.fit.holdout
    if every and count is not None and count - count // every < FEWEST_FITTED:
        raise InputError(
            f"fit.holdout: {every} keeps {count // every} of {count} photographs out, which leaves "
            f"fewer than {FEWEST_FITTED} to fit; should be 0"
        )


def refuse_other_weights(key: str, file: Path) -> None:
    """Refuse a file that is none of torch's and no TFLite, by how it begins."""
    try:
        with open(file, "rb") as opened:
            begins = opened.read(8)
    except OSError as error:
        raise InputError(f"{key}: {file}: cannot be read: {error.strerror}") from error
    if begins and not begins.startswith(CHECKPOINT) and not is_tflite(begins):
        raise InputError(
            f"{key}: {file}: is no file of weights: torch's begin otherwise; should be one that "
            "`bin/run train` or torch.save made, or the TFLite file of mobilenet_v2"
        )


def refuse_unknown_weights(key: str, name: str, model: str) -> None:
    """Refuse a name of weights that torchvision lacks; DEFAULT it has for each model of its own."""
    if model == "mobilenet_v2":
        raise InputError(
            f"{key}: {name!r}: {model!r} has none of torchvision's weights, and without batch "
            "normalisation does not learn from random ones; should be the path of its TFLite file, "
            "or of one that `bin/run train` made from that"
        )
    if name in (NEW, "DEFAULT"):
        return
    from silmesh.silhouettes.network import list_weights

    if name not in (known := list_weights(model)):
        raise InputError(
            f"{key}: {name!r} is none of torchvision's for {model!r}; there are "
            f"{', '.join(known)}, or a file's path"
        )


def refuse_lacking_backgrounds(key: str, source: str) -> None:
    """Refuse a folder or a glob without photographs; some come with scikit-image."""
    if source != "shipped":
        with blaming(key):
            find_images(Path(source))


def refuse_lacking_mesh(key: str, file: Path | None) -> None:
    """Refuse a mesh of a person's own that is not there."""
    if file is not None and not file.is_file():
        raise InputError(f"{key}: {file}: is not there; should be file:path/to/mesh.ply")
