"""The provenance of a taught policy: the record of its training in its file, and a check by reproducing its weights."""

import hashlib
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

import minihuman
from minihuman.errors import LearnError
from minihuman.learn.policy.file import PolicyCard, load_policy, save_policy
from minihuman.learn.policy.network import Policy
from minihuman.learn.policy.observation import get_image_shape
from minihuman.learn.teaching.dataset import Dataset
from minihuman.learn.teaching.learner import LearningRequest, LearningResult, choose_encoder, make_learner
from minihuman.storage.durable_files import hash_file

UNLIMITED_S = float("inf")
PACKAGE = Path(minihuman.__file__).parent
HASHED_FOLDERS = ("learn", "worlds")  # the folders of the package with the code on which weights depend


@dataclass(frozen=True, slots=True)
class PolicyArtifact:
    """A policy file that was written, with its digest and card."""

    path: Path
    sha256: str
    card: PolicyCard


def make_policy(
    dataset: Dataset,
    learner: str,
    out: Path,
    *,
    seed: int,
    start: Path | None = None,
    budget_s: float = UNLIMITED_S,
    checkpoint: Path | None = None,
) -> PolicyArtifact:
    """Learn a policy and write it, with its provenance, to a file that is either complete or absent.

    Args:
        dataset: the dataset to learn from
        learner: the learner's name, with settings after a colon
        out: the policy file to write
        seed: the seed of all random draws
        start: the previous policy's file, for learners that continue from it
        budget_s: the longest learning time in seconds
        checkpoint: a file from which an interrupted learner resumes

    Raises:
        LearnError: if there is nothing to learn from, or ``start`` was trained in another world.
    """
    torch.set_num_threads(1)  # small networks are faster on one thread, and their sums have a fixed order
    start_policy = _load_start(start, dataset)
    request = LearningRequest(dataset, np.random.default_rng(seed), start_policy, budget_s, checkpoint)
    learned = make_learner(learner).learn(request)
    card = _build_card(dataset, learner.partition(":")[0], learned, seed, _hash_start(start))
    save_policy(learned.policy, card, out)
    return PolicyArtifact(out, hash_file(out), card)


def reproduce_policy(path: Path, dataset: Dataset, *, start: Path | None = None) -> list[str]:
    """Learn a policy again from its training data, and describe the differences, one per line.

    Returns:
        [] if the weights are equal. If the dataset or the starting policy has another digest, only the lines about
        these. Otherwise the weights that differ, after the versions of code that differ.

    Raises:
        LearnError: if the file has no record of its training data, or nothing can be learned.
    """
    policy, card = load_policy(path)
    training = card.notes.get("made")
    if training is None:
        raise LearnError(
            f"{path} was trained by {card.trained_by}, which records no dataset; name a policy made by `minihuman "
            "learn teach`"
        )
    digests = {"data_sha256": dataset.sha256(), "start_sha256": _hash_start(start)}
    data_differences = [
        f"{name} is {digest}, not {training[name]}" for name, digest in digests.items() if digest != training[name]
    ]
    if data_differences:
        return data_differences
    settings = ",".join(f"{name}={setting}" for name, setting in training["settings"].items())
    torch.set_num_threads(1)
    start_policy = _load_start(start, dataset)
    request = LearningRequest(dataset, np.random.default_rng(training["seed"]), start_policy)
    relearned = make_learner(f"{training['learner']}:{settings}").learn(request)
    weight_differences = _find_differences(policy, relearned.policy)
    current_code = get_code_versions()
    code_differences = [
        f"it was made by {name} {recorded}; here is {current_code[name]}"
        for name, recorded in training.get("code", {}).items()
        if recorded != current_code[name]
    ]
    if not weight_differences:
        return []
    return [*code_differences, *weight_differences]


@cache
def get_code_versions() -> dict[str, str]:
    """Return the versions of the packages on which weights depend, and the digest "sources_sha256" of source files."""
    digest = hashlib.sha256()
    for folder in HASHED_FOLDERS:
        sources = sorted((PACKAGE / folder).rglob("*.py"))
        assert sources, f"{folder} holds no source"
        for path in sources:
            digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + path.read_bytes() + b"\0")
    versions = {"minihuman": minihuman.__version__, **{name: version(name) for name in ("torch", "numpy")}}
    return versions | {"sources_sha256": digest.hexdigest()}


def _hash_start(start: Path | None) -> str:
    """Return the SHA-256 digest of the starting policy's file; "" if there is none."""
    if start is None:
        return ""
    return hash_file(start)


def _load_start(start: Path | None, dataset: Dataset) -> Policy | None:
    """Return the policy to start from; None if there is no file.

    Raises:
        LearnError: if the policy was trained in another world.
    """
    if start is None:
        return None
    policy, card = load_policy(start)
    if card.world != dataset.world:
        raise LearnError(
            f"{start} was trained in {card.world}, but the dataset is from {dataset.world}; start from another policy"
        )
    return policy


def _build_card(dataset: Dataset, learner: str, learned: LearningResult, seed: int, start_sha256: str) -> PolicyCard:
    """Return the card of a learned policy, with the record from which its training can be reproduced.

    Args:
        dataset: the dataset from which it was learned.
        learner: the learner's name, without settings.
        learned: the learner's result.
        seed: the seed of all random draws.
        start_sha256: the SHA-256 digest of the starting policy's file; "" for none.
    """
    training: dict[str, Any] = {
        "learner": learner,
        "settings": learned.settings,
        "seed": seed,
        "code": get_code_versions(),
        "data_sha256": dataset.sha256(),
        "start_sha256": start_sha256,
        "sources": [asdict(source) for source in dataset.sources],
        "selection": list(dataset.selection),
        "lessons": len(dataset.lessons),
        "steps": dataset.steps,
        "labelled_steps": dataset.labelled_steps,
        "ratings": len(dataset.ratings),
        "comparisons": len(dataset.comparisons),
        "found": learned.notes,
    }
    return PolicyCard(
        world=dataset.world,
        world_options=dataset.options,
        action_names=dataset.action_names,
        image_shape=get_image_shape(dataset.space),
        eyesight=dataset.eyesight,
        eyes=choose_encoder(dataset),
        trained_by=learner,
        steps=0,
        seed=seed,
        notes={"made": training},
    )


def _find_differences(policy: Policy, relearned: Policy) -> list[str]:
    """Return a line about each array of weights in which two policies differ, with the largest absolute difference."""
    relearned_weights = relearned.state_dict()
    differences = []
    for name, weights in policy.state_dict().items():
        if not torch.equal(weights, relearned_weights[name]):
            largest = float((weights - relearned_weights[name]).abs().max())
            differences.append(f"{name} differs by up to {largest:.3g}")
    return differences
