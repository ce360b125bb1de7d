"""Runs that continue without the terminal that started them."""

from collections.abc import Sequence

from v3studio.pipelines.config import Config
from v3studio.pipelines.runs.launch import ERRORS, Launched, launch, until_begun
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.settings_file import save_config
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.errors import StudioError


def start_background(take: Take, config: Config, arguments: Sequence[str]) -> Launched:
    """Start a run that continues when this process ends; returns when it has begun, or found everything up to date and
    ended. With a Ray client address (ray://), it runs on the head node of the cluster, else on this machine."""
    holder = take.running()
    if holder is not None:
        raise take.in_use(holder)
    with disk_errors(take.root):
        take.private.mkdir(parents=True, exist_ok=True)
        before = take.config.read_bytes() if take.config.is_file() else None
        save_config(take.config, config)
    place = str(take.root)
    words = [*arguments, "--take", place, "--json"]
    if config.run.executor == "ray" and config.run.address.startswith("ray://"):
        from v3studio.pipelines.runs.cluster.detached import start_on_head

        launched = start_on_head(config.run.address, words, place)
    else:
        errors = take.private / ERRORS
        launched = until_begun(launch(words, errors), take.log, errors)
    if launched.code:
        if before is not None:  # a run that was refused changes nothing
            write_bytes(take.config, before)
        raise StudioError("run.failed", launched.error.removeprefix("error: "), code_of_process=launched.code)
    return launched
