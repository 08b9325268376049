"""Policy files: a policy's weights, with a card that says how the policy was trained and where it can play."""

import io
import math
import platform
import warnings
import zipfile
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy

from minihuman import __version__
from minihuman.errors import LearnError
from minihuman.learn.policy.network import (
    ACTOR_HEAD,
    EncoderName,
    MissionImageExtractor,
    Policy,
    build_policy,
)
from minihuman.learn.policy.observation import ObservationEncoder, make_image_space
from minihuman.storage.durable_files import UNFINISHED_SUFFIX, replace_durably

FORMAT = 1
MAX_FILE_BYTES = 2**25
MAX_LAYERS = 16  # of the actor, and of the critic
MAX_UNITS = 4096  # of a layer
MAX_VALUES = 2**23  # of a policy's weights together, and of an image


@dataclass(frozen=True, slots=True)
class PolicyCard:
    """A policy's description in plain values, stored next to its weights."""

    world: str  # a Gymnasium id
    world_options: dict[str, Any]
    action_names: tuple[str, ...]  # by the policy's action number, or of an action's components
    image_shape: tuple[int, int, int]  # channels, height, width
    eyesight: ObservationEncoder
    eyes: EncoderName
    trained_by: str  # "ppo", "cloning, then ppo", or a learner's name
    steps: int  # of training in the world; 0 for a pure clone
    seed: int
    notes: dict[str, Any] = field(default_factory=dict)
    other_worlds: tuple[str, ...] = ()  # in which it was trained, too
    memory: bool = False  # whether it remembers an episode's steps
    hidden: tuple[int, ...] = (64, 64)  # sizes of the actor's and the critic's layers
    is_continuous: bool = False  # actions are vectors from a Gaussian

    @property
    def worlds(self) -> tuple[str, ...]:
        """The ids of the worlds in which the policy can play."""
        return (self.world, *self.other_worlds)

    @property
    def observation_space(self) -> spaces.Dict:
        """The observation space of the policy's network."""
        image = make_image_space(self.image_shape)
        if not self.eyesight.missions:
            return spaces.Dict({"image": image})
        return spaces.Dict({"image": image, "mission": spaces.Box(0, 1, (9,), np.float32)})


def get_versions() -> dict[str, str]:
    """Return the versions of the packages on which a policy's results depend, by the packages' names."""
    packages = ("torch", "stable-baselines3", "gymnasium", "numpy")
    versions = {"python": platform.python_version(), "minihuman": __version__}  # a checkout need not be installed
    return versions | {name: version(name) for name in packages}


def save_policy(policy: BasePolicy, card: PolicyCard, path: Path) -> None:
    """Write a policy file with the policy's weights and its card, replacing any existing file.

    Raises:
        OSError: if the file cannot be written.
    """
    save_atomically(
        {"format": FORMAT, "card": asdict(card), "versions": get_versions(), "weights": policy.state_dict()}, path
    )


def load_policy(path: Path) -> tuple[Policy, PolicyCard]:
    """Read a policy file; return the policy, ready to act on the CPU, and its card.

    Raises:
        LearnError: if the file is missing or is not a policy file of minihuman, or its weights do not fit its card.
    """
    content = read_policy_file(path)
    card = _read_card(content, path)
    weights: Any = content.get("weights")
    try:
        if (problem := _find_misfit(card, weights)) is None:
            policy = build_policy(
                card.observation_space,
                len(card.action_names),
                card.eyes,
                memory=card.memory,
                hidden=card.hidden,
                initial_std=1.0 if card.is_continuous else None,  # replaced by the weights of the file
            )
            policy.load_state_dict(weights)
            policy.set_training_mode(False)
            return policy, card
    except (ArithmeticError, AssertionError, RuntimeError, TypeError, ValueError) as error:  # for impossible shapes
        problem = (str(error).splitlines() or [type(error).__name__])[0]
    raise LearnError(
        f"{path}: the weights do not fit the network that its model card describes ({problem}); train it again"
    )


def _find_misfit(card: PolicyCard, weights: Any) -> str | None:
    """Return the reason why weights do not fit the network that a card describes; None if they fit.

    The network is not built in memory, since a card from elsewhere can describe one of any size.
    """
    if not isinstance(weights, dict) or not weights:
        return f"weights is a {type(weights).__name__}"
    for name, tensor in weights.items():
        if not isinstance(name, str) or not _is_plain_tensor(tensor):
            return f"{name!r} is not a tensor of finite 32-bit floats"
    if sum(tensor.numel() for tensor in weights.values()) > MAX_VALUES:
        return f"more than {MAX_VALUES} weights"
    if not card.hidden or len(card.hidden) > MAX_LAYERS or not all(1 <= size <= MAX_UNITS for size in card.hidden):
        return f"layers of {card.hidden} units"
    if min(card.image_shape) < 1 or math.prod(card.image_shape) > MAX_VALUES:
        return f"an image of {' x '.join(map(str, card.image_shape))}"
    with torch.device("meta"):
        extractor = MissionImageExtractor(card.observation_space, card.eyes).state_dict()
    shapes = {f"features_extractor.{name}": tuple(tensor.shape) for name, tensor in extractor.items()}
    shapes[f"{ACTOR_HEAD}bias"] = (len(card.action_names),)
    if card.is_continuous:
        shapes["log_std"] = (len(card.action_names),)
    for name, shape in shapes.items():
        if name not in weights:
            return f"{name} is absent, not {shape}"
        actual_shape = tuple(weights[name].shape)
        if actual_shape != shape:
            return f"{name} is {actual_shape}, not {shape}"
    return None


def _is_plain_tensor(candidate: Any) -> bool:
    """Return whether an object is a dense tensor of finite float32 on the CPU, of limited size."""
    return (
        isinstance(candidate, torch.Tensor)
        and (candidate.dtype, candidate.layout, candidate.device.type) == (torch.float32, torch.strided, "cpu")
        and candidate.numel() <= MAX_VALUES
        and bool(torch.isfinite(candidate).all())
    )


def read_policy_file(path: Path) -> dict[str, Any]:
    """Return the content of a policy file: format, card, versions and weights.

    Raises:
        LearnError: if the file is missing or is not a policy file of minihuman.
    """
    if not path.is_file():
        raise LearnError(f"policy file {path} does not exist; make one with `minihuman learn`")
    try:
        _require_small_archive(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch warns of a foreign pickle before it raises
            # weights_only: a policy file from elsewhere must not be able to run code
            content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise LearnError(
            f"{path} is not a policy file ({type(error).__name__}); make one with `minihuman learn`"
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise LearnError(
            f"{path} is not a policy file of format {FORMAT}; train the policy again with this version of minihuman"
        )
    return content


def _require_small_archive(path: Path) -> None:
    """Check that a file is a ZIP archive, as PyTorch writes it, whose unpacked size is limited.

    Raises:
        ValueError: if the archive is too large.
        OSError: if the file cannot be read.
        zipfile.BadZipFile: if the file is not a ZIP archive.
    """
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
    if path.stat().st_size > MAX_FILE_BYTES or sum(entry.file_size for entry in entries) > MAX_FILE_BYTES:
        raise ValueError(f"larger than {MAX_FILE_BYTES} bytes")


def _read_card(content: dict[str, Any], path: Path) -> PolicyCard:
    """Return the card in a policy file's content; the path is for the error.

    Raises:
        LearnError: if the card is missing or not valid.
    """
    try:
        return msgspec.convert(content.get("card"), PolicyCard)
    except (msgspec.ValidationError, RecursionError) as error:
        raise LearnError(
            f"{path}: its model card cannot be read ({error}); train the policy again with this version of minihuman"
        ) from None


def save_atomically(content: Any, path: Path) -> None:
    """Write a file with ``torch.save`` so that a crash leaves either the old file or the complete new one.

    Raises:
        OSError: if the file cannot be written; the error names ``path``.
    """
    buffer = io.BytesIO()  # not the file itself: torch reports a full disk as a RuntimeError
    torch.save(content, buffer)
    with replace_durably(path, path.with_name(path.name + UNFINISHED_SUFFIX)) as file:
        file.write(buffer.getbuffer())


def read_checkpoint(checkpoint: Path) -> dict[str, Any]:
    """Return the content of a checkpoint: tensors and plain values.

    Raises:
        LearnError: if the file cannot be read, such as one that another version wrote; the file is left as it is.
    """
    try:
        # weights_only: a study's folder from elsewhere must not be able to run code
        saved: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=True)
    except Exception as error:  # unpickling can raise any exception
        raise LearnError(
            f"checkpoint {checkpoint} cannot be read ({type(error).__name__}); "
            "resume with the version that wrote it, or move the file away to start again"
        ) from error
    return saved
