"""Training as a target of its own, which a run's silhouettes may depend on."""

import pandas as pd
import pytest

pytestmark = pytest.mark.slow

TRAIN = "train: {holdout: [jug], epochs: 2, batch: 2, size: 64}\n"
LEARNT = """\
  learnt:
    silhouettes: deeplab
    deeplab: {weights: results/train/weights.pt}
    init: {vertices: 60}
"""


def test_training_and_what_depends_on_it(fresh):
    fresh.add_object("jug", centre=(21, 17))
    with open(fresh / "config/config.yaml", "a") as config:
        config.write(LEARNT + TRAIN)
    fresh.run("train")
    assert len(pd.read_csv(fresh / "results/train/epochs.csv")) == 2
    assert not (fresh / "results/train/checkpoint.pt").exists()
    assert fresh.outdated("train") == set()

    jobs = fresh.outdated()
    assert {job.split("_")[0] for job in jobs if job.startswith("silhouettes")} == {
        *("silhouettes cup/32-pad-mask", "silhouettes cup/32-pad-deeplab"),
        *("silhouettes jug/32-pad-mask", "silhouettes jug/32-pad-deeplab"),
    }
    assert not {job for job in jobs if job.startswith("train")}

    fresh.edit("config/config.yaml", "epochs: 2", "epochs: 1")
    assert "train train/weights" in fresh.outdated()
