"""Memory that threads have freed goes back to the system. Runs in a separate process, whose memory nobody else uses."""

from __future__ import annotations

import json
import subprocess
import sys

SCRIPT = """
import json, threading
import psutil
from gui.platform.memory import give_back

def resident():
    return psutil.Process().memory_info().rss / 2**20

kept = []

def work():
    blocks = [b"x" * (60_000 + at) for at in range(1500)]
    kept.append(blocks[::100])  # these keep the heap from shrinking by itself

threads = [threading.Thread(target=work) for _ in range(4)]
start = resident()
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
full = resident()
given = give_back()
print(json.dumps([start, full, resident(), given, sum(map(sum, (map(len, blocks) for blocks in kept)))]))
"""


def test_memory_that_threads_freed_is_given_back() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    start, full, after, given, kept = json.loads(done.stdout)
    assert full > start + 100, "glibc gave it back by itself: nothing to test"
    assert given
    assert after < start + 0.2 * (full - start)
    assert kept == 4 * sum(60_000 + at for at in range(0, 1500, 100))
