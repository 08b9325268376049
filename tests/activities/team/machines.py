"""Two session machines beside one team table, on a clock of the test's own."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from minihuman.activities.team.activity import TeamPlayActivity
from minihuman.activities.team.events import JointStepped
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown, Stop, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.replay import resume_from_events
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.team_host import TeamTable
from minihuman.worlds.adapters.world import World

MS = 1_000_000


class Clock:
    """Seconds that a test turns on."""

    s = 0.0

    def __call__(self) -> float:
        return self.s


class Seat:
    """A person's session machine and the events that it emitted.

    Args:
        protocol: the study.
        data: the data folder.
        table: the teams.
        participant: who comes back; None: a new one.
        session: of the participant.
        hour: of the wall clock at which it begins.
        facts: of the session.
    """

    def __init__(
        self,
        protocol: Any,
        data: Path,
        table: TeamTable,
        *,
        participant: str | None = None,
        session: int = 1,
        hour: int = 0,
        facts: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.plan = plan_next_session(protocol, data, participant=participant, session=session, any_day=True)
        self._started_ns = 1 + hour * 3600 * 1000 * MS
        self.machine = SessionMachine(self.plan, World, facts, picture_px=None)
        self.host = make_agent_host(protocol, self.plan, data, teams=table)
        self._data, self._protocol = data, protocol
        self.events: list[Event] = []
        self.is_connected = True  # to the host
        self._now_ns = 0
        self.take(Tick(0))

    def take(self, *inputs: Input) -> None:
        for happened in inputs:
            self.events += self.machine.receive(happened)
        self.answer()

    def answer(self) -> None:
        """Ask the host for whatever the machine waits for."""
        while self.is_connected and not self.machine.over and (want := self.machine.request) is not None:
            given = self.host.answer(want, self.machine.play, self._now_ns)
            if given is None:
                return
            self.events += self.machine.receive(given)

    def wait(self, ms: float) -> None:
        """Let time pass, and whatever screen there is be seen."""
        self._now_ns += round(ms * MS)
        self.take(Tick(self._now_ns), ScreenShown(self._now_ns, self._now_ns, self._now_ns))

    def take_at(self, now_ns: int, *inputs: Input) -> None:
        """Take inputs that come at a time of the server's, and ask the host."""
        self._now_ns = now_ns
        if not self.machine.over:
            self.take(*inputs)

    def press(self, *keys: str) -> None:
        for key in keys:
            self._now_ns += MS
            self.take(KeyDown(self._now_ns, key))

    def to_play(self, *others: "Seat") -> None:
        """Press Enter and let time pass until all play."""
        for _ in range(40):
            for seat in (self, *others):
                if seat.machine.phase is not Phase.PLAYING:
                    seat.wait(20)
                    seat.press("enter")
            if all(seat.machine.phase is Phase.PLAYING for seat in (self, *others)):
                return
        raise AssertionError([seat.machine.phase for seat in (self, *others)])

    def stop(self, reason: str) -> None:
        """End the session from outside, so that nobody waits for it."""
        self._now_ns += MS
        self.events += self.machine.receive(Stop(self._now_ns, reason, ""))  # type: ignore[arg-type]
        self.host.close()

    def save(self) -> None:
        """Write the session's log."""
        recorder = McapRecorder(self._data, self.plan, started_ns=self._started_ns)
        recorder.write(self.events)
        log = recorder.close()
        if log is not None:
            record_log_end(log)

    def stop_and_save(self) -> None:
        """Stop the session in the middle; it can be resumed."""
        self.stop("connection_lost")
        self.save()

    def save_part(self) -> None:
        """Write the log as a server that is killed leaves it."""
        recorder = McapRecorder(self._data, self.plan, started_ns=self._started_ns)
        recorder.write(self.events)
        recorder.leave()

    def resume(self, table: TeamTable) -> None:
        """Go on from the log in another process, as after a kill."""
        self.machine, unwritten = resume_from_events(self.events, World, picture_px=None)
        self.events += unwritten
        self.host = make_agent_host(self._protocol, self.plan, self._data, teams=table)

    def of(self, kind: type) -> list[Any]:
        """The events of a kind."""
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def joint(self) -> list[tuple[int, ...]]:
        """The joint actions of the running or last episode."""
        return [event.actions for event in self.of(JointStepped)]

    @property
    def part(self) -> TeamPlayActivity:
        assert isinstance(self.machine.part, TeamPlayActivity)
        return self.machine.part


def sit_down(
    path: Path, data: Path, *, people: int = 2, facts: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[Seat], Clock, TeamTable]:
    """So many people of a study before their first key."""
    protocol, clock = read_protocol(path), Clock()
    table = TeamTable(protocol, data, clock)
    return [Seat(protocol, data, table, facts=facts) for _ in range(people)], clock, table
