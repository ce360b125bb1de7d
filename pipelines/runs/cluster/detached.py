"""A run that belongs to the cluster: its process is started by an actor on the head node."""

import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from v3studio.pipelines.runs.cluster.connection import ADDRESS_VARIABLE, connected
from v3studio.pipelines.runs.launch import ERRORS, Launched, launch, until_begun
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError


class Starter:
    """Actor that starts the process of a run on its node, and ends with it."""

    def start(self, words: Sequence[str], place: str) -> Launched:
        """Start `v3studio WORDS`, and wait until it has begun or ended. Raises OSError: the take is not here."""
        import ray

        take = Take(Path(place))
        errors = take.private / ERRORS
        # not as a setting: the run would write the address, which is for this node, to the take
        address = ray.get_runtime_context().gcs_address
        process = launch(words, errors, {ADDRESS_VARIABLE: address})
        launched = until_begun(process, take.log, errors)

        def wait() -> None:
            process.wait()
            time.sleep(5)  # the answer may still be on its way
            os._exit(0)

        threading.Thread(target=wait, daemon=True).start()
        return launched


def start_on_head(address: str, words: Sequence[str], place: str) -> Launched:
    """Start a run on the head node of a cluster (ray://HOST:PORT), and wait until it has begun or ended."""
    with connected(address, 1) as ray:
        options = {"lifetime": "detached", "num_cpus": 0, "resources": {"node:__internal_head__": 0.001}}
        starter = ray.remote(Starter).options(**options).remote()
        try:
            launched: Launched = ray.get(starter.start.remote(list(words), place))
        except (ray.exceptions.RayError, ConnectionError) as error:
            ray.kill(starter)
            lines = str(error).strip().splitlines() or [type(error).__name__]
            problem = f"the head node of {address} cannot start the run ({lines[-1]})"
            fix = "Mount the take under the same path there, and install the same version of V3 Studio."
            raise StudioError("cluster.not_visible", problem, fix=fix) from None
        return launched
