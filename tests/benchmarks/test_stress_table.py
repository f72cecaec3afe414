"""What the tables of the stress benchmark call a miss."""

from stress_table import judge_cell, tabulate, tabulate_objects


def _cell(iou, verdict="made", **others):
    return {"iou": iou, "volume_iou": 0.5, "verdict": verdict, **others}


def test_a_cell_may_lie_a_hundredth_below_the_best_of_the_others():
    cells = {"hull": _cell(0.9), "ellipsoid": _cell(0.95), "silmesh": _cell(0.941, "good")}
    assert judge_cell(cells, "silmesh") == []
    cells["today"] = _cell(0.96, "doubtful")
    assert judge_cell(cells, "silmesh") == ["below"]
    assert judge_cell(cells, "today") == []


def test_a_collapse_must_not_be_called_good():
    assert judge_cell({"silmesh": _cell(0.7, "good")}, "silmesh") == ["called good"]
    assert judge_cell({"silmesh": _cell(0.7, "doubtful")}, "silmesh") == []


def test_a_row_has_mean_and_least_iou_volume_verdicts_and_misses():
    told = {"named": ["a"], "recall": 0.5, "false_alarms": 0.0}
    cells = {
        "bear": {"hull": _cell(0.9), "silmesh": _cell(0.8, "good", **told)},
        "pot": {"hull": _cell(0.5), "silmesh": _cell(0.6, "refused")},
    }
    row = tabulate({"24 views": {"bites": cells}}).splitlines()[-1]
    assert row == (
        "| bites | 0.700 (0.500) / 0.500 | 0.700 (0.600) / 0.500 | 1 good, 1 refused | 50% / 0% "
        "| bear below |"
    )


def test_a_turntable_has_the_largest_errors_of_the_objects():
    cells = {
        "bear": {"silmesh": _cell(0.9, "good", axis_off=0.5, elevation_off=0.25)},
        "pot": {"silmesh": _cell(0.9, "good", axis_off=0.125, elevation_off=1.0)},
    }
    refused = {"bear": {"silmesh": _cell(0.0, "refused")}}
    lines = tabulate({"36 views, calibrate": {"clean": cells, "bites": refused}}).splitlines()
    assert "| silmesh: axis / elevation off |" in lines[2]
    assert "| 0.50 / 1.00 |" in lines[4]
    assert lines[5].split("|")[5].strip() == "–"


def test_objects_stand_beside_each_other_with_the_best_of_the_others():
    cells = {
        "bear": {"hull": _cell(0.9), "today": _cell(0.95), "silmesh": _cell(0.93, "doubtful")},
        "pot": {"silmesh": _cell(0.875, "good")},
        "axe": {"silmesh": _cell(0.0, "refused")},
        "tube": {"hull": _cell(0.9)},
    }
    lines = tabulate_objects({"24 views": {"bites": cells}}, "silmesh").splitlines()
    assert lines[2] == "| damage | axe | bear | pot |"
    assert lines[4] == ("| bites | **refused** | **0.930 (0.950) / 0.500 d** | 0.875 / 0.500 |")


def test_few_views_are_also_compared_with_those_that_were_not_given():
    cells = {
        "hull": _cell(0.99, iou_unseen=0.75),
        "silmesh": _cell(0.985, "doubtful", iou_unseen=0.8),
    }
    lines = tabulate_objects({"24 views": {"4 views": {"bear": cells}}}, "silmesh").splitlines()
    assert lines[4] == "| 4 views | 0.985 (0.990) / 0.500, unseen 0.800 (0.750) d |"
