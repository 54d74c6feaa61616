"""Train a method from demonstrations: cross-entropy over pixels and angles, pick and place apart."""

from __future__ import annotations

import hashlib
import io
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from accelerate import PartialState
from accelerate.utils import reduce
from torch import nn
from tqdm import tqdm

from gem_lite import clip, demonstrations, tasks
from gem_lite.config import Config
from gem_lite.demonstrations import DemonstrationSet
from gem_lite.files import write_whole
from gem_lite.learning import augment
from gem_lite.policies import checkpoints
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.samples import PreparedStep, Sample

SAVE_EVERY, SAVE_SECONDS = 100, 60
"""Steps and seconds between two saves of the training state: a killed run loses at most the fewer of these."""


class Cost(NamedTuple):
    """What a training took, its earlier parts included: seconds on the clock, and of all CPU cores together."""

    seconds: float
    cpu_seconds: float

    @classmethod
    def now(cls) -> Cost:
        """The two clocks' readings; the difference of two readings is a cost."""
        return cls(time.time(), time.process_time())

    def since(self, began: Cost) -> Cost:
        """What has been spent from ``began`` to here."""
        return Cost(self.seconds - began.seconds, self.cpu_seconds - began.cpu_seconds)


def make_batch(
    prepared: Sequence[PreparedStep], settings: Config, rng: np.random.Generator, recolor: bool = False
) -> list[Sample]:
    """Draw steps, hide the image-conditioned map now and then, move each by a random motion, and ``recolor`` it."""
    batch = []
    for _ in range(settings.batch):
        step = prepared[rng.integers(len(prepared))]
        sample = step.text_only if rng.random() < settings.drop_image_map else step.with_image
        keep = [sample.pick, sample.place]
        motion = augment.random_motion(rng, tuple(sample.image.shape[-2:]), keep, settings.turn)
        moved = augment.apply(motion, sample)
        moved = augment.rescaled(rng, moved, settings.map_gain, settings.map_offset)
        batch.append(augment.recolored(rng, moved) if recolor else moved)
    return batch


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
        watch: called with every step's number and losses.

    Raises:
        ValueError: ``run`` holds the state of another training.
        FloatingPointError: a loss or a gradient is not finite; the last saved state stays intact.
        OSError: the state cannot be saved; the last saved one stays intact.
    """
    settings, team = policy.config, PartialState(cpu=device == "cpu")
    # Convolutions of few channels run a fifth faster with the channels innermost in memory.
    modules = {name: m.to(team.device, memory_format=torch.channels_last).train() for name, m in policy.modules.items()}
    optimizers = {name: torch.optim.Adam(m.parameters(), lr=settings.learning_rate) for name, m in modules.items()}
    identity = {"method": policy.name, "config": settings.as_dict(), "seed": seed, "data": _fingerprint(prepared)}
    identity |= {"processes": team.num_processes}
    state_file, saved, spent = run / "state.pt", 0, Cost(0.0, 0.0)
    run.mkdir(parents=True, exist_ok=True)
    if state_file.exists():
        state = torch.load(state_file, map_location=team.device)
        if state["identity"] != identity:
            raise ValueError(
                f"{state_file} belongs to a training with other settings (method, configuration, data, seed or "
                "number of processes); give another run"
            )
        for name, module in modules.items():
            module.load_state_dict(state[name])
            optimizers[name].load_state_dict(state[f"{name}_optimizer"])
        saved, spent = state["step"], Cost(*state["cost"])
        team.print(f"resuming at step {saved} from {state_file}")
    began, stored = Cost.now().since(spent), time.time()

    def last_good() -> str:
        return f"{state_file} holds step {saved}, intact" if saved else "no state had been saved yet"

    def store(step: int) -> None:
        state = {"identity": identity, "step": step, "cost": tuple(Cost.now().since(began))}
        for name, module in modules.items():
            state |= {name: module.state_dict(), f"{name}_optimizer": optimizers[name].state_dict()}
        # Into memory first: torch's own writer reports a full disk as it likes, and not always.
        buffer = io.BytesIO()
        torch.save(state, buffer)
        try:
            write_whole(state_file, buffer.getvalue())
        except OSError as error:
            raise OSError(f"the state of step {step} cannot be saved ({error}); {last_good()}") from error

    bar = tqdm(
        range(saved, settings.steps), "training", settings.steps, initial=saved, unit="step",
        disable=not team.is_main_process,
    )  # fmt: skip
    for step in bar:
        # Every step's draw depends on the seed and the step alone, so a resumed run draws the same.
        draw = (seed, step) if team.is_main_process else (seed, step, team.process_index)
        batch = make_batch(prepared, settings, np.random.default_rng(draw), policy.recolors)
        # Warm up over 50 steps, hold, and fall linearly to a fiftieth over the second half.
        rate = settings.learning_rate * min(1.0, (step + 1) / 50, 0.02 + 2 * (1 - step / settings.steps))
        with torch.autocast("cuda", torch.bfloat16, enabled=device != "cpu"):
            losses = policy.losses(batch)
        for name, loss in losses.items():
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the {name} loss is {loss.item()} at step {step}; {last_good()}")
            optimizer = optimizers[name]
            for group in optimizer.param_groups:
                group["lr"] = rate
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            if team.num_processes > 1:
                for parameter in modules[name].parameters():
                    parameter.grad = reduce(parameter.grad, "mean")
            norm = nn.utils.clip_grad_norm_(modules[name].parameters(), 1.0)
            if not torch.isfinite(norm):
                raise FloatingPointError(f"the {name} gradient is {norm.item()} at step {step}; {last_good()}")
            optimizer.step()
        if watch:
            watch(step, {name: loss.item() for name, loss in losses.items()})
        if step % 10 == 0:
            bar.set_postfix({name: f"{loss.item():.2f}" for name, loss in losses.items()})
        due = (step + 1) % SAVE_EVERY == 0 or time.time() - stored > SAVE_SECONDS
        if due or step + 1 == settings.steps:
            if team.is_main_process:
                store(step + 1)
            saved, stored = step + 1, time.time()
    for module in modules.values():
        module.to("cpu", memory_format=torch.contiguous_format)
    return Cost.now().since(began)


def _fingerprint(prepared: Sequence[PreparedStep]) -> str:
    digest = hashlib.sha256()
    for step in prepared:
        for sample in (step.with_image, step.text_only):
            for name, value in vars(sample).items():
                content = value.numpy().tobytes() if isinstance(value, torch.Tensor) else repr(value).encode()
                digest.update(name.encode() + content)
    return digest.hexdigest()


def hardware(device: str) -> str:
    """What trains, in words: the GPU's name, or how many of how many CPU cores."""
    if device != "cpu":
        return f"{PartialState().num_processes} x {torch.cuda.get_device_name()}"
    return f"{torch.get_num_threads()} of {os.cpu_count()} CPU cores"


def train_from_folder(
    folder: Path, checkpoint: Path, method: type[PickPlacePolicy], settings: Config, run: Path, seed: int = 0,
    episodes: int | None = None, clip_name: str | None = None, device: str = "cpu",
) -> dict | None:  # fmt: skip
    """Train a method from the demonstrations in ``folder`` and write its checkpoint; resumes from ``run``, see `train`.

    Args:
        settings: the method's configuration; the length of its table becomes that of the demonstrations' task.
        episodes: use only the first so many demonstrations.
        clip_name: as `clip.load` takes it.
        device: "cpu" or "cuda".

    Returns:
        What the checkpoint's card says of the training. None in all processes but the first, which alone writes:
        all hold the same weights.

    Raises:
        ValueError: no GPU, more episodes than there are or none, or see `train`.
        FloatingPointError: see `train`.
        OSError: no demonstrations, or what has to be written cannot be; see `train`.
    """
    if device != "cpu" and not torch.cuda.is_available():
        raise ValueError(f"this machine has no GPU that torch can use; the device must be cpu, got {device}")
    demos = _first_demonstrations(folder, episodes)
    table = tasks.make(demos[0].task).workspace.length
    policy = method(settings.on_table(table), clip.load(clip_name), seed=seed)
    cost = train(policy, policy.prepare(demos), seed, run, device)
    if not PartialState().is_main_process:
        return None
    facts = {
        "task": demos[0].task,
        "demos": len(demos),
        "demonstrations_world": demos[0].world,
        "data_sha256": demonstrations.data_hash(folder, episodes),
        "seed": seed,
        "train_seconds": round(cost.seconds, 1),
        "train_cpu_seconds": round(cost.cpu_seconds, 1),
        "hardware": hardware(device),
    }
    checkpoints.save_policy(policy, checkpoint, facts)
    (run / "state.pt").unlink(missing_ok=True)
    return {"method": policy.name, **facts}


def _first_demonstrations(folder: Path, episodes: int | None) -> DemonstrationSet:
    if episodes is not None and episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    demos = demonstrations.load(folder)[:episodes]
    if episodes is not None and len(demos) < episodes:
        raise ValueError(f"episodes must be at most {len(demos)}, which {folder} holds, got {episodes}")
    return demos
