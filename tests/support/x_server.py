"""A private X server, for programs with a window."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def x_server(size: str = "1400x900") -> Iterator[str]:
    """Name of its display, for example ":101"; `size` in pixels."""
    read_end, write_end = os.pipe()
    # -r: no key repeat; -noreset: else it starts again when the window closes, and refuses xdotool meanwhile
    command = ["Xvfb", "-displayfd", str(write_end), "-screen", "0", f"{size}x24", "-nolisten", "tcp", "-r", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[write_end], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(write_end)
    try:
        with os.fdopen(read_end) as pipe:
            number = pipe.readline().strip()
        assert number, f"Xvfb ended with status {server.wait()}"
        yield f":{number}"
    finally:
        server.terminate()
        server.wait(120)
