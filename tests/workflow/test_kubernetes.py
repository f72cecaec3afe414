"""Jobs go through the profile for Kubernetes to a kubectl that runs them here."""

import shutil
from importlib.util import find_spec

import pretended_kubectl
import pytest

MESH = "results/cup/round/mesh.glb"
NAMES = {"SILMESH_IMAGE": "silmesh:0.1", "SILMESH_CLAIM": "shared", "SILMESH_MOUNT": "/shared"}
OPTIONS = ("--workflow-profile", "profiles/kubernetes", "--latency-wait", "5")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not find_spec("snakemake_executor_plugin_cluster_generic"),
        reason="snakemake-executor-plugin-cluster-generic is not installed (the extra `cluster`)",
    ),
]


def test_the_profile_makes_the_same_bytes(project, finished, tmp_path):
    shutil.rmtree(project / "results")
    state = tmp_path / "kubectl"
    state.mkdir()
    project.run(MESH, *OPTIONS, **NAMES, **pretended_kubectl.install(state))
    assert (project / MESH).read_bytes() == (finished / MESH).read_bytes()
    jobs = list(state.glob("silmesh-*/job.json"))
    assert len(jobs) == 2, "what comes before the fit, and the run"
