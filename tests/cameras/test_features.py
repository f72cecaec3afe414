import numpy as np
import PIL.ExifTags
import PIL.Image  # before pycolmap
import pillow_heif
import pycolmap
import pytest
from scenes import blotches, save
from scipy.ndimage import gaussian_filter

from silmesh.cameras.features import _sift, extract, keep_inside
from silmesh.cameras.matching import match
from silmesh.cameras.stages import DATABASE, Report, make_stage, read_report
from silmesh.errors import InputError
from silmesh.files import MADE
from silmesh.settings.cameras import Features, Matches
from silmesh.views import place_view


@pytest.fixture
def photographs(tmp_path):
    return [save(tmp_path / "photos" / f"{i}.png", blotches(i)) for i in range(4)]


def features(paths, tmp_path, name="db", **options):
    folder = tmp_path / name
    folder.mkdir()
    settings = Features(max_size=options.pop("max_size", 1600), features=options.pop("count", 500))
    report = extract(paths, settings, folder=folder, **{"threads": 1} | options)
    return report, folder / DATABASE


def read(database):
    """Each image's name, camera, keypoints and descriptors."""
    with pycolmap.Database.open(database) as opened:
        return {
            image.image_id: (
                image.name,
                opened.read_camera(image.camera_id),
                opened.read_keypoints(image.image_id),
                opened.read_descriptors(image.image_id).data,
            )
            for image in opened.read_all_images()
        }


def test_images_are_numbered_and_named_as_the_views(photographs, tmp_path):
    told = []
    report, database = features(photographs, tmp_path, progress=told.append)
    assert told == [0.25, 0.5, 0.75, 1]
    found = read(database)
    assert {i: row[0] for i, row in found.items()} == {1: "0", 2: "1", 3: "2", 4: "3"}
    assert report.figures["features"] == {row[0]: len(row[2]) for row in found.values()}
    assert report.figures["lenses"] == 1
    camera = found[1][1]
    assert (camera.width, camera.height, camera.focal_length) == (320, 240, 1.2 * 320)
    assert not camera.has_prior_focal_length


def test_twice_the_features_are_kept_after_those_of_the_limit(photographs, tmp_path):
    report, database = features(photographs, tmp_path, count=200)
    for (name, _, keypoints, descriptors), path in zip(
        read(database).values(), photographs, strict=True
    ):
        with PIL.Image.open(path) as image:
            limited = _sift(np.asarray(image.convert("L")), 200)
        first = report.figures["features_first"][name]
        assert 200 < first < report.figures["features"][name]
        np.testing.assert_array_equal(keypoints[:first], limited[0])
        np.testing.assert_array_equal(descriptors[:first], limited[1])


def test_only_the_features_of_the_limit_are_matched_at_first(photographs, tmp_path):
    images = [PIL.Image.open(path) for path in photographs]
    copies = [save(tmp_path / "c" / f"{i}.png", np.asarray(images[0])[:, i:]) for i in (0, 9, 20)]
    report, database = features(copies, tmp_path, count=200)
    (tmp_path / "m").mkdir()
    match(database, Matches(), 1, tmp_path / "m", report)
    first = list(report.figures["features_first"].values())
    with pycolmap.Database.open(tmp_path / "m" / DATABASE) as opened:
        for pair, found in zip(*opened.read_all_matches(), strict=True):
            places = [i - 1 for i in pycolmap.pair_id_to_image_pair(pair)]
            assert len(found) > 20
            assert (np.asarray(found).max(axis=0) < [first[i] for i in places]).all()
    assert len(read(tmp_path / "m" / DATABASE)[1][2]) == report.figures["features"]["0"]


def test_an_unreadable_photograph_is_left_out_and_keeps_its_number(photographs, tmp_path):
    photographs[1].write_bytes(photographs[1].read_bytes()[:500])
    report, database = features(photographs, tmp_path)
    assert {i: row[0] for i, row in read(database).items()} == {1: "0", 3: "2", 4: "3"}
    assert list(report.dropped) == ["1"]
    assert report.dropped["1"].startswith(f"{photographs[1]}: cannot be read as an image: ")
    for path in photographs[2:]:
        path.write_text("no image")
    with pytest.raises(InputError, match="there are 1 different photographs"):
        features(photographs, tmp_path, "few")


def test_equal_names_and_telephones_formats(photographs, tmp_path):
    """What COLMAP cannot read has its focal length as well: 28 mm on film of 43.3 mm diagonal."""
    pillow_heif.register_heif_opener()
    exif = PIL.Image.Exif()
    exif.get_ifd(PIL.ExifTags.IFD.Exif)[41989] = 28
    paths = []
    for photograph, name in zip(photographs, ("r1/a.heic", "r2/a.avif", "r1/b.jpg"), strict=False):
        paths.append(tmp_path / name)
        paths[-1].parent.mkdir(exist_ok=True)
        with PIL.Image.open(photograph) as image:
            image.convert("RGB").save(paths[-1], exif=exif.tobytes())
    report, database = features(paths, tmp_path)
    assert [row[0] for row in read(database).values()] == ["r1_a", "r2_a", "r1_b"]
    expected = 28 / np.hypot(36, 24) * np.hypot(320, 240)
    assert report.figures["focal_from_exif"] == pytest.approx(
        {"r1_a": expected, "r2_a": expected, "r1_b": expected}, rel=1e-3
    )


@pytest.mark.parametrize("value", ["far", 0])
def test_a_focal_length_that_is_none_is_left_out(photographs, tmp_path, value):
    pillow_heif.register_heif_opener()
    exif = PIL.Image.Exif()
    exif.get_ifd(PIL.ExifTags.IFD.Exif)[41989] = value
    paths = [tmp_path / f"{i}.avif" for i in range(3)]
    for photograph, path in zip(photographs, paths, strict=False):
        with PIL.Image.open(photograph) as image:
            image.convert("RGB").save(path, exif=exif.tobytes())
    assert features(paths, tmp_path)[0].figures["focal_from_exif"] == {}


def test_the_same_photographs_give_the_same_bytes_with_any_number_of_threads(photographs, tmp_path):
    one = features(photographs, tmp_path, "one")[1]
    two = features(photographs, tmp_path, "two", threads=2)[1]
    assert one.read_bytes() == two.read_bytes()


def test_a_photograph_that_was_made_smaller_has_keypoints_in_its_own_pixels(tmp_path):
    small = [blotches(i) for i in range(3)]
    paths = [save(tmp_path / "s" / f"{i}.png", p) for i, p in enumerate(small)]
    large = [
        save(tmp_path / "l" / f"{i}.png", p.repeat(4, 0).repeat(4, 1)) for i, p in enumerate(small)
    ]
    plain = read(features(paths, tmp_path, "plain")[1])[1]
    shrunk = read(features(large, tmp_path, "shrunk", max_size=320)[1])[1]
    assert shrunk[1].width == 1280
    apart = np.linalg.norm(shrunk[2][:, None, :2] / 4 - plain[2][None, :, :2], axis=2).min(axis=1)
    assert np.median(apart) < 0.1  # centres at integer + 0.5 scale about the corner


def test_a_photograph_is_turned_as_its_exif_says(photographs, tmp_path):
    exif = PIL.Image.Exif()
    exif[0x0112] = 6  # to be turned by 90 degrees
    for path in photographs:
        image = PIL.Image.open(path).rotate(90, expand=True)
        (tmp_path / "turned").mkdir(exist_ok=True)
        image.save(tmp_path / "turned" / path.name, exif=exif)
    turned = sorted((tmp_path / "turned").iterdir())
    upright, other = (
        read(features(p, tmp_path, n)[1])[2] for p, n in ((photographs, "a"), (turned, "b"))
    )
    np.testing.assert_array_equal(upright[2], other[2])


def test_the_focal_length_of_exif_is_taken(tmp_path):
    exif = PIL.Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 50  # as on 35 mm film, whose diagonal is 43.27 mm
    paths = []
    for i in range(3):
        paths.append(tmp_path / f"{i}.jpg")
        PIL.Image.fromarray(blotches(i)).save(paths[-1], exif=exif if i else PIL.Image.Exif())
    report, database = features(paths, tmp_path)
    cameras = [row[1] for row in read(database).values()]
    assert [c.has_prior_focal_length for c in cameras] == [False, True, True]
    assert cameras[1].focal_length == pytest.approx(50 * 400 / 43.27, rel=1e-3)
    assert report.figures["lenses"] == 2
    assert set(report.figures["focal_from_exif"]) == {"1", "2"}


def test_photographs_of_two_sizes_have_two_lenses(photographs, tmp_path):
    photographs.append(save(tmp_path / "photos" / "4.png", blotches(4, (240, 320))))
    report, database = features(photographs, tmp_path)
    assert report.figures["lenses"] == 2
    assert [row[1].width for row in read(database).values()] == [320] * 4 + [240]


def test_repeated_photographs_are_left_out_and_named(photographs, tmp_path):
    photographs.append(save(tmp_path / "photos" / "4.png", blotches(1)))
    report, database = features(photographs, tmp_path)
    assert report.dropped == {"4": "the same picture as '1'"}
    assert "'4', which is '1'" in report.warnings[0]
    assert list(read(database)) == [1, 2, 3, 4]


def test_a_blurred_photograph_is_named(photographs, tmp_path):
    blurred = gaussian_filter(blotches(9).astype(float), 12).astype(np.uint8)
    photographs.append(save(tmp_path / "photos" / "4.png", blurred))
    assert "perhaps blurred: 4 (fewer" in features(photographs, tmp_path)[0].warnings[0]


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([blotches(0), blotches(1)], "there are 2 different photographs; it takes at least 3"),
        ([blotches(0)] * 5, r"there are 1 different .* '1' is the same picture as '0'"),
        ([np.full((240, 320), 9 * i, np.uint8) for i in range(5)], "too little texture: 0 feat"),
        ([blotches(i, (120, 100)) for i in range(5)], "0.png: has 120x100 pixels; .* at least 200"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path, pictures, message):
    paths = [save(tmp_path / "p" / f"{i}.png", p) for i, p in enumerate(pictures)]
    with pytest.raises(InputError, match=message):
        features(paths, tmp_path)


def test_an_array_of_images_is_refused(tmp_path):
    np.save(tmp_path / "source.npy", np.zeros((3, 4, 64, 64), np.uint8))
    with pytest.raises(InputError, match=r"an array of images \(64x64 pixels\)"):
        features([tmp_path / "source.npy"], tmp_path)


def test_features_off_the_object_are_left_out_and_the_rest_stays(photographs, tmp_path):
    report, database = features(photographs, tmp_path)
    before = database.read_bytes()
    views = [place_view(p.stem, str(p), 320, 240, 64, "pad") for p in photographs]
    silhouettes = np.zeros((4, 64, 64), bool)
    silhouettes[:, :, 32:] = True  # the right half
    (tmp_path / "kept").mkdir()
    kept = keep_inside(database, views, silhouettes, tmp_path / "kept", report)
    assert database.read_bytes() == before
    everything, inside = read(database), read(tmp_path / "kept" / DATABASE)
    right = everything[2][2][:, 0] >= 160 - 3 * 320 / 64  # widened by three working pixels
    np.testing.assert_array_equal(inside[2][2], everything[2][2][right])
    np.testing.assert_array_equal(inside[2][3], everything[2][3][right])
    assert kept.figures["features_inside"]["1"] == right.sum()


def test_an_object_without_features_is_refused(photographs, tmp_path):
    report, database = features(photographs, tmp_path)
    views = [place_view(p.stem, str(p), 320, 240, 64, "pad") for p in photographs]
    silhouettes = np.zeros((4, 64, 64), bool)
    silhouettes[:, 32, 32] = True
    (tmp_path / "kept").mkdir()
    with pytest.raises(InputError, match="the object itself shows too little texture"):
        keep_inside(database, views, silhouettes, tmp_path / "kept", report)


def test_a_refused_stage_keeps_its_reason_and_nothing_else(tmp_path):
    def refuse(part, before):
        (part / "half").write_text("")
        raise InputError("no texture")

    make_stage(tmp_path / "a", Report(warnings=("w",)), refuse)
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"report.json", MADE}
    assert read_report(tmp_path / "a") == Report("no texture", warnings=("w",))
    make_stage(tmp_path / "b", read_report(tmp_path / "a"), refuse)
    assert read_report(tmp_path / "b").refusal == "no texture"
