"""Commands on takes in object storage: they work on a copy on this machine, which is brought up to date before and sent
during and after the command."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from studio.errors import StudioError
from studio.storage import is_address


@contextmanager
def working_copy(arguments: argparse.Namespace) -> Iterator[None]:
    """Replace a take's address in a command's arguments by the folder of its working copy.

    `arguments.stored_run` becomes the `StoredRun` of the take, or None if it is a folder.

    Arguments:
        stored_take: how a command uses the take: "run", "work", "read" or "attach"; commands without it need a folder.

    Raises:
        StudioError: the command needs a folder (`storage.take_needs_folder`), there is no take at the address
            (`take.not_found`), another machine runs it (`take.locked`), or `storage.*`.
    """
    arguments.stored_run = None
    found = {
        name: value
        for name in ("take", "config", "source", "takes")
        if isinstance(value := getattr(arguments, name, None), Path) and is_address(value)
    }
    if not found:
        yield
        return
    from pipelines.takes.stored_run import StoredRun
    from pipelines.takes.stored_take import NO_GROUP, StoredTake

    name, address = next(iter(found.items()))
    use = getattr(arguments, "stored_take", None)
    if use is None:
        raise StudioError(
            "storage.take_needs_folder",
            "is a take in object storage, which this command cannot use",
            file=StoredTake(address).address,
            fix="`v3studio status ADDRESS` brings the copy on this machine up to date and names its folder: use that.",
        )
    stored = StoredTake(address)
    run = arguments.stored_run = StoredRun(stored)
    detaches = getattr(arguments, "detach", False)
    with ExitStack() as stack:
        group: int | None = None
        if detaches:  # what is started holds the take
            run.refuse_other()
        elif use == "run":
            stack.enter_context(run.held(f"v3studio {getattr(arguments, 'stage', None) or 'run'}"))
        if detaches or use == "attach":
            group = NO_GROUP
        elif use == "work" and not _needs_all(arguments):
            group = arguments.group
        if not stored.pull(group) and (use != "run" or name == "config" or getattr(arguments, "config", None) is None):
            raise StudioError(
                "take.not_found",
                "there is no take at this address",
                file=stored.address,
                fix="Create one with `v3studio run CONFIG --take ADDRESS`.",
            )
        setattr(arguments, name, stored.folder)
        if use == "read":
            run.refresh()
        elif use == "attach":
            stack.enter_context(run.followed())
        else:
            stack.enter_context(stored.pushed())
        yield


def _needs_all(arguments: argparse.Namespace) -> bool:
    return arguments.print_commands or "evaluate" in (arguments.stage or ())
