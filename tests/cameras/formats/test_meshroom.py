"""Meshroom's cameras.sfm, in the schemas that its versions write, all values as strings."""

import json

import numpy as np
import pytest
from shots import HEIGHT, NAMES, WIDTH, assert_seen, by_definition, cameras, views

from silmesh.cameras.formats import attempt_from_file
from silmesh.errors import InputError
from silmesh.geometry.lens import Lens

GIVEN = cameras()  # f = (700, 690), c = (331, 228), which AliceVision counts from pixel centres


def as_strings(value):
    if isinstance(value, dict):
        return {key: as_strings(v) for key, v in value.items()}
    if isinstance(value, list | np.ndarray):
        return [as_strings(v) for v in value]
    return value if isinstance(value, str) else repr(float(value)) if value % 1 else str(int(value))


def intrinsics(version):
    """The pinhole 700, 690, 331, 228 as this version says it."""
    minor = tuple(map(int, version.split(".")))
    row = {"intrinsicId": "12", "width": WIDTH, "height": HEIGHT, "serialNumber": "x"}
    row |= {"type": "pinhole", "initializationMode": "estimated", "locked": "0"}
    row |= {"sensorWidth": 36, "sensorHeight": 24, "distortionParams": ""}
    offset = [331 - WIDTH / 2, 228 - HEIGHT / 2]
    row["principalPoint"] = [331, 228] if minor < (1, 2, 1) else offset
    if minor < (1, 2, 0):
        return row | {"pxFocalLength": 700, "pxInitialFocalLength": -1}
    if minor < (1, 2, 2):
        return row | {"pxFocalLength": [700, 690]}
    mm = 36 / WIDTH
    if minor < (1, 2, 5):
        return row | {"focalLength": 700 * mm, "pixelRatio": 700 / 690}
    row |= {"pixelRatio": 690 / 700, "distortionType": "none"}
    return row | {"focalLength": (700 if minor < (1, 2, 11) else 690) * mm}


def sfm(version="1.2.11", lens=None, poses=range(4), **view):
    rows = [
        {"viewId": str(40 + i), "poseId": str(40 + i), "intrinsicId": "12"}
        | {"path": f"C:\\photos\\{name}.JPG", "width": WIDTH, "height": HEIGHT, "metadata": ""}
        | view
        for i, name in enumerate(NAMES)
    ]
    transforms = [
        {"rotation": GIVEN.R[i].numpy().flatten(order="F"), "center": GIVEN.centres[i].numpy()}
        for i in poses
    ]
    return {
        "version": version.split("."),
        "featuresFolders": ["/somewhere"],
        "views": rows,
        "intrinsics": [intrinsics(version) | (lens or {})],
        "poses": [
            {"poseId": str(40 + i), "pose": {"transform": transform, "locked": "0"}}
            for i, transform in zip(poses, transforms, strict=True)
        ],
    }


def read(tmp_path, content, name="cameras.sfm"):
    (tmp_path / name).write_text(json.dumps(as_strings(content)))
    return attempt_from_file(tmp_path / name, views())


@pytest.mark.parametrize(
    "version", ["1.0.0", "1.2.0", "1.2.1", "1.2.3", "1.2.6", "1.2.8", "1.2.14"]
)
@pytest.mark.parametrize("name", ["cameras.sfm", "sfm.json"])
def test_every_version_has_its_conventions(tmp_path, version, name):
    attempt = read(tmp_path, sfm(version), name)
    assert attempt.figures["format"] == "Meshroom's cameras.sfm"
    K = np.array([[700, 0, 331.5], [0, 700 if version == "1.0.0" else 690, 228.5], [0, 0, 1]])
    expected = [by_definition(K, GIVEN.R[i], GIVEN.t[i]) for i in range(4)]
    assert_seen(attempt.cameras, np.stack(expected))
    assert attempt.cameras.lenses == (None,) * 4


@pytest.mark.parametrize(
    ("version", "kind", "values", "lens"),
    [
        ("1.2.3", {"type": "radial1"}, [0.1], Lens("SIMPLE_RADIAL", (0.1,))),
        (
            "1.2.3",
            {"type": "radial3"},
            [0.1, 2, 3],
            Lens("FULL_OPENCV", (0.1, 2, 0, 0, 3, 0, 0, 0)),
        ),
        (
            "1.2.8",
            {"distortionType": "brown"},
            [0.1, 2, 3, 0.4, 0.5],
            Lens("FULL_OPENCV", (0.1, 2, 0.4, 0.5, 3, 0, 0, 0)),
        ),
        (
            "1.2.11",
            {"distortionType": "fisheye"},
            [0.1, 0.2, 0.3, 0.4],
            Lens("OPENCV_FISHEYE", (0.1, 0.2, 0.3, 0.4)),
        ),
        ("1.2.3", {"type": "fisheye1"}, [0.9], Lens("FOV", (0.9,))),
        ("1.2.8", {"distortionType": "radialk3"}, "", None),
    ],
)
def test_a_lens(tmp_path, version, kind, values, lens):
    content = sfm(version, lens=kind | {"distortionParams": values})
    assert read(tmp_path, content).cameras.lenses == (lens,) * 4


def test_a_lens_that_is_scaled_to_keep_radius_one(tmp_path):
    lens = {"distortionType": "radialk3pt", "distortionParams": [0.1, 0.05, -0.03]}
    found = read(tmp_path, sfm("1.2.8", lens=lens)).cameras
    x = np.array([[0.3, -0.2]])
    r2 = 0.13
    factor = (1 + 0.1 * r2 + 0.05 * r2**2 - 0.03 * r2**3) / 1.12
    expected = x * factor * [700, 690] + [331.5, 228.5]
    K = found.K[0].numpy()
    at = found.lenses[0].distort(x) @ K[:2, :2].T + K[:2, 2]
    np.testing.assert_allclose(at, expected / 10 + [0, 8])


def test_a_view_without_a_pose_is_dropped(tmp_path):
    attempt = read(tmp_path, sfm(poses=[0, 1, 3]))
    assert attempt.cameras.views == ("shot_1", "shot_2", "shot_11")
    file = tmp_path / "cameras.sfm"
    assert attempt.dropped == {"shot_10": f"{file} has no camera for it"}
    assert attempt.warnings == (
        f"{file}: 1 of 4 photographs have no camera and are left out: 'shot_10'",
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            sfm(poses=[]),
            "none of its 4 views has a pose; should be the cameras.sfm that Meshroom's",
        ),
        (sfm(lens={"distortionType": "3deradial4"}), "the lens '3deradial4' cannot be read; known"),
        (
            sfm(lens={"undistortionType": "3declassicld", "undistortionParams": [0.1]}),
            "its lens 'none' has an undistortion '3declassicld' beside",
        ),
        (
            sfm(lens={"distortionType": "radialk1", "distortionParams": [0.1, 0.2]}),
            r"its lens 'radialk1' has terms \['0.2'\] beside, which cannot be read",
        ),
        (sfm(lens={"distortionParams": [0.1]}), r"its lens 'none' has terms \['0.1'\] beside"),
        (sfm(lens={"focalLength": -3}), "should be positive: a negative one mirrors"),
        (sfm(lens={"principalPoint": ["nan", "0"]}), "principalPoint: should be finite numbers"),
        (sfm(isPoseIndependant="false"), "view shot_1.JPG: is part of a rig"),
        (sfm(intrinsicId="13"), "its intrinsics 13 are not in the file"),
        (sfm() | {"views": "x"}, "should hold a list of objects with 'viewId'"),
        (sfm(poseId=[]), "none of its 4 views has a pose"),
        (sfm(poseId={"a": 1}), "none of its 4 views has a pose"),
        (sfm(intrinsicId=["12"]), "its intrinsics .* are not in the file"),
        (sfm(viewId=[]), "each 'viewId' should be a name or a number of its own"),
        (sfm(lens={"width": 0}), "width and height should be whole numbers from 1 to"),
        (sfm(lens={"height": "1e99"}), "width and height: should be numbers up to"),
        (sfm(lens={"sensorWidth": 0}), "sensorWidth and pixelRatio should be above 0, not 0 and"),
        (sfm(lens={"distortionParams": {"a": 1}}), "distortionParams should be a list"),
        (sfm(lens={"focalLength": [1, 2]}), "focalLength: should be finite numbers of shape"),
        (sfm() | {"poses": [{"poseId": "40"}]}, "should have an object 'pose', not None"),
        (
            sfm() | {"poses": [{"poseId": "40", "pose": {"transform": []}}]},
            r"should have an object 'transform', not \[\]",
        ),
    ],
)
def test_a_wrong_file_is_named(tmp_path, content, message):
    with pytest.raises(InputError, match=message) as error:
        read(tmp_path, content)
    assert str(tmp_path / "cameras.sfm") in str(error.value)
