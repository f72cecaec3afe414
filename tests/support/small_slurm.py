"""A SLURM of one machine, in namespaces of its own: two nodes, which tests may lose.

It needs Debian's slurmctld, slurmd and slurm-client, and root. Its processes, its network and its
/etc/slurm are seen only by what is started in it, and end with it: nothing is left behind, and
several of them do not meet.
"""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

HOST = "small"
NODES = ("one", "two")
PATIENCE = 60.0  # seconds for what takes well under ten where nothing else is at work
AWAY = 5  # seconds for which nobody answers in the controller's place
CONFIGURATION = """\
ClusterName=small
SlurmctldHost={host}(10.0.0.1)
SlurmctldPort=6817
AuthType=auth/none
CredType=cred/none
SlurmUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
SlurmdTimeout=20
SlurmctldTimeout=10
InactiveLimit=0
KillWait=2
MinJobAge=300
MessageTimeout=5
SchedulerParameters=sched_interval=2,bf_interval=2
SlurmdParameters=config_overrides
GresTypes=gpu
{nodes}
PartitionName=work Nodes=ALL Default=YES MaxTime=60 State=UP
PartitionName=closed Nodes=ALL MaxTime=60 State=DOWN
PartitionName=lab Nodes=ALL MaxTime=60 State=UP AllowAccounts=lab
"""
NODE = "NodeName={name} NodeHostname={host} NodeAddr=10.0.0.1 Port={port} CPUs=8 RealMemory=32000"
GPU = "two"  # the node that has one, on paper


COMMANDS = ("slurmctld", "slurmd", "sbatch", "ip", "unshare", "nsenter", "pkill")
NAMESPACES = ("--mount", "--pid", "--fork", "--kill-child", "--mount-proc", "--net", "--uts")
SETTLE = """\
set -e
hostname {host}
ip link set lo up
ip addr add 10.0.0.1/32 dev lo
mkdir -p /etc/slurm
mount --bind '{folder}/etc' /etc/slurm
cp /etc/hosts '{folder}/hosts'
echo 10.0.0.1 {host} >>'{folder}/hosts'
mount --bind '{folder}/hosts' /etc/hosts
touch '{folder}/settled'
"""


def find_hindrance() -> str:
    """Why none can be started here; "" if one can."""
    lacking = [name for name in COMMANDS if not shutil.which(name)]
    if lacking:
        return f"{lacking[0]} is not there (Debian: slurmctld slurmd slurm-client iproute2 procps)"
    if os.getuid() != 0:
        return "only root can start a SLURM of its own"
    with TemporaryDirectory() as folder:
        os.mkdir(f"{folder}/etc")
        tried = subprocess.run(
            _in_namespaces(SETTLE.format(host=HOST, folder=folder)), capture_output=True, text=True
        )
    return f"no namespaces: {tried.stderr.strip()}" if tried.returncode else ""


def _in_namespaces(script: str) -> list[str]:
    return ["unshare", *NAMESPACES, "sh", "-c", script]


class Slurm:
    """The controller, its nodes, and what is started among them.

    Args:
        folder: for its state and logs
    """

    def __init__(self, folder: Path):
        self.folder = folder
        nodes = [
            NODE.format(name=name, host=HOST, port=6820 + i) + " Gres=gpu:1" * (name == GPU)
            for i, name in enumerate(NODES)
        ]
        (folder / "state").mkdir(parents=True)
        (folder / "etc").mkdir()
        (folder / "etc/gres.conf").write_text(f"NodeName={GPU} Name=gpu File=/dev/zero\n")
        text = CONFIGURATION.format(host=HOST, folder=folder, nodes="\n".join(nodes))
        (folder / "etc/slurm.conf").write_text(text)
        # Ends, and all with it, when its input closes: also when these tests are killed.
        stay = SETTLE.format(host=HOST, folder=folder) + "exec cat"
        self._space = subprocess.Popen(_in_namespaces(stay), stdin=subprocess.PIPE)
        self._controller: subprocess.Popen | None = None

    def begin(self) -> None:
        """Start all daemons, and wait until the nodes are there."""
        self.wait_for(lambda: (self.folder / "settled").exists(), "its namespaces")
        self.start_controller()
        for name in NODES:
            self.start_node(name)
        self.wait_for(lambda: self.states() == dict.fromkeys(NODES, "idle"), "idle nodes")

    def end(self) -> None:
        """End all that was started in it: its first process ends, and with that its namespaces."""
        self._space.kill()
        self._space.wait()
        self._space.stdin.close()
        if self._controller:
            self._controller.wait()

    def _children(self) -> list[int]:
        pid = self._space.pid
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]

    def within(self, words: Sequence[str], folder: Path | str = "/") -> list[str]:
        """A command, as it is started from outside to run inside, in a folder."""
        (inner, *_) = self._children()
        spaces = ("--mount", "--pid", "--net", "--uts")
        return ["nsenter", f"--target={inner}", *spaces, f"--wdns={folder}", "--", *words]

    def ask(self, *words: str) -> str:
        """What a command inside says; "" where it fails."""
        done = subprocess.run(self.within(words), capture_output=True, text=True, timeout=PATIENCE)
        return done.stdout if done.returncode == 0 else ""

    def start_controller(self) -> None:
        """Start the controller; when it ends it is started again, and goes on from its state.

        So a service manager would do. Debian 12's (22.05.8) ends with a segmentation fault when a
        job of a lost node is told to begin before the two minutes that SLURM has it wait.
        """
        again = f"while ! slurmctld -D >/dev/null 2>&1; do sleep {AWAY}; done"
        self._controller = subprocess.Popen(self.within(["sh", "-c", again]))

    def start_node(self, name: str) -> None:
        """Start the daemon of a node."""
        subprocess.run(self.within(["slurmd", "-N", name]), check=True, timeout=PATIENCE)

    def kill(self, daemon: str) -> None:
        """Kill ``slurmctld`` or ``slurmd-<node>``; what that has started lives on."""
        self.ask("kill", "-9", (self.folder / f"{daemon}.pid").read_text().strip())

    def save(self, job: str) -> None:
        """Wait until the controller has saved that a job runs: up to five seconds after it began.

        A controller that was killed before takes the job for one that waits, begins it a second
        time beside the first, and then holds it for good.
        """
        then = time.time()
        self.ask("scontrol", "update", f"JobId={job}", "Comment=a change to be saved")
        state = self.folder / "state/job_state"
        self.wait_for(lambda: state.stat().st_mtime > then, "saved its state")

    def lose_node(self, name: str) -> None:
        """Kill a node's daemon and all that it has started, as if the power were cut."""
        self.kill(f"slurmd-{name}")
        self.ask("pkill", "-9", "-f", "^slurmstepd")
        started = f"grep -lzx SLURMD_NODENAME={name} /proc/[0-9]*/environ | cut -d/ -f3"
        self.ask("sh", "-c", f"kill -9 $({started})")

    def states(self) -> dict[str, str]:
        """What the controller says of each node: ``idle``, ``mixed``, ``down``..."""
        said = self.ask("sinfo", "-h", "-p", "work", "-N", "-o", "%N %T")
        return dict(line.split() for line in said.splitlines())

    def wait_for(self, reached, what: str, patience: float = PATIENCE) -> None:
        """Wait until something came true."""
        end = time.monotonic() + patience
        while not reached():
            assert time.monotonic() < end, f"SLURM has not {what} in time; see {self.folder}"
            time.sleep(0.2)


@contextmanager
def small_slurm(folder: Path) -> Iterator[Slurm]:
    """One that is ready, for the block."""
    slurm = Slurm(folder)
    try:
        slurm.begin()
        yield slurm
    finally:
        slurm.end()
