"""The nodes of a Ray cluster: names, sizes, and which of them are not to be used."""

from __future__ import annotations

import time
from typing import Any

_LOOK_SECONDS = 2.0


class Nodes:
    """See the module.

    Args:
        ray: the package, connected.

    Attributes:
        excluded: ids of nodes that get no more tasks, because they do not see the take or the footage.
    """

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self._found: dict[str, dict[str, Any]] = {}
        self._looked = 0.0
        self.excluded: set[str] = set()

    def _alive(self) -> dict[str, dict[str, Any]]:
        if not self._found or time.monotonic() - self._looked > _LOOK_SECONDS:
            self._looked = time.monotonic()
            self._found.update({node["NodeID"]: node for node in self._ray.nodes()})
        return {key: node for key, node in self._found.items() if node["Alive"]}

    def name(self, node: str) -> str:
        """A node's host name, with the beginning of its id where several have the same; "a node" if it is unknown."""
        found = self._found.get(node) or self._alive().get(node)
        if found is None:
            return "a node"
        host = str(found["NodeManagerHostname"])
        same = [one for one in self._found.values() if one["NodeManagerHostname"] == host]
        return host if len(same) == 1 else f"{host}-{node[:4]}"

    def memory(self, node: str) -> float:
        """Bytes of a node that tasks may take."""
        return float(self._found.get(node, {}).get("Resources", {}).get("memory", 0.0))

    @property
    def usable(self) -> list[str]:
        """Ids of the nodes that may get tasks."""
        return [key for key in self._alive() if key not in self.excluded]

    def most(self, resource: str) -> float:
        """What the largest usable node has of a resource: "CPU", "GPU", "memory"."""
        alive = self._alive()
        return max((float(alive[key]["Resources"].get(resource, 0.0)) for key in self.usable), default=0.0)

    def fitting(self, options: dict[str, Any]) -> int:
        """How many tasks with these options fit the usable nodes at once."""
        wanted = {"CPU": options["num_cpus"], "GPU": options["num_gpus"], "memory": options["memory"]}
        alive, count = self._alive(), 0
        for key in self.usable:
            has = alive[key]["Resources"]
            count += min(int(has.get(name, 0.0) / amount) for name, amount in wanted.items() if amount)
        return count

    def on(self, node: str) -> Any:
        """Scheduling strategy for exactly this node."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return NodeAffinitySchedulingStrategy(node, soft=False)
