"""Every reader of a person's files, each with files that it reads, made here: what is changed.

Camera files go through the list of formats, so one that is new there needs a maker in ``CAMERAS``;
``test_fuzz`` fails until it has one.
"""

import io
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import pillow_heif
import torch
import trimesh
from PIL import Image, features
from scipy.io import savemat
from shots import NAMES, cameras, views
from tflite_files import write_tflite

from silmesh.cameras import formats
from silmesh.errors import InputError
from silmesh.fitting.checkpoint import Checkpoint
from silmesh.geometry.camera import write_cameras
from silmesh.geometry.lens import Lens
from silmesh.geometry.mesh_files import read_mesh, refuse_flat, to_tensors
from silmesh.intake.video import cut
from silmesh.planning.config import parse_config
from silmesh.planning.datasets import read_datasets
from silmesh.planning.yamls import read_configuration
from silmesh.report.tables import read_published
from silmesh.silhouettes.network import Weights as NetworkWeights
from silmesh.silhouettes.network import build_network, load_weights, write_weights
from silmesh.views import count_frames, read_image, read_photographs

GIVEN, VIEWS = cameras(), views()
P = GIVEN.projections.numpy()
Files = dict[str, bytes]


@dataclass(frozen=True)
class Reader:
    """A reader, and the files of a case that it reads.

    Attributes:
        name: of the reader and the case
        files: by their paths in a folder
        read: takes the folder
        share: of all inputs, beside 1 of most
    """

    name: str
    files: Files
    read: Callable[[Path], Any]
    share: float = 1.0


# Files of cameras ---------------------------------------------------------------------------------


def _colmap_text(folder: Path) -> None:
    lenses = [None, Lens("RADIAL", (0.1, -0.02)), Lens("FOV", (0.5,)), None]
    images = {name: f"{name}.jpg" for name in NAMES}
    formats.colmap_model.write(folder / "model", replace(GIVEN, lenses=tuple(lenses)), images)


def _colmap_binary(folder: Path) -> None:
    import pycolmap

    _colmap_text(folder)
    pycolmap.Reconstruction(folder / "model").write_binary(folder / "model")
    for file in folder.glob("model/*.txt"):
        file.unlink()


def _meshroom(folder: Path) -> None:
    R, centres = GIVEN.R.numpy(), GIVEN.centres.numpy()
    size = {"width": "640", "height": "480"}
    lens = {"type": "pinhole", "focalLength": "39.4", "sensorWidth": "36", "pixelRatio": "1"}
    lens |= {"principalPoint": ["11", "-12"], "distortionType": "brown"}
    content = {
        "version": ["1", "2", "11"],
        "views": [
            {"viewId": str(i), "poseId": str(i), "intrinsicId": "7", "path": f"/p/{name}.jpg"}
            | size
            for i, name in enumerate(NAMES)
        ],
        "intrinsics": [
            {"intrinsicId": "7", "distortionParams": ["0.1", "0", "0", "0.2", "0"]} | size | lens
        ],
        "poses": [
            {"poseId": str(i), "pose": {"transform": _sfm_pose(R[i], centres[i]), "locked": "0"}}
            for i in range(4)
        ],
    }
    (folder / "cameras.sfm").write_text(json.dumps(content))


def _sfm_pose(R: np.ndarray, centre: np.ndarray) -> dict[str, list[str]]:
    return {"rotation": [*map(str, R.flatten(order="F"))], "center": [*map(str, centre)]}


def _frames() -> list[dict[str, Any]]:
    flip = np.diag([1.0, -1, -1])
    frames = []
    for i, name in enumerate(NAMES):
        pose = np.eye(4)
        pose[:3, :3] = GIVEN.R[i].numpy().T @ flip
        pose[:3, 3] = GIVEN.centres[i].numpy()
        frames.append({"file_path": f"./images/{name}", "transform_matrix": pose.tolist()})
    return frames


def _nerf(folder: Path) -> None:
    shared = {"w": 640, "h": 480, "fl_x": 700.0, "fl_y": 690.0, "cx": 331.0, "cy": 228.0}
    shared |= {"k1": 0.1, "p1": 0.01, "camera_model": "OPENCV"}
    (folder / "transforms.json").write_text(json.dumps({**shared, "frames": _frames()}))


def _nerf_synthetic(folder: Path) -> None:
    frames = _frames()
    for part, own in (("train", frames[:2]), ("val", frames[2:3]), ("test", frames[3:])):
        content = {"camera_angle_x": 0.86, "frames": own}
        (folder / f"transforms_{part}.json").write_text(json.dumps(content))


def _silmesh(folder: Path) -> None:
    lenses = [None, Lens("RADIAL", (0.1, -0.02)), Lens("FISHEYE", ()), None]
    write_cameras(folder / "cameras.json", replace(GIVEN, lenses=tuple(lenses)))


def _texts(folder: Path) -> None:
    for name, matrix in zip(NAMES, P, strict=True):
        np.savetxt(folder / f"{name}.txt", matrix)


def _cells() -> np.ndarray:
    cells = np.empty((1, 4), object)
    for i in range(4):
        cells[0, i] = P[i]
    return cells


def _npz(folder: Path) -> None:
    whole = [np.r_[matrix, [[0, 0, 0, 1]]] for matrix in P]
    values = {f"world_mat_{i}": matrix for i, matrix in enumerate(whole)}
    values |= {f"scale_mat_{i}": np.eye(4) for i in range(4)}
    np.savez(folder / "cameras.npz", **values)


def _npz_of_dvr(folder: Path) -> None:
    values = {f"camera_mat_{i}": GIVEN.K[i].numpy() for i in range(4)}
    poses = [np.c_[GIVEN.R[i].numpy(), GIVEN.t[i].numpy()] for i in range(4)]
    values |= {f"world_mat_{i}": pose for i, pose in enumerate(poses)}
    np.savez_compressed(folder / "cameras.npz", **values)


def _middlebury(folder: Path) -> None:
    rows = [
        " ".join([f"{name}.png", *map(str, [*K.flatten(), *R.flatten(), *t])])
        for name, K, R, t in zip(NAMES, *(np.asarray(x) for x in (GIVEN.K, GIVEN.R, GIVEN.t)),
                                 strict=True)
    ]  # fmt: skip
    (folder / "temple_par.txt").write_text("\n".join(["4", *rows, ""]))


def _llff(folder: Path) -> None:
    rows = []
    for i in range(4):
        R, centre = GIVEN.R[i].numpy().T, GIVEN.centres[i].numpy()
        pose = np.c_[R[:, 1], R[:, 0], -R[:, 2], centre, [480, 640, 700]]
        rows.append([*pose.flatten(), 1.0, 9.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))


def _metashape(folder: Path) -> None:
    shots = "".join(
        f'<camera id="{i}" sensor_id="0" label="{name}.jpg"><transform>'
        + " ".join(map(str, np.linalg.inv(np.r_[np.c_[GIVEN.R[i], GIVEN.t[i]], [[0, 0, 0, 1]]])
                       .flatten()))
        + "</transform></camera>"
        for i, name in enumerate(NAMES)
    )  # fmt: skip
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0"><chunk label="c">'
        '<sensors next_id="1"><sensor id="0" label="s" type="frame">'
        '<resolution width="640" height="480"/><calibration type="frame" class="adjusted">'
        '<resolution width="640" height="480"/><f>700</f><cx>11</cx><cy>-12</cy><k1>0.1</k1>'
        f"</calibration></sensor></sensors><cameras>{shots}</cameras>"
        "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>1 2 3</translation>"
        "<scale>2.5</scale></transform></chunk></document>\n"
    )


def _bundler(folder: Path) -> None:
    flip = np.diag([1.0, -1, -1])
    blocks = []
    for i in range(4):
        R, t = flip @ GIVEN.R[i].numpy(), flip @ GIVEN.t[i].numpy()
        blocks.append("\n".join(["700 0 0", *(" ".join(map(str, row)) for row in (*R, t))]))
    (folder / "bundle.out").write_text("\n".join(["# Bundle file v0.3", "4 0", *blocks, ""]))
    (folder / "list.txt").write_text("".join(f"{name}.jpg 0 700\n" for name in NAMES))


def _realitycapture(folder: Path) -> None:
    rows = [f"{name}.jpg,{i}.0,2.0,3.0,10.0,20.0,30.0,35.0,0,0,0,0,0,0,0,0" for i, name in
            enumerate(NAMES)]  # fmt: skip
    header = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
    (folder / "cameras.csv").write_text("\n".join([header, *rows, ""]))


CAMERAS: dict[str, tuple[Callable[[Path], Any], str]] = {  # makers, and what is named of the folder
    "colmap text": (_colmap_text, "model"),
    "colmap binary": (_colmap_binary, "model"),
    "meshroom": (_meshroom, "cameras.sfm"),
    "nerf": (_nerf, "transforms.json"),
    "nerf synthetic": (_nerf_synthetic, ""),
    "silmesh": (_silmesh, "cameras.json"),
    "texts": (_texts, ""),
    "mat": (lambda folder: savemat(folder / "p.mat", {"Q": "text", "P": _cells()}), "p.mat"),
    "mat compressed": (
        lambda folder: savemat(folder / "p.mat", {"P": _cells()}, do_compression=True),
        "p.mat",
    ),
    "mat array": (
        lambda folder: savemat(folder / "p.mat", {"P": np.moveaxis(P, 0, 2).astype("f4")}),
        "p.mat",
    ),
    "npz": (_npz, "cameras.npz"),
    "npz of dvr": (_npz_of_dvr, "cameras.npz"),
    "middlebury": (_middlebury, "temple_par.txt"),
    "softras": (
        lambda folder: np.save(folder / "camera.npy", np.array([[2.7, 0, 90.0 * i] for i in
                                                                range(4)])),
        "camera.npy",
    ),
    "llff": (_llff, "poses_bounds.npy"),
    "metashape": (_metashape, "cameras.xml"),
    "bundler": (_bundler, "bundle.out"),
    "realitycapture": (_realitycapture, "cameras.csv"),
}  # fmt: skip


def _read_cameras(target: str) -> Callable[[Path], Any]:
    def read(folder: Path) -> None:
        formats.attempt_from_file(folder / target, VIEWS)

    return read


def _cameras() -> Iterator[Reader]:
    for name, (make, target) in CAMERAS.items():
        reader = Reader(f"cameras {name}", _made(make), _read_cameras(target))
        if format_of(reader):
            yield reader


def format_of(reader: Reader) -> str | None:
    """The key of the format that a reader's files are recognised as."""
    with tempfile.TemporaryDirectory() as folder:
        _write(reader.files, Path(folder))
        target = CAMERAS[reader.name.removeprefix("cameras ")][1]
        try:
            found = formats.recognise(Path(folder) / target)[0]
        except InputError:
            return None
    return next(key for key, format_ in formats.FORMATS.items() if format_ is found)


# Everything else ----------------------------------------------------------------------------------


def _mesh(kind: str, **options: Any) -> Files:
    ball = trimesh.creation.icosphere(subdivisions=1)
    data = ball.export(file_type=kind, **options)
    return {f"mesh.{kind.removesuffix('_ascii')}": data.encode() if isinstance(data, str) else data}


def _read_mesh(folder: Path) -> None:
    (path,) = folder.iterdir()
    mesh = read_mesh(path)
    refuse_flat(path, mesh)
    to_tensors(mesh)


def _meshes() -> Iterator[Reader]:
    kinds = {"ply": {}, "ply ascii": {"encoding": "ascii"}, "obj": {}, "glb": {}, "stl": {},
             "stl_ascii": {}, "off": {}}  # fmt: skip
    for kind, options in kinds.items():
        yield Reader(f"mesh {kind}", _mesh(kind.removesuffix(" ascii"), **options), _read_mesh)


def _image(ending: str, mode: str = "RGB", **options: Any) -> Files:
    pixels = np.random.default_rng(1).integers(0, 255, (24, 32, 4), np.uint8)
    image = Image.fromarray(pixels).convert(mode)
    packed = io.BytesIO()
    kind = {"jpg": "JPEG", "tif": "TIFF", "gif.png": "GIF"}.get(ending, ending.upper())
    if kind == "HEIF":
        pillow_heif.register_heif_opener()  # from then on Pillow writes it
    image.save(packed, kind, **options)
    return {f"shot.{ending}": packed.getvalue()}


def _read_image(folder: Path) -> None:
    (path,) = folder.iterdir()
    count_frames(path)
    view, image = VIEWS[0], read_image(path)
    view.into_square(image, Image.Resampling.LANCZOS)


def _images() -> Iterator[Reader]:
    exif = Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "Maker"
    kinds = [("png", "RGB", {}), ("png", "RGBA", {}), ("png", "P", {}), ("png", "I;16", {}),
             ("png", "RGB", {"exif": exif}), ("jpg", "RGB", {"exif": exif}), ("jpg", "CMYK", {}),
             ("tif", "RGB", {"compression": "tiff_lzw"}), ("tif", "RGB", {"exif": exif}),
             ("tif", "RGB", {"compression": "jpeg"}), ("tif", "F", {}),
             ("tif", "RGBA", {"compression": "tiff_deflate"}), ("webp", "RGB", {"exif": exif}),
             ("webp", "RGBA", {"lossless": True}), ("bmp", "RGB", {}), ("bmp", "P", {}),
             ("gif.png", "P", {}), ("heif", "RGB", {"exif": exif}),
             ("heif", "RGBA", {})]  # fmt: skip
    if features.check("avif"):
        kinds.append(("avif", "RGB", {"exif": exif}))
    for ending, mode, options in kinds:
        name = f"image {ending} {mode} {options.get('compression', ' '.join(options))}"
        yield Reader(name.strip(), _image(ending, mode, **options), _read_image)


def _array() -> Reader:
    def make(folder: Path) -> None:
        np.save(folder / "source.npy", np.zeros((3, 4, 16, 16), np.uint8))

    def read(folder: Path) -> None:
        for _ in read_photographs([folder / "source.npy"]):
            pass

    return Reader("array", _made(make), read)


def _weights(legacy: bool) -> Reader:
    with torch.device("meta"):
        build_network("resnet50", 2)  # what is imported for it takes seconds once

    def make(folder: Path) -> None:
        state = {"backbone.0.weight": torch.zeros(4, 3), "classifier.4.weight": torch.ones(2, 4)}
        held = NetworkWeights("resnet50", ("a", "b"), (0.5,) * 3, (0.2,) * 3, 192, state)
        write_weights(folder / "w.pt", held)
        if legacy:
            held = torch.load(folder / "w.pt", weights_only=True)
            torch.save(held, folder / "w.pt", _use_new_zipfile_serialization=False)

    return Reader(
        f"weights{' legacy' * legacy}",
        _made(make),
        lambda folder: load_weights(str(folder / "w.pt"), "mobilenet_v3_large"),
        share=0.3,  # each builds networks to compare with
    )


def _tflite() -> Reader:
    return Reader(
        "weights tflite",
        _made(lambda folder: write_tflite(folder / "w.tflite")),
        lambda folder: load_weights(str(folder / "w.tflite"), "mobilenet_v2"),
        share=0.02,  # millions of bytes each, nearly all of them weights
    )


def _checkpoint() -> Reader:
    def make(folder: Path) -> None:
        state = {"fit": {"steps": 3, "u": torch.zeros(5, 3)}, "records": [(0, 0.1)]}
        Checkpoint(folder / "c.pt", ["one"], every=0).offer(lambda: state)

    def read(folder: Path) -> None:
        found = Checkpoint(folder / "c.pt", ["one"]).read()
        assert found is None or isinstance(found, dict)

    return Reader("checkpoint", _made(make), read)


def _varint(value: int) -> bytes:
    low, high = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(high) if high else bytes([low])


def _field(number: int, value: bytes | str | int) -> bytes:
    """A field of a protocol buffer."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    value = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def foreground_model(size: int = 8, channels: int = 3, batch: int | str = 1) -> bytes:
    """An ONNX model that takes an image [1, 3, size, size] and gives its brightest colour.

    It adds a weight of 0 to it.

    Args:
        batch: photographs at once, or a name for their number
    """

    def described(name: str, shape: list[int | str]) -> bytes:
        sides = b"".join(
            _field(1, _field(2 if isinstance(side, str) else 1, side)) for side in shape
        )
        return _field(1, name) + _field(2, _field(1, _field(1, 1) + _field(2, sides)))  # of float

    axes = _field(1, "axes") + _field(8, 1) + _field(20, 7)  # whole numbers
    brightest = _field(1, "x") + _field(2, "z") + _field(4, "ReduceMax") + _field(5, axes)
    add = _field(1, "z") + _field(1, "w") + _field(2, "y") + _field(4, "Add")
    weight = _field(1, 1) + _field(2, 1) + _field(8, "w") + _field(9, bytes(4))  # a float
    graph = _field(1, brightest) + _field(1, add) + _field(2, "g") + _field(5, weight)
    graph += _field(11, described("x", [batch, channels, size, size]))
    graph += _field(12, described("y", [batch, 1, size, size]))
    return _field(1, 7) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 11))


def _foreground() -> Reader:
    from silmesh.silhouettes.matting import _ask, open_model

    def read(folder: Path) -> None:
        model = open_model(folder / "m.onnx", 1)
        size = tuple(side.get_length() for side in model.input(0).partial_shape)[2:]
        _ask(model, str(folder / "m.onnx"), np.zeros((1, 3, *size), np.float32))

    return Reader("foreground", {"m.onnx": foreground_model()}, read, share=0.6)


CONFIGURATION = b"""# a run
datasets: datasets.tsv
views: &views {size: 256, resize: pad}
quality: {policy: auto, fewest: 3}
train: {holdout: [cup, plate], epochs: 3, learning_rate: 0.01}
variants:
  uninitialised:
    init: {shape: sphere, vertices: 1352, align: none}
    fit: {preset: softras, iterations: 2000, betas: [0.5, 0.99], weights: {laplacian: 0.1}}
  auto:
    views: *views
    cameras: file:cameras.json
    silhouettes: matting
    fit: {preset: fast, remesh: false, sigma: auto}
"""


def _read_configuration(folder: Path) -> None:
    path = folder / "config.yaml"
    parse_config(read_configuration(path), str(path))


def _table() -> Reader:
    rows = "object\timages\tmasks\tsilhouettes\tcameras\tturntable\ttruth\tvariants\n"
    rows += "cup\tcup\tmasks/*.png\tmask\tturntable\t2.732,0,5\t\ta,b\n"
    rows += "pot\tpot.npy\t\talpha\tfile:cameras.json\t,,5\tpot.ply\t\n"
    pictures = {f"{where}/{i}.png": b"" for where in ("cup", "masks") for i in range(3)}
    packed = io.BytesIO()
    np.save(packed, np.zeros((3, 4, 2, 2), np.uint8))
    beside = pictures | {"pot.npy": packed.getvalue(), "cameras.json": b"[]", "pot.ply": b""}

    def read(folder: Path) -> None:
        for name, data in beside.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(data)
        read_datasets(folder / "datasets.tsv")

    return Reader("table", {"datasets.tsv": rows.encode()}, read)


def _published() -> Reader:
    rows = [f"cup,auto,{i},{1 / (i + 1)}" for i in range(20)]
    text = "\n".join(["object,variant,iteration,loss", *rows, ""])
    return Reader(
        "published", {"p.csv": text.encode()}, lambda folder: read_published(folder / "p.csv")
    )


def _video() -> Reader:
    def make(folder: Path) -> None:
        with av.open(str(folder / "turn.mp4"), "w", format="mp4") as film:
            stream = film.add_stream("mpeg4", rate=30)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for i in range(6):
                picture = np.full((48, 64, 3), 40 * i, np.uint8)
                film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            film.mux(stream.encode())

    return Reader(
        "video",
        _made(make),
        lambda folder: cut(folder / "turn.mp4", folder / "frames"),
        share=0.3,
    )


def _made(make: Callable[[Path], Any]) -> Files:
    """The files that a maker leaves in a folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(folder)
        files = sorted(file for file in folder.rglob("*") if file.is_file())
        return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def _write(files: Files, folder: Path) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


@cache
def readers() -> tuple[Reader, ...]:
    """All of them."""
    # What the formats' own code raises is to be found, not made a refusal of.
    formats.reading = lambda path, what: nullcontext()
    return (
        *_cameras(),
        *_meshes(),
        *_images(),
        _array(),
        _weights(False),
        _weights(True),
        _tflite(),
        _checkpoint(),
        Reader("configuration", {"config.yaml": CONFIGURATION}, _read_configuration),
        _table(),
        _published(),
        _video(),
        _foreground(),
    )
