"""What each page of the report begins and ends with: the overview, and what its numbers mean."""

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from platform import python_version
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from PIL import Image

from silmesh.geometry.thresholds import COHERENT
from silmesh.report.gallery import encode_webp
from silmesh.report.measures import LACKING, METRICS, OVERVIEW, TRUTH, is_incoherent, show
from silmesh.report.parts import SCRIPTS, STYLES
from silmesh.report.pictures import crop_thumbnail
from silmesh.report.tables import Run

PACKAGES = ("silmesh", "torch", "numba", "numpy", "scikit-image", "trimesh", "snakemake")
THUMBNAIL = 132  # pixels


def render(
    template: str,
    objects: Sequence[Mapping[str, Any]],
    metrics: Mapping[Run, Mapping[str, Any]],
    settings: Mapping[str, Any],
    **told: Any,
) -> str:
    """Write a page.

    Args:
        template: that extends ``base.html.j2``
        objects: ``name``, ``link``, and of its ``runs`` ``thumbnail`` and ``describe_numbers``
        metrics: of every run on the page
        settings: as ``write_page`` takes them
        told: what else the template asks for
    """
    page = _read_template(template)
    shown = [key for key in TRUTH if any(v.get(key) is not None for v in metrics.values())]
    return page.render(
        objects=objects,
        count=sum(len(object_["runs"]) for object_ in objects),
        overview=[metric for metric in METRICS if metric.key in (*OVERVIEW, *shown)],
        meanings=[m for m in METRICS if any(m.key in v for v in metrics.values())],
        coherent=COHERENT,
        configuration=settings["configuration"],
        versions=_versions(),
        styles=[read_part(name) for name in STYLES],
        scripts=[read_part(name) for name in SCRIPTS],
        lacking=LACKING,
        **told,
    )


@cache  # a report of many objects has as many pages
def _read_template(name: str) -> Template:
    return Environment(
        loader=PackageLoader("silmesh.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template(name)


@cache
def read_part(name: str) -> str:
    """A file of this package, as text."""
    return files("silmesh.report").joinpath(name).read_text(encoding="utf-8")


def describe_numbers(variant: str, metrics: Mapping[str, Any]) -> dict[str, Any]:
    """What the overview shows of a run beside its picture."""
    return {
        "variant": variant,
        "values": {m.key: show(metrics.get(m.key), m) for m in METRICS},
        "numbers": {m.key: metrics.get(m.key) for m in METRICS},
        "incoherent": is_incoherent(metrics),
    }


def encode_thumbnail(picture: Path) -> str:
    """The mesh of a run's picture, small: WebP in base64."""
    with Image.open(picture) as image:
        small = crop_thumbnail(image).resize((THUMBNAIL, THUMBNAIL), Image.Resampling.LANCZOS)
    return encode_webp(small.convert("RGB"), 75)


def _versions() -> dict[str, str]:
    """Versions of Python and of the libraries that decide the numbers, here and now."""
    found = {"Python": python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = LACKING
    return found
