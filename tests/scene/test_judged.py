"""Masks of an ellipsoid before known cameras, some of them wrong: from files to judged scene."""

import numpy as np
import pytest
from scenes import dome, save, silhouettes

import silmesh
from silmesh.errors import InputError
from silmesh.geometry.overlap import iou
from silmesh.silhouettes import FULL

SIZE, COUNT = 64, 24
AXES = (0.45, 0.3, 0.35)
EMPTY, FILLED, OTHER, BITTEN = [3, 11], [6], [8, 17], [14, 20]


def bite(silhouette, share=0.2):
    """Without the so many of its pixels that are nearest to its leftmost one."""
    bitten, pixels = silhouette.copy(), np.argwhere(silhouette)
    first = pixels[pixels[:, 1].argmin()]
    nearest = ((pixels - first) ** 2).sum(axis=1).argsort()[: round(share * len(pixels))]
    bitten[tuple(pixels[nearest].T)] = False
    return bitten


def spoil(seen, cameras):
    """Masks that are empty, full, of a rod at another place, and bitten."""
    found = seen.copy()
    found[EMPTY], found[FILLED] = False, True
    found[OTHER] = silhouettes(cameras, (0.1, 0.7, 0.1), (0.25, 0.2, 0))[OTHER]
    found[BITTEN] = [bite(seen[i]) for i in BITTEN]
    return found


@pytest.fixture(scope="module")
def ball():
    cameras = dome(COUNT, SIZE)
    return cameras, silhouettes(cameras, AXES)


def find_scene(folder, masks, cameras, policy):
    """The scene that is to be fitted."""
    for view, mask in zip(cameras.views, masks, strict=True):
        save(folder / f"photographs/{view}.png", np.zeros((SIZE, SIZE, 3), np.uint8))
        save(folder / f"masks/{view}.png", mask)
    shown = silmesh.read_photographs(folder / "photographs", size=SIZE)
    found = silmesh.find_silhouettes(shown, folder / "masks", policy=policy)
    return silmesh.find_cameras(shown, found, cameras)


def named(cameras, *positions):
    return {cameras.views[i] for some in positions for i in some}


def test_wrong_masks_are_named_and_the_rest_is_fitted(ball, tmp_path):
    cameras, seen = ball
    notes = (scene := find_scene(tmp_path, spoil(seen, cameras), cameras, "auto")).notes
    lost = dict.fromkeys(named(cameras, EMPTY), "empty")
    assert notes["dropped"] == lost | dict.fromkeys(named(cameras, FILLED), FULL)
    assert set(notes["doubtful"]) == named(cameras, EMPTY, FILLED, OTHER, BITTEN)
    assert notes["doubtful"][cameras.views[OTHER[0]]] == "other views contradict it"
    assert set(scene.cameras.views) == set(cameras.views) - named(cameras, EMPTY, FILLED)
    sound = [i for i, v in enumerate(scene.cameras.views) if v not in notes["doubtful"]]
    assert scene.coherence[sound].min() > 0.95
    # The ellipsoid's own longest radius is 0.45, and the world's is 0.5.
    assert scene.similarity.scale == pytest.approx(0.5 / 0.45, rel=0.05)


def test_those_that_are_named_are_dropped_where_that_is_the_policy(ball, tmp_path):
    cameras, seen = ball
    scene = find_scene(tmp_path, spoil(seen, cameras), cameras, "drop")
    assert set(scene.notes["dropped"]) == named(cameras, EMPTY, FILLED, OTHER, BITTEN)
    assert scene.coherence.mean() > 0.95


def test_most_masks_without_an_object_are_refused_with_their_number(ball, tmp_path):
    cameras, seen = ball
    masks = seen.copy()
    masks[:13] = False
    with pytest.raises(InputError, match="13 of 24 silhouettes cannot be used"):
        find_scene(tmp_path, masks, cameras, "auto")


def test_inverted_masks_are_refused(ball, tmp_path):
    cameras, seen = ball
    with pytest.raises(InputError, match="it may be inverted"):
        find_scene(tmp_path, ~seen, cameras, "auto")


def test_given_masks_are_repaired_where_that_is_asked(ball, tmp_path):
    cameras, seen = ball
    for view, mask in zip(cameras.views, seen, strict=True):
        colours = np.where(mask[..., None], (180, 60, 40), (90, 120, 90)).astype(np.uint8)
        save(tmp_path / f"photographs/{view}.png", colours)
        save(tmp_path / f"masks/{view}.png", spoil(seen, cameras)[cameras.views.index(view)])
    shown = silmesh.read_photographs(tmp_path / "photographs", size=SIZE)
    found = silmesh.find_silhouettes(shown, tmp_path / "masks", policy="repair")
    scene = silmesh.find_cameras(shown, found, cameras)
    wrong = named(cameras, EMPTY, FILLED, OTHER, BITTEN)
    assert set(scene.notes["repaired"]) == set(scene.notes["repairs"]) == wrong
    assert scene.notes["dropped"] == {}
    assert {scene.notes["weights"][view] for view in wrong} == {0.5}
    order = [cameras.views.index(view) for view in scene.cameras.views]
    assert iou(scene.silhouettes, seen[order]).min() > 0.95
    bitten = scene.notes["repairs"][cameras.views[BITTEN[0]]]
    assert bitten["added"] == pytest.approx(0.2 / 0.8, abs=0.03)
    assert bitten["removed"] < 0.02


@pytest.mark.parametrize("policy", ["keep", "repair"])
def test_what_wrong_silhouettes_alone_show_at_the_frame_is_not_said_once_repaired(
    ball, tmp_path, policy
):
    cameras, seen = ball
    found = seen.copy()
    found[::3, :12, :20] = True  # a blob in a corner
    for view, mask, wrong in zip(cameras.views, seen, found, strict=True):
        colours = np.where(mask[..., None], (180, 60, 40), (90, 120, 90)).astype(np.uint8)
        save(tmp_path / f"photographs/{view}.png", colours)
        save(tmp_path / f"masks/{view}.png", wrong)
    shown = silmesh.read_photographs(tmp_path / "photographs", size=SIZE)
    given = silmesh.find_silhouettes(shown, tmp_path / "masks", policy=policy)
    measured = " ".join(silmesh.find_cameras(shown, given, cameras).notes["measured"])
    assert ("the frame cuts the object" in measured) == (policy == "keep")


def test_what_is_transparent_is_no_background(ball, tmp_path):
    """A bite in a cut-out photograph is black as what is around it; the other views mend it."""
    cameras, seen = ball
    for i, (view, mask) in enumerate(zip(cameras.views, seen, strict=True)):
        cut_out = bite(mask) if i in BITTEN else mask
        photograph = np.full((SIZE, SIZE, 4), (180, 60, 40, 255), np.uint8) * cut_out[..., None]
        save(tmp_path / f"photographs/{view}.png", photograph)
    shown = silmesh.read_photographs(tmp_path / "photographs", size=SIZE)
    found = silmesh.find_silhouettes(shown, source="alpha", policy="repair")
    scene = silmesh.find_cameras(shown, found, cameras)
    assert set(scene.notes["repaired"]) == named(cameras, BITTEN)
    order = [cameras.views.index(view) for view in scene.cameras.views]
    assert iou(scene.silhouettes, seen[order]).min() > 0.93
