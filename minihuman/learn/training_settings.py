"""The worlds and settings of a training run by PPO, from the command line or a job's TOML file.

A setting has one name everywhere: the field here, the key in the file, the option of `minihuman learn ppo`. This module
does not import torch.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import msgspec

from minihuman.errors import LearnError


@dataclass(frozen=True, slots=True)
class WorldChoice:
    """A world to train in: a Gymnasium id, with the module that registers it if needed, and its options."""

    id: str
    options: dict[str, Any] = field(default_factory=dict)


def _setting(
    default: Any, help: str, panel: str = "Training", least: float | None = None, most: float | None = None
) -> Any:
    """Declare a setting as a field of a dataclass.

    Args:
        default: its default.
        help: the help text of its option.
        panel: the panel of the help in which the option is listed.
        least: the smallest valid value; None for no limit.
        most: the largest valid value; None for no limit.
    """
    return field(default=default, metadata={"help": help, "panel": panel, "least": least, "most": most})


_ALGORITHM = "Algorithm"
_NETWORK = "Network"
_CURRICULUM = "Curriculum"
_PEOPLE = "People's demonstrations"


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """The settings of a training run; the defaults suit grids and rooms that are learned in some 100,000 steps.

    Raises:
        LearnError: if a setting is out of range.
    """

    steps: int = _setting(300_000, "The steps of all worlds together, rounded up to whole rollouts.", least=1)
    worlds: int = _setting(16, "The number of worlds that are stepped together.", least=1)
    seed: int = _setting(1, "The random seed of levels, network and choices.", least=0)
    missions: bool = _setting(False, "Also let the policy observe the mission.")
    device: str = _setting("cpu", "Where the network is trained: cpu or cuda.")
    checkpoint_every: int = _setting(20, "The number of updates between checkpoints; 0 for none.", least=0)
    evaluation: int = _setting(100, "The number of fresh episodes to evaluate the policy on; 0 for none.", least=0)
    network: Literal["auto", "mlp", "cnn"] = _setting(
        "auto", "What sees the image: an MLP, a CNN, or what suits the image.", _NETWORK
    )
    hidden: tuple[int, ...] = _setting((64, 64), "The sizes of the actor's and the critic's layers.", _NETWORK)
    memory: bool = _setting(False, "Remember an episode's steps, by a gated recurrent unit (GRU).", _NETWORK)
    initial_std: float = _setting(
        0.6, "The standard deviation, at first, of each component of a continuous action.", _NETWORK, 1e-3, 10
    )
    rollout: int = _setting(128, "The number of steps of each world between updates.", _ALGORITHM, 1)
    epochs: int = _setting(4, "How often an update goes through a rollout.", _ALGORITHM, 1)
    minibatches: int = _setting(4, "The number of minibatches of an epoch.", _ALGORITHM, 1)
    learning_rate: float = _setting(7e-4, "The learning rate of Adam.", _ALGORITHM, 0)
    schedule: Literal["linear", "constant"] = _setting(
        "linear", "Whether the learning rate falls to 0 or stays constant.", _ALGORITHM
    )
    gamma: float = _setting(0.99, "The discount factor.", _ALGORITHM, 0, 1)
    gae_lambda: float = _setting(0.95, "The trace decay of generalised advantage estimates.", _ALGORITHM, 0, 1)
    clip: float = _setting(0.2, "How far a probability's ratio may move from 1 and count.", _ALGORITHM, 0)
    entropy: float = _setting(0.01, "The weight of the policy's entropy.", _ALGORITHM, 0)
    value: float = _setting(0.5, "The weight of the critic's error.", _ALGORITHM, 0)
    max_gradient_norm: float = _setting(0.5, "The norm to which gradients are clipped.", _ALGORITHM, 0)
    curriculum: Literal["uniform", "staged", "plr"] = _setting(
        "uniform", "How levels are chosen: alike, world after world, or again by what is left to learn.", _CURRICULUM
    )
    levels: int = _setting(0, "The number of seeds of each world; 0 for a new one each episode.", _CURRICULUM, 0)
    stage_success: float = _setting(0.9, "In stages, the success at which the next world begins.", _CURRICULUM, 0, 1)
    stage_episodes: int = _setting(100, "In stages, the number of latest episodes that success is of.", _CURRICULUM, 1)
    replay: float = _setting(0.5, "By PLR, the chance that a level is played again.", _CURRICULUM, 0, 1)
    replay_levels: int = _setting(1000, "By PLR, how many levels are remembered.", _CURRICULUM, 1)
    temperature: float = _setting(0.1, "By PLR, the temperature of the ranks of scores.", _CURRICULUM, 1e-3)
    staleness: float = _setting(0.1, "By PLR, the weight of how long ago a level was played.", _CURRICULUM, 0, 1)
    from_people: str = _setting("", "The study whose people's episodes the policy is cloned from first.", _PEOPLE)
    demonstrations: int = _setting(0, "How many demonstrations are cloned; 0 for all.", _PEOPLE, 0)
    critic_updates: int = _setting(5, "The updates in which, after cloning, only the critic learns.", _PEOPLE, 0)
    kl: float = _setting(0.0, "The weight, falling to 0, of the divergence from the clone.", _PEOPLE, 0)

    def __post_init__(self) -> None:
        self._require_numbers_in_range()
        self._require_layers()
        self._require_compatible_memory()

    def _require_numbers_in_range(self) -> None:
        for declared in fields(self):
            number = getattr(self, declared.name)
            least = declared.metadata["least"]
            most = declared.metadata["most"]
            is_low = least is not None and not number >= least  # also for NaN
            is_high = most is not None and not number <= most
            if is_low or is_high:
                limits = f"{least} or more" if most is None else f"{least} to {most}"
                raise LearnError(f"{declared.name} is {number!r}; use {limits}")

    def _require_layers(self) -> None:
        if not self.hidden or min(self.hidden) < 1 or max(self.hidden) > 4096:
            raise LearnError(f"hidden is {list(self.hidden)}; name one or more sizes of 1 to 4096")

    def _require_compatible_memory(self) -> None:
        if self.memory and self.from_people:
            raise LearnError("a clone of people has no memory; omit memory or from_people")
        if self.memory and self.minibatches > self.worlds:
            raise LearnError(
                f"minibatches is {self.minibatches}, but with a memory each needs a world of {self.worlds}; use fewer"
            )


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """A training run: the worlds to train in, in order, and the settings.

    Raises:
        LearnError: if no world is named.
    """

    worlds: tuple[WorldChoice, ...]
    settings: TrainingSettings

    def __post_init__(self) -> None:
        if not self.worlds:
            raise LearnError("no world to train in is named; name one, such as minihuman/MiniGrid-DoorKey-5x5-v0")


def read_job(path: Path) -> TrainingJob:
    """Read a job's TOML file: settings by name, and a table [[world]] with an id and options for each world.

    Raises:
        LearnError: if the file is not TOML, or a key or its value is not valid.
        OSError: if the file cannot be read.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LearnError(f"{path} is not TOML: {error}") from None
    try:
        worlds = msgspec.convert(table.pop("world", []), tuple[WorldChoice, ...])
        return TrainingJob(worlds, change_settings(TrainingSettings(), table))
    except (LearnError, msgspec.ValidationError) as error:
        raise LearnError(f"{path}: {error}") from None


def change_settings(settings: TrainingSettings, changes: Mapping[str, Any]) -> TrainingSettings:
    """Return a copy of settings with some of them changed.

    Args:
        settings: the settings.
        changes: the new values by the settings' names, as in a TOML file.

    Raises:
        LearnError: if there is no setting with a name, or a change is not valid.
    """
    names = [declared.name for declared in fields(TrainingSettings)]
    converted = {}
    for name, change in changes.items():
        if name not in names:
            raise LearnError(f"{name!r} is not a setting; use world or one of {', '.join(names)}")
        try:
            converted[name] = msgspec.convert(change, _SETTING_TYPES[name])
        except msgspec.ValidationError as error:
            raise LearnError(f"{name} is {change!r}: {error}") from None
    return replace(settings, **converted)


_SETTING_TYPES: Mapping[str, Any] = TrainingSettings.__annotations__
