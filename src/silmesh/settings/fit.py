"""The fit: what each preset's procedure is told."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

from pydantic import Discriminator, Field, Tag

from silmesh.errors import InputError
from silmesh.own_code import own_file
from silmesh.settings.section import (
    Betas,
    NotNegative,
    OwnCode,
    Positive,
    Section,
    Seed,
    Truth,
    whole,
)

Preset = Literal[  # the model of each is in FITS, below
    "softras",
    "fast",
]
AUTO = "auto"
RENDERERS = (  # each but the first is the module of its name in softras
    AUTO,
    "cpu",
    "gpu",
    "reference",
)
Renderer = Literal[RENDERERS] | OwnCode
Options = Annotated[
    dict[str, bool | int | float | str], "names, each with a number, words, true or false"
]
Photometric = Annotated[Literal["auto", False], "'auto' or false"]
SOFTNESS = 0.03  # pixels: the root of sigma where it is `auto`


class Weights(Section):
    """Weights of the smoothness terms, summed over the mesh."""

    laplacian: NotNegative = Field(0.03, description="of the Laplacian term")
    flatten: NotNegative = Field(0.0003, description="of the flatten term")


class FastWeights(Section):
    """Weights of the smoothness terms, summed over the mesh."""

    laplacian: NotNegative = Field(0.1, description="of the Laplacian term")
    flatten: NotNegative = Field(0.00005, description="of the flatten term")


class _Fit(Section):
    """What all presets have."""

    preset: Preset | OwnCode = Field(
        "fast", description="fast: ours; softras: the report's procedure to the letter"
    )
    renderer: Renderer = Field(
        AUTO,
        description="auto: cpu on the CPU, gpu on a GPU; these: the fast kernels; reference: "
        "plain torch, slow; a function of your own takes what "
        "`silmesh.softras.soft_silhouettes` does",
    )
    holdout: Literal[0] | whole(
        2, 10_000
    ) = Field(0, description="every n-th view is kept out of the fit; 0 for none")
    seed: Seed = Field(0, description="of random choices; the preset softras makes none")
    device: Literal["cpu", "cuda", "auto"] = Field(
        "auto", description="auto takes the GPU if there is one"
    )

    def sigma_at(self, size: int) -> float:
        """Softness of the silhouettes in images of ``size`` pixels, in squared half-image units."""
        return (2 * SOFTNESS / size) ** 2 if self.sigma == "auto" else self.sigma


class SoftRasFit(_Fit):
    """The report's procedure: ``silmesh.fitting.softras``."""

    preset: Preset | OwnCode = Field("softras", description="the report's procedure to the letter")
    iterations: whole(1, 1_000_000) = Field(2000, description="steps")
    learning_rate: Positive = Field(0.01, description="Adam's")
    betas: Betas = Field((0.5, 0.99), description="Adam's")
    sigma: Positive = Field(
        1e-4, description="softness of the silhouettes, in squared half-image units"
    )
    weights: Weights = Field(Weights(), description="of the smoothness terms")


class FastFit(_Fit):
    """Our procedure: ``silmesh.fitting.fast``."""

    iterations: whole(1, 1_000_000) = Field(600, description="steps at most")
    learning_rate: Positive = Field(0.5, description="the longest step of a vertex, in pixels")
    betas: Betas = Field((0.9, 0.999), description="of the vertices' Adam")
    sigma: Positive | Literal["auto"] = Field(
        "auto", description="as for softras, of the last steps; auto is 0.03 pixels squared"
    )
    weights: FastWeights = Field(FastWeights(), description="of the smoothness terms")
    smoothing: NotNegative = Field(
        1.0, description="how far a step spreads over the mesh, in squared edges"
    )
    vertices: whole(12, 200_000) = Field(
        200_000,
        description="most vertices that a mesh gets, where images are larger than 256 pixels and "
        "their finer levels give it more than it began with",
    )
    batch: whole(0, 10_000) = Field(12, description="views in a step; 0 for all")
    coarse_to_fine: Truth = Field(True, description="begin with smaller, softer images")
    refine_cameras: Truth = Field(True, description="correct the cameras alongside")
    remesh: Truth = Field(True, description="give the mesh new edges when they are uneven")
    untangle: Truth = Field(True, description="in the end turn parts that are inside out")
    span_unseen: Truth = Field(
        True, description="in the end span what no view sees, as below what stands on a table"
    )
    judge_views: Truth = Field(
        True, description="views and parts of silhouettes that the others contradict do not count"
    )
    photometric: Photometric = Field(
        False,
        description="auto: afterwards the surface moves to where the photographs agree, if some "
        "that were kept out agree that it is better; the command's default",
    )


class OwnFit(SoftRasFit):
    """A procedure of a person's own, told what the report's is, and what else it takes."""

    preset: OwnCode = Field(description="makes the procedure")
    options: Options = Field({}, description="what else it takes, as it is")


FITS = {  # by the preset, whose procedure is the module of its name in fitting
    "softras": SoftRasFit,
    "fast": FastFit,
}
OWN = "own"  # what is none of these is of


def name_fit(preset: str, photometric: str | bool | None = None) -> dict[str, Any]:
    """What a person says of a fit, as keys of the configuration.

    Args:
        photometric: ``auto`` if not given, where the preset has it
    """
    if photometric is None:
        return {"preset": preset, **({"photometric": AUTO} if preset == "fast" else {})}
    return {"preset": preset, "photometric": photometric}


def is_photometric(fit: _Fit) -> bool:
    """Whether photographs have a say in the mesh after a fit, if they agree."""
    return bool(getattr(fit, "photometric", False))


def spans_unseen(fit: _Fit) -> bool:
    """Whether ends that no view sees are spanned after it."""
    return bool(getattr(fit, "span_unseen", False))


def refuse_clash(fit: _Fit) -> None:
    """Refuse a renderer that does not run on the device.

    Raises:
        InputError: it does not
    """
    for renderer, device, other in (("cpu", "cuda", "cpu"), ("gpu", "cpu", "cuda")):
        if fit.renderer == renderer and fit.device == device:
            raise InputError(
                f"fit.renderer: '{renderer}' does not render on the device '{device}'; should be "
                f"'auto' or 'reference', or fit.device '{other}'"
            )


def _preset_of(fit: Any) -> str:
    """Which of the models a fit is of; what is no preset is refused by that of the default one."""
    preset = fit.get("preset") if isinstance(fit, Mapping) else getattr(fit, "preset", None)
    if not isinstance(preset, str):
        return "fast"
    return OWN if own_file(preset) else preset if preset in FITS else "fast"


Fit = Annotated[
    Union[  # noqa: UP007, of as many as there are
        tuple(Annotated[model, Tag(name)] for name, model in [(OWN, OwnFit), *FITS.items()])
    ],
    Discriminator(_preset_of),
]
