"""A Ray cluster of two nodes on this machine, on the loopback interface, with token authentication."""

import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import IO

from v3studio.pipelines.events import Event, GroupStarted, Metrics, read_line

SETTINGS: Mapping[str, str] = {
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": "0123456789abcdef" * 2,
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # loopback only
    "RAY_prestart_worker_first_driver": "0",
    "RAY_enable_worker_prestart": "0",
    "RAY_gcs_server_port_wait_time_s": "600",  # by default half a minute, which a busy machine takes
    "RAY_gcs_server_request_timeout_seconds": "600",
    "RAY_worker_niceness": "0",  # as a local run; by default, tasks have to wait for everything else
}
"""Environment of the cluster and of its drivers."""

_PROGRAM = """
import sys
import ray
from ray.cluster_utils import Cluster
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

class Busy:
    def begin(self):
        pass

cpus = int(sys.argv[1])
few = {"wait": False, "num_cpus": cpus, "include_log_monitor": False}  # each would be a Python process more
head = {**few, "include_dashboard": False, "no_monitor": True}
cluster = Cluster(initialize_head=True, head_node_args=head)
second = cluster.add_node(**few)
cluster.wait_for_nodes(600)
ray.init(cluster.address, log_to_driver=False)
on_first = NodeAffinitySchedulingStrategy(cluster.head_node.node_id, soft=False)
busy = ray.remote(Busy).options(num_cpus=cpus, scheduling_strategy=on_first).remote()
ray.get(busy.begin.remote())
print("ready", cluster.address, second.node_id[:4], flush=True)
for line in sys.stdin:
    if line.strip() == "free":
        ray.kill(busy)
        print("freed", flush=True)
    elif line.strip() == "kill":
        cluster.remove_node(second, allow_graceful=False)
        print("killed", flush=True)
    else:
        break
cluster.shutdown()
"""


class ClusterEnded(AssertionError):
    """The program that runs the cluster has ended."""


class TwoNodes:
    """The cluster; in a process of its own, since Ray reads its environment once. All CPUs of the first node, the head,
    are taken at first, so that the second gets the first task on slow machines, too.

    Attributes:
        address: of the head node.
        second: what the name of the second node ends with in events.
    """

    def __init__(self, process: subprocess.Popen[str], errors: IO[str]) -> None:
        self._process, self._errors = process, errors
        self.address, self.second = self._answer("ready").split()

    def events_while_second_is_killed(self, lines: Iterable[str]) -> Iterator[Event]:
        """The events of a run. The first node is freed when a group trains; the second is killed when it has trained a
        frame of a group that has more.

        Args:
            lines: standard output of `v3studio run --json`, read as it is written.
        """
        freed = killed = False
        nodes: dict[int | None, str] = {}
        for line in lines:
            event, _ = read_line(line)
            if event is not None:
                yield event
            if event is None or event.stage != "train":
                continue
            if isinstance(event, GroupStarted):
                nodes[event.group] = event.node
                if not freed:
                    self._say("free")
                    self._answer("freed")
                    freed = True
            if not killed and isinstance(event, Metrics) and nodes.get(event.group, "").endswith(self.second):
                self._say("kill")  # all its processes, as when its power fails
                self._answer("killed")
                killed = True

    def close(self) -> None:
        """Stop the cluster."""
        if self._process.poll() is None:
            self._say("end")
        self._process.communicate()

    def _say(self, word: str) -> None:
        self._process.stdin.write(f"{word}\n")
        self._process.stdin.flush()

    def _answer(self, word: str) -> str:
        for line in self._process.stdout:
            if line.startswith(word):
                return line.removeprefix(word).strip()
        self._errors.seek(0)
        raise ClusterEnded(f"the cluster ended: {self._errors.read()[-2000:]}")


STARTS = 4
"""Most starts of the cluster. A raylet ends if its agent does not start within 15 seconds, a constant of Ray; on a
machine with many busy processes the first start, which reads all files from the disk, may take longer."""


@contextmanager
def two_nodes(cpus: int = 1) -> Iterator[TwoNodes]:
    """Start a cluster with `cpus` CPUs on each of its two nodes. Raises ClusterEnded."""
    command, pipe, variables = [sys.executable, "-c", _PROGRAM, str(cpus)], subprocess.PIPE, {**os.environ, **SETTINGS}
    with TemporaryFile("w+") as errors:
        for left in reversed(range(STARTS)):
            process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, text=True, env=variables)
            try:
                nodes = TwoNodes(process, errors)
                break
            except ClusterEnded:
                if not left:
                    raise
        try:
            yield nodes
            nodes.close()
        finally:
            if process.poll() is None:
                process.terminate()
                process.communicate()
