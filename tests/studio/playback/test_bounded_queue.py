import threading
import time

from studio.playback.bounded_queue import Lane


def test_items_come_out_in_order_and_then_it_is_over():
    lane = Lane(3)
    for item in (1, 2, 3):
        assert lane.put(item) == 0
    lane.finish()
    assert [lane.get(), lane.get(), lane.get(), lane.get()] == [1, 2, 3, None]
    assert lane.over


def test_put_waits_for_room():
    lane = Lane(1)
    lane.put("a")
    done = threading.Event()
    thread = threading.Thread(target=lambda: (lane.put("b"), done.set()))
    thread.start()
    assert not done.wait(0.05)
    assert lane.get() == "a"
    assert done.wait(5)
    assert lane.get() == "b"
    thread.join()


def test_stale_items_make_room():
    lane = Lane(2)
    lane.put(1)
    lane.put(2)
    assert lane.put(3, stale=lambda second: second <= 2) == 1
    assert lane.take_while(lambda item: True) == [2, 3]


def test_put_waits_until_the_oldest_grows_stale():
    lane = Lane(1)
    lane.put(1)
    began = time.monotonic()
    assert lane.put(2, stale=lambda second: time.monotonic() - began > 0.1) == 1
    assert lane.peek() == 2


def test_abort_lets_everybody_go():
    full, empty = Lane(1), Lane(1)
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
        thread.join(5)
    assert results == [None, None, None]
    assert full.get() is None
    assert full.over
