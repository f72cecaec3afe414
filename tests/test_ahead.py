"""Work that is done ahead of its turn."""

import threading
import time

import pytest

from silmesh.ahead import ahead


def test_results_come_in_the_order_of_the_items():
    def work(item: int) -> int:
        time.sleep(0.01 * (5 - item % 5))  # later ones are ready sooner
        return item**2

    assert list(ahead(work, range(20), 3)) == [item**2 for item in range(20)]


def test_no_more_are_begun_than_threads_can_hold():
    taken = []

    def items():
        for item in range(10):
            taken.append(item)
            yield item

    results = ahead(lambda item: item, items(), 2)
    assert next(results) == 0
    assert taken == [0, 1, 2]


def test_items_are_worked_on_together():
    both = threading.Barrier(2, timeout=10)
    assert sorted(ahead(lambda _: both.wait(), range(2), 2)) == [0, 1]


def test_what_the_work_raises_comes_where_its_result_would():
    results = ahead(lambda item: 1 / item, [2, 1, 0, 4], 2)
    assert [next(results), next(results)] == [0.5, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)
