"""Play a study as laboratories know it: people decline, are killed and resumed, quit, stay away, withdraw, are marked.

The courses repeat in turn, so that a study of twelve has each of them once.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from minihuman.activities.trials.screens import TrialScreen
from minihuman.admin.enrolment_entries import AuditNote
from minihuman.admin.enrolment_log import free_slot
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.api import export, open_study, report
from minihuman.cli.command_line import make_command_line
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.inputs import Input, PointerPressed, PointerReleased, Stop
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, Screen
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import DeferredRecorder
from minihuman.recorded_study import Episode
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.machine import collect_machine_facts
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.recompute.exports import QUERIES

OUTPUTS = ("report", "query", "notebook", "csv", "parquet", "minari", "lerobot", "bids")
PROTOCOLS = tuple(sorted(Path(__file__).parent.glob("protocols/*.toml")))
MONDAY_NS = 1_767_603_600_000_000_000  # 2026-01-05T09:00:00Z
HOUR_NS = 3_600_000_000_000
DAY_NS = 24 * HOUR_NS


@dataclass(frozen=True)
class Course:
    """What becomes of a participant; the numbers are of inputs taken while playing, by session."""

    kills: tuple[tuple[int, int], ...] = ()  # session, and the input after which the program was killed and resumed
    cut: int = 0  # the session that was killed and never resumed
    quits: int = 0  # the session that was quit
    declines: bool = False
    sessions: int = 99  # how many they came to
    marks: tuple[tuple[int, int | None], ...] = ()  # session and episode (None: all) that a reviewer excluded
    withdraws_after: int = 0  # the session
    replaced: bool = False


COURSES = (
    Course(),
    Course(kills=((1, 4), (1, 9))),
    Course(marks=((1, 2),)),
    Course(cut=2, kills=((2, 3),)),
    Course(declines=True),
    Course(quits=1),
    Course(kills=((2, 30),)),
    Course(sessions=1, replaced=True),
    Course(withdraws_after=1),
    Course(marks=((2, None), (1, 1))),
    Course(quits=2, kills=((1, 25),)),
    Course(withdraws_after=2, kills=((1, 12),)),
    Course(),
    Course(cut=1),
    Course(),
    Course(marks=((1, None), (2, None))),
)
PLAYERS = ("human-like", "optimal", "human-like", "random")


class _Killed(BaseException):
    """The program is gone; what its log held then is kept aside."""


class _Window(SimulatedWindow):
    """A simulated participant's window whose session is killed or quit after some inputs, or whose consent declined."""

    kill_after = quit_after = -1
    declines = False
    folder = Path()
    _page: Screen | None = None
    _taken = 0

    def show(self, screen: Screen):
        self._page = screen
        return super().show(screen)

    def wait(self, until_ns: int | None) -> list[Input]:
        if self.declines and isinstance(self._page, PageScreen) and self._session.part.part.plan.agree:
            t_ns = self._clock() + 1_000_000_000
            self._clock.advance_to(t_ns)
            spot = (t_ns, 0.5, 0.5, "decline")
            return [PointerPressed(*spot), PointerReleased(*spot)]
        inputs = super().wait(until_ns)
        self._taken += bool(inputs) and isinstance(self._page, PlayScreen | TrialScreen)
        if self._taken == self.kill_after:
            aside = self.folder.with_name(f"{self.folder.name}.aside")
            shutil.copytree(self.folder, aside)
            raise _Killed
        if self._taken == self.quit_after:
            return [Stop(self._clock(), "window_closed")]
        return inputs


def _play(
    protocol: Protocol,
    plan: SessionPlan,
    data: Path,
    person: str,
    rng: np.random.Generator,
    *,
    started_ns: int,
    kill_after: int = -1,
    quit_after: int = -1,
    declines: bool = False,
) -> tuple[Path | None, str]:
    clock = VirtualClock()
    offset = {"utc_offset_min": "-480"}
    facts = {"player": person, "player_seed": "1", **collect_machine_facts(), **offset, "window": "simulated"}
    session = build_session(plan, World, facts, picture_px=None)
    recorder = DeferredRecorder(plan, lambda: McapRecorder(data, session.plan, started_ns=started_ns))
    window = _Window(make_participant(person, rng), session, clock)
    window.kill_after, window.quit_after, window.declines = kill_after, quit_after, declines
    window.folder = session_folder(data, plan.study, plan.participant.id, plan.session)
    try:
        path = run_session(session, window, recorder, clock, agent=make_agent_host(protocol, plan, data, patient=True))
    except _Killed:
        shutil.rmtree(window.folder)
        window.folder.with_name(f"{window.folder.name}.aside").rename(window.folder)
        return window.folder, "killed"
    if path is not None:
        record_log_end(path)
    return path, session.end_reason


def _play_session(
    protocol: Protocol, data: Path, code: str | None, session: int, course: Course, place: int, person: str
) -> tuple[str, str]:
    """Play a session to its end, however often it is killed before; return the code and the end's reason."""
    rng = np.random.default_rng([place, session])
    started_ns = MONDAY_NS + place * HOUR_NS + (session - 1) * DAY_NS
    kills = [after for number, after in course.kills if number == session]
    kills += [7] if course.cut == session else []
    for turn, after in enumerate([*kills, -1]):
        plan = plan_next_session(protocol, data, participant=code, session=session, any_day=session > 1)
        code = plan.participant.id
        quits = course.quits == session and after == -1
        path, reason = _play(
            protocol, plan, data, person, rng,
            started_ns=started_ns + turn * HOUR_NS // 3, kill_after=after, quit_after=15 if quits else -1,
            declines=course.declines,
        )  # fmt: skip
        if path is None:
            free_slot(data / plan.study, code, reason)
        if reason != "killed" or (course.cut == session and turn + 1 == len(kills)):
            return code, reason
    raise AssertionError("the last turn ends")


def play_study(toml: Path, data: Path, people: int, players: Sequence[str] = PLAYERS) -> Path:
    """Play a protocol with so many people, simulated by players in turn; return the study's folder."""
    protocol = read_protocol(toml)
    study = data / protocol.study.name
    sessions = max(len(protocol.sessions), 1)
    for place in range(people):
        course = COURSES[place % len(COURSES)]
        code, reason = None, "complete"
        for session in range(1, min(sessions, course.sessions) + 1):
            code, reason = _play_session(protocol, data, code, session, course, place, players[place % len(players)])
            if course.withdraws_after == session:
                withdraw_participant(study, code, seal=None, note=AuditNote("asked for it", "e1"))
                reason = "withdrawn"
            if reason != "complete":
                break
        if course.replaced:
            replace_participant(study, code, AuditNote("did not come", "e1"))
        for session, episode in course.marks:
            _mark(study / str(code) / f"ses-{session:02d}", episode)
    return study


def _mark(folder: Path, episode: int | None) -> None:
    """What a reviewer writes: one mark that counts, one that was taken back, one that excludes nothing."""
    if not folder.is_dir():
        return
    log = read_log(folder)
    for mark in (
        Annotation("exclude", "2026-01-09T09:00:00Z", episode=episode, note="noise"),
        Annotation("seen", "2026-01-09T09:01:00Z"),
        Annotation("exclude", "2026-01-09T09:02:00Z", episode=1, note="a slip"),
        Annotation("exclude", "2026-01-09T09:03:00Z", episode=1, taken_back=True),
    ):
        add_annotation(log, mark)


def write_outputs(study: Path, out: Path, names: Collection[str] = OUTPUTS) -> None:
    """Write a study's report, exports, answers to queries, and what a notebook sees of it, a folder for each."""
    out.mkdir(parents=True, exist_ok=True)
    for name in names:
        folder = out / name
        match name:
            case "report":
                report(study, folder)
            case "query":
                folder.mkdir()
                whole = {table: f"select * from {table}" for table in ("episodes", "participants")}
                for file, sql in (QUERIES | whole).items():
                    arguments = ["query", str(study), sql, "--csv"]
                    answered = CliRunner().invoke(make_command_line(), arguments, catch_exceptions=False)
                    (folder / f"{file}.csv").write_text(answered.stdout, encoding="utf-8")
            case "notebook":
                folder.mkdir()
                (folder / "notebook.json").write_text(json.dumps(describe_notebook(study)))
            case _:
                export(name, study, folder)


def describe_notebook(study: Path) -> dict[str, Any]:
    """What ``open_study`` gives of every session and episode; each session is opened by its own key."""
    opened = open_study(study)
    sessions = [opened[session.participant, session.number] for session in opened]
    return {
        "exclusions": list(opened.exclusions),
        "sessions": [
            {
                "participant": one.participant, "group": one.group, "number": one.number, "player": one.player,
                "started_at": one.started_at, "end_reason": one.end_reason, "included": len(one),
                "segments": len(one.segments), "episodes": [describe_episode(episode) for episode in one.all_episodes],
            }
            for one in sessions
        ],
    }  # fmt: skip


def describe_episode(one: Episode) -> dict[str, Any]:
    names = ("number", "attempt", "block", "world", "seed", "outcome", "reward", "steps", "playing_s", "exclusion")
    arrays = {name: getattr(one, name).tolist() for name in ("times_s", "rewards", "reaction_ms", "path")}
    return {name: getattr(one, name) for name in names} | arrays


def recompute_outputs(study: Path, out: Path, names: Collection[str] = OUTPUTS) -> tuple[dict[str, list[int]], str]:
    """Compare the outputs by a program in which minihuman cannot be imported.

    Returns:
        Of each output how many numbers and words were compared and how many differ; and what it printed, its
        traceback first.
    """
    root = Path(__file__).parents[2]
    blocked = (
        f"import sys, runpy; sys.path.insert(0, {str(root)!r}); sys.modules['minihuman'] = None; "
        "runpy.run_module('tests.recompute', run_name='__main__', alter_sys=True)"
    )
    command = [sys.executable, "-I", "-W", "ignore", "-c", blocked, str(study), str(out), *names]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    told = f"{found.stderr[-4_000:]}{found.stdout[-12_000:]}"
    counts: dict[str, list[int]] = json.loads(found.stdout.splitlines()[-1]) if found.stdout else {}
    return counts, told
