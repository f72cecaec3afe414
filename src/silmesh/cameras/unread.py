"""What other programs write that is not read: what it is, and how to make of it what is read."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

METASHAPE = "File > Export > Export Cameras as Agisoft XML (cameras.xml)"
REALITY = "Alignment > Export > Registration: Internal/External camera parameters (.csv) or COLMAP"


class Unread(NamedTuple):
    """What a file is, and how its cameras can be had otherwise."""

    what: str
    instead: str

    def __str__(self) -> str:
        return f"is {self.what}, which is not read. Instead {self.instead}"


OPENSFM = Unread(
    "OpenSfM's (or OpenDroneMap's) reconstruction",
    "write a COLMAP model, `bin/opensfm export_colmap DATASET`, or Bundler's file, "
    "`bin/opensfm export_bundler DATASET`, and give that",
)
OPENMVG = Unread(
    "openMVG's sfm_data",
    "write a COLMAP model, `openMVG_main_openMVG2Colmap -i sfm_data.json -o model`, and give that",
)
SPLATS = Unread(
    "the list of cameras that Gaussian splatting writes beside its result",
    "give the COLMAP model (sparse/0) that it was made from",
)
POLYCAM = Unread(
    "a Polycam capture, with a file of its own for each camera",
    "convert it, `ns-process-data polycam --data CAPTURE.zip --output-dir OUT`, and give the "
    "transforms.json that this writes",
)
NERFIES = Unread("a camera of Nerfies or HyperNeRF", "give the COLMAP model that it was made from")
RECORD3D = Unread(
    "Record3D's metadata",
    "convert it, `ns-process-data record3d --data FOLDER --output-dir OUT`, and give the "
    "transforms.json that this writes",
)
ENDINGS = {
    ".nvm": Unread(
        "VisualSFM's reconstruction",
        "save it there as Bundler's bundle.out beside its list.txt (SfM > Save NV Match, with the "
        "ending .out), or align the photographs by COLMAP",
    ),
    ".mvs": Unread(
        "an OpenMVS scene",
        "give the cameras that it was made from, or write a COLMAP model, "
        "`InterfaceCOLMAP -i scene.mvs -o model`, and give that",
    ),
    ".abc": Unread(
        "an Alembic scene",
        "let Meshroom's node ConvertSfMFormat write it as .sfm or .json, and give that",
    ),
    **dict.fromkeys(
        (".psx", ".psz"), Unread("a project of Agisoft Metashape", f"write there {METASHAPE}")
    ),
    **dict.fromkeys(
        (".rcproj", ".rsproj", ".rcalign", ".rsalign"),
        Unread("a project of RealityCapture (RealityScan)", f"write there {REALITY}"),
    ),
    ".xmp": Unread("a sidecar, as RealityCapture writes for each photograph", f"write {REALITY}"),
    **dict.fromkeys(
        (
            ".blend",
            ".fbx",
            ".dae",
            ".usd",
            ".usda",
            ".usdc",
            ".usdz",
            ".ma",
            ".mb",
            ".glb",
            ".gltf",
        ),
        Unread(
            "the scene of a 3D program",
            "write its cameras as NeRF's transforms.json (for Blender the add-on BlenderNeRF "
            "does), or give what the program that found them writes",
        ),
    ),
    **dict.fromkeys(
        (".p4d", ".p4m"),
        Unread("a project of Pix4D", "export its undistorted images and cameras as COLMAP's"),
    ),
    ".db": Unread(
        "COLMAP's database of features, without poses",
        "give the model that its mapper writes (sparse/0)",
    ),
    ".ply": Unread("a mesh or a cloud of points", "give the cameras that it was made by"),
    ".log": Unread(
        "a trajectory, as Tanks and Temples has it, without focal lengths",
        "give the COLMAP model that it was made from",
    ),
    **dict.fromkeys(
        (".yml", ".yaml"),
        Unread(
            "YAML, as calibration programs write it",
            "give poses and focal lengths as a COLMAP model or NeRF's transforms.json",
        ),
    ),
    **dict.fromkeys(
        (".pkl", ".pickle", ".pt", ".pth"),
        Unread(
            "a pickle, which may hold any program",
            "save the matrices as .npz (world_mat_0, world_mat_1, ...)",
        ),
    ),
}
WITHIN = (  # patterns in a folder, and what such a file holds near its beginning: what it is
    ("reconstruction.json", b"", OPENSFM),
    ("opensfm/reconstruction.json", b"", OPENSFM),
    ("sfm_data.json", b"", OPENMVG),
    ("keyframes/corrected_cameras/*.json", b"", POLYCAM),
    ("keyframes/cameras/*.json", b"", POLYCAM),
    ("corrected_cameras/*.json", b'"t_0', POLYCAM),
    ("cameras/*.json", b'"t_0', POLYCAM),
    ("*.json", b'"t_0', POLYCAM),
    ("camera/*.json", b"focal_length", NERFIES),
)
BEGINNING = 4096  # bytes of a file by which its format is recognised
ROOTS = {  # of XML: the name of its outermost element
    "BlocksExchange": Unread(
        "ContextCapture's blocks (BlocksExchange)",
        f"of Metashape write {METASHAPE}; of others a COLMAP model or Bundler's bundle.out",
    ),
    "opencv_storage": Unread(
        "OpenCV's storage of a calibration",
        "give poses and focal lengths as a COLMAP model or NeRF's transforms.json",
    ),
}


def _keys(content: Any) -> set[str]:
    return set(content) if isinstance(content, dict) else set()


def _is_splats(content: Any) -> bool:
    rows = content if isinstance(content, list) else []
    return bool(rows) and {"img_name", "rotation", "position"} <= _keys(rows[0])


def _is_opensfm(content: Any) -> bool:
    rows = content if isinstance(content, list) else []
    return bool(rows) and {"cameras", "shots"} <= _keys(rows[0])


def _is_polycam(content: Any) -> bool:
    return {"t_00", "t_23", "fx"} <= _keys(content)


JSON: tuple[tuple[Callable[[Any], bool], Unread], ...] = (
    (_is_opensfm, OPENSFM),
    (_is_splats, SPLATS),
    (_is_polycam, POLYCAM),
    (lambda content: "sfm_data_version" in _keys(content), OPENMVG),
    (lambda content: {"views", "intrinsics", "extrinsics"} <= _keys(content), OPENMVG),
    (lambda content: {"orientation", "position", "focal_length"} <= _keys(content), NERFIES),
    (lambda content: {"poses", "K"} <= _keys(content), RECORD3D),
)


def recognise_json(content: Any) -> Unread | None:
    """What the content of a JSON file is, if it is known and not read."""
    return next((unread for is_it, unread in JSON if is_it(content)), None)


def recognise_root(name: str) -> Unread | None:
    """What an XML file is by its outermost element, if it is known and not read."""
    return ROOTS.get(re.sub(r"^\{.*\}", "", name))


def recognise_file(path: Path) -> Unread | None:
    """What a file is by its name, if it is known and not read."""
    return ENDINGS.get(path.suffix.lower())


def find_within(folder: Path) -> tuple[Path, Unread] | None:
    """The first file or folder in a folder that is known and not read, and what it is."""
    for pattern, marker, unread in WITHIN:
        for found in sorted(folder.glob(pattern))[:1]:
            if not marker or marker in read_beginning(found):
                return found.parent if "*" in pattern else found, unread
    for file in sorted(folder.iterdir()):
        if unread := recognise_file(file):
            return file, unread
    return None


def read_beginning(path: Path) -> bytes:
    """What a file's format is told by."""
    with open(path, "rb") as file:
        return file.read(BEGINNING)
