"""A study's folder: which study it holds, and which of its jobs are done."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from minihuman.errors import LearnError
from minihuman.learn.transfer.job import Result, read_result, write_atomically
from minihuman.learn.transfer.plan import Job, Ppo, Study

STUDY = "study.json"
COUNTS = ("runs", "baselines")


def open_folder(study: Study, out: Path) -> None:
    """Make the folder the study's own, or see that it is already; a study may come back with more runs.

    Raises:
        LearnError: if the folder holds another study, or anything else; nothing is touched then.
    """
    path = out / STUDY
    wanted = json.loads(json.dumps(study.as_dict()))
    if path.exists():
        held = json.loads(path.read_text())
        changed = [name for name in {**held, **wanted} if held.get(name) != wanted.get(name)]
        # a run's seeds do not depend on how many there are
        if changed and set(changed) <= set(COUNTS) and all(wanted[name] >= held[name] for name in COUNTS):
            write_atomically(json.dumps(wanted, indent=1), path)
            return
        if not changed:
            return
        name = changed[0]
        raise LearnError(
            f"{out} holds another study ({name} is {held.get(name)!r} there and {wanted.get(name)!r} here); "
            "choose another --out"
        )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise LearnError(f"{out} is not empty and holds no study; choose a new --out")
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(json.dumps(wanted, indent=1), path)


def read_results(study: Study, out: Path) -> dict[Job, Result]:
    """The results of the jobs that are done, in the study's order."""
    results = {job: read_result(job, out) for job in study.jobs()}
    return {job: result for job, result in results.items() if result is not None}


def read_study(out: Path) -> Study:
    """Which study a folder holds.

    Raises:
        LearnError: if it holds none, or one of another version.
    """
    path = out / STUDY
    try:
        settings = json.loads(path.read_text())
        return Study(**settings | {"ppo": Ppo(**settings["ppo"]), "transfers": tuple(settings["transfers"])})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LearnError(
            f"{path} is no study of this version ({error}); name a folder of minihuman learn transfer"
        ) from None


def read_merged(folders: Sequence[Path]) -> tuple[Study, dict[Job, Result]]:
    """One study out of the folders that hold runs of it. Where two have the same run, the first folder's counts.

    Raises:
        LearnError: if a folder holds another study.
    """
    studies = [read_study(folder) for folder in folders]
    whole = replace(studies[0], **{name: max(getattr(study, name) for study in studies) for name in COUNTS})
    for folder, study in zip(folders, studies, strict=True):
        if replace(study, **{name: getattr(whole, name) for name in COUNTS}) != whole:
            raise LearnError(
                f"{folder} holds another study than {folders[0]}; only runs of one study can be put together"
            )
    results: dict[Job, Result] = {}
    for folder in reversed(folders):
        results |= read_results(whole, folder)
    return whole, {job: results[job] for job in whole.jobs() if job in results}
