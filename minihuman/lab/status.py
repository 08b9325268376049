"""A study's state of play as lines: who has been here, how far they came, and what needs a hand."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from minihuman.lab.flow import left_before
from minihuman.lab.register_lines import Withdrawn, read_lines, read_register, replaced_by_others
from minihuman.lab.session_table import SessionRow, sessions
from minihuman.lab.summary import Summary
from minihuman.log.paths import PART_SUFFIX


def status_lines(study_dir: Path) -> Iterator[str]:
    """One line a session, then one a slot that was taken but never played.

    Raises:
        LogError: if there is no such folder.
        AllocationError: if the register cannot be read.
    """
    rows = list(sessions(study_dir))
    yield f"{'participant':12} {'group':16} {'session':>7} {'episodes':>9} {'steps':>7}  state"
    logs = Counter(_session(row.summary) for row in rows if row.summary)
    for row in rows:
        many = logs[_session(row.summary)] if row.summary else 1
        copied = f", one of {many} logs of this session, of which one counts: {row.path}" if many > 1 else ""
        yield _line(row) + copied
    played = {row.summary.participant for row in rows if row.summary}
    for slot in read_register(study_dir):
        if slot.participant not in played:
            yield f"{slot.participant:12} {slot.group:16} {'-':>7} {'-':>9} {'-':>7}  slot taken, nothing recorded"
    yield from _partings(study_dir)


def _session(summary: Summary) -> tuple[str, str, int]:
    return summary.study, summary.participant, summary.session


def _partings(study_dir: Path) -> Iterator[str]:
    """Who left; nobody is named who withdrew or left no data."""
    lines = read_lines(study_dir)
    for what, count in left_before(lines).items():
        yield f"{count} {what}"
    for code in replaced_by_others(lines):
        yield f"{code:12} does not come back; the slot is offered again"
    withdrawn = sum(isinstance(line, Withdrawn) for line in lines)
    if withdrawn:
        yield f"{withdrawn} withdrew and {'is' if withdrawn == 1 else 'are'} left out"


def _line(row: SessionRow) -> str:
    found = row.summary
    if found is None:
        return f"{row.path}  cannot be read: {row.problem}"
    episodes = f"{found.episodes_completed}/{found.episodes_planned}"
    return f"{found.participant:12} {found.group:16} {found.session:7} {episodes:>9} {found.steps:7}  {_state(row)}"


def _progress(summary: Summary) -> str:
    if summary.end_reason == "screened_out":
        return "screened out"
    return "complete" if summary.complete else f"unfinished: {summary.end_reason}"


def _state(row: SessionRow) -> str:
    summary = row.summary
    assert summary is not None
    parts = [_progress(summary)]
    if row.path.name.endswith(PART_SUFFIX):
        parts.append("live, or cut off: finished at its next start")
    elif not summary.clean:
        parts.append("unclean: recovered after a cut")
    if summary.segments > 1:
        parts.append(f"{summary.segments} segments")
    if summary.player != "human":
        parts.append(summary.player)
    return ", ".join(parts)
