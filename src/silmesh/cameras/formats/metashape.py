"""Agisoft Metashape's (PhotoScan's) ``cameras.xml``: sensors, cameras, and the chunk's transform.

    <document version="1.5.0"><chunk>
      <sensors><sensor id="0" type="frame"><resolution/><calibration class="adjusted">...
      <components><component id="0"><transform>...
      <cameras><camera id="0" sensor_id="0" component_id="0" label="IMG_1.JPG"><transform>...
      <transform><rotation/><translation/><scale/></transform>

Conventions, by the appendix "Camera models" of the manuals:

    pose        ``transform`` of a camera is from camera to chunk, 4 x 4 by rows, axes as ours; a
                chunk's or a component's own leads on to the world, scale R X + translation
    version 1.2 u = w / 2 + cx + x' f + x' b1 + y' b2,  v = h / 2 + cy + y' f,  with
                x' = x (1 + k1 r^2 + ... + k4 r^8) + p1 (r^2 + 2 x^2) + 2 p2 x y
    before      u = cx + x' fx + y' skew,  v = cy + y' fy,  and p1, p2 the other way round
    fisheye     the same of (x, y) bent to the angle from the axis (equidistant)
    pixels      of the file, before it is turned as its ``orientation`` (EXIF's) says; centres at
                integer + 0.5

Cameras without a transform were not aligned; they, and those that are disabled, are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from silmesh.cameras.formats.assignment import Sizes, is_scaled
from silmesh.cameras.formats.parsing import Camera, gather, intrinsics, nearest_rotation, numbers
from silmesh.cameras.unread import recognise_root
from silmesh.errors import InputError, blaming
from silmesh.geometry.camera import WIDEST, Cameras
from silmesh.geometry.lens import Lens, lens_of
from silmesh.views import View

CENTRED = (1, 2)  # the version since when a principal point is from the middle
FISHEYES = ("fisheye", "equidistant_fisheye")
FOCAL = ("f", "fx", "fy")
LENS = ("k1", "k2", "k3", "k4", "p1", "p2")
KNOWN = {*FOCAL, *LENS, "cx", "cy", "b1", "b2", "skew", "resolution"}
SAID = {"covariance", "date", "model", "label"}  # of a calibration, beside its numbers
TURNS = {  # from a file's pixels to upright ones, by EXIF's orientation: the linear part
    "1": [[1, 0], [0, 1]],
    "3": [[-1, 0], [0, -1]],
    "6": [[0, -1], [1, 0]],
    "8": [[0, 1], [-1, 0]],
}


class Sensor(NamedTuple):
    """What the photographs of one camera share: size, K with centres at integer + 0.5, lens."""

    size: tuple[int, int]
    K: np.ndarray
    lens: Lens | None


class Transform(NamedTuple):
    """From a chunk to the world: scale R X + shift."""

    scale: float
    R: np.ndarray
    shift: np.ndarray


HERE = Transform(1.0, np.eye(3), np.zeros(3))


def read(path: Path, views: Sequence[View]) -> dict[str, Cameras]:
    """Cameras by their labels, of each component that was aligned by itself."""
    root = parse_xml(path)
    if root.tag != "document":
        unread = recognise_root(root.tag) or f"holds {root.tag!r}, not Metashape's 'document'"
        raise InputError(f"{path}: {unread}")
    chunks = [chunk for chunk in root.findall("chunk") if any(_find_aligned(chunk))]
    if not chunks:
        raise InputError(
            f"{path}: has no camera with a transform; should be what Metashape's File > Export > "
            "Export Cameras writes after the photographs were aligned"
        )
    version, sizes = _parse_version(root, path), Sizes(views)
    read: dict[str, Cameras] = {}
    for i, chunk in enumerate(chunks):
        prefix = f"chunk {chunk.get('label') or i}, " if len(chunks) > 1 else ""
        groups = _read(chunk, version, path, sizes)
        read |= {prefix + name: found for name, found in groups.items()}
    return read


def parse_xml(path: Path) -> Element:
    """The root of an XML file, which may not define entities: these can grow without bound.

    Raises:
        InputError: it cannot be read as XML, or has a document type
    """
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    def refuse(*_: object) -> None:
        raise InputError(f"{path}: has a DOCTYPE, which no file of cameras needs; remove it")

    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(path.read_bytes(), True)
        return builder.close()
    except InputError:
        raise
    except (OSError, expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"{path}: cannot be read as XML: {error}") from error


def _parse_version(root: Element, path: Path) -> tuple[int, int]:
    words = (root.get("version") or "0.0").split(".")
    if len(words) < 2 or not all(word.isdecimal() and len(word) < 5 for word in words):
        raise InputError(f"{path}: version should be as 1.5.0, not {'.'.join(words)[:80]!r}")
    return int(words[0]), int(words[1])


def _find_aligned(chunk: Element) -> list[Element]:
    """The cameras that have a pose and are not disabled, in groups or not."""
    cameras = chunk.find("cameras")
    found = [] if cameras is None else list(cameras.iter("camera"))
    return [
        camera
        for camera in found
        if camera.find("transform") is not None
        and (camera.get("enabled") or "true").lower() not in ("false", "0")
    ]


def _read(chunk: Element, version: tuple[int, int], path: Path, sizes: Sizes) -> dict[str, Cameras]:
    elements = {sensor.get("id"): sensor for sensor in chunk.iterfind("sensors/sensor")}
    sensors: dict[str | None, Sensor] = {}
    transforms = _parse_transforms(chunk, path)
    groups: dict[str | None, list[Camera]] = {}
    for element in _find_aligned(chunk):
        where = f"{path}: camera {(element.get('label') or '')[:80]!r}"
        own, component = element.get("sensor_id"), element.get("component_id")
        if own not in elements:
            raise InputError(f"{where}: its sensor {own!r} is not in the file")
        if own not in sensors:
            sensors[own] = _parse_sensor(elements[own], version, f"{path}: sensor {own!r}")
        transform = transforms.get(component, transforms[None])
        camera = _parse(element, sensors[own], transform, where)
        groups.setdefault(component, []).append(_turn(camera, element, sizes, where))
    return {f"component {name or 0}": gather(cameras) for name, cameras in groups.items()}


def _parse_transforms(chunk: Element, path: Path) -> dict[str | None, Transform]:
    """By the components' ids, and the chunk's own by None."""
    transforms = {None: _parse_transform(chunk.find("transform"), f"{path}: chunk", HERE)}
    for component in chunk.iterfind("components/component"):
        where = f"{path}: component {component.get('id')!r}"
        transform = _parse_transform(component.find("transform"), where, transforms[None])
        transforms[component.get("id")] = transform
    return transforms


def _parse_transform(element: Element | None, where: str, default: Transform) -> Transform:
    if element is None or not len(element):
        return default

    def get(tag: str, of: np.ndarray) -> np.ndarray:
        text = element.findtext(tag)
        if text is None:
            return of
        return numbers(text.split(), (of.size,), f"{where}: {tag}").reshape(of.shape)

    scale = float(get("scale", np.ones(1))[0])
    if scale <= 0:
        raise InputError(f"{where}: scale should be positive, not {scale:g}")
    R = nearest_rotation(get("rotation", HERE.R), f"{where}: rotation")
    return Transform(scale, R, get("translation", HERE.shift))


def _parse(element: Element, sensor: Sensor, transform: Transform, where: str) -> Camera:
    words = (element.findtext("transform") or "").split()
    pose = numbers(words, (16,), f"{where}: transform").reshape(4, 4)
    R = nearest_rotation(pose[:3, :3], where).T @ transform.R.T
    centre = transform.scale * transform.R @ pose[:3, 3] + transform.shift
    return Camera(element.get("label") or "", sensor.size, sensor.K, R, -R @ centre, sensor.lens)


def _parse_sensor(element: Element, version: tuple[int, int], where: str) -> Sensor:
    kind = (element.get("type") or "frame").lower()
    calibrations = element.findall("calibration")
    adjusted = [c for c in calibrations if c.get("class") == "adjusted"] or calibrations
    if not adjusted:
        raise InputError(f"{where}: has no calibration; the photographs should have been aligned")
    calibration = adjusted[0]
    kind = (calibration.get("type") or kind).lower()
    if kind not in ("frame", *FISHEYES):
        raise InputError(
            f"{where}: a camera of type {kind!r} cannot be read; known are frame and fisheye. "
            "Let Metashape undistort the photographs, and export them and a COLMAP model"
        )
    _refuse_rolling(element, where)
    value = _parse_numbers(calibration, where)
    size = _parse_size(calibration.find("resolution"), element.find("resolution"), where)
    with blaming(where):
        lens = _parse_lens(value, kind, version)
    return Sensor(size, _parse_matrix(value, size, version, where), lens)


def _refuse_rolling(element: Element, where: str) -> None:
    said = [p.get("value") for p in element.iterfind("property[@name='rolling_shutter']")]
    said.append(element.findtext("rolling_shutter"))
    if any((value or "0").strip().lower() not in ("0", "false", "disabled", "") for value in said):
        raise InputError(
            f"{where}: has a rolling shutter, each row with a pose of its own, which cannot be "
            "read; align the photographs without rolling shutter compensation"
        )


def _parse_numbers(calibration: Element, where: str) -> dict[str, float]:
    """What a calibration says; what is unknown may only be 0."""
    value: dict[str, float] = {}
    for element in calibration:
        if element.tag in SAID or element.tag == "resolution":
            continue
        number = float(numbers((element.text or "").strip(), (), f"{where}: {element.tag}"))
        if element.tag in KNOWN:
            value[element.tag] = number
        elif number:
            raise InputError(
                f"{where}: its calibration has {element.tag[:80]} = {number:g}, which cannot be "
                "read; align without it, or let Metashape undistort the photographs"
            )
    return value


def _parse_size(own: Element | None, other: Element | None, where: str) -> tuple[int, int]:
    element = own if own is not None else other
    if element is None:
        raise InputError(f"{where}: has no resolution")
    words = [element.get("width"), element.get("height")]
    width, height = numbers(words, (2,), f"{where}: resolution").tolist()
    if not (1 <= width <= WIDEST and 1 <= height <= WIDEST):
        raise InputError(f"{where}: resolution should be pixels, not {width:g} x {height:g}")
    return int(width), int(height)


def _parse_matrix(
    value: Mapping[str, float], size: tuple[int, int], version: tuple[int, int], where: str
) -> np.ndarray:
    focal = value.get("f") or value.get("fy") or value.get("fx") or 0.0
    across = (value.get("fx") or focal) + value.get("b1", 0.0)
    centre = np.array([value.get("cx", 0.0), value.get("cy", 0.0)])
    if _is_centred(value, centre, np.array(size), version):
        centre = centre + np.array(size) / 2
    skew = value.get("b2", 0.0) + value.get("skew", 0.0)
    return intrinsics((across, focal), tuple(centre), where, skew)


def _is_centred(
    value: Mapping[str, float], centre: np.ndarray, size: np.ndarray, version: tuple[int, int]
) -> bool:
    """Whether the principal point is from the middle: as the version says, unless it cannot be.

    Of the two places that it may be at, one may lie outside of the image.
    """
    if "cx" not in value and "cy" not in value:
        return True
    centred = version >= CENTRED
    inside = [((at >= 0) & (at <= size)).all() for at in (centre, centre + size / 2)]
    return bool(inside[1]) if inside[0] != inside[1] else centred


def _parse_lens(value: Mapping[str, float], kind: str, version: tuple[int, int]) -> Lens | None:
    k1, k2, k3, k4, p1, p2 = (value.get(name, 0.0) for name in LENS)
    if version >= CENTRED:
        p1, p2 = p2, p1  # to OpenCV's order
    if kind in FISHEYES:
        return lens_of("THIN_PRISM_FISHEYE", [k1, k2, p1, p2, k3, k4, 0.0, 0.0])
    return lens_of("BROWN", [k1, k2, k3, k4, p1, p2])


def _turn(camera: Camera, element: Element, sizes: Sizes, where: str) -> Camera:
    """A camera of a file's pixels for the photograph as it is seen upright.

    Pixels are turned by a rotation A about the axis. Then K becomes A K A^T, what is seen turns
    with R and t, and so do the tangential terms: they are q r^2 + 2 (q . x) x with q = (p2, p1).
    """
    word = (element.findtext("orientation") or "1").strip()
    if word not in TURNS:
        raise InputError(f"{where}: orientation should be 1, 3, 6 or 8, not {word[:80]!r}")
    lying = word in ("6", "8")
    turned = camera.size[::-1] if lying else camera.size
    own = sizes.of(camera.name)
    if word == "1" or (lying and not is_scaled(turned, own) and is_scaled(camera.size, own)):
        return camera  # the photograph was never turned
    if camera.K[0, 1]:
        raise InputError(f"{where}: skew and an orientation of {word} cannot be read together")
    A, around = np.array(TURNS[word], float), np.eye(3)
    around[:2, :2] = A
    K = around @ camera.K @ around.T
    K[:2, 2] = A @ (camera.K[:2, 2] - np.array(camera.size) / 2) + np.array(turned) / 2
    lens = _turn_lens(camera.lens, A)
    return replace(camera, size=turned, K=K, R=around @ camera.R, t=around @ camera.t, lens=lens)


def _turn_lens(lens: Lens | None, A: np.ndarray) -> Lens | None:
    if lens is None:
        return None
    values = list(lens.parameters)
    at = 4 if lens.model == "BROWN" else 2  # of p1, p2
    p2, p1 = A @ [values[at + 1], values[at]]
    values[at : at + 2] = [float(p1), float(p2)]
    return Lens(lens.model, tuple(values))
