"""The planner: look, choose the next thing that belongs, say the sentence; the policy acts; look again.

::

    planner = Planner(goals.read("pick all toys and place them into the brown box"), belongs, names, policy.source)
    while (instruction := planner.next(observation)) is not None:
        observation = robot.do(policy.act(observation, instruction))
    print(planner.plan)

The planner sees what the policy sees, camera views, and nothing else. It looks again after every act, so a thing that
fell back on the table is seen and tried once more.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from gem_lite import language
from gem_lite.language import Parser, Queries
from gem_lite.maps import refusal
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource
from gem_lite.planning import swaps
from gem_lite.planning.goals import Goal
from gem_lite.planning.naming import Found, NamedThing, lies_in, named_things, phrase_scores, telling_phrase
from gem_lite.planning.swaps import Move, Swap
from gem_lite.rgbd.observation import Observation

TRIES = 2
"""A thing that stays on the table after so many sentences is given up."""
Belongs = Callable[[Sequence[str], str], Sequence[bool]]
"""Whether each of some names belongs to a kind, such as `belonging.Belonging`."""
Namer = Callable[[SceneEmbedding, Sequence[str], MapSource], list[NamedThing]]


@dataclass(frozen=True)
class Step:
    """What a plan says, and whether it was done; None before anybody looked again.

    Attributes:
        instruction: a sentence, or the queries of a move to a spot (`swaps`).
        name: of the thing that it moves.
        done: whether the thing is gone afterwards, or at its spot.
    """

    instruction: str | Queries
    name: str
    done: bool | None = None


@dataclass(frozen=True)
class Plan:
    """What a planner said so far.

    Attributes:
        steps: what was said, in its order.
        missing: what is not on the table, a sentence each.
        failed: what was given up after `TRIES`, or has a name that the parser refuses, a sentence each.
    """

    steps: tuple[Step, ...]
    missing: tuple[str, ...]
    failed: tuple[str, ...]


@dataclass(frozen=True)
class _Table:
    """All things but the place, and which of them lie outside of it."""

    found: list[Found]
    outside: list[bool]

    def count(self) -> Counter[str]:
        """How often each name lies outside."""
        return Counter(thing.name for (_, thing), outside in zip(self.found, self.outside, strict=True) if outside)


@dataclass
class _Progress:
    """What was done for one goal.

    Attributes:
        said: the number of its sentences.
        most: the largest number of them, so that a thing whose name changes with every look ends, too; 0 before a look.
        done: the number of sentences after which their thing was gone.
        tried: how often the thing of each name stayed on the table.
        given_up: the names that are not tried again.
        before: how often each name was on the table when the last sentence was said; None if that was judged.
        moves: those of a swap that are left; None before a look.
        failures: how often the present one of them failed.
    """

    said: int = 0
    most: int = 0
    done: int = 0
    tried: Counter[str] = field(default_factory=Counter)
    given_up: set[str] = field(default_factory=set)
    before: Counter[str] | None = None
    moves: deque[Move] | None = None
    failures: int = 0


class Planner:
    """Says the next sentence for a policy, until the goals are reached or given up.

    Args:
        goals: see `goals.read` and `goals.read_lines`.
        belongs: which names belong to a kind.
        names: what things on the table may be called. See `naming.named_things`.
        source: the policy's map source.
        parser: the policy's reader of sentences. Every line is read by it before it is said.
        namer: gives the things their names.

    Raises:
        ValueError: there is no goal or no name.
    """

    def __init__(
        self, goals: Sequence[Goal | Swap], belongs: Belongs, names: Sequence[str], source: MapSource,
        parser: Parser = language.parse, namer: Namer = named_things,
    ) -> None:  # fmt: skip
        for argument, given in (("goals", goals), ("names", names)):
            if not given:
                raise ValueError(f"{argument} is empty: give at least one")
        self._goals = deque(goals)
        self._belongs, self._names, self._source, self._parser, self._namer = belongs, names, source, parser, namer
        self._steps: list[Step] = []
        self._missing: list[str] = []
        self._failed: list[str] = []
        self._progress = _Progress()

    @property
    def plan(self) -> Plan:
        """The plan so far."""
        return Plan(tuple(self._steps), tuple(self._missing), tuple(self._failed))

    def next(self, *observations: Observation) -> str | Queries | None:
        """The next instruction for the policy, or None if no goal is left.

        Args:
            observations: what the cameras see now, one for each table.

        Raises:
            ValueError: there is no observation.
        """
        if not observations:
            raise ValueError("observations is empty: there must be one for each table")
        scenes = [self._source.embed(observation.views) for observation in observations]
        while self._goals:
            goal = self._goals[0]
            step = self._next_move(goal, scenes) if isinstance(goal, Swap) else self._next_sentence(goal, scenes)
            if step is not None:
                self._steps.append(step)
                return step.instruction
            self._goals.popleft()
            self._progress = _Progress()
        return None

    def _next_move(self, swap: Swap, scenes: Sequence[SceneEmbedding]) -> Step | None:
        """The next move of a swap; None if all are done or one was given up."""
        progress = self._progress
        if progress.moves is None:
            try:
                progress.moves = deque(swaps.moves(swap, scenes, self._source, self._names))
            except ValueError as reason:
                self._missing.append(str(reason))
                return None
        else:
            last = progress.moves[0]
            done = swaps.is_done(last, scenes, self._source, self._names)
            self._steps[-1] = replace(self._steps[-1], done=done)
            progress.failures = 0 if done else progress.failures + 1
            if done:
                progress.moves.popleft()
            elif progress.failures == TRIES:
                self._failed.append(f'the "{last.thing}" is not at {last.spot} after {TRIES} tries')
                return None
        return Step(progress.moves[0].queries, progress.moves[0].thing) if progress.moves else None

    def _next_sentence(self, goal: Goal, scenes: Sequence[SceneEmbedding]) -> Step | None:
        """The next sentence for a goal; None if it is reached or cannot be."""
        table = self._look(scenes, goal.place)
        if table is None:
            self._missing.append(f'there is no "{goal.place}": nothing on the table looks like it')
            return None
        self._judge_last_step(table.count())
        return self._choose(goal, table, scenes)

    def _look(self, scenes: Sequence[SceneEmbedding], place: str) -> _Table | None:
        """What lies on the tables besides a place; None if there is no such place."""
        found = [(scene, thing) for scene in scenes for thing in self._namer(scene, self._names, self._source)]
        scores = phrase_scores(found, place, self._source)
        if scores.max(initial=0) < refusal.LOWEST_SCORE:
            return None
        there, best = found.pop(int(scores.argmax()))
        return _Table(found, [scene is not there or not lies_in(thing, best) for scene, thing in found])

    def _judge_last_step(self, now: Counter[str]) -> None:
        """Say of the last step whether its thing is gone, and give up what was tried often enough.

        Args:
            now: how often each name is on the table.
        """
        before = self._progress.before
        if before is None:
            return
        last = self._steps[-1]
        done = now.total() < before.total() and (last.name not in before or now[last.name] < before[last.name])
        self._steps[-1] = replace(last, done=done)
        self._progress.before = None
        self._progress.done += done
        self._progress.tried[last.name] += not done
        if not done and self._progress.tried[last.name] == TRIES:
            self._progress.given_up.add(last.name)
            self._failed.append(f'the "{last.name}" is still on the table after {TRIES} tries')

    def _choose(self, goal: Goal, table: _Table, scenes: Sequence[SceneEmbedding]) -> Step | None:
        """The next step to a goal, of those that pass every check; None if there is none."""
        progress = self._progress
        progress.most = progress.most or TRIES * max(1, sum(table.outside))
        if progress.said == progress.most or (progress.done and not goal.every):
            return None
        for step, where in self._candidates(goal, table, scenes):
            if step.name not in progress.given_up and self._passes(step, where):
                progress.said += 1
                progress.before = table.count()
                return step
        return None

    def _candidates(
        self, goal: Goal, table: _Table, scenes: Sequence[SceneEmbedding]
    ) -> Iterator[tuple[Step, Sequence[SceneEmbedding]]]:
        """The possible next steps, the surest name first, each with the tables on which its thing may lie."""
        if not goal.every:
            yield Step(goal.sentence, goal.thing), scenes
            return
        belong = self._belongs([thing.name for _, thing in table.found], goal.thing)
        right = [number for number, outside in enumerate(table.outside) if outside and belong[number]]
        if not right and not self._progress.said:
            self._missing.append(f'there is no "{goal.thing}" outside of the "{goal.place}"')
        for number in sorted(right, key=lambda number: -table.found[number][1].score):
            scene, thing = table.found[number]
            yield Step(goal.line(telling_phrase(number, table.found, self._source)), thing.name), [scene]

    def _passes(self, step: Step, scenes: Sequence[SceneEmbedding]) -> bool:
        """Whether the parser reads a step's sentence, and its thing is on one of the tables. Others are given up."""
        try:
            queries = self._parser(step.instruction) if isinstance(step.instruction, str) else step.instruction
        except ValueError as error:
            self._progress.given_up.add(step.name)
            self._failed.append(str(error))
            return False
        goals = (queries,) if isinstance(queries, Queries) else queries
        picks = [goal.pick for goal in goals]
        reasons = [refusal.refusal(scene, picks, self._source, self._names) for scene in scenes]
        if all(reasons):
            self._progress.given_up.add(step.name)
            self._missing.append(str(reasons[0]))
            return False
        return True
