"""What ``minihuman verify`` says of a log: the proof of its steps, then of everything around them."""

from collections.abc import Collection, Iterator
from pathlib import Path

from minihuman.errors import LogError
from minihuman.lab.advised import advice
from minihuman.lab.prove import prove
from minihuman.lab.seal import broken
from minihuman.lab.verify import other_rules, verify
from minihuman.log.paths import LOG_SUFFIX, PART_SUFFIX, folders_with_logs, sessions_among
from minihuman.log.read.guard import guarded
from minihuman.log.read.open_log import files_of, open_log
from minihuman.worlds.trust import trusting

MOST_LINES = 20  # of differences, a log


def sessions_at(given: Path) -> list[Path]:
    """Where the sessions of a folder, or of all folders in it, are: log by log; a folder where one is in several files.

    Raises:
        LogError: if there is none.
    """
    if not given.is_dir():
        return [given]
    found: list[Path] = []
    for folder, names in folders_with_logs(given):
        sessions = list(sessions_among(folder, names).values())
        alone = len(sessions) == 1
        found += [folder] if alone and len(sessions[0]) > 1 else [file for files in sessions for file in files]
    if not found:
        raise LogError(
            f"{given} holds no session logs (*{LOG_SUFFIX} or *{PART_SUFFIX}); name a log or a study's folder"
        )
    return sorted(found)


def proofs(log: Path, *, trust: Collection[str] = (), policies: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield lines on a session, each with whether it is good news; with ``policies`` on what its agents thought, too.

    ``log`` is a log, or the folder of the one session that is in it, in as many files as it may be.

    Raises:
        LogError: if the log cannot be read, or the file of a policy.
        WorldError: if a world of it cannot be made here, or is in a module that is not trusted.
    """
    session = open_log(log)
    make_world = trusting(trust)
    if other := other_rules(session):
        yield other, True
    with guarded(log, "played again"):
        steps = verify(session, make_world)
    if steps.difference:
        yield steps.difference, False
    if steps.drawn_otherwise:
        yield (
            f"{steps.drawn_otherwise} episodes with an earlier renderer's pictures: these are not compared",
            True,
        )
    differences: list[str] = []
    for file in files_of(log):
        with guarded(file, "proven"):
            differences += prove(file, make_world)
    for difference in differences[:MOST_LINES]:
        yield difference, False
    if len(differences) > MOST_LINES:
        yield f"and {len(differences) - MOST_LINES} more", False
    if policies:
        yield from advice(session, make_world)
    if not steps.difference and not differences:
        yield f"{steps.episodes} episodes, {steps.steps} steps, all as logged", True


def unbroken(study: Path, seal: str) -> Iterator[tuple[str, bool]]:
    """Yield lines on a sealed study, each with whether it is good news.

    Raises:
        LogError: if the seal is none.
    """
    lines = [(line, False) for line in broken(study, seal)]
    yield from lines or [("every file is as it was sealed", True)]
