"""The cache in memory: what it keeps, and that values are made once."""

import math
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from v3studio.studio.memory_cache import MemoryCache, OnDemand, image_cache


def arrays(size: int) -> tuple[np.ndarray, ...]:
    return (np.zeros(size - 1, np.uint8), np.zeros(1, np.uint8))


def test_the_least_recently_used_values_are_dropped_first() -> None:
    cache = image_cache(30)
    for key in "abc":
        cache.put(key, arrays(10))
    assert cache.get("a") is not None
    assert "b" in cache  # which is no use
    cache.put("d", arrays(10))
    assert list(cache) == ["c", "a", "d"]
    cache.put("huge", arrays(31))
    assert cache.get("huge") is None
    assert cache.used == 30
    cache.put("a", arrays(5))
    assert (cache.used, list(cache)) == (25, ["c", "d", "a"])
    cache.drop("c")
    cache.drop("never there")
    assert (cache.used, list(cache)) == (15, ["d", "a"])
    cache.clear()
    assert (cache.used, list(cache)) == (0, [])


def test_values_are_made_once_and_keys_do_not_wait_for_each_other() -> None:
    cache: MemoryCache[object, int] = MemoryCache(math.inf)
    made: list[str] = []
    begun, wait = threading.Event(), threading.Event()

    def slow(key: str) -> int:
        begun.set()
        assert wait.wait(60)
        made.append(key)
        return 1

    with ThreadPoolExecutor(4) as pool:
        results = [pool.submit(cache.get_or_make, "slow", slow) for _ in range(3)]
        assert begun.wait(60)
        assert cache.get_or_make("other", lambda key: 2) == 2
        wait.set()
        assert [result.result() for result in results] == [1, 1, 1]
    assert made == ["slow"]
    wrong = threading.Event()  # any key that can be referenced weakly
    kept = weakref.ref(wrong)
    with pytest.raises(ZeroDivisionError):
        cache.get_or_make(wrong, lambda key: 1 // 0)
    del wrong
    assert kept() is None


def test_after_failures_a_value_is_still_made_by_one_thread_at_a_time() -> None:
    cache: MemoryCache[str, int] = MemoryCache(math.inf)
    made, making = [], threading.Lock()

    def fails_thrice(key: str) -> int:
        assert making.acquire(blocking=False)
        made.append(key)
        time.sleep(0.05)  # so that the thread that failed asks again while the other one makes the value
        making.release()
        return 1 if len(made) > 3 else 1 // 0

    with ThreadPoolExecutor(2) as pool:
        errors = [one.exception() for one in [pool.submit(cache.get_or_make, "key", fails_thrice) for _ in range(6)]]
    assert sorted(type(error).__name__ for error in errors) == ["NoneType"] * 3 + ["ZeroDivisionError"] * 3
    assert len(made) == 4


def test_items_on_demand_are_made_at_each_access() -> None:
    made: list[int] = []

    def double(key: int) -> int:
        made.append(key)
        return 2 * key

    items = OnDemand(range(5), double)
    part = items[1:4]
    assert (len(items), len(part), made) == (5, 3, [])
    assert (items[-1], part[0], list(part)) == (8, 2, [2, 4, 6])
    assert made == [4, 1, 1, 2, 3]
