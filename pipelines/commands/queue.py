"""`v3studio queue`: a queue of takes that this machine works through."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, print_text
from v3studio.pipelines.commands.common.source import add_source, is_take, read_settings
from v3studio.pipelines.reports.terminal import console, escaped, say, table_of
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from types import FrameType

    from v3studio.pipelines.batch.queue_file import QueuedTake, QueueFile


def register(commands: Any) -> None:
    more = "A failed take does not stop the next one; an interrupted one resumes where it stopped."
    command = add_command(commands, "queue", "queue takes, and run them one after the other", more=more)
    kinds = command.add_subparsers(title="commands", required=True, metavar="COMMAND")

    add = _kind(kinds, "add", "add a take at the end", _add)
    add_source(add)
    add.add_argument("--take", type=Path, metavar="TAKE", help="folder of the take; created when it is run")

    _kind(kinds, "list", "show the takes and their states", _list)

    _kind(kinds, "run", "run all waiting takes, including those added meanwhile", _run)

    _kind(kinds, "stop", "stop the program that runs the queue; its take resumes when it runs again", _stop)

    move = _kind(kinds, "move", "move a waiting take", _move)
    move.add_argument("number", type=int, metavar="NUMBER", help="number of the take, from `v3studio queue list`")
    move.add_argument("place", type=int, metavar="PLACE", help="new place in the queue; 1 is next")

    remove = _kind(kinds, "remove", "remove takes from the queue; their folders are not touched", _remove)
    remove.add_argument("number", type=int, nargs="+", metavar="NUMBER", help="number of the take")

    retry = _kind(kinds, "retry", "queue a finished or failed take again", _retry)
    retry.add_argument("number", type=int, metavar="NUMBER", help="number of the take")


def _kind(kinds: Any, name: str, text: str, command: Any) -> argparse.ArgumentParser:
    parser = add_command(kinds, name, text, command)
    parser.add_argument("--queue", type=Path, metavar="FILE", help="file of the queue (default: the user's queue)")
    return parser


def _file(arguments: argparse.Namespace) -> QueueFile:
    from v3studio.pipelines.batch.queue_file import QueueFile, default_queue

    return QueueFile(arguments.queue or default_queue())


def _add(arguments: argparse.Namespace) -> None:
    source, take = arguments.source, arguments.take
    if take is None:
        if not is_take(source):
            fix = f"Example: v3studio queue add {source} --take takes/first."
            raise StudioError("command.no_take", "no take is specified", fix=fix, option="--take")
        source, take = None, source
    read_settings(source, arguments.overrides, take=take)  # report invalid settings now, not overnight
    entry = _file(arguments).add(take, source, tuple(arguments.set))
    arguments.result = entry.model_dump(mode="json")
    print_text(arguments, f"take {entry.number}: {entry.take}")


def _list(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.runs.status import progress
    from v3studio.pipelines.takes.take import Take

    queue = _file(arguments)
    queued = queue.read()
    arguments.result = queued.model_dump(mode="json")
    if arguments.json:
        return
    if not queued.takes:
        say("The queue is empty.")
        return
    shown = table_of("number", "state", "progress", "take", "added", "ended", "message", left=(1, 2, 3, 4, 5, 6))
    is_run = queue.is_run()
    for entry in queued.takes:
        state = "interrupted" if entry.state == "running" and not is_run else entry.state
        times = (text.replace("T", " ").removesuffix("+00:00") for text in (entry.added, entry.finished))
        words = progress(Take(entry.take))[0] if state == "running" else ""
        shown.add_row(
            str(entry.number), state, escaped(words), escaped(str(entry.take)), *times, escaped(entry.message)
        )
    console().print(shown)
    if not is_run and any(entry.state in ("waiting", "running") for entry in queued.takes):
        say("The queue is not running; `v3studio queue run` starts it.")


def _run(arguments: argparse.Namespace) -> int:
    from v3studio.pipelines.batch.run_queue import run_queue
    from v3studio.pipelines.events import Emit, Event, Finished, Log
    from v3studio.pipelines.events.cancellation import Cancellation
    from v3studio.pipelines.runs.console import Bars

    stopped = Cancellation()

    def interrupt(number: int, frame: FrameType | None) -> None:
        stopped.cancel()
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as for a job in the background of a shell
        signal.signal(signal.SIGINT, interrupt)
    bars = ExitStack()
    show: Emit = arguments.emit

    def tell(entry: QueuedTake, words: str) -> None:
        text = f"take {entry.number}: {words}"
        arguments.emit(Log(message=text)) if arguments.json else say(f"== {text}")

    def starts(entry: QueuedTake) -> None:
        nonlocal show
        tell(entry, str(entry.take))
        if not arguments.json:
            show = bars.enter_context(Bars())

    def emit(event: Event) -> None:
        if not (arguments.json and isinstance(event, Finished)):  # of one take; that of the queue is the last
            show(event)

    def ended(entry: QueuedTake) -> None:
        bars.close()
        tell(entry, f"{entry.state}{f' ({entry.message})' if entry.message else ''}")

    with bars:
        done, failed = run_queue(_file(arguments), starts, emit, ended, check=stopped.check)
    arguments.result = {"done": done, "failed": failed}
    print_text(arguments, f"{done} done, {failed} failed")
    return 1 if failed else 0


def _stop(arguments: argparse.Namespace) -> None:
    arguments.result = {"pid": _file(arguments).stop()}
    print_text(arguments, f"stopping process {arguments.result['pid']}")


def _move(arguments: argparse.Namespace) -> None:
    _changed(arguments, lambda queue: queue.move(arguments.number, arguments.place))


def _remove(arguments: argparse.Namespace) -> None:
    _changed(arguments, lambda queue: [queue.remove(number) for number in arguments.number])


def _retry(arguments: argparse.Namespace) -> None:
    _changed(arguments, lambda queue: queue.retry(arguments.number))


def _changed(arguments: argparse.Namespace, change: Callable[[QueueFile], object]) -> None:
    queue = _file(arguments)
    change(queue)
    arguments.result = queue.read().model_dump(mode="json")
