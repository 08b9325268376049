"""The options of `minihuman learn ppo`, one for each training setting, and the command's output.

This module does not import torch, which the command's help does not need.
"""

import inspect
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

from minihuman.cli.options import Option
from minihuman.errors import LearnError
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice, change_settings, read_job
from minihuman.trust import Permission, admit_worlds


def training_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with an option added for each training setting.

    The command receives the settings that are given on the command line, by name, as its parameter ``settings``.
    """

    @wraps(command)
    def run_with_settings(*arguments: Any, **named: Any) -> None:
        all_settings = {declared.name: named.pop(declared.name) for declared in fields(TrainingSettings)}
        settings = {name: setting for name, setting in all_settings.items() if setting is not None}
        if "hidden" in settings:
            settings["hidden"] = _parse_sizes(settings["hidden"])
        command(*arguments, **named, settings=settings)

    signature = inspect.signature(command)
    options = [
        inspect.Parameter(
            declared.name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=_annotate_setting(declared)
        )
        for declared in fields(TrainingSettings)
    ]
    parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "settings"]
    parameters = sorted([*parameters, *options], key=lambda parameter: parameter.kind)  # keyword-only ones come last
    run_with_settings.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return run_with_settings


def _annotate_setting(declared: Any) -> Any:
    """Return the annotation of a command's parameter that declares the option for a field of ``TrainingSettings``."""
    kind = TrainingSettings.__annotations__[declared.name]
    default = declared.default
    if declared.name == "hidden":
        kind = str
        default = ",".join(map(str, default))
    text = declared.metadata["help"]
    if default not in ("", False):
        text = f"{text.removesuffix('.')} (default {default})."
    least = declared.metadata["least"] if kind is int else None
    return Annotated[kind | None, Option(help=text, min=least, panel=declared.metadata["panel"])]


def _parse_sizes(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise LearnError(f"--hidden {text!r} is not valid; give sizes separated by commas, as in 64,64") from None


def compose_job(
    worlds: Sequence[str], path: Path | None, options: Sequence[str], settings: dict[str, Any]
) -> TrainingJob:
    """Compose a training job from the command line and, if a path is given, a job file.

    Args:
        worlds: the ids of the worlds; if there are none, those of the file are used.
        path: the TOML file of a job; None for the default settings.
        options: options of all worlds, as NAME=VALUE, which replace those of the file.
        settings: training settings by name, which replace those of the file.

    Raises:
        LearnError: if the file, a world, an option or a setting is not valid.
    """
    job = None if path is None else read_job(path)
    choices = tuple(WorldChoice(world) for world in worlds) or (job.worlds if job else ())
    common_options = dict(map(_parse_option, options))
    choices = tuple(WorldChoice(choice.id, {**choice.options, **common_options}) for choice in choices)
    return TrainingJob(choices, change_settings(job.settings if job else TrainingSettings(), settings))


def _parse_option(text: str) -> tuple[str, Any]:
    """Parse NAME=VALUE; return the name, and the value as parsed from TOML or, if it is not valid TOML, as text.

    Raises:
        LearnError: if the equals sign or the name is missing.
    """
    name, separator, value_text = text.partition("=")
    if not separator or not name:
        raise LearnError(f"--option {text!r} is not valid; write NAME=VALUE, as in max_steps=100")
    try:
        return name, tomllib.loads(f"value = {value_text}")["value"]
    except tomllib.TOMLDecodeError:
        return name, value_text


def admit_training(job: TrainingJob, folder: Path, permission: Permission) -> None:
    """Allow the worlds of a job to run Python code, if the user trusts it.

    Args:
        job: the training job.
        folder: the folder of the job file, in which the code may lie.
        permission: whether the user trusts the code, or a function that asks.

    Raises:
        LearnError: if the user does not trust the code.
    """
    worlds = [(choice.id, choice.options) for choice in job.worlds]
    refused = admit_worlds(worlds, folder.resolve(), permission)
    if refused:
        raise LearnError(f"its worlds run Python from {refused}, which is not trusted; if you trust it, add --trust")


def describe_progress(point: Any, steps: int, curriculum: str) -> str:
    """Return a line about the progress of a training.

    Args:
        point: the latest point of the learning curve.
        steps: the number of steps of the whole training.
        curriculum: a description of the state of the curriculum; "" if there is none.
    """
    line = f"{point.steps} of {steps} steps, {point.success:.0%} of episodes succeed"
    return f"{line}; {curriculum}" if curriculum else line


def describe_training(out: Path, job: TrainingJob, report: Any) -> str:
    """Return a description of a training's result: a line for the run, one for its clone if any, one for each world.

    Args:
        out: the policy file that was written.
        job: the training job.
        report: what the function ``train`` returned.
    """
    last = report.points[-1]
    latest = f"of the latest, {last.success:.0%} succeeded, mean return {last.return_mean:.3f}"
    lines = [f"{out}: {last.steps} steps, {last.episodes} episodes; {latest}"]
    if report.clone is not None:
        lines.append(f"the clone in fresh episodes of {job.worlds[0].id}: success {report.clone}")
    lines += [
        f"in {evaluation.episodes} fresh episodes of {choice.id}: success {evaluation}, mean return "
        f"{evaluation.mean_return:.3f}, mean steps {evaluation.mean_steps:.1f}"
        for choice, evaluation in zip(job.worlds, report.evaluations, strict=False)
    ]
    return "\n".join(lines)
