"""How the processes that ``stress.py`` starts answer: a line of JSON for each line that they read.

It needs nothing but Python, for one of them runs in an environment of its own.
"""

import json
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path


def answer_lines(work: Callable[[Path, Path], dict], failed: str) -> None:
    """Answer each line of standard input, a case's folder and the mesh to write.

    Args:
        work: of these two, gives the answer; what it prints goes to standard error
        failed: the verdict where it raises an exception of whatever kind
    """
    answers = sys.stdout
    for line in sys.stdin:
        folder, made = map(Path, json.loads(line))
        with redirect_stdout(sys.stderr):
            try:
                answer = work(folder, made)
            except Exception as error:
                answer = {"verdict": failed, "said": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)
