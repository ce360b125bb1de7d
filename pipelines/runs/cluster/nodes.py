"""The nodes of a Ray cluster: names, sizes, and which of them are not to be used."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_LOOK_SECONDS = 2.0
_QUERY_SECONDS = 20.0


@dataclass(frozen=True)
class Wanted:
    """The resources that a task takes of a node: CPUs, GPUs (or a share of one), and memory in bytes."""

    cpus: int
    gpus: float
    memory: int

    @property
    def resources(self) -> dict[str, float]:
        """The amounts by Ray's names of resources."""
        amounts = {"CPU": self.cpus, "GPU": self.gpus, "memory": self.memory}
        return {name: amount for name, amount in amounts.items() if amount}

    def __str__(self) -> str:
        """The text for people: "4 CPUs, 1 GPU and 8.0 GB of memory"."""
        return _amounts(self.cpus, self.gpus, self.memory)


def _amounts(cpus: float, gpus: float, memory: float) -> str:
    named = [_amount("CPU", cpus)]
    if gpus:
        named.append(_amount("GPU", gpus))
    return f"{', '.join(named)} and {_amount('memory', memory)}"


def _amount(resource: str, value: float) -> str:
    if resource == "memory":
        return f"{value / 1e9:.1f} GB of memory"
    return f"{value:g} {resource if value == 1 else f'{resource}s'}"


@dataclass(frozen=True)
class _Node:
    host: str
    alive: bool
    resources: Mapping[str, float]

    def fits(self, wanted: Wanted) -> int:
        """The number of such tasks that run on it at once."""
        return min(int(self.resources.get(name, 0.0) / amount) for name, amount in wanted.resources.items())


class Nodes:
    """The nodes of a cluster: what they have, and what holds them. `excluded`: ids of nodes that get no more
    tasks, since they do not see take or footage."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._found: dict[str, _Node] = {}
        self._looked = 0.0
        self.excluded: set[str] = set()

    def _look(self) -> None:
        if not self._found or time.monotonic() - self._looked > _LOOK_SECONDS:
            self._looked = time.monotonic()
            for node in self._ray.nodes():
                self._found[node["NodeID"]] = _Node(
                    node["NodeManagerHostname"], node["Alive"], node.get("Resources", {})
                )

    def name(self, node: str) -> str:
        """A node's host name, with the beginning of its id where several have the same; "a node" if it is unknown."""
        if node not in self._found:
            self._look()
        known = self._found.get(node)
        if known is None:
            return "a node"
        same = [other for other in self._found.values() if other.host == known.host]
        return known.host if len(same) == 1 else f"{known.host}-{node[:4]}"

    def memory(self, node: str) -> float:
        """Bytes of a node that tasks may take; 0 if it is unknown."""
        return self._found[node].resources.get("memory", 0.0) if node in self._found else 0.0

    def usable(self) -> list[str]:
        """Ids of the nodes that may get tasks."""
        self._look()
        return [key for key, node in self._found.items() if node.alive and key not in self.excluded]

    def most(self, resource: str) -> float:
        """The most that a usable node has of a resource: "CPU", "GPU", "memory"."""
        return max((self._found[key].resources.get(resource, 0.0) for key in self.usable()), default=0.0)

    def fitting(self, wanted: Wanted) -> int:
        """The number of such tasks that fit the usable nodes at once."""
        return sum(self._found[key].fits(wanted) for key in self.usable())

    def sizes(self) -> str:
        """The usable nodes in words for people: the sizes, each once, the largest first."""
        resources = [self._found[key].resources for key in self.usable()]
        sizes = {tuple(amounts.get(name, 0.0) for name in ("CPU", "GPU", "memory")) for amounts in resources}
        return "; ".join(f"nodes with {_amounts(*size)}" for size in sorted(sizes, reverse=True)) or "no usable node"

    def holders(self, wanted: Wanted) -> str:
        """Say what holds the usable nodes that are large enough for a task: "node1 has 0 of 4 CPUs free, held
        by the actor Busy"; "" if one of them has room for it now."""
        from ray.exceptions import GetTimeoutError

        query = self._ray.remote(_usage).options(num_cpus=0).remote()
        try:
            free, actors, programs = self._ray.get(query, timeout=_QUERY_SECONDS)
        except GetTimeoutError:
            return "the cluster does not answer what holds its nodes"
        parts = []
        for key in self.usable():
            node = self._found[key]
            if not node.fits(wanted):
                continue
            left = free.get(key, {})
            if _Node(node.host, True, left).fits(wanted):
                return ""
            named = [
                f"{left.get(name, 0.0):g} of {_amount(name, node.resources[name])} free"
                for name, amount in wanted.resources.items()
                if left.get(name, 0.0) < amount
            ]
            held = f", held by {', '.join(actors[key])}" if actors.get(key) else ""
            parts.append(f"{self.name(key)} has {' and '.join(named)}{held}")
        if programs:
            parts.append(f"other programs that use the cluster: {', '.join(programs)}")
        return "; ".join(parts)


def _usage() -> tuple[dict[str, dict[str, float]], dict[str, list[str]], list[str]]:
    """Free resources of each node, by its id; the actors on it; and the other programs that are connected.

    A task without CPUs, since Ray's client (ray://) cannot answer this. The public state API needs the dashboard.
    """
    import ray
    from ray._private import state

    actors: dict[str, list[str]] = {}
    for actor in state.actors(actor_state_name="ALIVE").values():
        named = f"the actor {actor['Name'] or actor['ActorClassName']}"
        actors.setdefault(actor["Address"]["NodeID"], []).append(named)
    own = ray.get_runtime_context().get_job_id()
    programs = []
    for job in state.jobs():
        if not job["IsDead"] and job["JobID"] != own:
            command = (job["Entrypoint"].splitlines() or ["?"])[0]
            programs.append(f"`{command[:80]}` (process {job['DriverPid']} on {job['DriverIPAddress']})")
    return state.available_resources_per_node(), actors, programs
