"""How far a training has come, in a file: a training that was stopped goes on from there to the same weights."""

from __future__ import annotations

import io
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import torch
from torch import nn

from gem_lite.files import write_atomically

STATE_FILE = "state.pt"


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


@dataclass
class TrainingState:
    """What a training changes, and the file that keeps it.

    Attributes:
        file: where the state is kept.
        identity: what decides the training's result, ready for JSON; another training's file is refused.
        modules, optimizers: by role, with the same roles.
        writes: whether this process writes the file: of several processes one does.
        saved: how many steps the file holds; 0 while there is no file.
        saved_at: when it was written or read (seconds since the epoch).
        began: the clocks' readings at which an unbroken training would have begun.
    """

    file: Path
    identity: Mapping[str, object]
    modules: Mapping[str, nn.Module]
    optimizers: Mapping[str, torch.optim.Optimizer]
    writes: bool = True
    saved: int = 0
    saved_at: float = field(default_factory=time.time)
    began: Cost = field(default_factory=Cost.now)

    @property
    def cost(self) -> Cost:
        """What has been spent so far, before interruptions, too."""
        return Cost.now().since(self.began)

    @property
    def last_good(self) -> str:
        """What is left when the training fails now, in words."""
        return f"{self.file} holds step {self.saved}, intact" if self.saved else "no state had been saved yet"

    def restore(self, device: torch.device) -> None:
        """Take over what the file holds, if there is one.

        Raises:
            ValueError: it is of another training.
        """
        if not self.file.exists():
            return
        state = torch.load(self.file, map_location=device)
        if state["identity"] != self.identity:
            raise ValueError(
                f"{self.file} belongs to a training with other settings (method, configuration, data, seed or "
                "number of processes); give another run"
            )
        for role, module in self.modules.items():
            module.load_state_dict(state[role])
            self.optimizers[role].load_state_dict(state[f"{role}_optimizer"])
        self.saved = state["step"]
        self.began = self.began.since(Cost(*state["cost"]))

    def save(self, step: int) -> None:
        """Write the state after ``step`` steps.

        Raises:
            OSError: it cannot be written; the file holds what it held before.
        """
        if self.writes:
            self._write(step)
        self.saved, self.saved_at = step, time.time()

    def _write(self, step: int) -> None:
        state = {"identity": self.identity, "step": step, "cost": tuple(self.cost)}
        for role, module in self.modules.items():
            state |= {role: module.state_dict(), f"{role}_optimizer": self.optimizers[role].state_dict()}
        # Into memory first: torch's own writer reports a full disk as it likes, and not always.
        buffer = io.BytesIO()
        torch.save(state, buffer)
        try:
            write_atomically(self.file, buffer.getvalue())
        except OSError as error:
            raise OSError(f"the state of step {step} cannot be saved ({error}); {self.last_good}") from error
