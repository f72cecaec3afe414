"""Work on several images at once, whose results come in the images' order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

MOST = 4  # threads, as each has an image in memory
Item, Made = TypeVar("Item"), TypeVar("Made")


def ahead(work: Callable[[Item], Made], items: Iterable[Item], threads: int) -> Iterator[Made]:
    """The result of the work on each item, by so many threads at most; only as many wait.

    What the work raises is raised where its result would come.
    """
    threads = min(threads, MOST)
    with ThreadPoolExecutor(threads) as pool:
        begun = deque()
        for item in items:
            begun.append(pool.submit(work, item))
            if len(begun) > threads:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
