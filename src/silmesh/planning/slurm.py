"""What SLURM says of a run: whether it takes such jobs, whether it has GPUs, how its jobs are."""

import getpass
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

    A partition that is closed, whose limit is too short, or that is for other accounts takes a job
    and lets it wait for good: that is refused here.

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
        why = _find_wait(given)
    if why:
        job = ", ".join(f"{key} {value}" for key, value in given.items())
        raise InputError(f"SLURM takes no job of {job}: {why}; {REMEDY}")


def remember_jobs() -> None:
    """Have Snakemake's plugin ask again for jobs that SLURM could not tell of.

    Otherwise its version 2.8 forgets them while the controller is away, and the run never ends.
    """
    import snakemake_executor_plugin_slurm as plugin  # of an extra, there if jobs go to SLURM

    ask = getattr(plugin, "query_job_status", None)
    if not ask:  # another version
        return

    async def ask_again(*given: object) -> tuple[dict[str, str], float]:
        states, seconds = await ask(*given)
        return ({}, 0.0) if states is None else (states, seconds)

    plugin.query_job_status = ask_again


def _find_wait(job: Mapping[str, object]) -> str:
    """Why its partition lets a job wait for good; "" if it does not."""
    for line in _ask("scontrol", "show", "partition", "--oneliner").stdout.splitlines():
        partition = dict(word.split("=", 1) for word in line.split() if "=" in word)
        if _is_asked(partition, job.get("partition")):
            allowed = partition.get("AllowAccounts", "ALL")
            account = str(job.get("account") or (_find_account() if allowed != "ALL" else ""))
            return judge_partition(partition, account, int(job.get("time", 0)))
    return ""


def _is_asked(partition: Mapping[str, str], name: object) -> bool:
    return partition["PartitionName"] == name if name else partition["Default"] == "YES"


def judge_partition(partition: Mapping[str, str], account: str, minutes: int) -> str:
    """Why a partition lets a job wait for good; "" if it does not.

    Args:
        partition: as ``scontrol show partition`` says it
        account: of the job; "" if it has none
        minutes: that the job asks for
    """
    name, state, limit = (partition[key] for key in ("PartitionName", "State", "MaxTime"))
    allowed = partition.get("AllowAccounts", "ALL")
    if state != "UP":
        return f"partition {name} is {state.lower()}"
    if (found := LIMIT.fullmatch(limit)) and minutes > _minutes(found):
        return f"partition {name} has a limit of {limit}"
    if allowed != "ALL" and account not in allowed.split(","):
        of = f"of account {account}" if account else "without an account"
        return f"partition {name} takes no jobs {of}, only those of {allowed}"
    return ""


def _find_account() -> str:
    """The user's own account, which counts if none is named; "" if SLURM knows of none."""
    query = ("sacctmgr", "-nP", "show", "user", getpass.getuser(), "format=defaultaccount")
    try:
        said = _ask(*query)
    except InputError:
        return ""
    return said.stdout.strip() if said.returncode == 0 else ""


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
