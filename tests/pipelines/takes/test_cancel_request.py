import json
import os
import socket
import threading
from pathlib import Path
from typing import Any

import pytest

from v3studio.pipelines.takes.cancel_request import cancelled_on_request, request_cancel
from v3studio.pipelines.takes.take import Take

WAIT = 60.0


@pytest.fixture
def take(tmp_path: Path) -> Take:
    return Take.create(tmp_path / "take")


def test_a_request_that_comes_between_the_lock_and_the_watch_is_kept(take: Take) -> None:
    cancelled = threading.Event()
    with take.locked("v3studio run"):
        request_cancel(take)
        with cancelled_on_request(take, cancelled.set):
            assert cancelled.wait(WAIT)
    assert not take.cancel_request.exists()


@pytest.mark.parametrize(
    "left",
    ["", json.dumps({"pid": os.getpid() + 1, "host": socket.gethostname()}), '{"pid": 7, "host": "other"}', "{"],
    ids=["empty", "another process", "another host", "damaged"],
)
def test_a_request_to_another_run_is_dropped(take: Take, left: Any) -> None:
    take.private.mkdir()
    take.cancel_request.write_text(left)
    cancelled = threading.Event()
    with take.locked("v3studio run"), cancelled_on_request(take, cancelled.set):
        assert not take.cancel_request.exists()
        request_cancel(take)
        assert cancelled.wait(WAIT)
