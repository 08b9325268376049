"""The generator of tasks: XLand-MiniGrid's, number for number.

Source: ``scripts/ruleset_generator.py`` of https://github.com/dunnolab/xland-minigrid at commit 0d306d14, which is that
of release 0.9.3. The same settings and seed give the same tasks, as it draws from Python's random generator in the same
order. A task is a tree: the goal needs one or two things, each of which a rule makes of others, and so on. Rules and
things that lead nowhere are added as distractors.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.tasks import RuleGoal, RuleTask, TileRule

Tile = tuple[int, int]  # kind and colour: in sets of these, the order is the source's

# red, green, blue, purple, yellow, grey, white, brown, pink, orange: the source's order
_COLOURS = (1, 2, 3, 4, 5, 6, 9, 10, 11, 8)
_CARRIED = (numbers.BALL, numbers.SQUARE, numbers.PYRAMID, numbers.KEY, numbers.STAR, numbers.HEX)
_NEAR: list[Tile] = list(product((*_CARRIED, numbers.GOAL_TILE), _COLOURS))
_CARRIED_TILES: list[Tile] = list(product(_CARRIED, _COLOURS))
_PRODUCTS: list[Tile] = [*_CARRIED_TILES, (numbers.FLOOR, numbers.BLACK)]
# by the number that is drawn: up, down, left, right is the source's order
_RULES = (
    *(numbers.HOLD, numbers.AGENT_NEAR, numbers.AGENT_NEAR_UP, numbers.AGENT_NEAR_DOWN, numbers.AGENT_NEAR_LEFT),
    *(numbers.AGENT_NEAR_RIGHT, numbers.TILE_NEAR, numbers.TILE_NEAR_UP, numbers.TILE_NEAR_DOWN),
    *(numbers.TILE_NEAR_LEFT, numbers.TILE_NEAR_RIGHT),
)
_GOALS = (
    *(numbers.GOAL_HOLD, numbers.GOAL_AGENT_NEAR, numbers.GOAL_AGENT_NEAR_UP, numbers.GOAL_AGENT_NEAR_DOWN),
    *(numbers.GOAL_AGENT_NEAR_LEFT, numbers.GOAL_AGENT_NEAR_RIGHT, numbers.GOAL_TILE_NEAR, numbers.GOAL_TILE_NEAR_UP),
    *(numbers.GOAL_TILE_NEAR_DOWN, numbers.GOAL_TILE_NEAR_LEFT, numbers.GOAL_TILE_NEAR_RIGHT),
)
_FIRST_PAIR = 6  # from this number on, a rule or goal is about two tiles


@dataclass(frozen=True, slots=True)
class GeneratorSettings:
    """The settings of the generator, with the names and defaults of its source.

    Args:
        chain_depth: the greatest number of rules that follow each other before the goal.
        sample_depth: whether this number is drawn for each task, from 0.
        prune_chain: whether a thing that a rule would make may lie there from the start instead.
        prune_prob: how probable that is.
        num_distractor_rules: the number of rules that the goal does not need, at most or exactly.
        sample_distractor_rules: whether this number is drawn for each task, from 0.
        num_distractor_objects: the number of things that the goal does not need, in addition to those rules' inputs.
    """

    chain_depth: int = 1
    sample_depth: bool = False
    prune_chain: bool = False
    prune_prob: float = 0.5
    num_distractor_rules: int = 0
    sample_distractor_rules: bool = False
    num_distractor_objects: int = 0


# of scripts/generate_benchmarks.sh
PRESETS = {
    "trivial": GeneratorSettings(chain_depth=0, num_distractor_objects=3),
    "small": GeneratorSettings(
        chain_depth=1,
        prune_chain=True,
        prune_prob=0.3,
        sample_distractor_rules=True,
        num_distractor_rules=2,
        num_distractor_objects=2,
    ),
    "medium": GeneratorSettings(
        chain_depth=2,
        prune_chain=True,
        prune_prob=0.1,
        sample_distractor_rules=True,
        num_distractor_rules=3,
        num_distractor_objects=2,
    ),
    "high": GeneratorSettings(
        chain_depth=3,
        prune_chain=True,
        prune_prob=0.1,
        sample_distractor_rules=True,
        num_distractor_rules=4,
        num_distractor_objects=1,
    ),
}


def generate_tasks(settings: GeneratorSettings, count: int, seed: int = 42) -> Iterator[RuleTask]:
    """Yield ``count`` tasks that differ in their goals or rules, as the source does with the same settings and seed."""
    rng = random.Random(seed)
    drawn = set()
    for _ in range(count):
        task, is_bare = _draw_task(settings, rng)
        while (task.goal, task.rules, is_bare) in drawn:
            task, is_bare = _draw_task(settings, rng)
        drawn.add((task.goal, task.rules, is_bare))
        yield task


def _list_unused(tiles: list[Tile], used: list[Tile]) -> list[Tile]:
    """Return the ``tiles`` that are not in ``used``, in the order of a Python set, which is the source's order."""
    return list(set(tiles) - set(used))


def _tile_code(tile: Tile) -> int:
    kind, colour = tile
    return kind | colour << 4


def _draw_goal(rng: random.Random) -> tuple[RuleGoal, tuple[Tile, ...]]:
    """Draw a goal, and return it with the tiles that it needs."""
    number = rng.randint(0, len(_GOALS) - 1)
    tiles: tuple[Tile, ...]
    if number == 0:
        tiles = (rng.choice(_CARRIED_TILES),)
    elif number < _FIRST_PAIR:
        tiles = (rng.choice(_NEAR),)
    else:
        first = rng.choice(_NEAR)
        tiles = first, rng.choice(_CARRIED_TILES)
    return RuleGoal(_GOALS[number], *map(_tile_code, tiles)), tiles


def _draw_rule(product_tile: Tile, used: list[Tile], rng: random.Random) -> tuple[TileRule, tuple[Tile, ...]]:
    """Draw a rule that makes ``product_tile`` from tiles that are not used yet, and return it with these tiles."""
    number = rng.randint(0, len(_RULES) - 1)
    if number < _FIRST_PAIR:
        tile = rng.choice(_list_unused(_CARRIED_TILES, used))
        return TileRule(_RULES[number], _tile_code(tile), 0, _tile_code(product_tile)), (tile,)
    first = rng.choice(_list_unused(_NEAR, used))
    second = rng.choice(_list_unused(_CARRIED_TILES, used))
    return TileRule(_RULES[number], _tile_code(first), _tile_code(second), _tile_code(product_tile)), (first, second)


def _draw_task(settings: GeneratorSettings, rng: random.Random) -> tuple[RuleTask, bool]:
    """Draw a task: the goal, level by level the rules that make what it needs, and distractors.

    Return the task, and whether its chain of rules has no level; the source counts a task without a level as different
    from one that has the same goal and rules.
    """
    goal, chain = _draw_goal(rng)
    used = list(chain)
    chain_tiles = list(chain)
    rules: list[TileRule] = []
    things: list[Tile] = []
    levels = rng.randint(0, settings.chain_depth) if settings.sample_depth else settings.chain_depth
    if levels == 0:
        things.extend(chain)
    for level in range(levels):
        inputs: list[Tile] = []
        while chain_tiles:
            tile = chain_tiles.pop()
            if settings.prune_chain and rng.random() < settings.prune_prob:
                things.append(tile)
                continue
            rule, tiles = _draw_rule(tile, used, rng)
            used.extend(tiles)
            inputs.extend(tiles)
            rules.append(rule)
            if level == levels - 1:
                things.extend(tiles)
        chain_tiles = inputs
    things.extend(rng.choices(_list_unused(_NEAR, used), k=settings.num_distractor_objects))
    n_distractors = settings.num_distractor_rules
    if settings.sample_distractor_rules:
        n_distractors = rng.randint(0, n_distractors)
    for _ in range(n_distractors):
        product_tile = rng.choice(_list_unused(_PRODUCTS, used))
        rule, tiles = _draw_rule(product_tile, [], rng)
        rules.append(rule)
        things.extend(tiles)
    return RuleTask(goal, tuple(rules), tuple(map(_tile_code, things))), levels == 0
