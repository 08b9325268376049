"""A policy file: its weights, and everything needed to know where it may play and how it was made."""

import platform
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy

from minihuman import __version__
from minihuman.errors import LearnError
from minihuman.learn.policy.network import ACTOR_HEAD, EncoderName, Policy, build_policy
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.operating_system import replace_file, sync_file

FORMAT = 1


@dataclass(frozen=True, slots=True)
class PolicyCard:
    """What a policy is: plain values, stored beside the weights."""

    world: str  # a Gymnasium id
    world_options: dict[str, Any]
    action_names: tuple[str, ...]  # by the policy's action number
    image_shape: tuple[int, int, int]  # channels, height, width
    eyesight: ObservationEncoder
    eyes: EncoderName
    trained_by: str  # "ppo", "cloning, then ppo", or a learner's name
    steps: int  # of training in the world; 0 for a pure clone
    seed: int
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def observation_space(self) -> spaces.Dict:
        """What the network takes."""
        image = spaces.Box(0, 255, self.image_shape, np.uint8)
        if not self.eyesight.missions:
            return spaces.Dict({"image": image})
        return spaces.Dict({"image": image, "mission": spaces.Box(0, 1, (9,), np.float32)})


def get_versions() -> dict[str, str]:
    """The versions that numbers here depend on."""
    packages = ("torch", "stable-baselines3", "gymnasium", "numpy", "numba")
    ours = {"python": platform.python_version(), "minihuman": __version__}  # a checkout need not be installed
    return ours | {name: version(name) for name in packages}


def save_policy(policy: BasePolicy, card: PolicyCard, path: Path) -> None:
    """Write a policy file; a file that is there is replaced only by the caller's own decision, so check first."""
    save_atomically(
        {"format": FORMAT, "card": asdict(card), "versions": get_versions(), "weights": policy.state_dict()}, path
    )


def load_policy(path: Path) -> tuple[Policy, PolicyCard]:
    """Read a policy file, ready to act on the CPU.

    Raises:
        LearnError: if the file is missing or is not a policy of ours.
    """
    content = read_policy_file(path)
    card = _card(content, path)
    weights = content["weights"]
    policy = build_policy(card.observation_space, len(weights[ACTOR_HEAD + "bias"]), card.eyes)
    try:
        policy.load_state_dict(weights)
    except RuntimeError as error:
        problem = str(error).splitlines()[0]
        raise LearnError(
            f"{path}: the weights do not fit the network on its card ({problem}); train it again"
        ) from None
    policy.set_training_mode(False)
    return policy, card


def read_policy_file(path: Path) -> dict[str, Any]:
    """Read a policy file's content: format, card, versions and weights.

    Raises:
        LearnError: if the file is missing or is not a policy of ours.
    """
    if not path.is_file():
        raise LearnError(f"policy file {path} does not exist; `minihuman learn` writes one")
    try:
        # weights_only: a policy file from elsewhere must not be able to run code
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise LearnError(
            f"{path} is not a policy file ({type(error).__name__}); `minihuman learn` writes one"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise LearnError(f"{path} is not a policy file of format {FORMAT}; train the policy again with this version")
    return content


def _card(content: dict[str, Any], path: Path) -> PolicyCard:
    try:
        values = dict(content["card"])
        values["action_names"] = tuple(values["action_names"])
        values["image_shape"] = tuple(values["image_shape"])
        values["eyesight"] = ObservationEncoder(**values["eyesight"])
        return PolicyCard(**values)
    except (KeyError, TypeError) as error:
        raise LearnError(
            f"{path}: its card cannot be read ({error}); train the policy again with this version"
        ) from None


def save_atomically(value: Any, path: Path) -> None:
    """Write a file with ``torch.save`` so that a crash leaves the old one or the new one, whole."""
    unfinished = path.with_name(path.name + ".part")
    with unfinished.open("wb") as file:
        torch.save(value, file)
        file.flush()
        sync_file(file.fileno())
    replace_file(unfinished, path)


def write_atomically(text: str, path: Path) -> None:
    """Write a text file so that a reader sees the old one or the new one, whole."""
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text, encoding="utf-8", newline="\n")
    replace_file(unfinished, path)
