"""One job of the study, run to its end in its own folder and resumed after a kill, with the transfer of weights: in
place and frozen, or as the published code did it.
"""

import contextlib
import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.policy.file import PolicyCard, get_versions, read_policy_file, save_policy
from minihuman.learn.policy.network import ACTOR_HEAD, EncoderName
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.ppo import LeanPpo, make_ppo
from minihuman.operating_system import lock_descriptor
from minihuman.statistics.paired import paired_test
from minihuman.storage.durable_files import write_atomically
from transfer_study.plan import SOURCE, ProtocolName, TransferJob
from transfer_study.training import ResumableEnv, TrainingHistory, TrainingPoint, train_resumably


def area_under(steps: NDArray[np.float64], rewards: NDArray[np.float64]) -> float:
    """The trapezoid area under a reward curve whose steps are divided by the last one.

    ``steps`` and ``rewards`` have one value an update. A curve of one update has no area and yields its reward. The
    curve starts at its first update, not at 0, as in the published study.

    Raises:
        ValueError: if the two differ in length, are empty, or the steps do not grow.
    """
    x, y = np.asarray(steps, dtype=float), np.asarray(rewards, dtype=float)
    if len(x) != len(y) or not len(x) or np.any(np.diff(x) <= 0):
        raise ValueError(f"a curve needs as many growing steps as rewards; got {len(x)} steps and {len(y)} rewards")
    if len(x) == 1:
        return float(y[0])
    return float(np.trapezoid(y, x / x[-1]))


@dataclass(frozen=True, slots=True)
class Improvement:
    """How much more area a transfer has than the baseline of the same runs, relative to it: 0.1 is 10 % more.

    ``low`` and ``high`` bound it with 95 % confidence from three runs on; NaN below, and where an area is not above 0.
    """

    mean: float
    sd: float  # of the runs' own improvements; NaN for one
    low: float
    high: float
    p: float  # exact, paired
    smallest_p: float  # that so many runs could have come to
    better: float  # the share of runs with more area than their baseline, ties half
    runs: int


def improvement(transfer: NDArray[np.float64], baseline: NDArray[np.float64]) -> Improvement:
    """``transfer area / baseline area - 1``, of the geometric means over runs that share first weights and layouts.

    p is of the exact permutation test of the mean log ratio: within each run, transfer and baseline change places. It
    assumes no shape of the areas, and of fewer than six runs it is never below 0.05. The interval is Student's, of the
    log ratios, and right for normal ones alone: where a cell's runs are of two kinds, it says too much.

    Args:
        transfer: (runs,) areas.
        baseline: (runs,) areas of the same runs' baselines.
    """
    ours, base = np.asarray(transfer, dtype=float), np.asarray(baseline, dtype=float)
    ratios, runs = ours / base - 1, len(ours)
    mean, low, high, p, smallest = float(ratios.mean()), np.nan, np.nan, np.nan, np.nan
    if min(ours.min(), base.min()) > 0:
        logs = np.log(ours) - np.log(base)
        mean = float(np.expm1(logs.mean()))
        if test := paired_test(logs):
            p, smallest = test.p(), test.smallest_p
        if runs > 2 and np.ptp(logs) > 0:
            half = scipy.stats.t.ppf(0.975, runs - 1) * logs.std(ddof=1) / np.sqrt(runs)
            low, high = np.expm1(logs.mean() - half), np.expm1(logs.mean() + half)
    return Improvement(
        mean=mean,
        sd=float(ratios.std(ddof=1)) if runs > 1 else float("nan"),
        low=float(low),
        high=float(high),
        p=float(p),
        smallest_p=float(smallest),
        better=float((np.sign(ratios) / 2 + 0.5).mean()),
        runs=runs,
    )


def interquartile_mean(areas: NDArray[np.float64]) -> float:
    """The mean of the middle half of the runs (Agarwal et al., 2021); NaN for fewer than four."""
    return float(scipy.stats.trim_mean(areas, 0.25)) if len(areas) >= 4 else float("nan")


# What can move from one policy to another, by the names of parameters. The image's layers never do: the worlds'
# pictures have nothing in common. Shared feature layers are listed once, under "features_extractor".
PARTS = {
    "M": ("features_extractor.mission.",),
    "A": ("mlp_extractor.policy_net.", "action_net."),
    "C": ("mlp_extractor.value_net.", "value_net."),
}

Weights = Mapping[str, torch.Tensor]


def load_weights(path: Path) -> dict[str, torch.Tensor]:
    """The weights alone.

    Raises:
        LearnError: if the file is missing or is not a policy of ours.
    """
    weights: dict[str, torch.Tensor] = read_policy_file(path)["weights"]
    return weights


def get_part_parameters(policy: nn.Module, part: str) -> dict[str, nn.Parameter]:
    """The parameters of one part ("M", "A" or "C") by name."""
    return {name: parameter for name, parameter in policy.named_parameters() if name.startswith(PARTS[part])}


def transfer_in_place(
    policy: nn.Module, source: Weights, parts: Iterable[str], *, frozen: bool, head_rows: Sequence[int]
) -> None:
    """Copy parts of a source's weights into the policy's own parameters, so that the optimiser still holds them.

    ``head_rows`` says which of the source's actions each of the policy's actions is; the actor's head takes those
    rows. Frozen parameters get no gradient and stay equal to the bit.

    Raises:
        LearnError: if the source lacks a parameter or has another shape.
    """
    for part in sorted(parts):
        for name, parameter in get_part_parameters(policy, part).items():
            value = _find(source, name)
            if name.startswith(ACTOR_HEAD):
                value = value[list(head_rows)]
            if value.shape != parameter.shape:
                raise LearnError(
                    f"{name} is {tuple(value.shape)} in the source and {tuple(parameter.shape)} here; "
                    "the source was trained with another network"
                )
            with torch.no_grad():
                parameter.copy_(value)
            parameter.requires_grad_(not frozen)


def transfer_as_published(
    policy: nn.Module, source: Weights, parts: frozenset[str], *, frozen: bool, state: ProtocolName = "as-published"
) -> None:
    """Reproduce the published code, defects included (named in ``plan.DEFECTS``).

    Call it after the optimiser is built: the replaced parameters are then not in it. The actor's head becomes as
    wide as the source's. Until June 2023 the critic's head had its weight frozen always, its bias moved only so.
    """
    old_head = state == "as-published-2023-05-28"
    for part in sorted(parts):
        for name in get_part_parameters(policy, part):
            if old_head and name == "value_net.bias" and not frozen:
                continue
            misspelled = parts == frozenset("CM") and part == "M"
            free = (not frozen or misspelled) and not (old_head and name == "value_net.weight")
            _replace(policy, name, nn.Parameter(_find(source, name).clone(), requires_grad=free))


def _replace(policy: nn.Module, name: str, parameter: nn.Parameter) -> None:
    owner, _, attribute = name.rpartition(".")
    setattr(policy.get_submodule(owner), attribute, parameter)


def _find(source: Weights, name: str) -> torch.Tensor:
    try:
        return source[name]
    except KeyError:
        raise LearnError(f"the source has no {name}; it was trained with another network") from None


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
    points: tuple[TrainingPoint, ...]
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


def run_job(job: TransferJob, out: Path, device: str = "auto") -> Result:
    """Train a job to its end; a finished one is only read.

    Raises:
        LearnError: if its folder holds another job, another process trains it, or its source is not there yet.
    """
    folder = out / job.name
    folder.mkdir(parents=True, exist_ok=True)
    _claim(job, folder)
    with _sole(folder):
        return read_result(job, out) or _train_to_the_end(job, out, device)


def _train_to_the_end(job: TransferJob, out: Path, device: str) -> Result:
    folder = out / job.name
    torch.set_num_threads(1)  # one job a core; sums in one order
    started = time.perf_counter()
    source = None if job.source is None else load_weights(out / job.source.name / POLICY)
    ppo, world = prepare(job, source, device)
    history = train_resumably(
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
        versions=get_versions(),
    )
    write_atomically(json.dumps(asdict(result), indent=1), folder / RESULT)
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return result


def prepare(job: TransferJob, source: Weights | None, device: str) -> tuple[LeanPpo, ResumableEnv]:
    """The job's agent in its world, before the first step: seeded, and with the source's weights where it takes any."""
    as_published = job.study.published
    world = ResumableEnv(
        job.world,
        job.world_options,
        seed=job.seed,
        eyesight=ObservationEncoder(missions=True, scaling="raw" if as_published else "spread"),
        actions=job.actions,
    )
    ppo = make_ppo(world, settings=job.study.ppo, eyes=_eyes(job), seed=job.seed, device=device)
    if source is not None and as_published:
        transfer_as_published(ppo.policy, source, job.cell.parts, frozen=job.cell.frozen, state=job.study.protocol)
        ppo.policy.to(ppo.device)
    elif source is not None:
        shared = range(job.actions)  # turn left, turn right and forward come first in both worlds
        transfer_in_place(ppo.policy, source, job.cell.parts, frozen=job.cell.frozen, head_rows=shared)
    return ppo, world


def read_result(job: TransferJob, out: Path) -> Result | None:
    """A job's result; None while it has not finished.

    Raises:
        LearnError: if what is there was written by another version.
    """
    path = out / job.name / RESULT
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text())
        content["points"] = tuple(TrainingPoint(**point) for point in content["points"])
        return Result(**content)
    except (ValueError, KeyError, TypeError) as error:
        raise LearnError(
            f"{path} is not a result of this version ({error}); move it away or choose another --out"
        ) from None


def steps_so_far(job: TransferJob, out: Path) -> int:
    """How far a job has come."""
    path = out / job.name / PROGRESS
    return int(path.read_text()) if path.exists() else 0


def _claim(job: TransferJob, folder: Path) -> None:
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
            lock_descriptor(file.fileno(), wait=False)
        except BlockingIOError:
            raise LearnError(f"{folder} is being trained by another process; let it end first") from None
        yield


def _eyes(job: TransferJob) -> EncoderName:
    return "grid" if job.cell.name == SOURCE else "atari"


def _card(job: TransferJob, world: ResumableEnv) -> PolicyCard:
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


def _seconds(history: TrainingHistory, sitting_s: float) -> dict[str, float]:
    busy = {
        "world": history.world_s,
        "acting": history.acting_s,
        "learning": history.learning_s,
        "cpu": history.cpu_s,
        "last_sitting": sitting_s,
    }
    return {name: round(value, 2) for name, value in busy.items()}
