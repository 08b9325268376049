"""A participant made of X key events: types a whole session blindly, in every way that fingers fall on keys."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import cycle

from minihuman.players.port import way_of
from minihuman.study.plan import EpisodePlan, SessionPlan
from minihuman.worlds.adapt.world import World
from tests.xserver import Typist

UNMAPPED = "z"


def type_session(typist: Typist, plan: SessionPlan) -> None:
    """Everything from the keyboard check to the closing text, without looking: no input may be lost, so none can be.

    Keys are tapped, tapped twice within a frame, and rolled from one to the next; strangers and questions between.
    """
    typist.tap(*plan.key_pool)
    for episode in plan.episodes:
        if episode.episode_in_block == 0:
            typist.tap("enter")  # the instruction
        typist.tap("enter")  # ready
        _play(typist, episode)
        typist.tap("enter")  # the feedback
        last_of_block = episode.episode_in_block == episode.episodes_in_block - 1
        if last_of_block and plan.texts[episode.block].rest:
            typist.tap("enter")
    typist.tap("enter")  # the closing text


def _play(typist: Typist, episode: EpisodePlan) -> None:
    typist.tap(UNMAPPED, *episode.key_map.spare_keys)
    typist.tap("escape", "escape")  # end the session? no
    typist.tap("f8", "enter")  # a pause
    fingers = cycle((_tap, _roll, _tap))
    for pair in _pairs(_way(episode)):
        next(fingers)(typist, pair)


def _way(episode: EpisodePlan) -> list[str]:
    """The keys of the shortest way to the goal."""
    key_of = {action: key for key, action in episode.key_map.keys.items()}
    with closing(World(episode.world, episode.options)) as world:
        world.reset(episode.seed)
        return [key_of[action] for action in way_of(world)]


def _pairs(keys: Sequence[str]) -> Iterator[Sequence[str]]:
    return (keys[start : start + 2] for start in range(0, len(keys), 2))


def _tap(typist: Typist, keys: Sequence[str]) -> None:
    typist.tap(*keys)


def _roll(typist: Typist, keys: Sequence[str]) -> None:
    """The second key goes down before the first comes up; one key alone, or twice the same, cannot be rolled."""
    if len(set(keys)) < 2:
        typist.tap(*keys)
        return
    for key in keys:
        typist.press(key)
    for key in keys:
        typist.release(key)
