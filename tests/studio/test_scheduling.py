"""No library makes this process a real-time one."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Literal

import pytest

from studio.scheduling import kept_scheduling
from studio.stream import BakeSettings, bake_group
from tests.support.performer import performer

linux = pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="no scheduling policies here")


def policies() -> set[int]:
    return {os.sched_getscheduler(int(name)) for name in os.listdir("/proc/self/task")}


@linux
@pytest.mark.parametrize("codec", ["h264", "hevc", "av1"])
def test_baking_leaves_the_policy_of_all_threads(codec: Literal["h264", "hevc", "av1"], tmp_path: Path) -> None:
    before = policies()
    bake_group(performer(3, 300), tmp_path, 0, 0, BakeSettings(codec=codec, preset="ultrafast"), fps=25.0)
    assert policies() == before


@linux
def test_threads_get_theirs_back_and_new_ones_the_callers() -> None:
    stop, begun = threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        stop.wait(60)

    before = os.sched_getscheduler(0)
    with kept_scheduling():  # anybody may leave the usual policy for that of batch jobs
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        thread = threading.Thread(target=work)
        thread.start()
        assert begun.wait(60)
        assert os.sched_getscheduler(thread.native_id or 0) == os.SCHED_BATCH
    assert os.sched_getscheduler(0) == before
    assert os.sched_getscheduler(thread.native_id or 0) == before
    stop.set()
    thread.join()
