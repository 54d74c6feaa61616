"""What every learned method shares: how it reads, acts and is trained. `Policy` is the interface.

A method turns camera views into its own kind of `EmbeddedScene`, a scene and two queries into `Inputs`, and inputs into
logits over angles and pixels. The rest is the same for all methods and is in this module: from the sentence to the
action, and from the demonstration to the loss.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
import torch
from torch import nn
from typing_extensions import override

from gem_lite import config as configuration
from gem_lite import language
from gem_lite.actions import Action
from gem_lite.clip import Clip
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.foundations.registry import Registry
from gem_lite.language import Instruction, Queries, Query, Spot, is_relation
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey
from gem_lite.maps.relations import NoFreePlaceError
from gem_lite.maps.semantic_map import embed_query
from gem_lite.policies import augment
from gem_lite.policies.choosing import (
    Choice,
    Gate,
    ScoredAct,
    TablesChoice,
    best_cell,
    best_cells,
    check_place,
    gated,
    log_probability,
    unmoved,
    untried,
    with_spot,
)
from gem_lite.policies.inputs import (
    Cell,
    Inputs,
    PreparedStep,
    Sample,
    collate,
    cross_entropy,
    label,
    numbered_steps,
    right_bins,
)
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins


class EmbeddedScene(Protocol):
    """What a method computes from the camera views alone, before it knows a query."""

    @property
    def heightmap(self) -> HeightMap:
        """The table from above."""


SceneT = TypeVar("SceneT", bound=EmbeddedScene)


class _Methods(Registry[type["Policy"]]):
    """A method also knows its name, as `Policy.method`."""

    @override
    def add(self, name: str, entry: type[Policy], module: str | None = None) -> type[Policy]:
        entry.method = name
        return super().add(name, entry, module)


METHODS = _Methods("method")
"""Methods by their names, without ablations."""


class Policy(nn.Module, ABC, Generic[SceneT]):
    """A learned method: from images and a sentence to one pick and place.

    A new method has a ``Config`` and defines `build`, `embed`, `inputs`, `score_pick` and `score_place`;
    ``@METHODS.register("name")`` makes it known. The CLIP is no part of the module: it is frozen, and `to` does not
    move it (`Clip.to` does).

    Attributes:
        method: the method's name, without the endings of its ablations; its registration sets it.
        Config: the class of its configurations.
        choice: the class of its decisions.
        one_kernel: whether it scores one kernel against the features of each of several tables (`decide_over`).
        pick, place: its two trainable modules.
        memory: the demonstrations' crops, for a method that retrieves them.
        parser: the reader of instructions.

    Args:
        seed: of the initial weights.
        parser: a reader of instructions; by default the one that the configuration names.

    Raises:
        ValueError: ``config`` belongs to another method.
    """

    method: ClassVar[str]
    Config: ClassVar[type[configuration.Config]]
    choice: ClassVar[type[Choice]] = Choice
    one_kernel: ClassVar[bool] = False
    pick: nn.Module
    place: nn.Module

    def __init__(
        self, config: configuration.Config, clip: Clip, memory: CropMemory | None = None, seed: int = 0,
        parser: language.Parser | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        if not isinstance(config, self.Config):
            raise ValueError(f"config of {self.method} must be a {self.Config.__name__}, got {type(config).__name__}")
        self.config = config
        self.clip = clip
        self.memory = memory
        self.parser = language.PARSERS.find(config.parser) if parser is None else parser
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.pick, self.place = self.build()

    @property
    def device(self) -> torch.device:
        """The device of the policy's networks."""
        return next(self.parameters()).device

    @property
    def name(self) -> str:
        """The name in results and checkpoints, such as ``gem`` or ``gem-without-semantic-map``."""
        return self.method + self.config.variant

    @property
    def recolors(self) -> bool:
        """Whether training recolours the pictures. False, unless CLIP's features or maps keep the true colours."""
        return False

    @property
    def form_chances(self) -> tuple[float, ...]:
        """How often training draws each form of a prepared step. Most methods have one form."""
        return (1.0,)

    @property
    def roles(self) -> dict[str, nn.Module]:
        """The two trained modules by name; each has its own loss and optimizer."""
        return {"pick": self.pick, "place": self.place}

    @abstractmethod
    def build(self) -> tuple[nn.Module, nn.Module]:
        """New pick and place modules with the sizes in ``config``."""

    @abstractmethod
    def embed(self, views: Sequence[View]) -> SceneT:
        """Compute everything that does not depend on the queries."""

    @abstractmethod
    def inputs(self, scene: SceneT, queries: Queries) -> Inputs:
        """The networks' inputs for a scene of `embed` and the queries."""

    @abstractmethod
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        """Logits (B, R, H, W) of batched inputs: of a pick at each pixel with each yaw."""

    @abstractmethod
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """Logits (B, R, H, W) of a place at each pixel, turned by each angle, after ``picks`` at pixels (B, 2)."""

    def goals(self, instruction: Instruction | Queries) -> tuple[Queries, ...]:
        """The queries of each goal of an instruction, in the order in which to reach them. `Queries` are one goal.

        Raises:
            ValueError: the parser refuses the instruction, or the policy cannot follow it (`check_place`).
        """
        if isinstance(instruction, Queries):
            return (instruction,)
        goals = language.read_goals(instruction, self.parser)
        if self.config.parsing:
            return goals
        if not isinstance(instruction, str):
            raise ValueError(
                f"{self.method} without parsing reads whole sentences of words, got one with pictures: {instruction}"
            )
        for goal in goals:
            if is_relation(goal.place):
                reads = f"{self.method} without parsing reads whole sentences"
                raise ValueError(f"{reads} and has no map of a place {str(goal.place)!r}")
        return (Queries(instruction, instruction, goals[0].push),)

    def read(self, instruction: Instruction | Queries, reached: Collection[Queries] = ()) -> Queries:
        """The queries to act on: those of the first goal that is not ``reached``.

        Raises:
            ValueError: the parser refuses the instruction, or all its goals are reached.
        """
        for goal in self.goals(instruction):
            if goal not in reached:
                return goal
        raise ValueError(f"reached holds every goal of {str(instruction)!r}: nothing is left to do")

    def words(self, queries: Queries) -> dict[str, torch.Tensor]:
        """What the networks get of the queries, (L,) each, as `Inputs` holds it: "pick" and "place"."""
        return {"pick": self.embed_words(queries.pick), "place": self.embed_words(queries.place)}

    def embed_words(self, query: Query) -> torch.Tensor:
        """A query as the networks get it, (`language_dim`,): CLIP's embedding, then the code of its location words.

        Of a place beside things, they get the things, and of a spot, the word "table".
        """
        if isinstance(query, Spot):
            query = "table"
        if self.config.parsing and isinstance(query, str):
            query = language.without_relation(query)
        plain = language.location_in_front(query) if self.config.parsing and isinstance(query, str) else query
        embedding = embed_query(plain, self.clip)
        if not self.config.location_code:
            return embedding
        return torch.cat([embedding, language.location_code(query if isinstance(query, str) else "")])

    @property
    def language_dim(self) -> int:
        """L, the length of `embed_words`."""
        return self.clip.dim + (language.LOCATION_CODE_LENGTH if self.config.location_code else 0)

    def remember(self, demos: Sequence[Demonstration]) -> None:
        """Keep what the method later retrieves from demonstrations. Most methods keep nothing."""

    def prepare(self, demos: Sequence[Demonstration], start: int = 0) -> Iterator[PreparedStep]:
        """What training does not change, computed lazily, step by step. Call `remember` first.

        Args:
            start: how many steps to skip at the beginning.

        Raises:
            ValueError: a step has other cameras than the steps before it.
        """
        for key, step in itertools.islice(numbered_steps(demos), start, None):
            yield self.prepare_step(step, key)

    def prepare_step(self, step: DemonstrationStep, key: EpisodeKey) -> PreparedStep:
        """`prepare` for one step of the episode ``key``."""
        inputs = self.inputs(self.embed(step.observation.views), self.read(step.instruction))
        sample = label(step, inputs, self.config)
        return (sample,)

    def draw(self, step: PreparedStep, rng: np.random.Generator) -> Sample:
        """A training sample: one form of a prepared step, augmented."""
        return self.augmented(step[rng.choice(len(step), p=self.form_chances)], rng)

    def augmented(self, sample: Sample, rng: np.random.Generator) -> Sample:
        """A sample moved at random, and recoloured if the method `recolors`."""
        moved = augment.moved(rng, sample, self.config.turn)
        return augment.recolored(rng, moved) if self.recolors else moved

    def losses(self, batch: Sequence[Sample]) -> dict[str, torch.Tensor]:
        """Each module's cross-entropy over pixels and angles. The place module gets the demonstrated pick (A.11)."""
        inputs = collate(batch, self.device)
        count = self.config.angles
        turns = self.pick_angles
        picks = [(right_bins(s.pick_yaw, s.pick_symmetry, turns), round(s.pick[0]), round(s.pick[1])) for s in batch]
        places = [(right_bins(s.delta, s.place_symmetry, count), round(s.place[0]), round(s.place[1])) for s in batch]
        pixels = torch.tensor([cell[1:] for cell in picks])
        return {"pick": self.pick_loss(inputs, picks), "place": self.place_loss(inputs, pixels, places)}

    def pick_loss(self, inputs: Inputs, cells: Sequence[Cell]) -> torch.Tensor:
        """The cross-entropy of `score_pick` to labels. A method may compute it in a faster way."""
        return cross_entropy(self.score_pick(inputs), cells)

    def place_loss(self, inputs: Inputs, picks: torch.Tensor, cells: Sequence[Cell]) -> torch.Tensor:
        """The cross-entropy of `score_place` to labels. A method may compute it in a faster way."""
        return cross_entropy(self.score_place(inputs, picks), cells)

    @property
    def pick_angles(self) -> int:
        """At how many angles a pick is scored."""
        return self.config.angles

    def act_as(self, config: configuration.Config) -> None:
        """Act by other rules than those of the training, for instance without the rule for location words.

        Args:
            config: the policy's own, but for entries of `Config.ACTING` and the ablations that they are part of.

        Raises:
            ValueError: another entry differs.
        """
        differing = {name for name, value in vars(self.config).items() if vars(config).get(name) != value}
        if type(config) is not type(self.config) or not differing <= {*config.ACTING, "ablations"}:
            raise ValueError(
                f"config may differ from the policy's in {', '.join(sorted(self.config.ACTING))} only: a trained "
                "policy cannot change the rest"
            )
        self.config = config

    def gates(self, views: Sequence[View], inputs: Inputs, queries: Queries) -> Mapping[str, Gate]:
        """Maps that restrict "pick" and "place" where the policy acts (`policies.choosing`). Most methods have none."""
        return {}

    def act(
        self, observation: Observation, instruction: Instruction | Queries, empty_picks: Sequence[Pose2] = ()
    ) -> Action:
        """One pick and place; or one push, if the sentence says "push".

        Args:
            instruction: a sentence, with or without pictures, or the two queries. Of several goals, it acts on the
                first (`read` gives others).
            empty_picks: poses at which the tool has grasped nothing since it last held something, from its own log.
                The pick keeps away from them (`Config.empty_radius`).

        Raises:
            ValueError: the parser refuses the instruction; the place is a relation, such as "left of the bowl", and
                the method has no map of it, or no such place is free; a push could only end where it begins.
        """
        return self.decide(observation, instruction, empty_picks).action

    def decide(
        self, observation: Observation, instruction: Instruction | Queries, empty_picks: Sequence[Pose2] = ()
    ) -> Choice:
        """As `act`, with the logits from which the action was read."""
        queries = self.read(instruction)  # first, since it may refuse
        chosen, details = self._decide(
            [self.embed(observation.views)], [observation.views], queries, instruction, empty_picks
        )
        return self.choice(**vars(chosen.first()), **details[0])

    def decide_in(
        self, scene: SceneT, views: Sequence[View], queries: Queries, empty_picks: Sequence[Pose2] = ()
    ) -> Choice:
        """As `decide`, in a scene that `embed` has made of ``views``."""
        chosen, details = self._decide([scene], [views], queries, queries, empty_picks)
        return self.choice(**vars(chosen.first()), **details[0])

    def decide_over(
        self, observations: Sequence[Observation], instruction: Instruction | Queries, empty_picks: Sequence[Pose2] = ()
    ) -> TablesChoice:
        """As `decide`, over several tables, of which each keeps away from ``empty_picks``.

        Raises:
            ValueError: see `check_tables` and `act`; there is no observation; or the place of a push is on another
                table.
        """
        self.check_tables()
        if not observations:
            raise ValueError("observations is empty: there must be one for each table")
        queries = self.read(instruction)
        views = [observation.views for observation in observations]
        return self._decide([self.embed(of_table) for of_table in views], views, queries, instruction, empty_picks)[0]

    def _decide(
        self, scenes: Sequence[SceneT], views: Sequence[Sequence[View]], queries: Queries,
        instruction: Instruction | Queries, empty_picks: Sequence[Pose2],
    ) -> tuple[TablesChoice, Sequence[dict[str, Any]]]:  # fmt: skip
        inputs, details = zip(*(self.explained_inputs(scene, queries) for scene in scenes), strict=True)
        gates = [self.gates(of_table, of, queries) for of_table, of in zip(views, inputs, strict=True)]
        heightmaps = [scene.heightmap for scene in scenes]
        return self.choose_over(str(instruction), queries, heightmaps, inputs, empty_picks, gates), details

    def explained_inputs(self, scene: SceneT, queries: Queries) -> tuple[Inputs, dict[str, Any]]:
        """The `inputs`, and the entries that `choice` has besides those of `Choice`."""
        return self.inputs(scene, queries), {}

    def check_tables(self) -> None:
        """Check that the method can choose over several tables. Raises ValueError if it cannot."""
        if not self.one_kernel:
            raise ValueError(
                "policy must be a gem policy or one of its ablations to choose over several tables, got "
                f"{self.name}: it makes no kernel that is scored against the features of every table"
            )

    def choose(
        self, instruction: str, queries: Queries, heightmap: HeightMap, inputs: Inputs,
        empty_picks: Sequence[Pose2] = (), gates: Mapping[str, Gate] | None = None,
    ) -> Choice:  # fmt: skip
        """`choose_over` one table."""
        return self.choose_over(instruction, queries, [heightmap], [inputs], empty_picks, [gates or {}]).first()

    @torch.inference_mode()
    def choose_over(
        self, instruction: str, queries: Queries, heightmaps: Sequence[HeightMap], tables: Sequence[Inputs],
        empty_picks: Sequence[Pose2], gates: Sequence[Mapping[str, Gate]],
    ) -> TablesChoice:  # fmt: skip
        """The best pick over all tables, then the best place for it.

        With `Config.joint_picks` above 1, the product rule (A.1.6): p(pick) p(place | pick) is computed for several
        picks with the best place of each, and the act with the largest product is chosen.

        Both lie in cells that a camera saw. A pick keeps away from empty picks, as long as that leaves a cell. Pick and
        place keep to their ``gates``. No act ends where it begins: a push ends in another cell, a pick and place in
        another cell or turned. A push stays on its table.
        """
        dtype = next(self.parameters()).dtype
        if dtype != torch.float32:
            raise ValueError(f"a policy computes in float32, got {dtype}: call its float() first")
        gates = with_spot(gates, queries.place, heightmaps)
        check_place(self.name, queries, gates)
        inputs = collate(tables, self.device)
        seen = torch.from_numpy(np.stack([heightmap.seen for heightmap in heightmaps]))
        training = self.training
        self.eval()  # Afterwards in the mode of before: a policy may act between two training steps.
        try:
            pick_logits = self.score_picks(inputs).cpu()
            pickable = gated(gates, "pick", untried(empty_picks, self.config, seen))[:, None]
            seen_places = gated(gates, "place", seen)[:, None]
            acts = []
            for pick_table, pick_cell in best_cells(pick_logits, pickable, self.config.joint_picks):
                place_logits = self.score_places(inputs, pick_table, pick_cell[1:]).cpu()
                placeable = seen_places.repeat(1, place_logits.shape[1], 1, 1)
                placeable[pick_table] &= ~unmoved(place_logits.shape[1:], pick_cell[1:], queries.push)
                if queries.push:  # A blade does not leave its table.
                    placeable[torch.arange(len(tables)) != pick_table] = False
                if not placeable.any():
                    continue
                place_table, place_cell = best_cell(place_logits, placeable)
                product = log_probability(pick_logits, pickable, pick_table, pick_cell)
                product += log_probability(place_logits, placeable, place_table, place_cell)
                acts.append(ScoredAct(product, pick_table, pick_cell, place_table, place_cell, place_logits))
        finally:
            self.train(training)
        if not acts:
            raise NoFreePlaceError(
                f"no push leads to a place {str(queries.place)!r}: it would end where it begins, or on another table"
            )
        act = max(acts, key=lambda act: act.log_probability)
        workspace = self.config.workspace
        pick_yaw = float(angle_bins(pick_logits.shape[1])[act.pick_cell[0]])
        pick = Pose2(*workspace.to_world(*act.pick_cell[1:]), pick_yaw)
        # Δ turns the object from its present yaw, so the gripper ends at its pick yaw + Δ.
        delta = float(angle_bins(act.place_logits.shape[1])[act.place_cell[0]])
        place = Pose2(*workspace.to_world(*act.place_cell[1:]), (pick_yaw + delta) % math.tau)
        return TablesChoice(
            instruction, queries, tuple(heightmaps), collate(tables), pick_logits.numpy(), act.place_logits.numpy(),
            act.pick_table, act.pick_cell, pick, act.place_table, act.place_cell, place,
        )  # fmt: skip

    def score_picks(self, inputs: Inputs) -> torch.Tensor:
        """Logits (N, R, H, W) of a pick on N tables where the policy acts; N is 1 without `one_kernel`."""
        return self.score_pick(inputs)

    def score_places(self, inputs: Inputs, table: int, pixel: tuple[int, int]) -> torch.Tensor:
        """Logits (N, R, H, W) of a place on N tables after a pick at a table's pixel; N is 1 without `one_kernel`."""
        return self.score_place(inputs, torch.tensor([pixel]))
