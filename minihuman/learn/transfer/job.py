"""One job of the study, run to its end in its own folder: killed and started again, it goes on."""

import contextlib
import fcntl
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from minihuman.errors import LearnError
from minihuman.learn.agent.network import Eyes
from minihuman.learn.agent.observe import Eyesight
from minihuman.learn.agent.policy_file import PolicyCard, load_weights, save_policy, versions
from minihuman.learn.agent.ppo import LeanPpo
from minihuman.learn.agent.training import History, Point, new_ppo, train
from minihuman.learn.agent.training_world import TrainingWorld
from minihuman.learn.transfer.curves import area_under
from minihuman.learn.transfer.plan import SOURCE, Job
from minihuman.learn.transfer.weights import Weights, transfer_as_published, transfer_in_place

CHECKPOINT = "checkpoint.pt"
LOCK = "job.lock"
POLICY = "policy.pt"
RESULT = "result.json"
PROGRESS = "steps.txt"


@dataclass(frozen=True, slots=True)
class Result:
    """What a finished job found."""

    job: str
    config: dict[str, Any]
    config_hash: str
    points: tuple[Point, ...]
    seconds: dict[str, float]  # world, acting, learning, cpu of all three, and last_sitting (start-up included)
    device: str
    versions: dict[str, str]

    @property
    def area(self) -> float:
        """The area under its reward curve."""
        steps, rewards = zip(*((point.steps, point.reward) for point in self.points), strict=True)
        return area_under(np.array(steps, dtype=float), np.array(rewards))

    @property
    def steps(self) -> int:
        """How many steps it trained."""
        return self.points[-1].steps

    @property
    def busy_s(self) -> float:
        """How long it trained, by the clock on the wall."""
        return sum(self.seconds[part] for part in ("world", "acting", "learning"))

    @property
    def core_s(self) -> float:
        """Seconds of one core; by the wall in results that do not have them."""
        return self.seconds.get("cpu", self.busy_s)


def run_job(job: Job, out: Path, device: str = "auto") -> Result:
    """Train a job to its end; a finished one is only read.

    Raises:
        LearnError: if its folder holds another job, another process trains it, or its source is not there yet.
    """
    folder = out / job.name
    folder.mkdir(parents=True, exist_ok=True)
    _claim(job, folder)
    with _sole(folder):
        return read_result(job, out) or _train_to_the_end(job, out, device)


def _train_to_the_end(job: Job, out: Path, device: str) -> Result:
    folder = out / job.name
    torch.set_num_threads(1)  # one job a core; sums in one order
    started = time.perf_counter()
    source = None if job.source is None else load_weights(out / job.source.name / POLICY)
    ppo, world = prepare(job, source, device)
    history = train(
        ppo,
        world,
        steps=job.steps,
        checkpoint=folder / CHECKPOINT,
        told=lambda steps: write_atomically(str(steps), folder / PROGRESS),
    )
    save_policy(ppo.policy, _card(job, world), folder / POLICY)
    result = Result(
        job=job.name,
        config=job.config,
        config_hash=job.config_hash,
        points=tuple(history.points),
        seconds=_seconds(history, time.perf_counter() - started),
        device=str(ppo.device),
        versions=versions(),
    )
    write_atomically(json.dumps(asdict(result), indent=1), folder / RESULT)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return result


def prepare(job: Job, source: Weights | None, device: str) -> tuple[LeanPpo, TrainingWorld]:
    """The job's agent in its world, before the first step: seeded, and with the source's weights where it takes any."""
    as_published = job.study.published
    world = TrainingWorld(
        job.world,
        job.world_options,
        seed=job.seed,
        eyesight=Eyesight(missions=True, scaling="raw" if as_published else "spread"),
        actions=job.actions,
    )
    ppo = new_ppo(world, settings=job.study.ppo, eyes=_eyes(job), seed=job.seed, device=device)
    if source is not None and as_published:
        transfer_as_published(ppo.policy, source, job.cell.parts, frozen=job.cell.frozen, state=job.study.protocol)
        ppo.policy.to(ppo.device)
    elif source is not None:
        shared = range(job.actions)  # turn left, turn right and forward come first in both worlds
        transfer_in_place(ppo.policy, source, job.cell.parts, frozen=job.cell.frozen, head_rows=shared)
    return ppo, world


def read_result(job: Job, out: Path) -> Result | None:
    """A job's result; None while it has not finished.

    Raises:
        LearnError: if what is there was written by another version.
    """
    path = out / job.name / RESULT
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text())
        content["points"] = tuple(Point(**point) for point in content["points"])
        return Result(**content)
    except (ValueError, KeyError, TypeError) as error:
        raise LearnError(
            f"{path} is not a result of this version ({error}); move it away or choose another --out"
        ) from None


def steps_so_far(job: Job, out: Path) -> int:
    """How far a job has come."""
    path = out / job.name / PROGRESS
    return int(path.read_text()) if path.exists() else 0


def _claim(job: Job, folder: Path) -> None:
    path = folder / "job.json"
    claim = {"hash": job.config_hash, "config": job.config}
    if path.exists():
        held = json.loads(path.read_text())
        if held["hash"] != job.config_hash:
            raise LearnError(f"{folder} holds another job (its {path.name} differs); choose another --out")
    else:
        write_atomically(json.dumps(claim, indent=1), path)


@contextlib.contextmanager
def _sole(folder: Path) -> Iterator[None]:
    """Hold a job's folder; the lock is the kernel's and ends with the process, however that ends."""
    with (folder / LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LearnError(f"{folder} is being trained by another process; let it end first") from None
        yield


def _eyes(job: Job) -> Eyes:
    return "grid" if job.cell.name == SOURCE else "atari"


def _card(job: Job, world: TrainingWorld) -> PolicyCard:
    return PolicyCard(
        world=job.world,
        world_options=job.world_options,
        action_names=world.action_names,
        image_shape=world.image_shape,
        eyesight=world.eyesight,
        eyes=_eyes(job),
        trained_by="ppo",
        steps=job.steps,
        seed=job.seed,
        notes={"job": job.name, "protocol": job.study.protocol, "config_hash": job.config_hash},
    )


def _seconds(history: History, sitting_s: float) -> dict[str, float]:
    busy = {
        "world": history.world_s,
        "acting": history.acting_s,
        "learning": history.learning_s,
        "cpu": history.cpu_s,
        "last_sitting": sitting_s,
    }
    return {name: round(value, 2) for name, value in busy.items()}


def write_atomically(text: str, path: Path) -> None:
    """Write a text file so that a reader sees the old one or the new one, whole."""
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_text(text)
    unfinished.replace(path)
