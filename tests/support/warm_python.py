"""Python programs started from a process that has imported the heavy libraries already.

Importing PyTorch and its company takes three seconds of CPU time, and taking it down a third of one; the tests start
more than a hundred programs. A `WarmPython` imports once and forks for each program of all processes that run tests.
What a program is given (arguments, folder, environment, pipes) and what can be done to it (signals, kill -9, waiting)
is as with `subprocess`.
Three things differ: modules of the project are imported before the program starts; environment variables that Python,
the C library or OpenMP read as they start (LC_ALL, PYTHONUTF8) have the values of the `WarmPython`; and a program
without a window ends without taking its libraries down. Tests of imports, of start-up and of the very end therefore use
`subprocess`. A `v3studio` that such a program starts, as the window starts a run, is forked, too.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import errno
import fcntl
import functools
import gc
import io
import json
import os
import pkgutil
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

_ROOT = Path(__file__).parents[2]
_LIBRARIES = ("torch.optim", "cv2", "av", "v3studio.gui", "open3d", "pymeshlab", "matplotlib.figure")
_LIBRARIES += ("scipy.optimize", "rich.progress", "jinja2", "safetensors.torch")
_PACKAGES = ("v3studio.studio", "v3studio.pipelines", "v3studio.gui")


class WarmProcess:
    """A started program; the part of `subprocess.Popen` that the tests use.

    Attributes:
        pid: of the program.
        stdin, stdout, stderr: our ends of its pipes; None if it was given a file.
        returncode: exit status, negative for a signal; None until `poll`, `wait` or `communicate` sees the end.
    """

    def __init__(self, args: Sequence[str], pid: int, status: int, pipes: Sequence[IO[Any] | None]):
        self.args, self.pid, self._status = list(args), pid, status
        self.stdin, self.stdout, self.stderr = pipes
        self.returncode: int | None = None

    def wait(self, timeout: float | None = None) -> int:
        """The exit status; raises subprocess.TimeoutExpired."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0)
            told = os.read(self._status, 16)
            os.close(self._status)
            assert told, "the warm process has ended"
            self.returncode = int(told)
        return self.returncode

    def poll(self) -> int | None:
        """The exit status, or None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal unless the program has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[Any, Any]:
        """Read both pipes to their ends and wait; raises subprocess.TimeoutExpired."""
        read: dict[int, Any] = {}
        pipes = [pipe for pipe in (self.stdout, self.stderr) if pipe is not None and not pipe.closed]
        threads = [
            threading.Thread(target=lambda p=pipe: read.update({id(p): p.read()}), daemon=True) for pipe in pipes
        ]
        for thread in threads:
            thread.start()
        self.wait(timeout)
        for thread in threads:
            thread.join(timeout)
            if thread.is_alive():  # a process that the program left behind holds the pipe
                raise subprocess.TimeoutExpired(self.args, timeout or 0)
        for pipe in pipes:
            pipe.close()
        return read.get(id(self.stdout)), read.get(id(self.stderr))

    def __enter__(self) -> WarmProcess:
        return self

    def __exit__(self, *_: object) -> None:
        for pipe in (self.stdin, self.stdout, self.stderr):
            if pipe is not None:
                pipe.close()
        self.wait()


class WarmPython:
    """The process that forks, by a connection to it. It ends when all that were not forked by itself are closed."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket, self._lock = connection, threading.Lock()

    def popen(
        self,
        arguments: Sequence[object],  # what follows `python`: -m MODULE ..., -c CODE ..., or FILE ....
        *,
        cwd: Path | str = _ROOT,
        env: Mapping[str, str] | None = None,  # the whole environment; default: that of this process, now
        text: bool = False,  # the pipes give str (UTF-8) instead of bytes
        output: IO[bytes] | None = None,  # takes standard output, and error unless `errors` does, instead of pipes
        errors: IO[bytes] | int | None = None,  # takes standard error; `subprocess.STDOUT`: as standard output
        tied: bool = False,  # standard input is a pipe
        session: bool = False,  # it begins a session of its own
    ) -> WarmProcess:
        """Start a program."""
        args = [str(argument) for argument in arguments]
        status_read, status_write = os.pipe()
        ends = [os.pipe() if piped else None for piped in (tied, not output, not (errors or output))]
        taken = [end and end[number > 0] for number, end in enumerate(ends)]
        with open(os.devnull, "rb") as nothing:
            files = (nothing, output or nothing, errors or output or nothing)
            given = [file if end is None else end for file, end in zip(files, taken, strict=True)]
            if errors == subprocess.STDOUT:
                given[2] = given[1]
            descriptors = [one if isinstance(one, int) else one.fileno() for one in given]
            environment = dict(os.environ if env is None else env)
            where = json.dumps({"args": args, "cwd": str(cwd), "env": environment, "session": session}).encode()
            with self._lock:
                socket.send_fds(self._socket, [where], [*descriptors, status_write])
                pid = int(self._socket.recv(32))
        for descriptor in (*filter(None, taken), status_write):
            os.close(descriptor)
        kind, encoding = ("", "utf-8") if text else ("b", None)
        modes = ("w", "r", "r")
        opened = functools.partial(open, encoding=encoding)
        pipes = [end and opened(end[m == "w"], m + kind) for m, end in zip(modes, ends, strict=True)]
        return WarmProcess(args, pid, status_read, pipes)

    def run(
        self, arguments: Sequence[object], *, timeout: float = 280, **options: Any
    ) -> subprocess.CompletedProcess[Any]:
        """Run a program to its end, as subprocess.run with captured output; `options` of `popen`."""
        process = self.popen(arguments, **options)
        try:
            stdout, stderr = process.communicate(timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        return subprocess.CompletedProcess(process.args, process.wait(), stdout, stderr)


_started: list[subprocess.Popen[bytes]] = []


@functools.cache
def warm_python(locale: str | None = None) -> WarmPython:
    """The warm Python of all parallel processes of this run of the tests; one per locale (LC_ALL and LANG)."""
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", os.getpid())
    address = f"\0warm python {run} {locale}"  # no file
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    while True:
        _start(address, locale)
        try:
            connection.connect(address)
            return WarmPython(connection)
        except ConnectionRefusedError:  # it does not listen yet, or has just ended
            time.sleep(0.01)


def _start(address: str, locale: str | None) -> None:
    """Start a warm Python at this address, unless there is one."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        try:
            listener.bind(address)
        except OSError:
            return
        listener.listen()
        environment = {**os.environ, "PYTHONPATH": str(_ROOT)}
        environment |= {"LC_ALL": locale, "LANG": locale} if locale else {}
        command = [sys.executable, "-m", "tests.support.warm_python", str(listener.fileno())]
        command += ["no window"] if locale else []
        _started.append(subprocess.Popen(command, pass_fds=[listener.fileno()], cwd=_ROOT, env=environment))


def _serve(listener: socket.socket) -> tuple[list[str], socket.socket]:
    """Fork for each request, also of the forked processes, in which this returns the arguments of their program and a
    connection for their requests."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wake, woken = socket.socketpair()
    for end in (wake, woken):
        end.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(woken.fileno())
    running: dict[int, int] = {}
    connections: list[socket.socket] = []
    clients: set[socket.socket] = set()  # the connections of the tests' processes
    while True:
        ready = select.select([*connections, listener, wake], [], [])[0]
        if listener in ready:
            client, _ = listener.accept()
            connections.append(client)
            clients.add(client)
        if wake in ready:
            with contextlib.suppress(BlockingIOError):
                wake.recv(4096)
            while running:
                pid, state = os.waitpid(-1, os.WNOHANG)
                if not pid:
                    break
                status = running.pop(pid)
                with contextlib.suppress(BrokenPipeError):  # nobody waits for it any more
                    os.write(status, str(os.waitstatus_to_exitcode(state)).encode())
                os.close(status)
        for one in [one for one in connections if one in ready]:
            data, descriptors, _, _ = socket.recv_fds(one, 1 << 20, 4)
            if not data:
                connections.remove(one)
                clients.discard(one)
                one.close()
                if not clients:
                    os._exit(0)
                continue
            request = json.loads(data)
            *files, status = descriptors
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                signal.signal(signal.SIGINT, signal.default_int_handler)
                for end in (*connections, listener, wake, woken, ours):
                    end.close()
                for descriptor in (status, *running.values()):
                    os.close(descriptor)
                if request["session"]:
                    os.setsid()
                _become(request["cwd"], request["env"], files)
                return request["args"], theirs
            running[pid] = status
            connections.append(ours)
            theirs.close()
            for descriptor in files:
                os.close(descriptor)
            with contextlib.suppress(BrokenPipeError):
                one.send(str(pid).encode())


def _become(folder: str, environment: dict[str, str], files: list[int]) -> None:
    """Take on a program's folder, environment, input and output."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, descriptor in enumerate(files):
        os.dup2(descriptor, number)
    for descriptor in files:
        os.close(descriptor)
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        old = getattr(sys, name)
        raw = open(descriptor, "wb", buffering=-1, closefd=False)  # noqa: SIM115
        made = io.TextIOWrapper(raw, encoding=old.encoding, errors=old.errors, line_buffering=name == "stderr")
        setattr(sys, name, made)
        setattr(sys, f"__{name}__", made)


def forking(warm: WarmPython) -> type[subprocess.Popen[Any]]:
    """`subprocess.Popen` that has `v3studio` forked."""

    class Popen(subprocess.Popen[Any]):
        def __new__(cls, args: Any, **options: Any) -> Any:
            if args[:4] != [sys.executable, "-P", "-m", "v3studio.pipelines.cli"]:
                return super().__new__(cls)
            tied, piped = (options.get(name) == subprocess.PIPE for name in ("stdin", "stdout"))
            with open(os.devnull, "wb") as nothing:
                return warm.popen(
                    args[2:],
                    cwd=os.path.abspath(options.get("cwd", ".")),
                    env=options.get("env"),
                    output=None if piped else nothing,
                    errors=options["stderr"],
                    tied=tied,
                    session=options.get("start_new_session", False),
                )

    return Popen


def lose_locks(put: Callable[[object, str, object], None] = setattr) -> None:
    """Answer every lock as file systems without locks do. For all tests: `V3STUDIO_WITHOUT_LOCKS=1 pytest`."""
    from v3studio.studio import atomic_files

    def flock(file: object, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    put(atomic_files, "fcntl", SimpleNamespace(**{**vars(fcntl), "flock": flock}))
    put(atomic_files, "told_of_locks", threading.Event())


def _run(arguments: list[str]) -> None:
    """Run a program as Python would."""
    first, *rest = arguments
    if first == "-m":
        module, *rest = rest
        sys.argv = [module, *rest]
        sys.modules.pop(module, None)  # or runpy warns
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    elif first == "-c":
        code, *rest = rest
        sys.argv = ["-c", *rest]
        sys.path.insert(0, "")
        exec(compile(code, "<string>", "exec"), {"__name__": "__main__", "__builtins__": __builtins__})
    else:
        sys.argv = [first, *rest]
        sys.path.insert(0, str(Path(first).parent))
        runpy.run_path(first, run_name="__main__")


def _end(code: int) -> None:
    """End as Python does, without the libraries' last steps."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    ctypes.CDLL(None).fflush(None)
    os._exit(code & 0xFF)


if __name__ == "__main__":
    from importlib import import_module

    from v3studio.studio.process import passive_openmp

    passive_openmp()
    if "V3STUDIO_WITHOUT_LOCKS" in os.environ:
        lose_locks()
    gc.disable()
    for _name in _LIBRARIES:
        import_module(_name)
    for _package in map(import_module, _PACKAGES[: 2 if "no window" in sys.argv else 3]):
        for _module in pkgutil.walk_packages(_package.__path__, f"{_package.__name__}."):
            if "triton" not in _module.name:  # tests choose how Triton is imported, if it is there
                import_module(_module.name)
    gc.collect()
    gc.enable()
    gc.freeze()  # otherwise the first collection in each program copies all these pages
    _arguments, _own = _serve(socket.socket(fileno=int(sys.argv[1])))
    if "OMP_NUM_THREADS" in os.environ:  # OpenMP read it when it was loaded
        import torch

        torch.set_num_threads(int(os.environ["OMP_NUM_THREADS"]))
    subprocess.Popen = forking(WarmPython(_own))  # type: ignore[assignment,misc]
    _code: object = 0
    try:
        _run(_arguments)
    except SystemExit as stop:
        _code = stop.code or 0
        if not isinstance(_code, int):  # a message
            raise
    if "--log-state" not in _arguments:  # the end of a window is part of what is tested
        _end(_code)
    sys.exit(_code)
