"""What a process has used of its machine, as the kernel counts it, in a line of its log.

Snakemake's own tables (``benchmark:``) show the process that it started. That one may only wait for
a fork of another, so a step measures itself.
"""

import re
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path

LINE = re.compile(
    r"^# used (\d+\.\d) s of the processor and (\d+) MB of memory(?: and (\d+) MB of a GPU)? "
    r"in (\d+\.\d) s$",
    re.M,
)
TO_MB = 1e-6 * (1 if sys.platform == "darwin" else 1024)  # of ru_maxrss, whose unit differs


@dataclass(frozen=True)
class Usage:
    """Of a process, or of a fork from where it began.

    Attributes:
        processor: seconds of all its threads, and of processes that it has waited for
        memory: MB, the most at any moment, with what a fork shares with others
        gpu: MB that torch had of a GPU, likewise
        seconds: on the clock, since the libraries are loaded
    """

    processor: float
    memory: float
    gpu: float
    seconds: float

    def __str__(self):
        gpu = f" and {self.gpu:.0f} MB of a GPU" if self.gpu else ""
        used = f"{self.processor:.1f} s of the processor and {self.memory:.0f} MB of memory"
        return f"# used {used}{gpu} in {self.seconds:.1f} s"


def measure_usage(began: float) -> Usage:
    """Of this process.

    Args:
        began: when, as ``time.monotonic`` says
    """
    own, others = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    processor = sum(part.ru_utime + part.ru_stime for part in (own, others))
    memory = max(_read_peak() or TO_MB * own.ru_maxrss, TO_MB * others.ru_maxrss)
    return Usage(processor, memory, _measure_gpu(), time.monotonic() - began)


def _read_peak() -> float:
    """MB, the most that this process had, as Linux tells; 0 elsewhere.

    What ``getrusage`` says of a process counts that of the one which started it, too.
    """
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return 0.0
    found = re.search(r"^VmHWM:\s+(\d+) kB$", status, re.M)
    return 1.024e-3 * int(found[1]) if found else 0.0


def read_usage(log: Path) -> Usage | None:
    """What a step's log says that it used; None if it has not ended well."""
    found = LINE.findall(log.read_text(encoding="utf-8", errors="replace"))
    if not found:
        return None
    processor, memory, gpu, seconds = found[-1]
    return Usage(float(processor), float(memory), float(gpu or 0), float(seconds))


def _measure_gpu() -> float:
    torch = sys.modules.get("torch")  # a step that has not loaded it has used no GPU
    if torch is None or not torch.cuda.is_initialized():
        return 0.0
    return 1e-6 * torch.cuda.max_memory_reserved()
