"""The nodes of a Ray cluster: names, sizes, and which of them are not to be used."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_LOOK_SECONDS = 2.0


@dataclass(frozen=True)
class Wanted:
    """What a task takes of a node: CPUs, GPUs (or a share of one), and memory in bytes."""

    cpus: int
    gpus: float
    memory: int

    def __str__(self) -> str:
        """For people: "4 CPUs, 1 GPU and 8.0 GB of memory"."""
        return _amounts(self.cpus, self.gpus, self.memory)


def _amounts(cpus: float, gpus: float, memory: float) -> str:
    named = [f"{cpus:g} {'CPU' if cpus == 1 else 'CPUs'}"]
    if gpus:
        named.append(f"{gpus:g} {'GPU' if gpus == 1 else 'GPUs'}")
    return f"{', '.join(named)} and {memory / 1e9:.1f} GB of memory"


@dataclass(frozen=True)
class _Node:
    host: str
    alive: bool
    resources: Mapping[str, float]

    def fits(self, wanted: Wanted) -> int:
        """How many such tasks run on it at once."""
        amounts = {"CPU": wanted.cpus, "GPU": wanted.gpus, "memory": wanted.memory}
        return min(int(self.resources.get(name, 0.0) / amount) for name, amount in amounts.items() if amount)


class Nodes:
    """See the module.

    Args:
        ray: the package, connected.

    Attributes:
        excluded: ids of nodes that get no more tasks, because they do not see the take or the footage.
    """

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
        found = self._found.get(node)
        if found is None:
            return "a node"
        same = [one for one in self._found.values() if one.host == found.host]
        return found.host if len(same) == 1 else f"{found.host}-{node[:4]}"

    def memory(self, node: str) -> float:
        """Bytes of a node that tasks may take; 0 if it is unknown."""
        return self._found[node].resources.get("memory", 0.0) if node in self._found else 0.0

    def usable(self) -> list[str]:
        """Ids of the nodes that may get tasks."""
        self._look()
        return [key for key, node in self._found.items() if node.alive and key not in self.excluded]

    def most(self, resource: str) -> float:
        """What the largest usable node has of a resource: "CPU", "GPU", "memory"."""
        return max((self._found[key].resources.get(resource, 0.0) for key in self.usable()), default=0.0)

    def fitting(self, wanted: Wanted) -> int:
        """How many such tasks fit the usable nodes at once."""
        return sum(self._found[key].fits(wanted) for key in self.usable())

    def sizes(self) -> str:
        """What the usable nodes have, for people: the sizes, each once, the largest first."""
        found = [self._found[key].resources for key in self.usable()]
        sizes = {tuple(one.get(name, 0.0) for name in ("CPU", "GPU", "memory")) for one in found}
        return "; ".join(f"nodes with {_amounts(*size)}" for size in sorted(sizes, reverse=True)) or "no usable node"

    def on(self, node: str) -> Any:
        """Scheduling strategy for exactly this node."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return NodeAffinitySchedulingStrategy(node, soft=False)
