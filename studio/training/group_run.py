"""Training steps on random frames and views of a whole group, which can be interrupted and resumed."""

from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn
from v3studio.studio.training import settings as constants
from v3studio.studio.training.adam import Adam, ParameterGroup
from v3studio.studio.training.interframe import rate_factor
from v3studio.studio.training.step import Checkpoint, CheckpointFn, Stepper, part_of

Leaves = dict[str, Tensor]  # what is trained, by name


def train_group(
    steppers: Sequence[Stepper],
    start: Mapping[str, tuple[Tensor, float]],
    gaussians: Callable[[Leaves, int], Gaussians],
    loss: Callable[[Tensor, Gaussians, Leaves, int], Tensor],
    iterations: int,
    phase: str,
    progress: ProgressFn,
    checkpoint: CheckpointFn | None,
    resume: Checkpoint | None,
) -> Leaves:
    """Run all steps, each on a view of the next frame; the same inputs give the same leaves, bit for bit.

    Args:
        steppers: one per frame, all with the same generator.
        start: what is trained, where it has any numbers; each has its own Adam moments. With its learning rate, which
            decays in the second half of the steps (`rate_factor`).
        gaussians: the splats of a frame; gradients propagate to the leaves.
        loss: the photometric loss of a step with these splats, on a frame, plus what else it costs.
        phase: for progress and errors.
        progress: called with completed and total steps, `phase`, and regularly also with `loss`, `psnr` (dB) and
            `splats`.
        checkpoint: called with step and complete state every `CHECKPOINT_EVERY` steps, but not after the last.
        resume: a checkpoint of the same inputs. The result equals that of an uninterrupted run.
    """
    leaves = {
        name: value.detach().clone().contiguous().requires_grad_()
        for name, (value, _) in start.items()
        if value.shape[1:].numel()
    }
    adam = Adam([ParameterGroup([leaf], start[name][1], name) for name, leaf in leaves.items()], eps=1e-15)
    done, order = (0, []) if resume is None else _restored(resume, steppers, leaves, adam)
    while done < iterations:
        if not order:  # each frame once, in a new order
            order = torch.randperm(len(steppers), generator=steppers[0].generator).tolist()
        frame = order.pop(0)
        for group in adam.groups:
            group.rate = start[group.name][1] * rate_factor(done / iterations)
        splats = gaussians(leaves, frame)
        step = steppers[frame](splats, dropout=True)
        loss(step.loss, splats, leaves, frame).backward()  # type: ignore[no-untyped-call]
        adam.step()
        adam.zero_grad()
        done += 1
        progress(done, iterations, phase=phase, **step.figures(done, phase, len(splats)))
        if checkpoint is not None and done % constants.CHECKPOINT_EVERY == 0 and done < iterations:
            checkpoint(done, _state(done, order, steppers, leaves, adam))
    return leaves


def _state(done: int, order: list[int], steppers: Sequence[Stepper], leaves: Leaves, adam: Adam) -> Checkpoint:
    tensors = {
        "done": torch.tensor(done),
        "generator": steppers[0].generator.get_state(),
        "order": torch.tensor(order, dtype=torch.int64),
    }
    for index, stepper in enumerate(steppers):
        tensors |= {f"stepper.{index}.{name}": value for name, value in stepper.state().items()}
    for name, leaf in leaves.items():
        tensors[f"{name}.value"] = leaf.detach()
        tensors |= {f"{name}.adam.{key}": value for key, value in adam.state.get(leaf, {}).items()}
    return tensors


def _restored(state: Checkpoint, steppers: Sequence[Stepper], leaves: Leaves, adam: Adam) -> tuple[int, list[int]]:
    """Continue from a `_state`, bit for bit: the number of steps that are done, and the next frames."""
    steppers[0].generator.set_state(state["generator"].cpu())
    for index, stepper in enumerate(steppers):
        stepper.restore(part_of(state, f"stepper.{index}."))
    for name, leaf in leaves.items():
        with torch.no_grad():
            leaf.copy_(state[f"{name}.value"])
        moments = part_of(state, f"{name}.adam.")
        if moments:
            adam.state[leaf] = {key: value.to(leaf.device) for key, value in moments.items()}
    return int(state["done"]), state["order"].tolist()
