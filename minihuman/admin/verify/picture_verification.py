"""Verify the pictures that were shown according to a log: draw them again at the same steps, and compare their hashes.

Only pictures of third-party worlds are hashed, because nothing else records what was seen. Pictures have a verdict of
their own: equal, different, not comparable (drawn by another version or on another system), or not recorded.
"""

import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from typing import Literal

import numpy as np

from minihuman.errors import WorldError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import PICTURES_VERSION
from minihuman.worlds.picture_hash import hash_picture

PictureVerdict = Literal["equal", "different", "not comparable", "not recorded"]
_VERSION = "version_"  # prefix of a package's name in facts
_NOT_COMPARED = ("version_minihuman", "version_mcap")  # packages that draw no hashed pictures


@dataclass(frozen=True, slots=True)
class PictureVerification:
    """The result of drawing the shown pictures again.

    Attributes:
        verdict: the verdict on all pictures together.
        pictures: the number of pictures that were drawn again and are equal.
        detail: the first picture that differs, or why pictures are not comparable.
    """

    verdict: PictureVerdict
    pictures: int = 0
    detail: str = ""

    def __str__(self) -> str:
        match self.verdict:
            case "equal":
                return f"pictures equal: {self.pictures} that were shown, drawn again"
            case "not recorded":
                return "pictures not recorded: the log has no hashes of what was shown"
        return f"pictures {self.verdict}: {self.detail}"


def verify_pictures(log: SessionLog, make_world: WorldFactory = World) -> PictureVerification | None:
    """Draw the shown pictures of third-party worlds again; return None if no participant saw such a world.

    The verdict covers the episodes up to the first that differs.

    Raises:
        WorldError: if a world in the log cannot be created here.
    """
    if log.facts.get("window") == "simulated":
        return None
    facts = {segment.number: segment.facts for segment in log.segments}
    verdict: PictureVerdict | None = None
    pictures = 0
    for (world_id, options), group in groupby(
        log.episodes, lambda episode: (episode.plan.world, episode.world_options)
    ):
        with closing(make_world(world_id, options)) as world:
            if world.is_built_in:
                continue
            for episode in group:
                hashes = find_shown_pictures(episode)
                if not hashes:
                    verdict = verdict or "not recorded"
                    continue
                recorded = facts[episode.segment]
                difference = _find_difference(episode, hashes, world, _find_picture_size(recorded))
                if difference:
                    return _judge_difference(recorded, difference, pictures)
                pictures += len(hashes)
                verdict = "equal"
    if verdict is None:
        return None
    return PictureVerification(verdict, pictures)


def find_shown_pictures(episode: EpisodeLog) -> dict[int, int]:
    """Return the hashes of an episode's shown pictures, by step; empty if they were not recorded."""
    steps = np.asarray(episode.frames.column("step"))
    hashes = np.asarray(episode.frames.column("picture_hash"))
    return {int(step): int(picture) for step, picture in zip(steps, hashes, strict=True) if picture}


def _find_picture_size(recorded: Mapping[str, str]) -> tuple[int, int]:
    """Return the width and height of the largest picture that a segment requested."""
    width, _, height = recorded.get("picture_px", "640 x 480").partition(" x ")
    return int(width), int(height)


def _find_difference(episode: EpisodeLog, hashes: Mapping[int, int], world: World, size_px: tuple[int, int]) -> str:
    """Replay an episode and return a line about the first picture that differs, or about an error; "" if none differs.

    Args:
        episode: the episode.
        hashes: the hashes of its shown pictures, by step; 0 is the reset.
        world: a world of the episode's id and options.
        size_px: the width and height of the pictures.
    """
    try:
        return next(_list_differences(episode, hashes, world, size_px), "")
    except WorldError as error:
        return f"{episode.name}: {error}"


def _list_differences(
    episode: EpisodeLog, hashes: Mapping[int, int], world: World, size_px: tuple[int, int]
) -> Iterator[str]:
    """Draw an episode again and yield a line for each step whose picture differs from the shown one.

    The arguments are those of ``_find_difference``.
    """
    plan = episode.plan
    world.reset(plan.seed)
    n_steps = len(episode.actions)
    for step in range(n_steps + 1):
        if step > 0:
            world.step(episode.actions_taken[step - 1])
        if step in hashes and hash_picture(world.frame(plan.view, size_px, plan.palette)) != hashes[step]:
            yield f"{episode.name} step {step}: the picture that was shown is not the one that is drawn now"


def _judge_difference(recorded: Mapping[str, str], difference: str, pictures: int) -> PictureVerification:
    """Return "different", or "not comparable" if the pictures were drawn with other software or on another machine.

    Args:
        recorded: the facts about the station that the log recorded.
        difference: a line about the first picture that differs.
        pictures: the number of equal pictures before it.
    """
    changed = []
    for name, recorded_fact in recorded.items():
        if not _affects_pictures(name):
            continue
        current_fact = _read_current_fact(name)
        recorded_version, *_ = recorded_fact.split(" ")  # without the release of the operating system
        if recorded_version != current_fact:
            changed.append(f"{name.removeprefix(_VERSION)} {recorded_fact}, here {current_fact}")
    if changed:
        return PictureVerification("not comparable", pictures, f"they were drawn with {'; '.join(changed)}")
    return PictureVerification("different", pictures, difference)


def _affects_pictures(fact: str) -> bool:
    """Return whether pictures may depend on a recorded fact about the station."""
    return fact in _STATION_FACTS or (fact.startswith(_VERSION) and fact not in _NOT_COMPARED)


def _read_current_fact(name: str) -> str:
    """Return this machine's value of a station fact, without the release of the operating system."""
    if name in _STATION_FACTS:
        return _STATION_FACTS[name]()
    try:
        return version(name.removeprefix(_VERSION))
    except PackageNotFoundError:
        return "none"


_STATION_FACTS: dict[str, Callable[[], str]] = {
    "pictures": lambda: str(PICTURES_VERSION),
    "system": platform.system,
    "machine": platform.machine,
}
