"""A rival after VIMA (A.1.5): tokens of things and of an action attend to the tokens of the prompt.

Smaller than VIMA, and without what one step and one kind of sentence do not need: see README.md.
"""

from __future__ import annotations

import json
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
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.environment import Environment

BIN = 0.01
"""A coordinate is chosen among bins of this width (m), as in VIMA."""
PATCH = 16
"""Side of a patch of a cutout, as in VIMA."""
WORDS = 2
"""The prompt's words: "put" and "into"."""
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
        steps, batch, learning_rate: of training.

    Raises:
        ValueError: a number below 1, a width that the heads do not share evenly, or another value out of range.
    """

    width: int = 128
    layers: int = 2
    cutout_layers: int = 2
    heads: int = 8
    dropout: float = 0.1
    steps: int = 5000
    batch: int = 32
    learning_rate: float = 3e-4

    def __post_init__(self) -> None:
        for name in ("width", "layers", "cutout_layers", "heads", "steps", "batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.width % self.heads:
            raise ValueError(f"width must be a multiple of {self.heads}, the number of heads, got {self.width}")
        if not 0 <= self.dropout < 1:
            raise ValueError(f"dropout must be from 0 to below 1, got {self.dropout}")
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
            self.box = _mlp(4, width, width)
            self.thing = nn.Linear(2 * width, width)
            self.words = nn.Parameter(0.02 * torch.randn(WORDS, width))
            self.prompted = _mlp(width, width, width)
            self.places = nn.Parameter(0.02 * torch.randn(2 * WORDS, width))
            self.prompt = nn.TransformerEncoder(
                nn.TransformerEncoderLayer(width, **_layer(config)), 1, enable_nested_tensor=False
            )
            self.action = nn.Parameter(0.02 * torch.randn(width))
            self.decoder = nn.TransformerDecoder(nn.TransformerDecoderLayer(width, **_layer(config)), config.layers)
            self.heads = nn.ModuleList(_mlp(width, bins, 2 * width) for bins in self.bins)

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
        seen, asked = looks[:, :most], self.prompted(looks[:, most:])
        put, into = (word.expand(count, -1) for word in self.words)
        prompt = self.prompt(torch.stack([put, asked[:, 0], into, asked[:, 1]], dim=1) + self.places)
        things = self.thing(torch.cat([seen, self.box(tokens.boxes)], dim=-1))
        history = torch.cat([things, self.action.expand(count, 1, -1)], dim=1)
        absent = F.pad(tokens.absent, (0, 1), value=False)
        action = self.decoder(history, prompt, tgt_key_padding_mask=absent)[:, -1]
        return [head(action) for head in self.heads]

    def loss(self, tokens: Tokens, labels: torch.Tensor) -> torch.Tensor:
        """The cross-entropy of labels (B, 4), a bin for each coordinate: the mean over coordinates."""
        logits = zip(self(tokens), labels.T, strict=True)
        return torch.stack([F.cross_entropy(scores, right) for scores, right in logits]).mean()

    def label(self, action: PickPlace) -> list[int]:
        """The bins of an action."""
        points = np.array([action.pick.x, action.pick.y, action.place.x, action.place.y])
        numbers = np.floor((points - np.tile([self.workspace.x_min, self.workspace.y_min], 2)) / BIN)
        return np.clip(numbers, 0, np.array(self.bins) - 1).astype(int).tolist()

    @torch.no_grad()
    def act(self, scene: Cutouts) -> PickPlace:
        """The action of the likeliest bins' middles, without a turn."""
        x, y, u, v = (BIN * (scores.argmax().item() + 0.5) for scores in self.eval()(tokens_of([scene])))
        w = self.workspace
        return PickPlace(Pose2(w.x_min + x, w.y_min + y), Pose2(w.x_min + u, w.y_min + v))

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
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, config.learning_rate, total_steps=config.steps, pct_start=WARM_UP
    )
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    rival.train()
    with tqdm(range(config.steps), "training", unit="step") as bar:
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


def parameters(rival: nn.Module) -> int:
    """The number of trained numbers."""
    return sum(parameter.numel() for parameter in rival.parameters())


def save(rival: Rival, path: Path, facts: dict) -> None:
    """Write the weights, and beside them a JSON with the configuration and ``facts``."""
    card = {"config": asdict(rival.config), "table": rival.workspace.limits, **facts}
    weights = safetensors.torch.save(rival.state_dict())
    write_together({path: weights, path.with_suffix(".json"): json.dumps(card, indent=1).encode()})


def load(path: Path, workspace: Workspace) -> tuple[Rival, dict]:
    """A saved rival and its card."""
    card = json.loads(path.with_suffix(".json").read_text())
    rival = Rival(RivalConfig(**card["config"]), workspace)
    rival.load_state_dict(safetensors.torch.load_file(path))
    return rival.eval(), card
