"""What other programs write that is not read is named for what it is, with a way out."""

import json

import pytest
from shots import views

from silmesh.cameras.formats import attempt_from_file
from silmesh.cameras.locate import locate
from silmesh.errors import InputError

POLYCAM = {f"t_{i}{j}": 0.0 for i in range(3) for j in range(4)} | {"fx": 1, "width": 2}
NERFIES = {"orientation": [], "position": [], "focal_length": 1}
OPENSFM = [{"cameras": {}, "shots": {}, "points": {}}]
OPENMVG = {"sfm_data_version": "0.3", "views": [], "intrinsics": [], "extrinsics": []}
SPLATS = [{"id": 0, "img_name": "a", "position": [0, 0, 0], "rotation": [], "fx": 1}]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("scene.nvm", "is VisualSFM's reconstruction, .* Bundler's bundle.out"),
        ("scene.MVS", "is an OpenMVS scene, .*InterfaceCOLMAP"),
        ("cameras.abc", "is an Alembic scene, .* ConvertSfMFormat"),
        ("cup.psx", r"is a project of Agisoft Metashape, .* Agisoft XML \(cameras.xml\)"),
        ("cup.rcproj", "is a project of RealityCapture .* Internal/External camera parameters"),
        ("cup.blend", "is the scene of a 3D program, .* transforms.json"),
        ("database.db", "is COLMAP's database of features, without poses.*sparse/0"),
        ("poses.pkl", "is a pickle, which may hold any program"),
    ],
)
@pytest.mark.parametrize("folder", [False, True])
def test_a_file_by_its_name(tmp_path, name, message, folder):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(tmp_path if folder else tmp_path / name, views())
    assert str(error.value).startswith(f"{tmp_path / name}: is ")


@pytest.mark.parametrize(
    ("place", "content", "message"),
    [
        ("reconstruction.json", OPENSFM, "is OpenSfM's .* export_colmap"),
        ("sfm_data.json", OPENMVG, "is openMVG's sfm_data, .*openMVG_main_openMVG2Colmap"),
        ("cameras.json", SPLATS, "Gaussian splatting writes .*sparse/0"),
        ("cameras/1.json", POLYCAM, "is a Polycam capture"),
        ("camera/1.json", NERFIES, "is a camera of Nerfies"),
        ("keyframes/cameras/1.json", POLYCAM, "is a Polycam capture, .*ns-process-data polycam"),
    ],
)
def test_json_by_its_content_and_its_place(tmp_path, place, content, message):
    file = tmp_path / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        attempt_from_file(file, views())
    with pytest.raises(InputError, match=message) as error:
        attempt_from_file(tmp_path, views())
    assert str(error.value).startswith(f"{file.parent if '/' in place else file}: is ")


def test_a_folder_of_cameras_of_another_kind_is_not_polycams(tmp_path):
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "1.json").write_text("{}")
    with pytest.raises(InputError, match="holds no cameras; known are"):
        attempt_from_file(tmp_path, views())


def test_what_is_read_goes_before_what_is_not(tmp_path):
    (tmp_path / "scene.nvm").touch()
    (tmp_path / "transforms.json").touch()
    assert locate(tmp_path).path == tmp_path / "transforms.json"


def test_a_folder_of_several_files_wants_one_named(tmp_path):
    for name in ("a.sfm", "b.sfm"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(InputError, match=r"holds 2 files of cameras; name one of a.sfm, b.sfm"):
        attempt_from_file(tmp_path, views())
