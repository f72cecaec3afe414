import numpy as np
import pytest
from scenes import dome, silhouettes, turntable

from silmesh.cameras.attempt import Attempt
from silmesh.errors import InputError
from silmesh.geometry.camera import Similarity
from silmesh.geometry.undistortion import Undistorted
from silmesh.scene.agreement import Normalised, choose, normalise, refuse_incoherent

SIZE, AXES, CENTRE = 64, [0.45, 0.2, 0.15], [0.05, 0.1, 0]


@pytest.fixture(scope="module")
def ring():
    cameras = turntable(12, SIZE, elevation=15)
    return cameras, silhouettes(cameras, AXES, CENTRE)


def test_coherent_cameras_pass_and_say_so(ring):
    attempt = refuse_incoherent(Attempt("colmap", ring[0]), ring[1])
    assert attempt.cameras is not None
    assert attempt.figures["coherence"] > 0.95


def test_incoherent_cameras_are_refused_with_their_figure(ring):
    shuffled = ring[0].select([0, 5, 10, 3, 8, 1, 6, 11, 4, 9, 2, 7])
    flat = silhouettes(ring[0], [0.45, 0.05, 0.05], [0.1, 0.1, 0])
    attempt = refuse_incoherent(Attempt("colmap", shuffled), flat)
    assert attempt.cameras is None
    assert "12 photographs have a camera, but the silhouettes contradict these" in attempt.refusal
    assert f"{attempt.figures['coherence']:.0%}" in attempt.refusal


def test_cameras_that_do_not_turn_are_refused(ring):
    still = ring[0].select([0] * 12)
    attempt = refuse_incoherent(Attempt("colmap", still), ring[1][[0] * 12])
    assert attempt.refusal.startswith("cameras 'colmap': the cameras all look along one line")


def test_an_empty_silhouette_has_no_say(ring):
    seen = ring[1].copy()
    seen[4] = False
    others = [i for i in range(12) if i != 4]
    all_, some = normalise(ring[0], seen), normalise(ring[0].select(others), seen[others])
    assert all_.coherence[4] == 0
    assert all_.coherence[others].tolist() == some.coherence.tolist()
    assert all_.similarity.scale == some.similarity.scale
    assert refuse_incoherent(Attempt("colmap", ring[0]), seen).cameras is not None


def test_a_full_silhouette_does_not_sink_the_cameras(ring):
    seen = ring[1].copy()
    seen[4] = True
    found = normalise(ring[0], seen)
    assert found.mean > 0.9
    assert found.similarity.scale == pytest.approx(normalise(*ring).similarity.scale, rel=0.02)


def test_views_that_most_others_contradict_have_no_say_about_cameras():
    cameras = turntable(24, SIZE, elevation=15)
    seen = silhouettes(cameras, AXES, CENTRE)
    wrong = [3, 10, 17]
    seen[wrong] = np.roll(seen[wrong], 18, axis=1)  # far too low
    found = normalise(cameras, seen)
    assert found.contradicted == tuple(wrong)
    assert found.mean > 0.95 > found.coherence[wrong].max()
    attempt = refuse_incoherent(Attempt("colmap", cameras), seen)
    assert attempt.cameras is not None
    assert attempt.figures["contradicted"] == [cameras.views[i] for i in wrong]


def bite(silhouette):
    """Without the fifth of its pixels that is nearest to its leftmost one."""
    bitten, pixels = silhouette.copy(), np.argwhere(silhouette)
    first = pixels[pixels[:, 1].argmin()]
    nearest = ((pixels - first) ** 2).sum(axis=1).argsort()[: len(pixels) // 5]
    bitten[tuple(pixels[nearest].T)] = False
    return bitten


def test_bites_do_not_sink_the_cameras():
    cameras = dome(24, SIZE)
    seen = silhouettes(cameras, [0.45, 0.3, 0.25], CENTRE)
    wrong, bitten = [1, 4, 9, 12, 18, 22], seen.copy()
    bitten[wrong] = [bite(seen[i]) for i in wrong]
    found = normalise(cameras, bitten)
    assert found.contradicted == ()
    assert found.coherence[wrong].max() < 0.85  # of each a fifth is lacking, and still counts
    assert np.delete(found.coherence, wrong).min() > 0.95
    assert np.flatnonzero(found.disbelieved > 0.12).tolist() == wrong
    assert found.similarity.scale == pytest.approx(normalise(cameras, seen).similarity.scale, 0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_wrong_cameras_are_not_made_coherent_by_leaving_views_out(seed):
    cameras = dome(24, SIZE)
    seen = silhouettes(cameras, [0.5, 0.12, 0.2], [0.1, 0.1, 0])
    order = np.random.default_rng(seed).permutation(24)
    attempt = refuse_incoherent(Attempt("colmap", cameras.select(order)), seen)
    assert attempt.cameras is None
    assert "the silhouettes contradict these" in attempt.refusal


def test_one_silhouette_alone_places_nothing(ring):
    seen = ring[1].copy()
    seen[1:] = False
    with pytest.raises(InputError, match="1 of the 12 views with a camera have a silhouette"):
        normalise(ring[0], seen)


def placed(ring, count, mean):
    cameras = ring[0].select(range(count))
    straight = Undistorted(cameras, {}, 0.0)
    return Normalised(cameras, straight, Similarity.identity(), np.full(count, mean))


A, B = Attempt("colmap", None, "12 of 36 views"), Attempt("calibrate", None)


@pytest.mark.parametrize(
    ("first", "second", "best"),
    [
        ((12, 0.96), (12, 0.90), 0),  # the more coherent
        ((12, 0.90), (12, 0.96), 1),
        ((9, 0.96), (12, 0.95), 1),  # nearly equal: more views
        ((9, 0.96), (12, 0.93), 0),
        ((12, 0.95), (12, 0.96), 1),  # as many views: the more coherent
    ],
)
def test_the_more_coherent_attempt_is_taken_or_that_with_more_views(ring, first, second, best):
    index, why = choose([A, B], [placed(ring, *first), placed(ring, *second)])
    assert index == best
    told = [f"{first[1]:.3f} over {first[0]} views", f"{second[1]:.3f} over {second[0]} views"]
    assert all(part in why for part in told)


def test_the_reason_of_a_refused_attempt_is_told(ring):
    index, why = choose([A, B], [None, placed(ring, 12, 0.9)])
    assert index == 1
    assert why == "calibrate: hull IoU 0.900 over 12 views; colmap: no cameras (12 of 36 views)"


def test_a_kept_world_is_not_moved(ring):
    assert normalise(*ring, keep_world=True).similarity.scale == 1
