"""What SLURM says before a run begins: whether it takes such jobs, and whether it has GPUs."""

import re
import subprocess
from collections.abc import Mapping

from silmesh.errors import InputError

SAID = re.compile(r"^sbatch: (?:error: )?|^allocation failure: ", re.M)
LIMIT = re.compile(r"(?:(?:(\d+)-)?(\d+):)?(\d+):\d+")  # of a partition: [[days-]hours:]minutes:s
PATIENCE = 60.0  # seconds that its commands have to answer
REMEDY = (
    "--default-resources slurm_account=NAME slurm_partition=NAME say where jobs go (`sinfo` lists "
    "partitions), --set-resources STEP:mem_mb=N what a step's are asked for"
)


def has_gpus() -> bool:
    """Whether some of its nodes have a GPU."""
    try:
        return "gpu" in _ask("sinfo", "-h", "-o", "%G").stdout
    except InputError:
        return False


def try_job(asked: Mapping[str, object]) -> None:
    """Have SLURM judge a job without submitting it.

    A partition that is closed, or whose limit is too short, takes a job and lets it wait for good:
    that is refused here.

    Args:
        asked: options of sbatch, ``mem``, ``time`` (minutes) or ``partition`` for example; None for
            what is not given

    Raises:
        InputError: it takes no such job; the message has what it says
    """
    given = {key: value for key, value in asked.items() if value is not None}
    words = [f"--{key}={value}" for key, value in given.items()]
    said = _ask("sbatch", "--test-only", *words, "--wrap=true")
    if said.returncode:
        why = "; ".join(filter(None, SAID.sub("", said.stderr).splitlines()))
    else:
        why = _find_closed(given.get("partition"), int(given.get("time", 0)))
    if why:
        job = ", ".join(f"{key} {value}" for key, value in given.items())
        raise InputError(f"SLURM takes no job of {job}: {why}; {REMEDY}")


def _find_closed(partition: object, minutes: int) -> str:
    """Why a partition, or the default one, lets a job wait for good; "" if it does not."""
    for line in _ask("sinfo", "-h", "-o", "%P %a %l").stdout.splitlines():
        name, state, limit = line.split()
        if name != partition if partition else not name.endswith("*"):
            continue
        if state != "up":
            return f"partition {name} is {state}"
        if (found := LIMIT.fullmatch(limit)) and minutes > _minutes(found):
            return f"partition {name} has a limit of {limit}"
    return ""


def _minutes(limit: re.Match[str]) -> int:
    days, hours, minutes = (int(part or 0) for part in limit.groups())
    return (days * 24 + hours) * 60 + minutes


def _ask(*words: str) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(words, capture_output=True, encoding="utf-8", timeout=PATIENCE)
    except OSError as error:
        raise InputError(f"{words[0]}: {error.strerror}; is SLURM on this machine?") from error
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{words[0]}: SLURM has not answered for {PATIENCE:.0f} s") from error
