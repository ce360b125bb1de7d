import signal
import subprocess
import sys

import pytest

LOOP = """
import sys, time, hashlib
from v3studio.pipelines.events.cancellation import Cancellation, stop_on_signals
from v3studio.studio.errors import Cancelled
flag = Cancellation()
try:
    with stop_on_signals(flag, lambda: print("last words", flush=True)):
        print("ready", flush=True)
        while True:
            {body}
except Cancelled:
    print("unwound", flush=True)
    sys.exit(130)
"""
POLITE = LOOP.format(body="time.sleep(0.01); flag.check()")
# a long call into C that lets other threads run, as structure from motion does
STUCK = LOOP.format(body="hashlib.pbkdf2_hmac('sha256', b'x', b'y', 10**9)")


@pytest.mark.parametrize(("body", "said"), [(POLITE, "unwound"), (STUCK, "last words")], ids=["polite", "stuck"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_work(body: str, said: str, number: int) -> None:
    process = subprocess.Popen([sys.executable, "-c", body], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        output, _ = process.communicate(timeout=120)  # 2 s on a machine that has nothing else to do
    finally:
        process.kill()
    assert (process.returncode, output) == (130, f"{said}\n")
