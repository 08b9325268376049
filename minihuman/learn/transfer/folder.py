"""A study's folder: which study it holds, and which of its jobs are done."""

import json
from pathlib import Path

from minihuman.errors import LearnError
from minihuman.learn.transfer.job import Result, read_result, write_atomically
from minihuman.learn.transfer.plan import Job, Study

STUDY = "study.json"


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
        if changed == ["runs"] and wanted["runs"] > held["runs"]:  # a run's seeds do not depend on how many there are
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
