"""What one training step and one decision cost, by method and part: python -m experiments.speed.training

Every method trains in the `lite` configuration on the shipped demonstrations (two scenes of them, since
its step costs the same on any). Also printed: how many parameters each has, beside the paper's Table A1.
"""

import time
import types
from collections import Counter
from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from experiments.speed.timing import seconds
from gem_lite import clip, demonstrations
from gem_lite.policies import methods
from gem_lite.policies.base import Policy
from gem_lite.policies.gem_config import LITE
from gem_lite.policies.networks import parameter_count
from gem_lite.training.train import make_batch

DEMONSTRATIONS = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
TABLE_A1 = {"gem": "5.7 M", "transporter-lan": "6.6 M", "cliport": "389 M", "cliport-grounded": "-"}
VIT_B_32 = 512, 768, (768, 768)
"""Widths of the paper's CLIP: of its embeddings, of the features that are projected to them, of inner features."""
ENCODERS = "gem-with-modulated-encoder", "gem-with-steerable-encoder"
"""GEM with another encoder than the paper's."""
PARTS = ("batch", "encoder", "kernel", "correlation", "backward", "optimizer")
REPEATS = 7


class Clock:
    """Adds up what parts of a step take; modules report through hooks."""

    def __init__(self) -> None:
        self.spent: Counter = Counter()

    def timed(self, part: str, work: Callable):
        start = time.perf_counter()
        result = work()
        self.spent[part] += time.perf_counter() - start
        return result

    def watch(self, part: str, module: nn.Module) -> None:
        started = []
        module.register_forward_pre_hook(lambda *_: started.append(time.perf_counter()))
        module.register_forward_hook(lambda *_: self.spent.update({part: time.perf_counter() - started.pop()}))


def watch_parts(policy: Policy, clock: Clock) -> None:
    """The kernel generators and query networks, and the networks that see the whole scene."""
    for module in policy.roles.values():
        named = dict(module.named_modules())
        kernels = [name for name in named if name.split(".")[-1] == "kernel"]
        scene = [name for name in named if name.split(".")[-1] in ("encoder", "refiner", "semantics")]
        for name in kernels:
            clock.watch("kernel", named[name])
        # A pick without a kernel is one network from the picture to the logits.
        for name in scene if kernels else [""]:
            clock.watch("encoder", named[name])


def step_by_parts(policy: Policy, prepared: list, optimizers: dict, clock: Clock) -> None:
    """One training step as `gem_lite.training.train.train` makes it."""
    batch = clock.timed("batch", lambda: make_batch(policy, prepared, np.random.default_rng(0)))
    before = clock.spent["encoder"] + clock.spent["kernel"]
    start = time.perf_counter()
    losses = policy.losses(batch)
    inside = clock.spent["encoder"] + clock.spent["kernel"] - before
    clock.spent["correlation"] += time.perf_counter() - start - inside  # with crops, sampling and the loss
    for name, loss in losses.items():
        optimizers[name].zero_grad(set_to_none=True)
        clock.timed("backward", loss.backward)
        nn.utils.clip_grad_norm_(policy.roles[name].parameters(), 1.0)
        clock.timed("optimizer", optimizers[name].step)


def count(name: str, preset: str, dim: int, width: int, inner_widths: tuple[int, ...]) -> int:
    """Trainable parameters of a method with a CLIP of these widths: see `Clip`."""
    method, config = methods.find(name, preset)
    return parameter_count(method(config, types.SimpleNamespace(dim=dim, width=width, inner_widths=inner_widths)))


def main() -> None:
    """Print a line for each method and quantity."""
    model, demos = clip.load(), demonstrations.load(DEMONSTRATIONS)[:2]
    first = demos[0].steps[0]
    print(f"parameters: lite (CLIP of {model.dim} numbers), paper (of {VIT_B_32[0]}), the paper's Table A1")
    for name in (*methods.METHODS.names(), *ENCODERS):
        lite = count(name, "lite", model.dim, model.width, model.inner_widths)
        paper = count(name, "paper", *VIT_B_32)
        print(f"  {name:28s}{lite / 1e6:6.2f} M  {paper / 1e6:6.2f} M   {TABLE_A1.get(name, '-')}")
    print(
        f"\none training step, batch {LITE.batch}, {torch.get_num_threads()} threads; fastest of {REPEATS}, shares in %"
    )
    print("  method                      steps/s" + "".join(f"{part:>13s}" for part in PARTS) + "   one act")
    for name in (*methods.METHODS.names(), *ENCODERS):
        method, config = methods.find(name)
        policy, clock = method(config, model), Clock()
        policy.remember(demos)
        prepared = list(policy.prepare(demos))
        for module in policy.roles.values():
            module.to(memory_format=torch.channels_last)
        optimizers = {role: torch.optim.Adam(m.parameters(), lr=1e-3) for role, m in policy.roles.items()}
        watch_parts(policy, clock)
        step_by_parts(policy, prepared, optimizers, clock)
        clock.spent.clear()
        fastest, _ = seconds(lambda p=(policy, prepared, optimizers, clock): step_by_parts(*p), REPEATS)
        total = sum(clock.spent.values())
        shares = "".join(f"{100 * clock.spent[part] / total:13.0f}" for part in PARTS)
        acting, _ = seconds(lambda policy=policy: policy.act(first.observation, first.instruction), 3)
        print(f"  {name:28s}{1 / fastest:7.2f}{shares}{acting:8.2f} s")
    print("  correlation: with the crops, the sampling of angles and the loss; kernel: query networks, too")


if __name__ == "__main__":
    main()
