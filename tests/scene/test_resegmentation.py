import numpy as np
from PIL import Image
from scenes import dome, silhouettes

from silmesh.scene.resegmentation import repair, segment

COUNT = 24


def test_a_plate_is_cut_away_by_the_other_views_and_the_colours():
    cameras = dome(COUNT, 96)
    truth = silhouettes(cameras, [0.4, 0.25, 0.3])
    found = truth.copy()
    found[3, 60:90, 10:80] = True
    rng = np.random.default_rng(0)
    colours = np.where(truth[3][..., None], (150, 90, 60), (190, 190, 185))
    pixels = (colours + rng.normal(0, 8, colours.shape)).clip(0, 255).astype(np.uint8)
    sound = [i for i in range(COUNT) if i != 3]
    shares = []
    new = repair([Image.fromarray(pixels)], found, cameras, [3], sound, progress=shares.append)[0]
    assert shares == [1]
    assert (new & truth[3]).sum() / (new | truth[3]).sum() > 0.97


def test_nothing_is_found_where_the_others_allow_nothing():
    nothing = np.zeros((32, 32), bool)
    assert not segment(np.zeros((32, 32, 3), np.uint8), nothing, ~nothing).any()
