"""The simulation of a cluster, against what follows from the numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.scaling import Cluster, Costs, simulate

COSTS = Costs(frames=[[30.0] + [10.0] * 9], overhead=5.0, bytes_in=2e6, bytes_out=1e6)  # 120 s of work


@pytest.mark.parametrize(("gpus", "rounds"), [(1, 12), (5, 3), (12, 1), (40, 1)])
def test_without_trouble_groups_run_in_rounds(gpus, rounds):
    found = simulate(Cluster("", gpus), COSTS, 12, seed=0)
    assert found.makespan == pytest.approx(rounds * 125)
    assert (found.work, found.attempts, found.moved) == (12 * 120, 12, 12 * 10 * 3e6)


def test_a_slow_node_takes_twice_as_long():
    assert simulate(Cluster("", 2, slow=2), COSTS, 2, seed=0).makespan == pytest.approx(5 + 2 * 120)
    assert simulate(Cluster("", 2, slow=1), COSTS, 3, seed=0).makespan == pytest.approx(2 * 125), (
        "the fast one takes two"
    )


def test_interrupted_groups_go_on_with_the_frame_that_was_lost():
    calm = simulate(Cluster("", 4), COSTS, 200, seed=1)
    failing = simulate(Cluster("", 4, failing=0.1), COSTS, 200, seed=1)
    assert failing.work == calm.work
    assert 205 < failing.attempts < 240  # 200 / 0.9 is expected
    again = failing.attempts - 200
    assert calm.makespan < failing.makespan < calm.makespan + again * (5 + 30) + 125, "at most a frame is lost"
    lost = simulate(Cluster("", 4, lost_per_hour=2.0), COSTS, 200, seed=1)
    assert lost.attempts > 205
    assert lost.makespan > calm.makespan
    assert simulate(Cluster("", 4, lost_per_hour=2.0), COSTS, 200, seed=1) == lost, "the same seed"


def test_nodes_that_are_lost_are_replaced():
    cluster = Cluster("", 1, lost_per_hour=60.0)
    soon, late = (simulate(replace(cluster, replaced_after=seconds), COSTS, 5, seed=3) for seconds in (0.0, 1000.0))
    assert late.attempts == soon.attempts
    assert late.makespan == pytest.approx(soon.makespan + 1000 * (late.attempts - 5))
