"""From logs to a cloned policy with its card: clones for several numbers of demonstrations, judged beside chance."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from minihuman.data.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.agent.evaluate import Evaluation, at_random, evaluate, sampling
from minihuman.learn.agent.network import Eyes, Policy
from minihuman.learn.agent.observe import Eyesight, Sight, image_shape
from minihuman.learn.agent.policy_file import PolicyCard, save_policy, versions
from minihuman.learn.clone.clone import Cloned, Cloning, clone, split
from minihuman.learn.clone.demonstrations import Demonstrations, read_demonstrations
from minihuman.learn.clone.finetune import Start, compare_starts
from minihuman.learn.transfer.job import write_atomically

_EYES: dict[Sight, Eyes] = {"whole": "map", "remembered": "near"}


@dataclass(frozen=True, slots=True)
class CloneStudy:
    """What to clone, and how to judge it."""

    world: str
    sight: Sight = "view"
    missions: bool = False
    sizes: tuple[int, ...] = ()  # numbers of demonstrations to clone from, beside all of them
    evaluation_episodes: int = 200
    finetune_steps: int = 0  # of PPO from the clone and from nothing; 0 for none
    finetune_runs: int = 1
    success: float = 0.9  # the rate that fine-tuning is timed to
    selection: Selection = field(default_factory=lambda: Selection(outcome=("goal",)))
    cloning: Cloning = field(default_factory=Cloning)


@dataclass(frozen=True, slots=True)
class Row:
    """A clone from so many demonstrations, and how it plays."""

    demonstrations: int
    cloned: Cloned
    played: Evaluation


def clone_study(source: Path, out: Path, study: CloneStudy, *, command: str, device: str = "auto") -> str:
    """Clone, judge, and write the policy (``out``), its card (``out`` + .md) and numbers (.json); returns the card.

    The policy is the clone from all demonstrations, fine-tuned where that is asked for.

    Raises:
        LearnError: if a file is there already, a number of demonstrations is below 1, or nothing can be cloned; nothing
            is written then.
    """
    torch.set_num_threads(1)  # such small networks are faster so, and sums come in one order
    files = {kind: out.with_name(out.name + kind) for kind in ("", ".md", ".json")}
    if there := [path for path in files.values() if path.exists()]:
        raise LearnError(f"{there[0]} is there already; choose another --out")
    if odd := [size for size in study.sizes if size < 1]:
        raise LearnError(f"a number of demonstrations is {odd[0]}; it is 1 or more")
    demonstrations = read_demonstrations(
        source, study.world, Eyesight(study.missions, sight=study.sight), study.selection
    )
    eyes: Eyes = _EYES.get(study.sight, "grid" if _is_small(demonstrations) else "atari")
    training, validation = split(demonstrations, share=study.cloning.validation_share, seed=study.cloning.seed)
    rows, policy = [], None
    sizes = sorted({*(size for size in study.sizes if size < len(training.episodes)), len(training.episodes)})
    for size in sizes:
        policy, cloned = clone(training.first(size), validation, eyes=eyes, settings=study.cloning)
        rows.append(Row(size, cloned, _play(policy, demonstrations, study)))
    assert policy is not None
    chance = evaluate(
        at_random(len(demonstrations.action_names), study.cloning.seed),
        study.world,
        demonstrations.options,
        demonstrations.eyesight,
        episodes=study.evaluation_episodes,
        seed=study.cloning.seed,
        most_steps=demonstrations.most_steps,
    )
    card = _card(demonstrations, eyes, study)
    starts: list[Start] = []
    if study.finetune_steps:
        starts, policy, card = compare_starts(
            policy, card, steps=study.finetune_steps, runs=study.finetune_runs, seed=study.cloning.seed, device=device
        )
    text = card_text(study, demonstrations, rows, chance, starts, command)
    out.parent.mkdir(parents=True, exist_ok=True)
    save_policy(policy, card, out)
    write_atomically(json.dumps(_numbers(study, rows, chance, starts, command), indent=1), files[".json"])
    write_atomically(text, files[".md"])
    return text


def card_text(
    study: CloneStudy,
    demonstrations: Demonstrations,
    rows: list[Row],
    chance: Evaluation,
    starts: list[Start],
    command: str,
) -> str:
    """The card in Markdown: what it learnt from, how well it plays, and how that was found."""
    players = sorted({episode.player for episode in demonstrations.episodes})
    last = rows[-1].cloned
    lines = [
        f"# A policy cloned from {', '.join(players)} demonstrations of {study.world}",
        "",
        f"Options: {demonstrations.options or 'none'}. It sees {_sight(study)}.",
        f"Actions: {', '.join(demonstrations.action_names)}.",
        *(f"- {line}" for line in demonstrations.account.lines()),
        "",
        f"Training participants: {', '.join(last.training_participants)}.",
        f"Validation participants: {', '.join(last.validation_participants)}.",
        "",
        f"Success over {study.evaluation_episodes} held-out episodes, each action drawn from the policy, with its 95 %",
        "Wilson interval:",
        "",
        "| demonstrations | success | mean return | epochs | validation loss | agreement |",
        "| --- | --- | --- | --- | --- | --- |",
        *[
            f"| {row.demonstrations} | {row.played} | {row.played.mean_return:.3f} | {row.cloned.epochs} "
            f"| {row.cloned.validation_loss:.3f} | {row.cloned.agreement:.2f} |"
            for row in rows
        ],
        f"| chance | {chance} | {chance.mean_return:.3f} | - | - | - |",
        "",
    ]
    if starts:
        lines += fine_tuning(study, starts)
    lines += [f"Command: `{command}`", "", "Versions: " + ", ".join(f"{k} {v}" for k, v in versions().items())]
    return "\n".join(lines) + "\n"


def fine_tuning(study: CloneStudy, starts: list[Start]) -> list[str]:
    """What the card says of PPO from the clone and from nothing."""
    lines = [
        f"PPO for {study.finetune_steps:,} steps; steps until {study.success:g} of the last 100 episodes succeeded:",
        "",
        "| start | seed | steps | success at the end |",
        "| --- | --- | --- | --- |",
    ]
    for run in starts:
        reached = run.steps_to(study.success)
        steps = "not reached" if reached is None else f"{reached:,}"
        at_end = f"{run.history.points[-1].success:.2f}" if run.history.points else "-"  # where no episode ended
        lines.append(f"| {run.start} | {run.seed} | {steps} | {at_end} |")
    return [*lines, ""]


def _numbers(
    study: CloneStudy, rows: list[Row], chance: Evaluation, starts: list[Start], command: str
) -> dict[str, Any]:
    return {
        "study": asdict(study),
        "rows": [asdict(row) | {"success": row.played.rate, "interval": row.played.interval} for row in rows],
        "chance": asdict(chance) | {"success": chance.rate, "interval": chance.interval},
        "fine_tuning": [
            {"start": run.start, "seed": run.seed, "steps_to_success": run.steps_to(study.success)}
            | {"points": [asdict(point) for point in run.history.points]}
            for run in starts
        ],
        "command": command,
        "versions": versions(),
    }


def _play(policy: Policy, demonstrations: Demonstrations, study: CloneStudy) -> Evaluation:
    return evaluate(
        sampling(policy, study.cloning.seed),
        study.world,
        demonstrations.options,
        demonstrations.eyesight,
        episodes=study.evaluation_episodes,
        seed=study.cloning.seed,
        most_steps=demonstrations.most_steps,
    )


def _card(demonstrations: Demonstrations, eyes: Eyes, study: CloneStudy) -> PolicyCard:
    return PolicyCard(
        world=study.world,
        world_options=demonstrations.options,
        action_names=demonstrations.action_names,
        image_shape=image_shape(demonstrations.space),
        eyesight=demonstrations.eyesight,
        eyes=eyes,
        trained_by="cloning",
        steps=0,
        seed=study.cloning.seed,
        notes={"demonstrations": len(demonstrations.episodes)},
    )


def _is_small(demonstrations: Demonstrations) -> bool:
    return image_shape(demonstrations.space)[1] < 36  # what the Atari network needs


def _sight(study: CloneStudy) -> str:
    seen = {
        "view": "the world's own observation",
        "whole": "the whole grid, turned its way up",
        "remembered": "the cells near it that were in view so far, turned its way up",
    }
    return seen[study.sight] + (" and the mission" if study.missions else "")
