"""The instructions that are made of a task's goal and rules, in plain English, for people and language models.

Directions are those of the plan from above: "above" is towards its top. "Next to" is never diagonal.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.grid.missions import Sentences, words_in
from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.dynamics import TILE_COLOURS, TILE_KINDS
from minihuman.worlds.grid.ruleset.tasks import MOST_RULES, RuleGoal, RuleTask, TileRule

_NAMES = {"goal": "mat", "hex": "hexagon"}  # the names of kinds in instructions, where they differ from those in code
_FROM = ("directly above", "directly to the right of", "directly below", "directly to the left of")  # by direction
_OPPOSITE = (*_FROM[2:], *_FROM[:2])
_MAX_CHARS = 12_000  # characters of an instruction


def name_tile(tile: int) -> str:
    """Return the name of a tile, such as "red ball"."""
    kind = TILE_KINDS[tile & 15]
    return f"{TILE_COLOURS[tile >> 4]} {_NAMES.get(kind, kind)}"


def _with_article(tile: int) -> str:
    name = name_tile(tile)
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def describe_goal(goal: RuleGoal) -> str:
    """Return a goal as an English sentence."""
    first, second = goal.first, goal.second
    match goal.kind:
        case numbers.NO_GOAL:
            return "There is nothing to reach."
        case numbers.GOAL_HOLD:
            return f"Pick up {_with_article(first)}."
        case numbers.GOAL_ON_TILE:
            return f"Walk onto {_with_article(first)}."
        case numbers.GOAL_AGENT_NEAR:
            return f"Walk up to {_with_article(first)}, so that you stand next to it."
        case numbers.GOAL_TILE_NEAR:
            return f"{_put_together(first, second)}."
        case numbers.GOAL_TILE_AT:
            return f"Bring {_with_article(first)} to row {second + 1}, column {goal.third + 1}."
        case numbers.GOAL_AGENT_AT:
            return f"Go to row {first + 1}, column {second + 1}."
        case kind if kind >= numbers.GOAL_AGENT_NEAR_UP:
            return f"Stand {_OPPOSITE[kind - numbers.GOAL_AGENT_NEAR_UP]} {_with_article(first)}."
        case kind:
            return f"Put {_with_article(second)} {_FROM[kind - numbers.GOAL_TILE_NEAR_UP]} {_with_article(first)}."


def _put_together(first: int, second: int) -> str:
    """Return an instruction to bring two tiles together; a mat, which cannot be carried, is named last."""
    if first & 15 == numbers.GOAL_TILE:
        return f"Put {_with_article(second)} next to {_with_article(first)}"
    return f"Put {_with_article(first)} next to {_with_article(second)}"


def describe_rule(rule: TileRule) -> str:
    """Return a rule as an English sentence."""
    first, second = rule.first, rule.second
    disappears = rule.product == numbers.BLACK_FLOOR
    match rule.kind:
        case numbers.NO_RULE:
            return "Nothing happens."
        case numbers.HOLD:
            outcome = "a useless black tile" if disappears else _with_article(rule.product)
            return f"If you pick up {_with_article(first)}, it turns into {outcome} in your hand."
        case numbers.AGENT_NEAR:
            outcome = "disappears" if disappears else f"turns into {_with_article(rule.product)}"
            return f"If you step next to {_with_article(first)}, it {outcome}."
        case kind if kind >= numbers.AGENT_NEAR_UP:
            outcome = "disappears" if disappears else f"turns into {_with_article(rule.product)}"
            return f"If you step {_OPPOSITE[kind - numbers.AGENT_NEAR_UP]} {_with_article(first)}, it {outcome}."
    outcome = "both disappear" if disappears else f"the two turn into {_with_article(rule.product)}"
    if rule.kind == numbers.TILE_NEAR:
        together = _put_together(first, second)
        return f"If you {together[:1].lower()}{together[1:]}, {outcome}."
    direction = _FROM[rule.kind - numbers.TILE_NEAR_UP]
    return f"If you put {_with_article(second)} {direction} {_with_article(first)}, {outcome}."


def describe_task(task: RuleTask) -> str:
    """Return the goal and all rules of a task as an English text."""
    rules = [describe_rule(rule) for rule in task.rules]
    if not rules:
        return f"Goal: {describe_goal(task.goal)}"
    if len(rules) == 1:
        return f"Goal: {describe_goal(task.goal)} Rule: {rules[0]}"
    listed = " ".join(f"({number}) {rule}" for number, rule in enumerate(rules, 1))
    return f"Goal: {describe_goal(task.goal)} Rules: {listed}"


def _list_vocabulary_texts() -> Iterable[str]:
    """Yield texts that have every word of every instruction."""
    tiles = [kind | colour << 4 for kind in range(1, len(TILE_KINDS)) for colour in range(1, len(TILE_COLOURS))]
    for tile in tiles:
        yield f"{_with_article(tile)} {name_tile(tile)}."
    key = numbers.KEY | 1 << 4
    mat = numbers.GOAL_TILE | 2 << 4
    for kind in range(numbers.GOAL_AGENT_NEAR_LEFT + 1):
        yield describe_goal(RuleGoal(kind, key, key, 0))
    for kind in range(numbers.AGENT_NEAR_LEFT + 1):
        for first in (key, mat):
            rules = TileRule(kind, first, key, key), TileRule(kind, first, key, numbers.BLACK_FLOOR)
            yield describe_task(RuleTask(RuleGoal(numbers.GOAL_TILE_NEAR, first, key), rules, ()))
    yield describe_task(RuleTask(RuleGoal(0), (TileRule(0, 0, 0, 0),), ()))
    yield " ".join([*(f"({number})" for number in range(MOST_RULES + 1)), *(f"{n}, {n}." for n in range(257))])


_WORDS = sorted({word for text in _list_vocabulary_texts() for word in words_in(text)})


class TaskTexts(Sentences):
    """The space of all instructions that tasks of rules have.

    Args:
        example: one of them, which `sample` returns.
        seed: the seed of the space.
    """

    def __init__(self, example: str, *, seed: int | np.random.Generator | None = None) -> None:
        super().__init__(_WORDS, max_length=_MAX_CHARS, most_words=_MAX_CHARS // 4, seed=seed)
        self.example = example

    def contains(self, x: Any) -> bool:
        """Return whether a value is a text that is made of the words of instructions and is not too long."""
        return isinstance(x, str) and len(x) <= _MAX_CHARS and set(words_in(x)) <= set(self.words)

    def sample(self, mask: Any = None, probability: Any = None) -> str:
        """Return the example; raise a WorldError if a mask or a probability is given."""
        if mask is not None or probability is not None:
            raise WorldError("a space of instructions takes no mask and no probability; remove them")
        return self.example

    def __repr__(self) -> str:
        return "TaskTexts()"

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, TaskTexts)

    __hash__ = None  # type: ignore[assignment]  # spaces hold a random stream, so none of them is hashable
