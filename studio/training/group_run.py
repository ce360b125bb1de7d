"""Training steps on random frames and views of a whole group, which can be interrupted and resumed."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.training import settings as constants
from studio.training.adam import Adam, ParameterGroup
from studio.training.interframe import rate_factor
from studio.training.settings import TrainSettings
from studio.training.step import Checkpoint, CheckpointFn, Stepper, part_of
from studio.training.views import TrainingView


class GroupRun(ABC):
    """The state that changes in each step.

    Args:
        start: what is trained, by name, where it has any numbers; each has its own Adam moments. With its learning
            rate, which decays in the second half of the steps (`rate_factor`).
        seed: equal seeds and inputs give equal results, bit for bit.

    Attributes:
        steppers: one per frame.
    """

    phase = "joint"  # for progress and errors

    def __init__(
        self,
        views: Sequence[Sequence[TrainingView]],
        settings: TrainSettings,
        start: Mapping[str, tuple[Tensor, float]],
        iterations: int,
        seed: int,
    ) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        self.steppers = [Stepper(seen, settings, self._generator) for seen in views]
        self.leaves = {
            name: value.detach().clone().contiguous().requires_grad_()
            for name, (value, _) in start.items()
            if value.shape[1:].numel()
        }
        self._rates = {name: rate for name, (_, rate) in start.items()}
        groups = [ParameterGroup([leaf], self._rates[name], name) for name, leaf in self.leaves.items()]
        self._adam = Adam(groups, eps=1e-15)
        self._order: list[int] = []
        self.done, self.iterations = 0, iterations

    @abstractmethod
    def gaussians(self, frame: int) -> Gaussians:
        """The current splats of a frame; gradients propagate to the leaves."""

    @abstractmethod
    def loss(self, photometric: Tensor, gaussians: Gaussians, frame: int) -> Tensor:
        """The photometric loss of a step on a frame, plus what else it costs."""

    def train(
        self,
        progress: ProgressFn = no_progress,
        checkpoint: CheckpointFn | None = None,
        resume: Checkpoint | None = None,
    ) -> None:
        """Run all steps.

        Args:
            progress: called with completed and total steps, `phase`, and regularly also with `loss`, `psnr` (dB) and
                `splats`.
            checkpoint: called with step and complete state every `CHECKPOINT_EVERY` steps, but not after the last.
            resume: a checkpoint of the same inputs. The result equals that of an uninterrupted run.
        """
        if resume is not None:
            self.restore(resume)
        while self.done < self.iterations:
            figures = self.step()
            progress(self.done, self.iterations, phase=self.phase, **figures)
            due = self.done % constants.CHECKPOINT_EVERY == 0 and self.done < self.iterations
            if checkpoint is not None and due:
                checkpoint(self.done, self.state())

    def step(self) -> dict[str, float]:
        """Run one step on a view of the next frame; returns figures every few steps."""
        if not self._order:  # each frame once, in a new order
            self._order = torch.randperm(len(self.steppers), generator=self._generator).tolist()
        frame = self._order.pop(0)
        factor = rate_factor(self.done / self.iterations)
        for group in self._adam.groups:
            group.rate = self._rates[group.name] * factor
        gaussians = self.gaussians(frame)
        step = self.steppers[frame](gaussians, dropout=True)
        self.loss(step.loss, gaussians, frame).backward()  # type: ignore[no-untyped-call]
        self._adam.step()
        self._adam.zero_grad()
        self.done += 1
        return step.figures(self.done, self.phase, len(gaussians))

    def state(self) -> Checkpoint:
        """The complete state, for `restore`."""
        found = {
            "done": torch.tensor(self.done),
            "generator": self._generator.get_state(),
            "order": torch.tensor(self._order, dtype=torch.int64),
        }
        for index, stepper in enumerate(self.steppers):
            found |= {f"stepper.{index}.{name}": value for name, value in stepper.state().items()}
        for name, leaf in self.leaves.items():
            found[f"{name}.value"] = leaf.detach()
            found |= {f"{name}.adam.{key}": value for key, value in self._adam.state.get(leaf, {}).items()}
        return found

    def restore(self, state: Checkpoint) -> None:
        """Continue from a `state()`, bit for bit."""
        self.done = int(state["done"])
        self._generator.set_state(state["generator"].cpu())
        self._order = [int(frame) for frame in state["order"]]
        for index, stepper in enumerate(self.steppers):
            stepper.restore(part_of(state, f"stepper.{index}."))
        for name, leaf in self.leaves.items():
            with torch.no_grad():
                leaf.copy_(state[f"{name}.value"])
            moments = part_of(state, f"{name}.adam.")
            if moments:
                self._adam.state[leaf] = {key: value.to(leaf.device) for key, value in moments.items()}
