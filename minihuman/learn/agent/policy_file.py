"""A trained policy on disk: its weights, and everything needed to know where it may play and what it is."""

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
from minihuman.learn.agent.network import ACTOR_HEAD, Eyes, Policy, bare_policy
from minihuman.learn.agent.observe import Eyesight
from minihuman.learn.agent.training import save_atomically

FORMAT = 1


@dataclass(frozen=True, slots=True)
class PolicyCard:
    """What a policy is: plain values, stored beside the weights."""

    world: str  # a Gymnasium id
    world_options: dict[str, Any]
    action_names: tuple[str, ...]  # by the policy's action number
    image_shape: tuple[int, int, int]  # channels, height, width
    eyesight: Eyesight
    eyes: Eyes
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


def versions() -> dict[str, str]:
    """The versions that numbers here depend on."""
    packages = ("torch", "stable-baselines3", "gymnasium", "numpy", "numba")
    ours = {"python": platform.python_version(), "minihuman": __version__}  # a checkout need not be installed
    return ours | {name: version(name) for name in packages}


def save_policy(policy: BasePolicy, card: PolicyCard, path: Path) -> None:
    """Write a policy file; a file that is there is replaced only by the caller's own decision, so check first."""
    save_atomically(
        {"format": FORMAT, "card": asdict(card), "versions": versions(), "weights": policy.state_dict()}, path
    )


def load_policy(path: Path) -> tuple[Policy, PolicyCard]:
    """Read a policy file, ready to act on the CPU.

    Raises:
        LearnError: if the file is missing or is not a policy of ours.
    """
    content = _read(path)
    card = _card(content, path)
    weights = content["weights"]
    policy = bare_policy(card.observation_space, len(weights[ACTOR_HEAD + "bias"]), card.eyes)
    try:
        policy.load_state_dict(weights)
    except RuntimeError as error:
        raise LearnError(f"{path} holds another network than its card says: {str(error).splitlines()[0]}") from None
    policy.set_training_mode(False)
    return policy, card


def load_weights(path: Path) -> dict[str, torch.Tensor]:
    """The weights alone.

    Raises:
        LearnError: if the file is missing or is not a policy of ours.
    """
    weights: dict[str, torch.Tensor] = _read(path)["weights"]
    return weights


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise LearnError(f"{path} is not there; name a policy file, as `minihuman learn` writes them")
    try:
        # weights_only: a policy file from elsewhere must not be able to run code
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise LearnError(f"{path} is no policy file ({type(error).__name__})") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise LearnError(f"{path} is no policy file of format {FORMAT}; train it again with this version")
    return content


def _card(content: dict[str, Any], path: Path) -> PolicyCard:
    try:
        values = dict(content["card"])
        values["action_names"] = tuple(values["action_names"])
        values["image_shape"] = tuple(values["image_shape"])
        values["eyesight"] = Eyesight(**values["eyesight"])
        return PolicyCard(**values)
    except (KeyError, TypeError) as error:
        raise LearnError(f"{path} has a card that cannot be read: {error}") from None
