"""Jobs of the profile for Kubernetes, as a kubectl is given them that runs them here."""

import json

import pretended_kubectl
import pytest

from silmesh.cli import kubernetes
from silmesh.errors import InputError

NAMES = {
    "SILMESH_IMAGE": "silmesh:0.1",
    "SILMESH_CLAIM": "shared",
    "SILMESH_MOUNT": "/shared",
}
SAID = {"threads": 2, "resources": {"mem_mb": 1500, "runtime": 20, "gpu": 1}}


@pytest.fixture
def there(tmp_path, monkeypatch):
    for name, value in (NAMES | pretended_kubectl.install(tmp_path)).items():
        monkeypatch.setenv(name, value)
    return tmp_path


def write_script(folder, line="true"):
    script = folder / "a script.sh"
    script.write_text(f"#!/bin/sh\n# properties = {json.dumps(SAID)}\n{line}\n")
    return script


def test_a_job_asks_for_what_its_step_needs(there):
    name = kubernetes.submit(write_script(there))
    job = json.loads((there / name.partition("/")[2] / "job.json").read_text())["spec"]
    (container,) = job["template"]["spec"]["containers"]
    assert job["activeDeadlineSeconds"] == 1200
    assert container["image"] == "silmesh:0.1"
    assert container["resources"]["requests"] == {"cpu": 2, "memory": "1500M"}
    assert container["resources"]["limits"] == {"memory": "1500M", "nvidia.com/gpu": 1}
    assert container["volumeMounts"] == [{"name": "shared", "mountPath": "/shared"}]


@pytest.mark.parametrize(("line", "status"), [("true", "success"), ("exit 3", "failed")])
def test_it_says_how_a_job_ended(there, line, status):
    name = kubernetes.submit(write_script(there, line))
    while (found := kubernetes.find_status(name)) == "running":
        pass
    assert found == status
    assert kubernetes.find_status("job.batch/another") == "failed"


def test_what_is_not_set_is_named(there, monkeypatch):
    monkeypatch.delenv("SILMESH_CLAIM")
    with pytest.raises(InputError, match=r"SILMESH_CLAIM is not set; should name the persistent"):
        kubernetes.submit(write_script(there))


def test_a_cluster_that_does_not_answer_is_waited_for(there):
    (there / "kubectl").write_text("#!/bin/sh\necho no route to host >&2\nexit 1\n")
    assert kubernetes.find_status("job.batch/silmesh-0") == "running"
    with pytest.raises(InputError, match="Kubernetes takes no job: no route to host"):
        kubernetes.submit(write_script(there))
