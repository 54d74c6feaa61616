"""A rival after VIMA (A.1.5): tokens of things and of an action attend to the tokens of the prompt.

It is smaller than VIMA, and has no part that one act and one kind of sentence do not need: see README.md.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
import torch.nn.functional as F
from torch import nn
from tqdm import tqdm

from experiments.picture_prompts.cutouts import SIDE, Cutouts, cutouts
from gem_lite.actions import PickPlace
from gem_lite.demonstrations import Demonstration
from gem_lite.evaluation.rollout import Actor, Observations
from gem_lite.foundations.files import write_together
from gem_lite.policies.checkpoints import card_path
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.environment import Environment

METHOD = "vima-like"
"""The rival's name in cards and rows."""
BIN = 0.01
"""A coordinate is chosen among bins of this width (m), as in VIMA."""
PATCH = 16
"""Side of a patch of a cutout, as in VIMA."""
WORDS = 2
"""The prompt's words: "put" and "into"."""
FREQUENCIES = (1, 2, 4, 8, 16)
"""A number of a box is also given as sines and cosines of so many half turns."""
WARM_UP = 0.05
"""The learning rate rises in this share of the steps, and then falls as a cosine."""


@dataclass(frozen=True)
class RivalConfig:
    """The rival's numbers.

    Attributes:
        width: of all tokens.
        layers: of the decoder.
        cutout_layers: of the encoder of cutouts.
        heads: of all attention.
        dropout: in training.
        spread: a label is shared by bins around the right one, by a normal distribution of this width (bins); with 0
            only the right bin is right, as in VIMA.
        steps, batch, learning_rate: of training.

    Raises:
        ValueError: a number below 1, a width that the heads do not share evenly, or another value out of range.
    """

    width: int = 128
    layers: int = 2
    cutout_layers: int = 2
    heads: int = 8
    dropout: float = 0.1
    spread: float = 2.0
    steps: int = 1000
    batch: int = 32
    learning_rate: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("width", "layers", "cutout_layers", "heads", "steps", "batch"):
            value = getattr(self, name)
            if not isinstance(value, int) or value < 1:
                raise ValueError(f"{name} must be a whole number from 1 on, got {value}")
        if self.width % self.heads:
            raise ValueError(f"width must be a multiple of {self.heads}, the number of heads, got {self.width}")
        if not 0 <= self.dropout < 1:
            raise ValueError(f"dropout must be from 0 to below 1, got {self.dropout}")
        if self.spread < 0:
            raise ValueError(f"spread must be at least 0, got {self.spread}")
        if not 0 < self.learning_rate <= 1:
            raise ValueError(f"learning_rate must be above 0 and up to 1, got {self.learning_rate}")


@dataclass(frozen=True)
class Tokens:
    """A batch of `Cutouts` of scenes with at most N things.

    Attributes:
        things: (B, N, 3, `SIDE`, `SIDE`) float32 in [-1, 1].
        boxes: (B, N, 4) float32.
        absent: (B, N) bool, where a scene has fewer things.
        prompt: (B, 2, 3, `SIDE`, `SIDE`) float32 in [-1, 1].
    """

    things: torch.Tensor
    boxes: torch.Tensor
    absent: torch.Tensor
    prompt: torch.Tensor

    def __getitem__(self, numbers: torch.Tensor) -> Tokens:
        return Tokens(*(getattr(self, name)[numbers] for name in ("things", "boxes", "absent", "prompt")))


def tokens_of(scenes: Sequence[Cutouts]) -> Tokens:
    """Cutouts of several scenes as one batch."""
    most = max(len(scene.boxes) for scene in scenes)

    def filled(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.zeros((most - len(values), *values.shape[1:]), values.dtype)])

    return Tokens(
        _pixels(np.stack([filled(scene.things) for scene in scenes])),
        torch.from_numpy(np.stack([filled(scene.boxes) for scene in scenes])),
        torch.tensor([[number >= len(scene.boxes) for number in range(most)] for scene in scenes]),
        _pixels(np.stack([scene.prompt for scene in scenes])),
    )


def _pixels(pictures: np.ndarray) -> torch.Tensor:
    """(..., H, W, 3) uint8 to (..., 3, H, W) float32 in [-1, 1]."""
    return torch.from_numpy(pictures).movedim(-1, -3).float() / 127.5 - 1


class CutoutEncoder(nn.Module):
    """A small vision transformer: a cutout to one token."""

    def __init__(self, config: RivalConfig) -> None:
        super().__init__()
        self.patches = nn.Conv2d(3, config.width, PATCH, PATCH)
        self.summary = nn.Parameter(0.02 * torch.randn(1, 1, config.width))
        self.positions = nn.Parameter(0.02 * torch.randn(1, 1 + (SIDE // PATCH) ** 2, config.width))
        layer = nn.TransformerEncoderLayer(config.width, **_layer(config))
        self.layers = nn.TransformerEncoder(layer, config.cutout_layers, enable_nested_tensor=False)

    def forward(self, cutouts: torch.Tensor) -> torch.Tensor:
        """(B, 3, `SIDE`, `SIDE`) to (B, width)."""
        patches = self.patches(cutouts).flatten(2).mT
        tokens = torch.cat([self.summary.expand(len(cutouts), -1, -1), patches], dim=1)
        return self.layers(tokens + self.positions)[:, 0]


def _layer(config: RivalConfig) -> dict:
    """What all transformer layers share."""
    return {
        "nhead": config.heads, "dim_feedforward": 4 * config.width, "dropout": config.dropout, "activation": "gelu",
        "batch_first": True, "norm_first": True,
    }  # fmt: skip


def _mlp(inputs: int, outputs: int, hidden: int) -> nn.Module:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs))


def fourier_features(boxes: torch.Tensor) -> torch.Tensor:
    """Boxes (..., 4) and the sines and cosines of `FREQUENCIES`, (..., 4 * 11): they tell near places apart."""
    turns = math.pi * boxes[..., None] * torch.tensor(FREQUENCIES)
    return torch.cat([boxes[..., None], turns.sin(), turns.cos()], dim=-1).flatten(-2)


class Rival(nn.Module):
    """From tokens to one pick and place: each of four coordinates is a choice among bins.

    Args:
        workspace: the table that the bins cover.
        seed: of the initial weights.
    """

    def __init__(self, config: RivalConfig, workspace: Workspace, seed: int = 0) -> None:
        super().__init__()
        self.config = config
        self.workspace = workspace
        width = config.width
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.cutouts = CutoutEncoder(config)
            self.box = _mlp(4 * (1 + 2 * len(FREQUENCIES)), width, width)
            self.thing = nn.Linear(2 * width, width)
            self.words = nn.Parameter(0.02 * torch.randn(WORDS, width))
            self.prompt_thing = _mlp(width, width, width)
            self.prompt_positions = nn.Parameter(0.02 * torch.randn(2 * WORDS, width))
            self.prompt_encoder = nn.TransformerEncoder(
                nn.TransformerEncoderLayer(width, **_layer(config)), 1, enable_nested_tensor=False
            )
            self.action = nn.Parameter(0.02 * torch.randn(width))
            self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(width, **_layer(config)), config.layers)
            self.coordinates = nn.ModuleList(_mlp(width, bins, 2 * width) for bins in self.bins)

    @property
    def bins(self) -> tuple[int, int, int, int]:
        """The number of bins of the pick's x and y, and of the place's."""
        w = self.workspace
        x, y = (round(length / BIN) for length in (w.x_max - w.x_min, w.y_max - w.y_min))
        return x, y, x, y

    def forward(self, tokens: Tokens) -> list[torch.Tensor]:
        """The logits (B, bins) of each coordinate."""
        count, most = tokens.absent.shape
        looks = self.cutouts(torch.cat([tokens.things, tokens.prompt], dim=1).flatten(0, 1)).unflatten(0, (count, -1))
        things = self.thing(torch.cat([looks[:, :most], self.box(fourier_features(tokens.boxes))], dim=-1))
        shown = self.prompt_thing(looks[:, most:])
        put, into = (word.expand(count, -1) for word in self.words)
        sentence = torch.stack([put, shown[:, 0], into, shown[:, 1]], dim=1)
        prompt = self.prompt_encoder(sentence + self.prompt_positions)
        history = torch.cat([things, self.action.expand(count, 1, -1)], dim=1)
        absent = F.pad(tokens.absent, (0, 1), value=False)
        action = self.decoder(history, prompt, tgt_key_padding_mask=absent)[:, -1]
        return [head(action) for head in self.coordinates]

    def loss(self, tokens: Tokens, labels: torch.Tensor) -> torch.Tensor:
        """The cross-entropy of labels (B, 4), a place in bins for each coordinate: the mean over coordinates."""
        logits = zip(self(tokens), labels.T, strict=True)
        return torch.stack(
            [F.cross_entropy(scores, self.soft_labels(right, scores)) for scores, right in logits]
        ).mean()

    def soft_labels(self, places: torch.Tensor, scores: torch.Tensor) -> torch.Tensor:
        """How right each bin is, (B, bins): places (B,) in bins, and their logits (B, bins)."""
        count = scores.shape[1]
        if not self.config.spread:
            return F.one_hot(places.long().clamp(0, count - 1), count).float()
        off = (torch.arange(count) + 0.5 - places[:, None]) / self.config.spread
        return torch.softmax(-(off**2) / 2, dim=1)

    def label(self, action: PickPlace) -> list[float]:
        """The place of an action's four coordinates, in bins from the table's corner."""
        points = np.array([action.pick.x, action.pick.y, action.place.x, action.place.y])
        return ((points - np.tile([self.workspace.x_min, self.workspace.y_min], 2)) / BIN).tolist()

    @torch.no_grad()
    def act(self, scene: Cutouts) -> PickPlace:
        """The action of the likeliest bins' middles, without a turn."""
        was_training = self.training
        self.eval()
        middles = [BIN * (scores.argmax().item() + 0.5) for scores in self(tokens_of([scene]))]
        self.train(was_training)
        x = self.workspace.x_min
        y = self.workspace.y_min
        pick = Pose2(x + middles[0], y + middles[1])
        place = Pose2(x + middles[2], y + middles[3])
        return PickPlace(pick, place)

    def actor(self) -> Actor:
        """The rival as an actor in a `segmented_world.SegmentedWorld`."""

        def act(environment: Environment, observations: Observations, _: Sequence[Pose2] = ()) -> PickPlace:
            return self.act(cutouts(observations[0], environment.task.instruction))

        return act


def train(rival: Rival, demos: Sequence[Demonstration], seed: int) -> None:
    """Train in place on the first step of each demonstration."""
    steps = [demonstration.steps[0] for demonstration in tqdm(demos, "cutouts", unit="episode")]
    tokens = tokens_of([cutouts(step.observation, step.instruction) for step in steps])
    labels = torch.tensor([rival.label(step.expert.action) for step in steps])
    config = rival.config
    optimizer = torch.optim.AdamW(rival.parameters(), config.learning_rate, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: rate(step / config.steps))
    rng = np.random.default_rng(seed)
    rival.train()
    with torch.random.fork_rng(devices=[]), tqdm(range(config.steps), "training", unit="step") as bar:
        torch.manual_seed(seed)  # for the dropout
        for step in bar:
            numbers = torch.from_numpy(rng.integers(len(labels), size=config.batch))
            loss = rival.loss(tokens[numbers], labels[numbers])
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(rival.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            if step % 50 == 0:
                bar.set_postfix(loss=f"{loss.item():.3f}")


def rate(progress: float) -> float:
    """The share of the learning rate at a share of the steps: it rises in `WARM_UP`, and falls as a cosine."""
    if progress < WARM_UP:
        return (progress + 0.01) / (WARM_UP + 0.01)
    return 0.5 * (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP)))


def count_parameters(network: nn.Module) -> int:
    """The number of trained numbers."""
    return sum(parameter.numel() for parameter in network.parameters())


def check_request(checkpoint: Path, seed: int) -> None:
    """Refuse what a training would fail at only in its end. Raises ValueError."""
    card_path(checkpoint)
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")


def save(rival: Rival, path: Path, facts: dict) -> None:
    """Write the weights, and beside them a card that `checkpoints.read_card` reads.

    Args:
        facts: further entries of the card.

    Raises:
        ValueError: ``path`` does not end in ".safetensors".
    """
    weights = safetensors.torch.save(rival.state_dict())
    digest = hashlib.sha256(weights).hexdigest()
    card = {"method": METHOD, "config": asdict(rival.config), "clip": {}, "memory": [], "sha256": digest, **facts}
    write_together({path: weights, card_path(path): json.dumps(card, indent=1).encode()})


def load(path: Path, card: dict, workspace: Workspace) -> Rival:
    """A saved rival.

    Args:
        card: what `checkpoints.read_card` returns for ``path``.

    Raises:
        ValueError: the file is cut off or changed, or does not fit its card.
    """
    weights = path.read_bytes()
    if hashlib.sha256(weights).hexdigest() != card["sha256"]:
        raise ValueError(f"the checkpoint {path} is cut off or changed: its SHA-256 is not the one in its JSON")
    try:
        rival = Rival(RivalConfig(**card["config"]), workspace)
        rival.load_state_dict(safetensors.torch.load(weights))
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"the weights in {path} and the configuration in its JSON do not fit: {error}") from error
    return rival.eval()
