"""Train GEM from demonstrations: cross-entropy over pixels and angles, pick and place apart."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hashlib
import json
import math
import os
import platform
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
from torch import nn
from tqdm import tqdm

from gem_lite import augment, clip, config, demonstrations, semantic_map
from gem_lite.augment import Sample
from gem_lite.clip import Clip
from gem_lite.config import Config
from gem_lite.crop_memory import CropMemory, collect_crops
from gem_lite.demonstrations import Demonstration
from gem_lite.gem import Policy, crop_at, to_rgbd

SAVE_EVERY = 100
"""Steps between two saves of the training state: a killed run loses at most these."""


@dataclasses.dataclass(frozen=True)
class PreparedStep:
    """A demonstrated step with all that stays frozen: images, both maps of each phrase, labels.

    ``with_image`` holds the image-conditioned blend (the text map itself where retrieval, which never
    finds the step's own episode, found nothing), ``text_only`` the map without it.
    """

    with_image: Sample
    text_only: Sample


def prepare(demos: Sequence[Demonstration], model: Clip, settings: Config) -> tuple[list[PreparedStep], CropMemory]:
    """Compute every demonstration's semantic maps once, and the memory of its crops."""
    steps = [(episode, step) for episode, demo in enumerate(demos) for step in demo.steps]
    scenes = [
        semantic_map.embed_scene(step.observation.views, model, settings)
        for _, step in tqdm(steps, desc="semantic maps", unit="scene")
    ]
    memory = CropMemory(collect_crops(demos, [scene.heightmap for scene in scenes], settings.top_patch), model)
    prepared = []
    for (episode, step), scene in zip(steps, scenes, strict=True):
        rgbd, action, workspace = to_rgbd(scene.heightmap), step.expert.action, settings.workspace
        texts, blends, words = [], [], []
        for phrase in (step.phrases.pick, step.phrases.place):
            text = semantic_map.text_conditioned_map(scene, phrase, model)
            image = semantic_map.image_conditioned_map(scene, phrase, model, memory, exclude_episode=episode)
            texts.append(text)
            blends.append(semantic_map.fuse(text, image, settings.text_weight, settings.image_weight))
            words.append(model.embed_texts([phrase])[0].cpu())
        with_image = Sample(
            image=torch.cat([rgbd, torch.from_numpy(np.stack(blends))]),
            pick=workspace.to_pixel(action.pick.x, action.pick.y),
            place=workspace.to_pixel(action.place.x, action.place.y),
            pick_yaw=action.pick.yaw,
            delta=action.delta,
            pick_symmetry=step.expert.pick_symmetry,
            place_symmetry=step.expert.place_symmetry,
            pick_words=words[0],
            place_words=words[1],
        )
        text_only = dataclasses.replace(with_image, image=torch.cat([rgbd, torch.from_numpy(np.stack(texts))]))
        prepared.append(PreparedStep(with_image, text_only))
    return prepared, memory


def right_bins(angle: float, symmetry: float, count: int) -> list[int]:
    """The angle bins that a label spreads over: the nearest bin of every equivalent angle.

    ``symmetry`` is the smallest turn that changes nothing (radians); 0 means that every angle is right.
    """
    if symmetry == 0:
        return list(range(count))
    copies = round(2 * math.pi / symmetry)
    equivalents = angle + 2 * math.pi * np.arange(copies) / copies
    return sorted({round(float(a) / (2 * math.pi / count)) % count for a in equivalents})


def cross_entropy(logits: torch.Tensor, cells: Sequence[tuple[list[int], int, int]]) -> torch.Tensor:
    """Mean cross-entropy of (B, R, H, W) logits against one pixel and its equally right angles each."""
    right = torch.stack([one[bins, row, col].mean() for one, (bins, row, col) in zip(logits, cells, strict=True)])
    return (logits.flatten(1).logsumexp(dim=1) - right).mean()


def make_batch(prepared: Sequence[PreparedStep], settings: Config, rng: np.random.Generator) -> list[Sample]:
    """Draw steps, hide the image-conditioned map now and then, and move each by a random motion."""
    batch = []
    for _ in range(settings.batch):
        step = prepared[rng.integers(len(prepared))]
        sample = step.text_only if rng.random() < settings.drop_image_map else step.with_image
        motion = augment.random_motion(rng, tuple(sample.image.shape[-2:]), [sample.pick, sample.place])
        batch.append(augment.apply(motion, sample))
    return batch


def losses(policy: Policy, batch: Sequence[Sample]) -> tuple[torch.Tensor, torch.Tensor]:
    """Pick and place loss of a batch; the place crop is taken at the demonstrated pick."""
    settings = policy.config
    device = next(policy.pick.parameters()).device
    image = torch.stack([sample.image for sample in batch]).to(device)
    rgbd, pick_map, place_map = image[:, :4], image[:, 4:5], image[:, 5:6]
    pick_words, place_words = (
        torch.stack([getattr(sample, f"{role}_words") for sample in batch]).to(device) for role in ("pick", "place")
    )
    pick_cells = [
        (right_bins(s.pick_yaw, s.pick_symmetry, settings.angles), round(s.pick[0]), round(s.pick[1])) for s in batch
    ]
    place_cells = [
        (right_bins(s.delta, s.place_symmetry, settings.angles), round(s.place[0]), round(s.place[1])) for s in batch
    ]
    crop = crop_at(image[:, :5], torch.tensor([cell[1:] for cell in pick_cells]), settings.crop)
    pick = cross_entropy(policy.pick(rgbd, pick_map, pick_words), pick_cells)
    place = cross_entropy(policy.place(rgbd, place_map, place_words, crop), place_cells)
    return pick, place


def train(policy: Policy, prepared: Sequence[PreparedStep], seed: int, run: Path, device: str = "cpu") -> float:
    """Train a policy's pick and place module in place; returns the seconds spent on it in all.

    Resumes from ``run`` if a training of the same configuration, data and seed was stopped there; the
    result is the same as without the stop.

    Raises:
        ValueError: ``run`` holds the state of another training.
        FloatingPointError: a loss is not finite; the last saved state stays intact.
    """
    settings = policy.config
    modules = {"pick": policy.pick.to(device).train(), "place": policy.place.to(device).train()}
    optimizers = {name: torch.optim.Adam(m.parameters(), lr=settings.learning_rate) for name, m in modules.items()}
    identity = {"config": settings.as_dict(), "seed": seed, "data": _fingerprint(prepared)}
    state_file, start, spent = run / "state.pt", 0, 0.0
    run.mkdir(parents=True, exist_ok=True)
    if state_file.exists():
        state = torch.load(state_file, map_location=device)
        if state["identity"] != identity:
            raise ValueError(f"{state_file} belongs to a training with other settings, data or seed; give another run")
        for name, module in modules.items():
            module.load_state_dict(state[name])
            optimizers[name].load_state_dict(state[f"{name}_optimizer"])
        start, spent = state["step"], state["seconds"]
        print(f"resuming at step {start} from {state_file}")
    began = time.time() - spent

    def store(step: int) -> None:
        state = {"identity": identity, "step": step, "seconds": time.time() - began}
        for name, module in modules.items():
            state |= {name: module.state_dict(), f"{name}_optimizer": optimizers[name].state_dict()}
        torch.save(state, state_file.with_suffix(".part"))
        os.replace(state_file.with_suffix(".part"), state_file)

    bar = tqdm(range(start, settings.steps), "training", settings.steps, initial=start, unit="step")
    for step in bar:
        # Every step's draw depends on the seed and the step alone, so a resumed run draws the same.
        batch = make_batch(prepared, settings, np.random.default_rng((seed, step)))
        # Warm up over 50 steps, hold, and fall linearly to a fiftieth over the second half.
        rate = settings.learning_rate * min(1.0, (step + 1) / 50, 0.02 + 2 * (1 - step / settings.steps))
        pair = dict(zip(("pick", "place"), losses(policy, batch), strict=True))
        for name, loss in pair.items():
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the {name} loss is {loss.item()} at step {step}; {state_file} is intact")
            optimizer = optimizers[name]
            for group in optimizer.param_groups:
                group["lr"] = rate
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(modules[name].parameters(), 1.0)
            optimizer.step()
        if step % 10 == 0:
            bar.set_postfix({name: f"{loss.item():.2f}" for name, loss in pair.items()})
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == settings.steps:
            store(step + 1)
    for module in modules.values():
        module.cpu()
    return time.time() - began


def _fingerprint(prepared: Sequence[PreparedStep]) -> str:
    digest = hashlib.sha256()
    for step in prepared:
        digest.update(step.with_image.image.numpy().tobytes())
    return digest.hexdigest()


def save_policy(policy: Policy, path: Path, facts: dict) -> None:
    """Write ``path`` (safetensors: weights and crop memory) and beside it a JSON that describes it.

    Args:
        facts: what the JSON should hold besides configuration, CLIP, versions and date: task, seed,
            demonstrations, data hash, seconds.
    """
    tensors = {
        f"{role}.{name}": value.detach().cpu().contiguous()
        for role, module in (("pick", policy.pick), ("place", policy.place))
        for name, value in module.named_parameters()
    }
    entries = []
    if policy.memory is not None:
        images, entries = policy.memory.pack()
        tensors["memory.images"] = torch.from_numpy(images)
    content = safetensors.torch.save(tensors)
    card = {
        "method": policy.name,
        "config": policy.config.as_dict(),
        "clip": {"name": policy.clip.name, "fingerprint": policy.clip.fingerprint},
        "memory": entries,
        "sha256": hashlib.sha256(content).hexdigest(),
        "versions": {"torch": torch.__version__, "python": platform.python_version()},
        "date": datetime.now(UTC).date().isoformat(),
        **facts,
    }
    demonstrations.write_whole(path, content)
    demonstrations.write_whole(path.with_suffix(".json"), json.dumps(card, indent=1).encode())


def read_card(path: Path) -> dict:
    """A checkpoint's JSON. Raises FileNotFoundError if it or the checkpoint is missing."""
    for needed in (path, path.with_suffix(".json")):
        if not needed.exists():
            raise FileNotFoundError(f"the checkpoint {path} is not complete: {needed} is missing")
    return json.loads(path.with_suffix(".json").read_text())


def load_policy(path: Path, model: Clip, settings: Config | None = None) -> Policy:
    """Load and verify a checkpoint of `save_policy`.

    Args:
        settings: if given, the configuration that the checkpoint must have.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: cut off or changed, of another configuration, or trained with another CLIP.
    """
    path = Path(path)
    card = read_card(path)
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != card["sha256"]:
        raise ValueError(f"the checkpoint {path} is cut off or changed: its SHA-256 is not the one in its JSON")
    found = Config.from_dict(card["config"])
    if settings is not None and settings != found:
        old, new = found.as_dict(), settings.as_dict()
        differ = [f"{key}: {old[key]!r} there, {new[key]!r} asked for" for key in new if old[key] != new[key]]
        raise ValueError(f"the checkpoint {path} has another configuration ({'; '.join(differ)})")
    if card["clip"]["fingerprint"] != model.fingerprint:
        raise ValueError(
            f"the checkpoint {path} was trained with the CLIP {card['clip']['name']!r}, "
            f"not with the weights of {model.name!r}"
        )
    tensors = safetensors.torch.load(content)
    memory = None
    if card["memory"]:
        memory = CropMemory.unpack(tensors["memory.images"].numpy(), card["memory"], model)
    policy = Policy(found, model, memory)
    with torch.no_grad():
        for role, module in (("pick", policy.pick), ("place", policy.place)):
            for name, value in module.named_parameters():
                value.copy_(tensors[f"{role}.{name}"])
    return policy


def main() -> None:
    """Command line: see ``python -m gem_lite.train --help``."""
    parser = argparse.ArgumentParser(
        description="Train GEM from demonstrations.",
        epilog="example: python -m gem_lite.train data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors",
    )
    parser.add_argument("demonstrations", type=Path, help="folder made by python -m gem_lite.demonstrations collect")
    parser.add_argument("checkpoint", type=Path, help="safetensors file to write")
    parser.add_argument("--config", choices=list(config.CONFIGS), default="lite", help="default lite")
    parser.add_argument("--steps", type=int, help="training steps (default: the configuration's)")
    parser.add_argument("--episodes", type=int, help="use only the first so many demonstrations")
    parser.add_argument("--seed", type=int, default=0, help="seed of weights and draws (default 0)")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (default: the embedded one)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (default cpu)")
    parser.add_argument("--run", type=Path, help="folder for the state to resume from (default runs/<checkpoint>)")
    args = parser.parse_args()
    try:
        demos = demonstrations.load(args.demonstrations)[: args.episodes]
        model = clip.load(args.clip)
        settings = config.CONFIGS[args.config]
        if args.steps is not None:
            settings = dataclasses.replace(settings, steps=args.steps)
        run = args.run or Path("runs") / args.checkpoint.stem
        prepared, memory = prepare(demos, model, settings)
        policy = Policy(settings, model, memory, args.seed)
        seconds = train(policy, prepared, args.seed, run, args.device)
    except (OSError, ValueError, FloatingPointError) as error:
        parser.exit(2, f"{error}\n")
    facts = {
        "task": demos[0].task,
        "demos": len(demos),
        "data_sha256": demonstrations.data_hash(args.demonstrations),
        "seed": args.seed,
        "train_seconds": round(seconds, 1),
        "hardware": f"{os.cpu_count()} CPU cores" if args.device == "cpu" else torch.cuda.get_device_name(),
    }
    save_policy(policy, args.checkpoint, facts)
    with contextlib.suppress(FileNotFoundError):
        (run / "state.pt").unlink()
    print(f"wrote {args.checkpoint} after {seconds:.0f} s of training on {len(demos)} demonstrations")


if __name__ == "__main__":
    main()
