"""What counts of the views, told from silhouettes of an ellipsoid of which some were spoilt."""

import numpy as np
import pytest
from scenes import dome, silhouettes
from scipy.ndimage import binary_dilation

from silmesh.fitting.belief import Belief, believe_all, find_belief
from silmesh.geometry.camera import Similarity
from silmesh.scene.scene import Scene

SIZE, COUNT, AXES = 96, 16, (0.45, 0.3, 0.2)


def make_scene(spoil=lambda seen: seen, notes=None) -> Scene:
    cameras = dome(COUNT, SIZE)
    seen = spoil(silhouettes(cameras, AXES))
    return Scene(cameras, Similarity.identity(), seen, np.ones(COUNT), notes or {})


def judged(scene: Scene) -> Belief:
    return find_belief(scene, list(range(COUNT)), scene.cameras)


def bite(seen: np.ndarray) -> np.ndarray:
    """Without the right fifth of what view 3 shows."""
    columns = np.flatnonzero(seen[3].any(axis=0))
    seen[3, :, columns[4 * len(columns) // 5] :] = False
    return seen


def test_of_silhouettes_that_agree_all_counts():
    belief = judged(make_scene())
    assert belief.views == list(range(COUNT))
    assert (belief.weights == 1).all()
    assert belief.known is None
    assert belief.warnings == []


@pytest.mark.parametrize("fill", [True, False])
def test_a_view_that_the_others_contradict_has_no_weight(fill):
    def spoil(seen):
        seen[5] = np.roll(seen[5], SIZE // 4, axis=1) if fill else ~seen[5]
        return seen

    belief = judged(make_scene(spoil))
    assert belief.views == [i for i in range(COUNT) if i != 5]
    assert belief.distrusted == ["v5"]
    assert belief.warnings == ["the other views contradict v5: no weight in the fit"]


def test_a_bite_does_not_count_and_the_rest_of_its_view_does():
    true = silhouettes(dome(COUNT, SIZE), AXES)
    belief = judged(make_scene(bite))
    assert belief.corrected == ["v3"]
    bitten = true[3] & ~bite(true.copy())[3]
    left_out = ~belief.known[3]
    assert (left_out & bitten).sum() > 0.8 * bitten.sum()
    assert not (left_out & true[3] & ~bitten).any()
    assert not (left_out & ~binary_dilation(bitten, iterations=8)).any()
    assert belief.known[[i for i in range(COUNT) if i != 3]].all()


def test_all_counts_if_nothing_is_judged():
    belief = believe_all(make_scene(bite, {"weights": {"v3": 0.5}}), [2, 3, 4])
    assert belief.known is None
    assert belief.weights.tolist() == [1, 0.5, 1]
