"""The tables, against ones written by hand."""

import json

import pytest

from silmesh.errors import InputError
from silmesh.report.tables import (
    gather_losses,
    gather_metrics,
    objects_of,
    read_losses,
    read_metrics,
    read_published,
)

HEADER = "iteration,loss,iou_loss,laplacian,flatten,seconds\n"
ROWS = {
    ("pot", "plain"): "0,0.7067403793334961,0.7,0.06,0.07,1.064328119000038\n1,0.5,0.4,1,2,3\n",
    ("pot", "fine-2"): "0,0.9,0.8,0.1,0.2,0.3\n",
    ("cup", "plain"): "0,0.1,0.2,0.3,0.4,0.5\n",
}


@pytest.fixture
def loss_files(tmp_path):
    files = {run: tmp_path / f"{'_'.join(run)}.csv" for run in ROWS}
    for run, file in files.items():
        file.write_text(HEADER + ROWS[run])
    return files


def test_all_losses_stand_below_one_another_to_the_last_digit(loss_files):
    table = gather_losses(read_losses(loss_files)).to_csv(index=False)
    assert table == (
        "object,variant,iteration,loss,iou_loss,laplacian,flatten,seconds\n"
        "pot,plain,0,0.7067403793334961,0.7,0.06,0.07,1.064328119000038\n"
        "pot,plain,1,0.5,0.4,1,2,3\n"
        "pot,fine-2,0,0.9,0.8,0.1,0.2,0.3\n"
        "cup,plain,0,0.1,0.2,0.3,0.4,0.5\n"
    )


def test_metrics_are_columns_lacking_ones_empty_and_whole_numbers_whole(tmp_path):
    metrics = {
        ("pot", "plain"): {"iou_mean": 0.1, "iou_holdout": None, "faces": 12, "iou": {"r0": 0.1}},
        ("cup", "plain"): {"iou_mean": 0.25, "chamfer": 0.03, "silhouettes": "cup/a,b"},
    }
    files = {run: tmp_path / f"{run[0]}.json" for run in metrics}
    for run, file in files.items():
        file.write_text(json.dumps(metrics[run]))
    assert gather_metrics(read_metrics(files)).to_csv(index=False) == (
        "object,variant,iou_mean,iou_holdout,faces,chamfer,silhouettes\n"
        "pot,plain,0.1,,12,,\n"
        'cup,plain,0.25,,,0.03,"cup/a,b"\n'
    )


def test_objects_and_variants_keep_their_order():
    assert objects_of(ROWS) == {"pot": ["plain", "fine-2"], "cup": ["plain"]}


def test_published_curves_by_object_and_variant(tmp_path):
    file = tmp_path / "published.csv"
    file.write_text("object,variant,iteration,loss\npot,plain,0,0.9\npot,plain,100,0.5\n7,x,0,1\n")
    curves = read_published(file)
    assert list(curves) == [("pot", "plain"), ("7", "x")]
    assert curves["pot", "plain"].to_dict("list") == {"iteration": [0, 100], "loss": [0.9, 0.5]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("object,variant,loss\n", "lacks iteration"),
        ("", "lacks object, variant, iteration, loss"),
        ("object,variant,iteration,loss\na,b,0,x\n", "line 2: loss: should be a number, not 'x'"),
        (
            "object,variant,iteration,loss\na,b,inf,1\n",
            "line 2: iteration: should be a number, not 'inf'",
        ),
        ("object,variant,iteration,loss\na,b,0,\n", "line 2: loss: should be a number, not ''"),
        ("object,variant,iteration,loss\n\xff\0,b,0,1\na,b,0,1,2,3\n", "cannot be read as a table"),
    ],
)
def test_a_table_without_curves_is_refused(tmp_path, text, message):
    file = tmp_path / "published.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_published(file)
