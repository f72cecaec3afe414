"""The page lists the rounds that a turntable was photographed in."""

from silmesh.report.page import _show_calibration, _show_rounds


def test_a_row_for_each_round():
    elevations = [{"value": 5.06, "sd": 0.38, "status": "found"}]
    elevations += [{"value": 40.0, "sd": 0.0, "status": "given"}]
    rounds = [
        {"views": [f"IMG_{i}" for i in range(start, start + 18)], "estimates": {"elevation": e}}
        for start, e in zip((0, 18), elevations, strict=True)
    ]
    assert _show_rounds(rounds) == [
        {
            "label": "Round 1",
            "meaning": "elevation of its 18 views, IMG_0 to IMG_17",
            "value": "5.06 ± 0.38°",
            "status": "found",
        },
        {
            "label": "Round 2",
            "meaning": "elevation of its 18 views, IMG_18 to IMG_35",
            "value": "40.00°",
            "status": "given",
        },
    ]
    assert _show_rounds([]) == []


def test_the_elevation_of_one_round_is_not_said_again():
    elevation = {"value": 5.06, "sd": 0.38, "status": "found"}
    rounds = [{"views": ["a", "b"], "estimates": {"elevation": elevation}}]
    estimates = {"elevation": elevation, "roll": {"value": 1.0, "sd": 0.1, "status": "found"}}

    def labels(figures):
        return [row["label"] for row in _show_calibration(figures)]

    assert labels({"estimates": estimates}) == ["Elevation", "Lean"]
    assert labels({"estimates": estimates, "rounds": rounds}) == ["Lean", "Round 1"]
