"""What answers a session's requests from outside: made by the hosts that the plans of its parts name."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import SegmentPath
from minihuman.runtime.team_host import TeamTable


@dataclass(frozen=True, slots=True)
class HostContext:
    """What the host of a part knows of its session.

    Args:
        protocol: the study.
        plan: the session's segment.
        data: the data folder.
        patient: wait for the learner and for partners, as no participant waits.
        logged: the events so far of a segment that is resumed.
        teams: those of this process; None: the session's own, where only agents can sit beside its person.
        changed: called when a member of the session's team did something that may answer a request of it.
        signs: of life, of the page that the session is in; None: it is in none.
    """

    protocol: Protocol
    plan: SessionPlan
    data: Path
    patient: bool = False
    logged: Sequence[Event] = ()
    teams: TeamTable | None = None
    changed: Callable[[], None] = field(default=lambda: None)
    signs: LifeSigns | None = None

    def list_logs(self) -> list[Path]:
        """List the files of the session's segment that are there now."""
        path = SegmentPath.of_plan(self.data, self.plan)
        return [file for file in (path.log, path.part) if file.exists()]


class SessionHosts(RequestHandler):
    """Hands each request to the host that answers it."""

    def __init__(self, hosts: Sequence[RequestHandler]) -> None:
        self._hosts = tuple(hosts)

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Return the first answer of a host; None as long as none has one."""
        answers = (host.answer(want, play, t_ns) for host in self._hosts)
        return next((answer for answer in answers if answer is not None), None)

    def close(self) -> None:
        """Close each host."""
        for host in self._hosts:
            host.close()


def make_session_host(context: HostContext) -> RequestHandler | None:
    """Make what answers a session's requests; None where no part of it asks for anything."""
    hosts = [make(context) for make in _load_makers(context.plan)]
    if len(hosts) > 1:
        return SessionHosts(hosts)
    return hosts[0] if hosts else None


def _load_makers(plan: SessionPlan) -> Iterator[Callable[[HostContext], RequestHandler]]:
    """Load the makers of hosts that a session's parts name, each once."""
    for place in dict.fromkeys(getattr(part.plan, "host", "") for part in plan.parts):
        if place:
            module, _, name = place.partition(":")
            yield getattr(import_module(module), name)
