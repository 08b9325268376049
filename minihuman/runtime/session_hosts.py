"""The handlers of a session's requests to agents and other participants; the plans of the session's parts name them."""

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
    """The session for which a part's host is made.

    Args:
        protocol: the study.
        plan: the plan of the session's segment.
        data: the data folder.
        patient: whether to wait for the learner and for partners, because no participant is waiting.
        logged: the events so far of a segment that is resumed.
        teams: the teams of this process; None to use the session's own, in which all partners are agents.
        changed: called when a member of the session's team did something that may answer one of its requests.
        signs: the signs of life of the session's page; None if the session is not in a page.
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
        """Return the existing log files of the session's segment."""
        path = SegmentPath.of_plan(self.data, self.plan)
        return [file for file in (path.log, path.part) if file.exists()]


class SessionHosts(RequestHandler):
    """Passes each request to the host that answers it."""

    def __init__(self, hosts: Sequence[RequestHandler]) -> None:
        self._hosts = tuple(hosts)

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Return the first answer that a host gives; None if no host has one yet."""
        answers = (host.answer(want, play, t_ns) for host in self._hosts)
        return next((answer for answer in answers if answer is not None), None)

    def close(self) -> None:
        """Close all hosts."""
        for host in self._hosts:
            host.close()


def make_session_host(context: HostContext) -> RequestHandler | None:
    """Make the handler of a session's requests; return None if no part of the session makes requests."""
    hosts = [make(context) for make in _load_makers(context.plan)]
    if len(hosts) > 1:
        return SessionHosts(hosts)
    return hosts[0] if hosts else None


def _load_makers(plan: SessionPlan) -> Iterator[Callable[[HostContext], RequestHandler]]:
    """Yield the functions that make the hosts that a session's parts name, each once."""
    for maker_path in dict.fromkeys(getattr(part.plan, "host", "") for part in plan.parts):
        if maker_path:
            module, _, name = maker_path.partition(":")
            yield getattr(import_module(module), name)
