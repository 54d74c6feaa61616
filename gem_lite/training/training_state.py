"""The state of a training, in a file. A stopped training continues from it and reaches the same weights.

The state is one file, so that a full disk leaves the old one whole. (Accelerate's own `save_state` writes several.)
"""

from __future__ import annotations

import io
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import torch
from torch import nn

from gem_lite.foundations.files import write_atomically

STATE_FILE = "state.pt"


class Cost(NamedTuple):
    """The cost of a training with all its parts: seconds on the clock, and CPU seconds of all cores together."""

    seconds: float
    cpu_seconds: float

    @classmethod
    def now(cls) -> Cost:
        """The present values of the two clocks. The difference of two such values is a cost."""
        return cls(time.time(), time.process_time())

    def since(self, start: Cost) -> Cost:
        """The cost from the clocks' values ``start`` to these."""
        return Cost(self.seconds - start.seconds, self.cpu_seconds - start.cpu_seconds)


@dataclass
class TrainingState:
    """The parts of a training, and the file of their state.

    Attributes:
        file: the file of the state.
        identity: the facts that decide the result of the training, ready for JSON. A file with others is refused.
        parts: modules and optimizers, each by a name of its own.
        saved: the number of steps in the file; 0 while there is no file.
        saved_at: the time of the last writing, or of the start (seconds since the epoch).
        start: the clocks' values at the start, moved back by the cost of earlier parts.
    """

    file: Path
    identity: Mapping[str, object]
    parts: Mapping[str, nn.Module | torch.optim.Optimizer]
    saved: int = 0
    saved_at: float = field(default_factory=time.time)
    start: Cost = field(default_factory=Cost.now)

    @property
    def cost(self) -> Cost:
        """The cost so far, with that before interruptions."""
        return Cost.now().since(self.start)

    @property
    def description(self) -> str:
        """The saved state in words, for error messages."""
        return f"{self.file} holds step {self.saved}, intact" if self.saved else "no state had been saved yet"

    def restore(self, device: torch.device) -> None:
        """Load the state from the file, if there is one.

        Raises:
            ValueError: the file is damaged, or belongs to another training.
        """
        if not self.file.exists():
            return
        state = load_state(self.file, device)
        if state["identity"] != self.identity:
            raise ValueError(
                f"{self.file} belongs to a training with other settings (method, configuration, data, seed or "
                "number of processes): give another folder by --state, or remove it"
            )
        for name, part in self.parts.items():
            part.load_state_dict(state[name])
        self.saved = state["step"]
        self.start = self.start.since(Cost(*state["cost"]))

    def save(self, step: int) -> None:
        """Write the state after ``step`` steps.

        Raises:
            OSError: the file cannot be written; it keeps its old content.
        """
        state = {"identity": self.identity, "step": step, "cost": tuple(self.cost)}
        state |= {name: part.state_dict() for name, part in self.parts.items()}
        try:
            save_state(self.file, state)
        except OSError as error:
            raise OSError(f"the state of step {step} cannot be saved ({error}); {self.description}") from error
        self.saved = step
        self.saved_at = time.time()


def save_state(file: Path, state: Mapping[str, object]) -> None:
    """Write the state of a training; after an interruption or on a full disk, the old file is unchanged."""
    # First into memory: torch does not always report a full disk.
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_atomically(file, buffer.getvalue())


def load_state(file: Path, device: torch.device | None = None) -> dict:
    """A state of `save_state`.

    Raises:
        ValueError: the file is empty, cut off or something else.
    """
    content = io.BytesIO(file.read_bytes())
    try:
        state = torch.load(content, map_location=device)
        if "identity" not in state:
            raise KeyError("identity")
    except Exception as error:  # A damaged file can have any error.
        raise ValueError(f"{file} is cut off or no state of a training: remove it to begin anew") from error
    return state
