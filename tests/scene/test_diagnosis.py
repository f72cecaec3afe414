"""What is measured of photographs that make no mesh, each cause by its own sentence."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from turns import ROUND, turn

from silmesh.geometry.frame import is_cut
from silmesh.scene.diagnosis import describe_cut, describe_masks, diagnose
from silmesh.silhouettes import read_silhouettes, write_silhouettes
from silmesh.views import place_view, write_views

SIZE = 48


def views(count, width=48, height=48):
    return [
        place_view(f"IMG_{i}", f"IMG_{i}.jpg", width, height, SIZE, "pad") for i in range(count)
    ]


def test_nothing_is_said_of_one_good_round():
    assert diagnose(turn(18, 15), views(18)) == []


def test_the_frame_of_a_padded_photograph():
    """The photograph fills rows 6 to 42 of its image: what ends there is cut."""
    seen = turn(12, 15)
    seen[:, 42:] = seen[:, :6] = False
    wide = views(12, 48, 36)
    seen[4, 41, 20:30] = seen[7, 6, 20:24] = True
    (said,) = (s for s in diagnose(seen, wide) if "frame" in s)
    cut = [i for i in range(12) if seen[i, 6].any() or seen[i, 41].any()]
    assert {4, 7} <= set(cut)
    assert said.startswith(f"the frame cuts the object in {len(cut)} of 12 photographs (IMG_")
    assert not is_cut(seen, [(0, 0, 48, 48)] * 12).any()


@pytest.mark.parametrize("upright", [1, 4, 9])
def test_photographs_that_lost_their_orientation(upright):
    shown = views(12, 64, 48)
    for i in range(upright):
        shown[i] = place_view(f"IMG_{i}", "", 48, 64, SIZE, "pad")
    said = diagnose(turn(12, 15), shown)
    assert len(said) == 1
    assert said[0].startswith(
        f"{upright} of 12 photographs are upright (48x64) and {12 - upright} are lying (64x48)"
    )
    fewer = "IMG_0" if upright < 6 else "IMG_9"
    assert f"turn {fewer}" in said[0]


def test_photographs_of_several_sizes():
    shown = [*views(9), *views(2, 48, 40), *views(1, 30, 30)]
    (said,) = diagnose(turn(12, 15), shown)
    assert said.startswith(
        "the photographs differ in size (9 of 48x48, 2 of 48x40, 1 of 30x30): if some were cropped"
    )


def test_rounds_are_named_with_what_to_do():
    seen = np.concatenate([turn(18, 5), turn(18, 40)])
    (said,) = diagnose(seen, views(36))
    assert said.startswith(
        "the photographs fall in 2 rounds: IMG_0 to IMG_17 (18), IMG_18 to IMG_35 (18); if one axis"
    )
    assert "give the photographs of one alone" in said


def test_a_long_pause_between_photographs(tmp_path):
    shown = []
    for i in range(12):
        exif = Image.Exif()
        minute, second = divmod(5 * i + (600 if i >= 5 else 0), 60)
        exif.get_ifd(0x8769)[36867] = f"2024:05:01 10:{minute:02}:{second:02}"
        path = tmp_path / f"{i}.jpg"
        Image.new("RGB", (48, 48)).save(path, exif=exif)
        shown.append(place_view(str(i), str(path), 48, 48, SIZE, "pad"))
    (said,) = diagnose(turn(24, 15, ROUND)[:12], shown)
    assert said.startswith(
        "the photographs fall in 2 rounds, taken with a long pause between: 0 to 4 (5), 5 to 11 (7)"
    )


def test_pieces_emptiness_and_size():
    seen = turn(12, 15)
    seen[:4, 2:6, 2:6] = True
    seen[11] = False
    said = diagnose(seen, views(12))
    assert said[0].startswith("no object is found in 1 of 12 photographs (IMG_11)")
    assert said[1].startswith("the silhouettes of 4 of 11 photographs come in several pieces, 2 in")
    assert len(said) == 2
    unread = [*views(11), replace(views(12)[11], unreadable="it is truncated")]
    assert len(diagnose(seen, unread)) == 1  # of that another line tells
    tiny = np.zeros_like(seen)
    tiny[:, 20:23, 20:23] = True
    assert diagnose(tiny, views(12))[0].startswith("the object covers 0.39% of half of the")


def test_order():
    mixed = turn(36, 15)[np.random.default_rng(0).permutation(36)]
    (said,) = diagnose(mixed, views(36))
    assert "seem not to be in the order in which they were taken" in said
    wrong = turn(36, 15)
    wrong[16] = wrong[7]
    (said,) = diagnose(wrong, views(36))
    assert said.startswith("1 of 36 silhouettes differ from both their neighbours")
    assert "(IMG_16)" in said


def test_of_a_coherent_scene_only_a_frame_that_cuts_many(tmp_path):
    for i in range(8):
        mask = np.zeros((36, 48), np.uint8)
        mask[10 : 36 if i < 3 else 30, 20:30] = 255
        Image.fromarray(mask).save(tmp_path / f"{i}.png")
    files = sorted(tmp_path.glob("*.png"))
    shown = write_views(files, SIZE, "pad", tmp_path / "views")
    write_silhouettes("mask", shown, tmp_path / "views", files, tmp_path / "seen")
    seen = read_silhouettes(tmp_path / "seen", [view.view for view in shown])
    (said,) = diagnose(seen, shown, coherent=True)
    assert said.startswith("the frame cuts the object in 3 of 8 photographs (0, 1, 2): what ")


@pytest.mark.parametrize(
    ("cut", "advice"),
    [
        (3, "leave those out, or photograph the whole object"),
        (12, "what lies beyond only the other 4 show; add more such, or photograph the whole"),
        (16, "photograph the whole object, from further away"),
    ],
)
def test_views_that_most_are_like_are_not_advised_to_be_left_out(cut, advice):
    seen = np.zeros((16, SIZE, SIZE), bool)
    seen[:, 20:30, 20:30] = True
    seen[:cut, 20:, 20:30] = True
    (said,) = describe_cut(seen, views(16, SIZE, SIZE))
    assert said.split("): ")[1].startswith(advice)


def test_the_values_of_masks(tmp_path):
    files = [tmp_path / f"{i}.png" for i in range(3)]
    for file, values in zip(files, ([0, 1], [0, 2], [0, 7]), strict=True):
        Image.fromarray(np.uint8([values] * 4)).save(file)
    (said,) = describe_masks(files)
    assert said.startswith("the masks hold the values 0, 1, 2, 7: 0 should be the background")
    Image.fromarray(np.arange(64, dtype=np.uint8).reshape(8, 8)).save(files[1])
    assert describe_masks(files)[0].startswith("the masks hold 64 values from 0 to 63: ")
    files[0].write_bytes(b"no image")
    assert describe_masks(files[:1]) == describe_masks([]) == []
