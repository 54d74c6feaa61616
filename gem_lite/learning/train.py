"""Train a method from demonstrations: cross-entropy over pixels and angles, pick and place apart."""

from __future__ import annotations

import argparse
import dataclasses
import os
import shutil
import time
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path

import numpy as np
import torch
from accelerate import Accelerator, PartialState
from torch import nn
from tqdm import tqdm

from gem_lite import clip, demonstrations, tasks
from gem_lite.config import Config
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.learning import augment, dataset
from gem_lite.learning.dataset import StoredSteps
from gem_lite.learning.training_state import STATE_FILE, Cost, TrainingState
from gem_lite.policies import checkpoints, methods
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.samples import PreparedStep, Sample

SAVE_EVERY, SAVE_SECONDS = 100, 60
"""Steps and seconds between two saves of the training state: a killed run loses at most the fewer of these."""
PREPARED = "prepared"
"""The folder in a run for its prepared steps."""
LONGEST_PREPARATION = timedelta(days=7)
"""How long the other processes wait for the one that prepares the steps."""
LONGEST_GRADIENT = 1.0


def make_batch(
    prepared: Sequence[PreparedStep], settings: Config, rng: np.random.Generator, recolor: bool = False
) -> list[Sample]:
    """Draw steps, hide the image-conditioned map now and then, move each by a random motion, and ``recolor`` it."""
    batch = []
    for _ in range(settings.batch):
        step = prepared[rng.integers(len(prepared))]
        sample = step.text_only if rng.random() < settings.drop_image_map else step.with_image
        keep = [sample.pick, sample.place]
        motion = augment.random_motion(rng, tuple(sample.rgbd.shape[-2:]), keep, settings.turn)
        moved = augment.apply(motion, sample)
        moved = augment.rescaled(rng, moved, settings.map_gain, settings.map_offset)
        batch.append(augment.recolored(rng, moved) if recolor else moved)
    return batch


def learning_rate(settings: Config, step: int) -> float:
    """The rate of a step: it warms up over 50 steps, holds, and falls linearly to a fiftieth over the second half."""
    return settings.learning_rate * min(1.0, (step + 1) / 50, 0.02 + 2 * (1 - step / settings.steps))


class Losses(nn.Module):
    """A policy's losses as the forward pass of one module, through which processes average their gradients."""

    def __init__(self, policy: PickPlacePolicy) -> None:
        super().__init__()
        self.modules_by_role = nn.ModuleDict(policy.roles)
        self.losses_of = policy.losses

    def forward(self, batch: Sequence[Sample]) -> dict[str, torch.Tensor]:
        """Each role's loss."""
        return self.losses_of(batch)


class Learner:
    """A policy's modules in training, with an optimizer for each.

    Attributes:
        modules, optimizers: by role.
    """

    def __init__(self, policy: PickPlacePolicy, accelerator: Accelerator) -> None:
        self.accelerator, self.modules = accelerator, dict(policy.roles)
        for module in self.modules.values():
            # Convolutions of few channels run a fifth faster with the channels innermost in memory.
            module.to(accelerator.device, memory_format=torch.channels_last).train()
        optimizers = [torch.optim.Adam(m.parameters(), lr=policy.config.learning_rate) for m in self.modules.values()]
        self.losses, *optimizers = accelerator.prepare(Losses(policy), *optimizers)
        self.optimizers = dict(zip(self.modules, optimizers, strict=True))

    def step(self, batch: Sequence[Sample], rate: float) -> dict[str, float]:
        """One step of every optimizer; returns each role's loss before it.

        Raises:
            FloatingPointError: a loss or a gradient is not finite; no weight has changed.
        """
        losses = self.losses(batch)
        for role, loss in losses.items():
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the {role} loss is {loss.item()}")
        for optimizer in self.optimizers.values():
            optimizer.zero_grad(set_to_none=True)
        # No weight has a part in two of the losses: the sum's gradients are those of each loss.
        self.accelerator.backward(sum(losses.values()))
        for role, module in self.modules.items():
            norm = self.accelerator.clip_grad_norm_(module.parameters(), LONGEST_GRADIENT)
            if not torch.isfinite(norm):
                raise FloatingPointError(f"the {role} gradient is {norm.item()}")
        for optimizer in self.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = rate
            optimizer.step()
        return {role: loss.item() for role, loss in losses.items()}

    def release(self) -> None:
        """Bring the modules back to the CPU, as they were."""
        for module in self.modules.values():
            module.to("cpu", memory_format=torch.contiguous_format)


def train(
    policy: PickPlacePolicy, prepared: Sequence[PreparedStep], seed: int, run: Path, device: str = "cpu",
    watch: Callable[[int, dict[str, float]], None] | None = None,
) -> Cost:  # fmt: skip
    """Train a policy's modules in place; returns what was spent on it in all.

    Resumes from ``run`` if a training of the same method, configuration, data and seed was stopped there;
    the result is the same as without the stop. On a GPU, networks run in bfloat16 where that is safe. Under
    ``accelerate launch`` every process draws a batch of its own and gradients are averaged: the batch is as
    many times larger as there are processes.

    Args:
        prepared: a list of steps, or those of a folder (`prepared_steps`).
        watch: called with every step's number and losses.

    Raises:
        ValueError: ``run`` holds the state of another training.
        FloatingPointError: a loss or a gradient is not finite; the last saved state stays intact.
        OSError: the state cannot be saved; the last saved one stays intact.
    """
    settings = policy.config
    accelerator = Accelerator(cpu=device == "cpu", mixed_precision="no" if device == "cpu" else "bf16")
    learner = Learner(policy, accelerator)
    state = _state(policy, learner, prepared, seed, run)
    steps, quiet = range(state.saved, settings.steps), not accelerator.is_main_process
    with tqdm(steps, "training", settings.steps, initial=state.saved, unit="step", disable=quiet) as bar:
        for step in bar:
            rng = _draws(seed, step, accelerator.process_index)
            batch = make_batch(prepared, settings, rng, policy.recolors)
            try:
                losses = learner.step(batch, learning_rate(settings, step))
            except FloatingPointError as error:
                raise FloatingPointError(f"{error} at step {step}; {state.last_good}") from None
            if watch:
                watch(step, losses)
            if step % 10 == 0:
                bar.set_postfix({role: f"{loss:.2f}" for role, loss in losses.items()})
            due = (step + 1) % SAVE_EVERY == 0 or time.time() - state.saved_at > SAVE_SECONDS
            if due or step + 1 == settings.steps:
                state.save(step + 1)
    learner.release()
    return state.cost


def _state(
    policy: PickPlacePolicy, learner: Learner, prepared: Sequence[PreparedStep], seed: int, run: Path
) -> TrainingState:
    """The state in ``run``, taken over if there is one."""
    accelerator = learner.accelerator
    identity = {
        "method": policy.name, "config": policy.config.as_dict(), "seed": seed,
        "data": dataset.fingerprint(prepared), "processes": accelerator.num_processes,
    }  # fmt: skip
    writes = accelerator.is_main_process
    state = TrainingState(run / STATE_FILE, identity, learner.modules, learner.optimizers, writes)
    state.restore(accelerator.device)
    if state.saved:
        accelerator.print(f"resuming at step {state.saved} from {state.file}")
    return state


def _draws(seed: int, step: int, process: int) -> np.random.Generator:
    """Every step's draw depends on the seed and the step alone, so a resumed run draws the same."""
    return np.random.default_rng((seed, step, process) if process else (seed, step))


def prepared_steps(policy: PickPlacePolicy, demos: DemonstrationSet, run: Path, device: str = "cpu") -> StoredSteps:
    """The demonstrations' prepared steps, in files in ``run``: for `train`, whose memory then does not grow with them.

    Goes on where an earlier preparation was stopped. Of several processes one prepares, and the others wait.

    Raises:
        ValueError, OSError: as `dataset.prepare`.
    """
    team = PartialState(cpu=device == "cpu", timeout=LONGEST_PREPARATION)
    with team.main_process_first():
        return dataset.prepare(policy, demos, run / PREPARED)


def discard(run: Path) -> None:
    """Remove what `train` and `prepared_steps` left in ``run``: call it when the checkpoint is written."""
    (run / STATE_FILE).unlink(missing_ok=True)
    shutil.rmtree(run / PREPARED, ignore_errors=True)


def hardware(device: str) -> str:
    """What trains, in words: the GPU's name, or how many of how many CPU cores."""
    if device != "cpu":
        return f"{PartialState().num_processes} x {torch.cuda.get_device_name()}"
    return f"{torch.get_num_threads()} of {os.cpu_count()} CPU cores"


def main() -> None:
    """Command line: see ``python -m gem_lite.learning.train --help``."""
    parser = argparse.ArgumentParser(
        description="Train a method from demonstrations.",
        epilog=methods.help_text() + "\n\nexamples:"
        "\n  python -m gem_lite.learning.train data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors"
        "\n  accelerate launch --num_processes 4 -m gem_lite.learning.train "
        "data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors --config paper --device cuda",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "demonstrations", type=Path, help="folder made by python -m gem_lite.learning.collecting collect"
    )
    parser.add_argument("checkpoint", type=Path, help="safetensors file to write")
    parser.add_argument("--method", default="gem", help="see below; default gem")
    parser.add_argument("--config", choices=list(Config.PRESETS), default="lite", help="default lite")
    parser.add_argument("--steps", type=int, help="training steps (default: the configuration's)")
    parser.add_argument("--episodes", type=int, help="use only the first so many demonstrations")
    parser.add_argument("--seed", type=int, default=0, help="seed of weights and draws (default 0)")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (default: the embedded one)")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="default cpu")
    parser.add_argument("--run", type=Path, help="folder for the state to resume from (default runs/<checkpoint>)")
    args = parser.parse_args()
    run = args.run or Path("runs") / args.checkpoint.stem
    try:
        if args.device == "cuda" and not torch.cuda.is_available():
            raise ValueError("this machine has no GPU that torch can use; leave out --device cuda")
        if args.episodes is not None and args.episodes < 1:
            raise ValueError(f"--episodes must be at least 1, got {args.episodes}")
        demos = demonstrations.load(args.demonstrations)[: args.episodes]
        if args.episodes is not None and len(demos) < args.episodes:
            raise ValueError(f"--episodes must be at most {len(demos)}, which {args.demonstrations} holds")
        model = clip.load(args.clip)
        method, settings = methods.find(args.method, args.config)
        settings = settings.on_table(tasks.make(demos[0].task).workspace.length)
        if args.steps is not None:
            settings = dataclasses.replace(settings, steps=args.steps)
        policy = method(settings, model, seed=args.seed)
        cost = train(policy, prepared_steps(policy, demos, run, args.device), args.seed, run, args.device)
        if not PartialState().is_main_process:
            return  # all processes hold the same weights: one writes them
        facts = {
            "task": demos[0].task,
            "demos": len(demos),
            "demonstrations_world": demos[0].world,
            "data_sha256": demonstrations.data_hash(args.demonstrations, args.episodes),
            "seed": args.seed,
            "train_seconds": round(cost.seconds, 1),
            "train_cpu_seconds": round(cost.cpu_seconds, 1),
            "hardware": hardware(args.device),
        }
        checkpoints.save_policy(policy, args.checkpoint, facts)
    except (OSError, ValueError, FloatingPointError) as error:
        parser.exit(2, f"{error}\n")
    except KeyboardInterrupt:
        parser.exit(130, f"\nstopped; the same command goes on from the last state in {run}\n")
    discard(run)
    print(
        f"wrote {args.checkpoint} after {cost.seconds:.0f} s of training {policy.name} on {len(demos)} demonstrations"
    )


if __name__ == "__main__":
    main()
