"""Train a method from demonstrations: cross-entropy over pixels and angles, separately for pick and place."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import torch
from accelerate import Accelerator, PartialState
from torch import nn
from torch.utils.data import ConcatDataset, DataLoader, Dataset
from tqdm import tqdm
from typing_extensions import override

from gem_lite import clip
from gem_lite.config import Config
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.policies import checkpoints
from gem_lite.policies.base import Policy
from gem_lite.policies.inputs import PreparedStep, Sample
from gem_lite.training import folders, step_files
from gem_lite.training.step_files import Steps
from gem_lite.training.training_state import STATE_FILE, Cost, TrainingState

SAVE_EVERY = 100
"""The training state is saved after this number of steps at the latest."""
SAVE_SECONDS = 60
"""The training state is saved after this time (seconds) at the latest."""
PREPARED = "prepared"
"""The name of the folder of the prepared steps, in the folder of a run."""
LONGEST_PREPARATION = timedelta(days=7)
"""The longest time that the other processes wait for the one that prepares the steps."""
MAX_GRADIENT_NORM = 1.0
WORKERS = 4
"""How many processes read and augment steps for a GPU."""


def draw(steps: Steps, rng: np.random.Generator) -> PreparedStep:
    """A random step. Of several tasks, each has the same chance, whatever the number of its steps."""
    part: Any = steps
    if isinstance(steps, ConcatDataset):
        part = steps.datasets[rng.integers(len(steps.datasets))]
    return part[rng.integers(len(part))]


def make_batch(policy: Policy, prepared: Steps, rng: np.random.Generator) -> list[Sample]:
    """A batch of training samples (`Policy.draw`)."""
    return [policy.draw(draw(prepared, rng), rng) for _ in range(policy.config.batch)]


class Batches(Dataset[list[Sample]]):
    """The batches of a training by the number of their step.

    A batch depends on these arguments and its number alone. So a resumed run draws the same batches, and so does any
    number of workers.
    """

    def __init__(self, policy: Policy, prepared: Steps, seed: int, process: int = 0) -> None:
        self.policy = policy
        self.prepared = prepared
        self.seed = seed
        self.process = process

    @override
    def __getitem__(self, step: int) -> list[Sample]:
        key = (self.seed, step, self.process) if self.process else (self.seed, step)
        return make_batch(self.policy, self.prepared, np.random.default_rng(key))


def learning_rate(settings: Config, step: int) -> float:
    """The rate of a step: it rises for 50 steps, is constant, and falls linearly to a fiftieth in the second half."""
    return settings.learning_rate * min(1.0, (step + 1) / 50, 0.02 + 2 * (1 - step / settings.steps))


class Losses(nn.Module):
    """A policy's losses as the forward pass of one module. Several processes need it to average their gradients."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, batch: Sequence[Sample]) -> dict[str, torch.Tensor]:
        """The loss of each role."""
        return self.policy.losses(batch)


class Learner:
    """A policy's modules in training, with an optimizer for each.

    Attributes:
        modules, optimizers: by role.
    """

    def __init__(self, policy: Policy, accelerator: Accelerator) -> None:
        self.accelerator = accelerator
        self.policy = policy
        self.modules = policy.roles
        # In this memory format, convolutions with few channels are a fifth faster.
        policy.to(accelerator.device, memory_format=torch.channels_last).train()  # type: ignore[call-overload]
        rate = policy.config.learning_rate
        optimizers = [torch.optim.Adam(m.parameters(), lr=rate, fused=True) for m in self.modules.values()]
        self.losses, *optimizers = accelerator.prepare(Losses(policy), *optimizers)
        self.optimizers = dict(zip(self.modules, optimizers, strict=True))

    def step(self, batch: Sequence[Sample], rate: float) -> dict[str, float]:
        """Make one step with every optimizer. Returns the loss of each role before the step.

        Raises:
            FloatingPointError: a loss or a gradient is not finite. No weight has changed.
        """
        losses = self.losses(batch)
        for role, loss in losses.items():
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the {role} loss is {loss.item()}")
        for optimizer in self.optimizers.values():
            optimizer.zero_grad(set_to_none=True)
        # No weight belongs to two losses, so the gradients of the sum are the gradients of each loss.
        self.accelerator.backward(sum(losses.values()))
        for role, module in self.modules.items():
            norm = self.accelerator.clip_grad_norm_(module.parameters(), MAX_GRADIENT_NORM)
            if not torch.isfinite(norm):
                raise FloatingPointError(f"the {role} gradient is {norm.item()}")
        for optimizer in self.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = rate
            optimizer.step()
        return {role: loss.item() for role, loss in losses.items()}

    def release(self) -> None:
        """Move the policy back to the CPU, in its old memory format."""
        self.policy.to("cpu", memory_format=torch.contiguous_format)  # type: ignore[call-overload]


def train(
    policy: Policy, prepared: Steps, seed: int, run: Path, device: str = "cpu",
    watch: Callable[[int, dict[str, float]], None] | None = None, workers: int | None = None,
    begun_with: str | None = None,
) -> Cost:  # fmt: skip
    """Train a policy's modules in place. Returns the total cost of the training.

    If a training with the same method, configuration, data and seed was stopped in ``run``, it continues, and the
    result is the same as without the stop. On a GPU, networks run in bfloat16 where that is safe. Under
    ``accelerate launch``, every process draws its own batch, and gradients are averaged: the batch size is
    multiplied by the number of processes.

    Args:
        prepared: a list of steps, or the `prepared_steps` of a folder.
        watch: called with the number and the losses of every step.
        workers: how many processes read and augment steps; by default none for a CPU, `WORKERS` for a GPU. The result
            is the same.
        begun_with: the SHA-256 of the checkpoint whose weights the policy has, if it is not new.

    Raises:
        ValueError: ``run`` holds the state of another training.
        FloatingPointError: a loss or a gradient is not finite. The last saved state stays intact.
        OSError: the state cannot be saved. The last saved state stays intact.
    """
    settings = policy.config
    accelerator = Accelerator(cpu=device == "cpu", mixed_precision="no" if device == "cpu" else "bf16")
    learner = Learner(policy, accelerator)
    identity = {
        "method": policy.name, "config": settings.as_dict(), "seed": seed,
        "data": step_files.fingerprint(prepared), "processes": accelerator.num_processes,
    }  # fmt: skip
    if begun_with:
        identity["begun_with"] = begun_with
    optimizers = {f"{role}_optimizer": optimizer for role, optimizer in learner.optimizers.items()}
    state = TrainingState(run / STATE_FILE, identity, learner.modules | optimizers)
    state.restore(accelerator.device)
    if state.saved:
        accelerator.print(f"resuming at step {state.saved} from {state.file}")
    if workers is None:
        workers = 0 if device == "cpu" else WORKERS
    batches = DataLoader(
        Batches(policy, prepared, seed, accelerator.process_index), batch_size=None, num_workers=workers,
        sampler=range(state.saved, settings.steps), generator=torch.Generator(),
    )  # fmt: skip
    first = state.saved
    main = accelerator.is_main_process
    with tqdm(batches, "training", settings.steps, initial=first, unit="step", disable=not main) as bar:
        for step, batch in enumerate(bar, first):
            try:
                losses = learner.step(batch, learning_rate(settings, step))
            except FloatingPointError as error:
                raise FloatingPointError(f"{error} at step {step}; {state.description}") from None
            if watch:
                watch(step, losses)
            if step % 10 == 0:
                bar.set_postfix({role: f"{loss:.2f}" for role, loss in losses.items()})
            due = (step + 1) % SAVE_EVERY == 0 or time.time() - state.saved_at > SAVE_SECONDS
            if main and (due or step + 1 == settings.steps):
                state.save(step + 1)
    learner.release()
    return state.cost


def _team(device: str) -> PartialState:
    """The processes of a training. The first one prepares what all read (`main_process_first`)."""
    return PartialState(cpu=device == "cpu", timeout=LONGEST_PREPARATION)


def prepared_steps(
    policy: Policy, demos: DemonstrationSet | Sequence[DemonstrationSet], run: Path, device: str = "cpu",
    shared: Path | None = None,
) -> Steps:  # fmt: skip
    """The prepared steps of demonstrations, in files, for `train`.

    A stopped preparation continues. With several processes, one prepares the steps, and the others wait.

    Args:
        demos: the demonstrations of a task, or those of each of several tasks.
        shared: a folder for the steps of many trainings. Trainings with the same steps prepare them once. Without it,
            the files are in ``run``, for this training alone.

    Raises:
        ValueError, OSError: the errors of `step_files.prepare`.
    """
    sets = [demos] if isinstance(demos, DemonstrationSet) else demos
    with _team(device).main_process_first():
        return step_files.prepare(policy, sets, shared or run / PREPARED)


def hardware(device: str) -> str:
    """The hardware of a training in words: the name of the GPUs, or the number of used CPU cores and of all."""
    if device != "cpu":
        return f"{PartialState().num_processes} x {torch.cuda.get_device_name()}"
    return f"{torch.get_num_threads()} of {os.cpu_count()} CPU cores"


def train_from_folder(
    folder: Path, checkpoint: Path, method: type[Policy], settings: Config, run: Path, seed: int = 0,
    episodes: int | None = None, clip_name: str | None = None, device: str = "cpu", also: Sequence[Path] = (),
    shared: Path | None = None, begin_with: Path | None = None,
) -> dict | None:  # fmt: skip
    """Train a method from the demonstrations in ``folder`` and write its checkpoint. Resumes from ``run``, see `train`.

    Args:
        folder: a set of demonstrations, see `demonstrations.load`.
        also: more folders, each drawn equally often, for a method with the ending "multi". Each task has as many
            demonstrations; those of one task may lie in several folders, for instance of several worlds.
        settings: the method's configuration. Recorded episodes keep its table; others set its length.
        episodes: the number of demonstrations to use, from the first; by default all.
        clip_name: the argument of `clip.load`.
        device: "cpu" or "cuda".
        shared: see `prepared_steps`.
        begin_with: a checkpoint of the same method, whose weights the training begins with; by default they are random.

    Returns:
        The facts about the training, as on the checkpoint's card. With several processes, only the first writes the
        checkpoint, and the others return None.

    Raises:
        ValueError: see `_check_request`, `folders.demonstrations_of_tasks`, `folders.on_table_of` and
            `checkpoints.begin_with`.
        FloatingPointError, OSError: see `train`.
    """
    _check_request(checkpoint, seed, device)
    _team(device)  # Each process gets its device.
    sets = folders.demonstrations_of_tasks((folder, *also), episodes, settings)
    policy = method(folders.on_table_of(sets, settings), clip.load(clip_name).to(device), seed=seed)
    begun_with = checkpoints.begin_with(policy, begin_with) if begin_with else None
    steps = prepared_steps(policy, sets, run, device, shared)
    cost = train(policy, steps, seed, run, device, begun_with=begun_with)
    if not PartialState().is_main_process:
        return None
    demos_of = folders.demonstrations_by_task(sets)
    facts = {
        "task": " + ".join(demos_of),
        "demos": min(demos_of.values()),  # They are equally many.
        "demonstrations_world": " + ".join(dict.fromkeys(part[0].world for part in sets)),
        "demonstrations_split": sets[0][0].split,
        "data_sha256": folders.data_hash(sets),
        "seed": seed,
        "train_seconds": round(cost.seconds, 1),
        "train_cpu_seconds": round(cost.cpu_seconds, 1),
        "hardware": hardware(device),
    }
    if begun_with:
        facts["begun_with_sha256"] = begun_with
    checkpoints.save_policy(policy, checkpoint, facts)
    (run / STATE_FILE).unlink(missing_ok=True)
    shutil.rmtree(run / PREPARED, ignore_errors=True)
    return {"method": policy.name, **facts}


def _check_request(checkpoint: Path, seed: int, device: str) -> None:
    """Refuse what a training would fail at only in its end.

    Raises:
        ValueError: there is no GPU for ``device``; ``checkpoint`` is a folder or does not end in ".safetensors";
            ``seed`` is negative.
    """
    if device != "cpu" and not torch.cuda.is_available():
        raise ValueError(f"this machine has no GPU that torch can use; the device must be cpu, got {device}")
    if checkpoint.is_dir():
        raise ValueError(f"checkpoint must be a file to write, got the folder {checkpoint}")
    checkpoints.card_path(checkpoint)  # A wrong name is refused now, not after the training.
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")
