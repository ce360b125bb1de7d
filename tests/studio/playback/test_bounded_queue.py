import threading
import time

from studio.playback.bounded_queue import BoundedQueue


def test_items_come_out_in_order_and_then_it_is_over():
    queue = BoundedQueue(3)
    for item in (1, 2, 3):
        assert queue.put(item) == 0
    queue.finish()
    assert [queue.get(), queue.get(), queue.get(), queue.get()] == [1, 2, 3, None]
    assert queue.over


def test_stale_items_make_room():
    queue = BoundedQueue(2)
    queue.put(1)
    queue.put(2)
    assert queue.put(3, stale=lambda second: second <= 2) == 1
    assert [queue.get(), queue.get()] == [2, 3]


def test_abort_lets_everybody_go():
    full, empty = BoundedQueue(1), BoundedQueue(1)
    full.put(1)
    results = []
    threads = [
        threading.Thread(target=lambda: results.append(full.put(2))),
        threading.Thread(target=lambda: results.append(full.put(2, stale=lambda second: False))),
        threading.Thread(target=lambda: results.append(empty.get())),
    ]
    for thread in threads:
        thread.start()
    time.sleep(0.05)
    full.abort()
    empty.abort()
    for thread in threads:
        thread.join(60)
    assert results == [None, None, None]
    assert full.get() is None
    assert full.over
