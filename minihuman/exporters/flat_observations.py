"""Observations of episodes for datasets: replay the episode, check every hash, and reshape the observations.

Observations are computed from the seed and the actions, or read from the log if it holds them. There is one dataset per
world, because worlds with different observations cannot share one. This module knows no file format.
"""

import copy
import hashlib
import json
import logging
import re
import string
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman import __version__
from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.errors import ExportError, LogError, WorldError
from minihuman.experiment.picture_versions import renders_same_images
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import describe_episode, get_action_names, get_shared_options
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.model.teaching_events import NO_ADVICE
from minihuman.log.observations import verify_observations
from minihuman.moved import forward_names
from minihuman.worlds.adapters.spaces import VectorActions
from minihuman.worlds.adapters.transition import ResetResult, StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.observation_spaces import find_mismatch

_CHARACTERS = frozenset(string.printable)
_MAX_TEXT_CHARACTERS = 4096
_MIN_PICTURE_PX = 32  # a smaller array is taken for an encoded grid


def stack_observations(observations: Sequence[Any]) -> Any:
    """Stack a list of observations or actions into arrays; dicts and tuples keep their form, texts become lists."""
    first = observations[0]
    if isinstance(first, dict):
        return {key: stack_observations([observation[key] for observation in observations]) for key in first}
    if isinstance(first, tuple):
        return tuple(stack_observations(column) for column in zip(*observations, strict=True))
    if isinstance(first, str):
        return list(observations)
    return np.stack(observations)


def to_standard_space(space: gymnasium.Space[Any]) -> gymnasium.Space[Any]:
    """Return a space with Gymnasium's kinds of spaces, which other libraries can store, in place of a world's own.

    Raises:
        ExportError: if a part of the space has no standard form.
    """
    match space:
        case gymnasium.spaces.Dict():
            return gymnasium.spaces.Dict({key: to_standard_space(part) for key, part in space.spaces.items()})
        case gymnasium.spaces.Tuple():
            return gymnasium.spaces.Tuple([to_standard_space(part) for part in space.spaces])
        case (
            gymnasium.spaces.Box()
            | gymnasium.spaces.Discrete()
            | gymnasium.spaces.MultiDiscrete()
            | gymnasium.spaces.MultiBinary()
            | gymnasium.spaces.Text()
        ):
            return space
    if isinstance(space.sample(), str):
        return gymnasium.spaces.Text(max_length=_MAX_TEXT_CHARACTERS, min_length=0, charset=_CHARACTERS)
    raise ExportError(f"the observation space {space} has no plain form; export as csv or parquet instead")


def is_picture(space: gymnasium.Space[Any]) -> bool:
    """Return whether observations are colour pictures uint8[H, W, 3], at least 32 pixels high and wide."""
    if not isinstance(space, gymnasium.spaces.Box) or space.dtype != np.uint8 or len(space.shape) != 3:
        return False
    height, width, n_channels = space.shape
    return n_channels == 3 and min(height, width) >= _MIN_PICTURE_PX


def flatten_observation(observation: Any, space: gymnasium.Space[Any]) -> NDArray[Any]:
    """Put all numbers of an observation in one row, with the parts of a dict in the order of the keys, without texts.

    The dtype is the narrowest that holds every part of the space exactly, so it is the same for all observations.
    """
    parts = _flatten_parts(observation, space)
    if parts:
        return np.concatenate(parts)
    return np.zeros(0, np.uint8)


def name_flat_observation(observation: Any, prefix: str = "") -> list[str]:
    """Return a name for each number of a flat observation: "direction", "image_0", "image_1", ...

    Each name begins with ``prefix``, which is the key and "_" for a part of an observation.
    """
    if isinstance(observation, str):
        return []
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(observation, dict):
        parts = [(key, observation[key]) for key in sorted(observation)]
    elif isinstance(observation, tuple):
        parts = enumerate(observation)
    else:
        size = np.asarray(observation).size
        if size == 1:
            return [prefix.rstrip("_") or "value"]
        return [f"{prefix}{index}" for index in range(size)]
    names = []
    for key, part in parts:
        names += name_flat_observation(part, f"{prefix}{key}_")
    return names


def _flatten_parts(observation: Any, space: gymnasium.Space[Any]) -> list[NDArray[Any]]:
    """Return the numbers of each part of an observation as an array of one dimension; texts are left out."""
    parts: list[NDArray[Any]] = []
    match space:
        case gymnasium.spaces.Dict():
            for key in sorted(observation):
                parts += _flatten_parts(observation[key], space[key])
            return parts
        case gymnasium.spaces.Tuple():
            for part, part_space in zip(observation, space.spaces, strict=True):
                parts += _flatten_parts(part, part_space)
            return parts
        case gymnasium.spaces.Discrete():
            return [np.asarray([observation], _choose_dtype(space))]
    if isinstance(observation, str):
        return []
    return [np.asarray(observation).reshape(-1)]


def _choose_dtype(space: gymnasium.spaces.Discrete) -> np.dtype[Any]:
    """Return the smallest unsigned type that holds all values of a space; int64 if some are negative."""
    if space.start < 0:
        return np.dtype(np.int64)
    last = int(space.start) + int(space.n) - 1
    return np.min_scalar_type(last)


def build_steering_columns(episode: EpisodeLog, *, with_reset: bool = False) -> dict[str, NDArray[Any]]:
    """Build columns with one row per step: whether the person acted, and which action the policy advised.

    The columns are "intervention" and "policy_action", which is -1 where the policy advised nothing. There are no
    columns if no agent took part in the episode. ``with_reset`` prepends a row for the reset, without intervention or
    advice.
    """
    taught = episode.taught
    if taught is None:
        return {}
    rows = {"intervention": taught.by_person, "policy_action": taught.policy_actions}
    if with_reset:
        blank = {"intervention": False, "policy_action": NO_ADVICE}
        rows = {name: np.insert(values, 0, blank[name]) for name, values in rows.items()}
    return rows


def get_step_steering(episode: EpisodeLog, index: int) -> dict[str, Any]:
    """Return who steered step ``index`` (0 is the first) and what the policy advised; {} if no agent took part."""
    taught = episode.taught
    if taught is None:
        return {}
    return {
        "intervention": bool(taught.by_person[index]),
        "policy_action": int(taught.policy_actions[index]),
        "policy_probabilities": np.round(taught.probabilities[index].astype(np.float64), 9).tolist(),
        "policy": taught.policy,
    }


def name_dataset(included: IncludedEpisode) -> str:
    """Return the folder name for the dataset of an episode's world, e.g. "minigrid-fourrooms-v0".

    A world with options has a digest of them in the name. If the options differ by episode, as in a design or a table
    of stimuli, the block's name replaces the digest.
    """
    name = _make_slug(included.episode.plan.world.rsplit("/", 1)[-1].rsplit(":", 1)[-1])
    options = get_shared_options(included)
    if not options:
        return name
    if isinstance(options, str):
        return _insert_mark(name, _make_slug(options))
    return _insert_mark(name, _compute_short_digest(options))


def _make_slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _compute_short_digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()[:6]


def _insert_mark(name: str, mark: str) -> str:
    """Insert a mark before the version in a name ("-v0"); append it if there is none."""
    stem, _, version = name.rpartition("-v")
    if stem:
        return f"{stem}-{mark}-v{version}"
    return f"{name}-{mark}"


PICTURE_PX = (128, 128)  # the largest size of a view that is drawn for learners whose observation is not a picture
LOG = logging.getLogger("minihuman")


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedEpisode:
    """An episode with its observations: ``n + 1`` observations for ``n`` actions, each equal to the recorded one.

    For a first-person episode drawn by an earlier version, each state is equal, and the pictures are this version's.
    """

    episode: EpisodeLog
    observations: tuple[Any, ...]
    observation_space: gymnasium.Space[Any]
    action_space: gymnasium.Space[Any]
    pictures: tuple[NDArray[np.uint8], ...] = ()  # (H, W, 3) each, if they were requested and can be drawn

    @property
    def actions(self) -> Any:
        """Return the ``n`` actions in the form that the environment's ``step`` takes.

        They are numbers from the start of a Discrete space, or arrays. The actions of a Dict or Tuple space are a dict
        or tuple of arrays, with one row per action.
        """
        vectors = self.episode.action_vectors
        if vectors is None:
            assert isinstance(self.action_space, gymnasium.spaces.Discrete)
            return self.episode.actions + int(self.action_space.start)
        space = VectorActions(self.action_space)
        return stack_observations([space.value(tuple(vector)) for vector in vectors.tolist()])


def name_state(demonstration: ReplayedEpisode) -> list[str]:
    """Return the names of the columns of ``build_state``."""
    if not is_picture(demonstration.observation_space):
        return name_flat_observation(demonstration.observations[0])
    if np.isnan(demonstration.episode.poses).any():
        return ["elapsed"]
    return ["x", "z", "cos_yaw", "sin_yaw"]


def build_state(demonstration: ReplayedEpisode) -> NDArray[np.float32]:
    """Build the observed numbers, an array (n + 1, numbers) with a row per observation of an episode of n steps.

    If the observation is a picture, the numbers are the agent's pose, or the elapsed share of the episode if the world
    provides no pose.
    """
    episode = demonstration.episode
    space = demonstration.observation_space
    if not is_picture(space):
        rows = [flatten_observation(observation, space) for observation in demonstration.observations]
        return _to_float32(np.stack(rows), episode)
    if np.isnan(episode.poses).any():
        return (np.arange(len(episode.poses)) / episode.plan.max_steps).astype(np.float32).reshape(-1, 1)
    x, _, z, yaw_rad = episode.poses.T
    return np.stack([x, z, np.cos(yaw_rad), np.sin(yaw_rad)], axis=1).astype(np.float32)


def _to_float32(rows: NDArray[Any], episode: EpisodeLog) -> NDArray[np.float32]:
    """Convert rows of numbers to float32.

    Raises:
        ExportError: if a finite number exceeds the range of float32.
    """
    beyond = np.argwhere(np.isfinite(rows) & (np.abs(rows.astype(np.float64)) > np.finfo(np.float32).max))
    if len(beyond):
        step, column = beyond[0].tolist()
        raise ExportError(
            f"{episode.name} step {step}: the observation has {rows[step, column]:g}, beyond float32; "
            "export as minari or imitation, which keep float64, as this format does not"
        )
    return rows.astype(np.float32)


def name_actions(included: IncludedEpisode) -> list[str]:
    """Return the names of the columns of "action" in ``build_actions``."""
    vectors = included.episode.action_vectors
    if vectors is None:
        return list(get_action_names(included))
    return [f"component_{n}" for n in range(vectors.shape[1])]


def build_actions(included: IncludedEpisode, demonstration: ReplayedEpisode) -> dict[str, NDArray[Any]]:
    """Build the actions as vectors for learners: "action" of shape (n, actions), and "discrete_action" of shape (n,).

    A row of "action" is a one-hot vector over the actions that participants could take, and "discrete_action" is what
    the environment's ``step`` takes. If ``step`` takes a vector, "action" is that vector, flattened, and the only
    column.
    """
    vectors = included.episode.action_vectors
    if vectors is not None:
        return {"action": vectors.astype(np.float32).reshape(len(vectors), -1)}
    names = np.array(included.episode.start.action_names)[included.episode.actions]
    one_hot = (names[:, None] == np.array(name_actions(included))).astype(np.float32)
    return {"action": one_hot, "discrete_action": demonstration.actions}


class Resimulator:
    """Replays episodes to obtain their observations, reusing the world of the previous episode where possible.

    Args:
        picture_px: the maximum width and height of pictures of the participant's view; None draws none. If the
            observation is a picture, it is used unchanged. Stored observations have no other pictures.
    """

    def __init__(self, *, picture_px: tuple[int, int] | None = None) -> None:
        self._picture_px = picture_px
        self._world: World | None = None
        self._made_from: tuple[str, dict[str, Any]] | None = None

    def __call__(self, included: IncludedEpisode) -> ReplayedEpisode:
        """Replay an episode, or take the observations from its log if requested.

        The spaces are those of the world as it is installed on this machine.

        Raises:
            ExportError: if the world cannot be created here or behaves differently than when it was played; or if the
                log holds no observations, or observations that do not match their hashes.
        """
        world = self._open_world(included)
        is_observed = is_picture(world.observation_space)
        pictures: list[NDArray[np.uint8]] = []

        def draw() -> None:
            if self._picture_px is not None and not is_observed:
                plan = included.episode.plan
                pictures.append(world.frame(plan.view, self._picture_px, plan.palette))

        if included.stored_frames:
            observations = _read_observations(included)
        else:
            observations = _replay_observations(included, world, draw)
        shown_pictures = tuple(pictures)
        if self._picture_px is not None and is_observed:
            shown_pictures = observations
        return ReplayedEpisode(
            included.episode, observations, world.observation_space, world.action_space, shown_pictures
        )

    def _open_world(self, included: IncludedEpisode) -> World:
        """Return a world for an episode: the previous one if it was made in the same way, else a new one.

        Raises:
            ExportError: if the world cannot be created here.
        """
        episode = included.episode
        made_from = (episode.plan.world, episode.world_options)
        if self._world is None or self._made_from != made_from:
            try:
                self._world = World(*made_from)
                self._made_from = made_from
            except WorldError as error:
                raise ExportError(f"{included.log.path}: {episode.name}: {error}") from error
        return self._world


_WITHOUT_OBSERVATIONS = "export as csv or parquet, which hold no observations"


def require_storable(included: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
    """Check, before anything is written, that a dataset can hold all observations and pictures of an episode.

    Raises:
        ExportError: if the space has no standard form, an observation does not match the space, or a picture differs in
            size from the first.
    """
    place = f"{included.log.path}: {included.episode.name}"
    try:
        to_standard_space(demonstration.observation_space)
    except ExportError as error:
        raise ExportError(f"{place}: {error}") from error
    for step, observation in enumerate(demonstration.observations):
        if mismatch := find_mismatch(observation, demonstration.observation_space):
            raise ExportError(f"{place} step {step}: {mismatch}; {_WITHOUT_OBSERVATIONS}")
    for step, picture in enumerate(demonstration.pictures):
        height, width = demonstration.pictures[0].shape[:2]
        if picture.shape[:2] != (height, width):
            raise ExportError(
                f"{place} step {step}: its picture changes size, from {width} x {height} to {picture.shape[1]} x "
                f"{picture.shape[0]} pixels; export as minari or imitation, which hold no such pictures"
            )


class ReplayedStudy:
    """Replays the episodes that have a step, counts them, and names the dataset of each.

    Args:
        chosen: the included episodes.
        reason: the reason why the format excludes an episode without a step.
        picture_px: the maximum picture size, as for ``Resimulator``.
    """

    def __init__(self, chosen: IncludedEpisodes, reason: str, *, picture_px: tuple[int, int] | None = None) -> None:
        self._chosen = chosen
        self._reason = reason
        self._resimulate = Resimulator(picture_px=picture_px)
        self._shapes: dict[str, Any] = {}  # of each dataset's first episode
        self._left_out: list[str] = []
        self._episodes = 0
        self._steps = 0

    def __iter__(self) -> Iterator[tuple[str, IncludedEpisode, ReplayedEpisode]]:
        """Yield the dataset's name, the episode and its observations, holding one episode in memory at a time.

        An episode whose shapes differ from those of the dataset's first episode is put in another dataset.

        Raises:
            ExportError: if an episode does not replay.
        """
        for included in self._chosen:
            if not len(included.episode.actions):
                self._left_out.append(f"{describe_episode(included)} {self._reason}")
                continue
            demonstration = self._resimulate(included)
            name = name_dataset(included)
            require_storable(included, demonstration)
            shape = [
                demonstration.observation_space,
                demonstration.action_space,
                *(picture.shape for picture in demonstration.pictures[:1]),
                name_actions(included),
                included.episode.taught is None,
                bool(np.isnan(included.episode.poses).any()),
            ]
            if self._shapes.setdefault(name, shape) != shape:
                name = _insert_mark(name, _compute_short_digest(shape))
            self._episodes += 1
            self._steps += len(included.episode.actions)
            yield name, included, demonstration

    def result(self, paths: Iterable[Path]) -> ExportResult:
        """Return the export's result for the given files and folders."""
        return ExportResult(tuple(paths), self._episodes, self._steps, tuple(self._left_out))


def _replay_observations(included: IncludedEpisode, world: World, draw: Callable[[], None]) -> tuple[Any, ...]:
    """Replay an episode in ``world`` and return its observations; call ``draw`` at the reset and after each step."""
    episode = included.episode
    drawn_anew = world.drawn and not all(renders_same_images(segment.facts) for segment in included.log.segments)
    if drawn_anew:
        LOG.warning(
            "%s: %s: its pictures are drawn by this version; the participant saw those of an earlier one",
            included.log.path,
            episode.name,
        )
    _require_same_observation(world, world.reset(episode.plan.seed), 0, included, drawn_anew=drawn_anew)
    observations = [copy.deepcopy(world.observation)]  # copied, as a world may overwrite its arrays
    draw()
    for step, action in enumerate(episode.actions_taken, 1):
        _require_same_observation(world, world.step(action), step, included, drawn_anew=drawn_anew)
        observations.append(copy.deepcopy(world.observation))
        draw()
    return tuple(observations)


def _require_same_observation(
    world: World, replayed: ResetResult | StepResult, step: int, included: IncludedEpisode, *, drawn_anew: bool
) -> None:
    """Raise ExportError if a replayed step differs from the logged one, in its state if its picture is drawn anew."""
    episode = included.episode
    if drawn_anew:
        same = world.state_hash() == int(episode.state_hashes[step])
    else:
        same = replayed.observation_hash == int(episode.observation_hashes[step])
    if not same:
        played = included.log.facts.get("version_minihuman", "of an unknown version")
        if episode.observations is None:
            instead = ""
        else:
            instead = ", or export those in the log with --stored-frames"
        raise ExportError(
            f"{included.log.path}: {episode.name} step {step}: the replayed observation differs from "
            f"the one recorded under minihuman {played} (this is {__version__}); export with {played}{instead}"
        )


def _read_observations(included: IncludedEpisode) -> tuple[Any, ...]:
    """Return the observations that the log holds; raise ExportError if it has none, or if a hash differs."""
    episode = included.episode
    if episode.observations is None:
        raise ExportError(
            f"{included.log.path}: {episode.name} has no stored observations (its block does not set "
            "record_observations = true); export without --stored-frames"
        )
    try:
        return tuple(verify_observations(episode.observations, episode.observation_hashes, episode.plan.episode))
    except LogError as error:
        raise ExportError(f"{included.log.path}: {error}") from error


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
