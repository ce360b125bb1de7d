"""A run that belongs to the cluster: its process is started by an actor on the head node."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Sequence
from pathlib import Path

from pipelines.runs.cluster.connection import connected
from pipelines.runs.launch import launch
from studio.errors import StudioError


class Starter:
    """Actor that starts the process of a run on its node, and ends with it."""

    def start(self, words: Sequence[str], errors: str) -> str:
        """Start `v3studio WORDS`; returns where, for people. Raises OSError."""
        import ray

        address = ray.get_runtime_context().gcs_address
        process = launch([*words, "--run.address", address], Path(errors))

        def wait() -> None:
            process.wait()
            os._exit(0)

        threading.Thread(target=wait, daemon=True).start()
        return f"process {process.pid} on {socket.gethostname()}"


def start_on_head(address: str, words: Sequence[str], errors: str) -> str:
    """Start a run on the head node of a cluster.

    Args:
        address: ray://HOST:PORT.
        words: arguments of `v3studio`.
        errors: file for the standard error of the run, on the head node.

    Returns:
        where it runs.

    Raises:
        StudioError: the cluster cannot be reached, or its head node does not see the take.
    """
    with connected(address, 1) as ray:
        options = {"lifetime": "detached", "num_cpus": 0, "resources": {"node:__internal_head__": 0.001}}
        starter = ray.remote(Starter).options(**options).remote()
        try:
            return str(ray.get(starter.start.remote(list(words), errors)))
        except ray.exceptions.RayTaskError as error:
            ray.kill(starter)
            lines = str(error).strip().splitlines()
            raise StudioError(
                "cluster.not_visible",
                f"the head node of {address} cannot start the run ({lines[-1]})",
                fix="Mount the take under the same path there, and install the same version of V3 Studio.",
            ) from None
