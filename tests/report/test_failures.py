"""Which runs failed, told from what Snakemake and the steps said."""

from silmesh.report.failures import find_unfinished

SAID = """\
Error in rule {rule}:
    message: None
    jobid: 7
    output: results/x
    log: {log} (check log file(s) for error details)
"""


def plan_run(folder, object_, variant="plain", **more):
    stages = {
        "views": f"{folder}/logs/views/{object_}-32-pad.tsv",
        "fit": f"{folder}/logs/fit/{object_}-{variant}.tsv",
    }
    told = {"object": object_, "variant": variant, "replicate": 1, "judged": "j", "scene": "s"}
    return told | {"stages": stages} | more


def finish(folder, object_, variant="plain"):
    """All that the report shows of a run, as empty files."""
    for name in (
        f"results/{object_}/{variant}/loss.csv",
        f"results/{object_}/{variant}/metrics.json",
        f"report/galleries/{object_}/j.json",
        f"report/cameras/{object_}/s.png",
        f"report/pictures/{object_}/{variant}.png",
        f"report/exhibits/{object_}/{variant}.json",
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def fail(folder, log, *lines):
    path = folder / "logs" / log
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines))
    return SAID.format(rule=path.parent.name, log=path)


def find(folder, runs, said):
    return find_unfinished(runs, said, folder / "results", folder / "report")


def test_whole_runs_are_none_of_them(tmp_path):
    finish(tmp_path, "cup")
    assert find(tmp_path, [plan_run(tmp_path, "cup")], "") == []


def test_a_failed_stage_is_named_with_the_words_of_its_step(tmp_path):
    finish(tmp_path, "cup")  # from before: what lies there is of other photographs
    said = fail(tmp_path, "views/cup-32-pad.log", "silmesh: a.png: is no image", "later noise", "")
    runs = [plan_run(tmp_path, "cup"), plan_run(tmp_path, "cup", "fine")]
    reason = {"stage": "views", "reason": "a.png: is no image"}
    assert find(tmp_path, runs, said) == [
        {"object": "cup", "variant": "plain", **reason},
        {"object": "cup", "variant": "fine", **reason},
    ]


def test_a_traceback_is_told_by_its_last_line_and_only_of_its_own_run(tmp_path):
    finish(tmp_path, "cup", "fine")
    said = fail(tmp_path, "fit/cup-plain.log", "Traceback", "MemoryError: 3 GB", "# used 1 s", "")
    runs = [plan_run(tmp_path, "cup"), plan_run(tmp_path, "cup", "fine")]
    (told,) = find(tmp_path, runs, said)
    assert (told["variant"], told["reason"]) == ("plain", "MemoryError: 3 GB")


def test_objects_whose_names_begin_alike_are_told_apart(tmp_path):
    said = fail(tmp_path, "gallery/cup-2-32-pad-mask.log", "silmesh: no room")
    runs = [plan_run(tmp_path, "cup"), plan_run(tmp_path, "cup-2")]
    assert [(one["stage"], one["reason"]) for one in find(tmp_path, runs, said)] == [
        ("", "was not begun"),
        ("gallery", "no room"),
    ]


def test_what_all_wait_for_is_the_reason_of_all(tmp_path):
    said = fail(tmp_path, "fetch_weights/isnet.log", "silmesh: no network")
    found = find(tmp_path, [plan_run(tmp_path, "cup"), plan_run(tmp_path, "jar")], said)
    assert [one["reason"] for one in found] == ["no network"] * 2


def test_a_step_that_said_nothing_is_named_by_its_log(tmp_path):
    said = fail(tmp_path, "fit/cup-plain.log", "# cd /x", "")
    (told,) = find(tmp_path, [plan_run(tmp_path, "cup")], said)
    assert told["reason"].endswith("cup-plain.log says nothing")


def test_replicates_need_no_picture(tmp_path):
    finish(tmp_path, "cup")
    (tmp_path / "report/pictures/cup/plain.png").unlink()
    assert find(tmp_path, [plan_run(tmp_path, "cup", replicate=2)], "") == []
    assert len(find(tmp_path, [plan_run(tmp_path, "cup")], "")) == 1
