"""The team host: forms teams, lifts barriers and closes joint actions for the sessions of one process. No socket.

It drives the lobbies and the play of each team, which use no clock, thread or file. A joint step that it has closed is
final and never reopens. Everything that it knows of an episode can be read from any member's running session or log, so
a restarted server continues from the longest of them.
"""

import secrets
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.activities.team.episode import TeamEpisode
from minihuman.activities.team.joint_play import JointPlay
from minihuman.activities.team.joint_step import StepDue
from minihuman.activities.team.lobby import Lobby, LobbyEntry, RecordedTeam, name_team
from minihuman.activities.team.message_events import MessageGiven
from minihuman.activities.team.plan import PERSON, TeamPlayPlan
from minihuman.activities.team.requests import (
    JointRequest,
    JointTaken,
    ReadyRequest,
    SeatSighted,
    SeatsReady,
    Team,
    TeamJoined,
    TeamLost,
    TeamRequest,
)
from minihuman.admin.enrolment_entries import TeamRecorded, list_team_entries
from minihuman.admin.enrolment_log import record_team
from minihuman.admin.policies import PolicyStore
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.moved import forward_names
from minihuman.runtime.seat_agents import SeatAgents
from minihuman.runtime.team_history import TeamBlockKey, read_team_history
from minihuman.storage.system import monotonic_s, now_text

PRESENCE_S = 3.0  # how long a person without a request counts as present; one who waits asks several times a second
_RECHECK_S = 0.5  # after which a patient member asks again without having been notified


@dataclass(slots=True)
class RunningTeam:
    """A team that is playing in this process."""

    play: JointPlay
    agents: SeatAgents
    members: "dict[int, TeamMember]" = field(default_factory=dict)  # by seat; only those with sessions in this process


class TeamTable:
    """All teams of a study in this process. The threads of several sessions call it.

    Args:
        protocol: the study.
        data: the data folder.
        now_s: the clock that measures waiting.
        gather: pair people only when this many sessions are waiting or over, which makes a simulation's teams
            repeatable.
    """

    def __init__(
        self, protocol: Protocol, data: Path, now_s: Callable[[], float] = monotonic_s, *, gather: int = 0
    ) -> None:
        self._gather = gather
        self._protocol = protocol
        self._study_dir = data / protocol.study.name
        self._data = data
        self._now_s = now_s
        self.lock = threading.Condition(threading.RLock())  # notified of every change
        self._lobbies: dict[str, Lobby[TeamMember]] = {}  # by block
        self._teams: dict[TeamBlockKey, RunningTeam] = {}  # the teams that are playing
        self._policies = PolicyStore(self._study_dir)

    def read_clock_s(self) -> float:
        """Return the time, in seconds, of the clock that measures waiting."""
        return self._now_s()

    def depart(self) -> None:
        """Expect one session fewer in the lobbies, because one of the gathered sessions is over."""
        with self.lock:
            self._gather -= 1
            self.lock.notify_all()

    def _notify_members(self, members: "Iterable[TeamMember]") -> None:
        """Wake all threads that wait for the table, and report a change to these members' sessions."""
        self.lock.notify_all()
        for member in tuple(members):
            member.changed()

    def _notify_concerned(self, running: RunningTeam) -> None:
        """Notify the members whose next answer may differ from their last."""
        seats = running.play.pop_concerned()
        if seats:
            self._notify_members(member for seat, member in running.members.items() if seat in seats)

    # Forming

    def join(self, want: TeamRequest, member: "TeamMember") -> Team | TeamLost | None:
        """Enter a member in the block's lobby, and form its team if there are partners.

        Returns:
            The member's team; None while the member has to wait; ``TeamLost`` if no partner came.
        """
        if len(want.plan.team.persons) == 1:
            return self._form_alone(want, member)
        lobby = self._lobbies.get(want.block)
        if lobby is None:
            lobby = self._lobbies[want.block] = Lobby(want.block, self._protocol.study.seed, self._list_slot_indices)
        entry = lobby.find(member)
        if entry is None:
            recorded = self._find_recorded(want, member)
            if recorded is not None:
                return recorded
            now_s = self._now_s()
            entry = LobbyEntry(member, member.plan.participant, want.plan.team, want.before, now_s, now_s)
            lobby.enter(entry)
        entry.asked_s = self._now_s()
        if self._gather:
            if len(lobby.unpaired) >= self._gather:
                for unpaired in lobby.unpaired:
                    self._pair(want, lobby, unpaired, present_since_s=0.0)
            elif entry.team is None:
                return None
        else:
            self._pair(want, lobby, entry, present_since_s=self._now_s() - PRESENCE_S)
        return self._leave_lobby(want, lobby, entry)

    def _form_alone(self, want: TeamRequest, member: "TeamMember") -> Team:
        """Form and record the team of a person whose partners are all agents."""
        plan = want.plan.team
        index = member.plan.participant.index
        seat = plan.persons[0]
        name = name_team(self._protocol.study.seed, index, is_solo=True)
        self._record_team(want.block, name, index, {seat: member}, plan.seats, is_solo=True)
        return Team(name, index, seat, plan.seats)

    def _list_slot_indices(self, group: str) -> list[int]:
        """Return the indices of a group's slots in the allocation list, in order."""
        return [slot.index for slot in build_allocation_list(self._protocol) if slot.group == group]

    def _pair(
        self,
        want: TeamRequest,
        lobby: "Lobby[TeamMember]",
        entry: "LobbyEntry[TeamMember]",
        *,
        present_since_s: float,
    ) -> None:
        """Form a team with a waiting member of a lobby, if there are partners who asked since ``present_since_s``."""
        if entry.team is None:
            partners = lobby.match(entry, present_since_s)
            if partners is not None:
                self._form_team(want, lobby, partners)

    def _leave_lobby(
        self, want: TeamRequest, lobby: "Lobby[TeamMember]", entry: "LobbyEntry[TeamMember]"
    ) -> Team | TeamLost | None:
        """Return the team of a member, who then leaves the lobby; None while the member waits.

        After the longest wait, return a team with stand-ins, or ``TeamLost`` if the study ends such sessions.
        """
        rules = want.plan.team
        if entry.team is None:
            if not self._gather and self._now_s() - entry.since_s < rules.lobby_s:
                return None
            if rules.partner_leaves != "end":
                self._form_team(want, lobby, [entry])
        lobby.leave(entry.member)
        return entry.team or TeamLost(0, "no_partner")

    def _form_team(
        self, want: TeamRequest, lobby: "Lobby[TeamMember]", partners: "list[LobbyEntry[TeamMember]]"
    ) -> None:
        """Seat and record a team of waiting members, and notify them."""
        entries = list_team_entries(self._study_dir)
        recorded = [RecordedTeam(entry.team, entry.index) for entry in entries if not entry.solo]
        seated = lobby.seat(partners, recorded)
        self._record_team(want.block, seated.name, seated.index, seated.members, seated.kinds)
        seated.admit()
        self._notify_members(entry.member for entry in partners)

    def _record_team(
        self,
        block: str,
        name: str,
        index: int,
        members: "dict[int, TeamMember]",
        kinds: tuple[str, ...],
        *,
        is_solo: bool = False,
    ) -> None:
        """Write a new team to the study's team log."""
        session = next(iter(members.values())).plan.session
        codes = {str(seat): member.plan.participant.id for seat, member in members.items()}
        record_team(self._study_dir, TeamRecorded(name, index, block, session, codes, kinds, now_text(), is_solo))

    def _find_recorded(self, want: TeamRequest, member: "TeamMember") -> Team | None:
        """Return the recorded team of a member who returns after a restart or with a new page; None if none is open."""
        block_and_session = (want.block, member.plan.session)
        for entry in reversed(list_team_entries(self._study_dir)):
            if entry.solo or (entry.block, entry.session) != block_and_session:
                continue
            code = member.plan.participant.id
            seat = next((int(seat) for seat, seat_code in entry.members.items() if seat_code == code), None)
            running = self._teams.get(TeamBlockKey(entry.team, entry.session, entry.block))
            is_over = running is not None and running.play.is_over
            if seat is not None and not is_over:
                return Team(entry.team, entry.index, seat, entry.seats)
        return None

    # Playing

    def take_seat(self, team: Team, block: str, rules: TeamPlayPlan, member: "TeamMember") -> RunningTeam:
        """Seat a member in its team for a block; return the running team."""
        key = TeamBlockKey(team.team, member.plan.session, block)
        running = self._teams.get(key)
        if running is None:
            agents = SeatAgents(self._protocol, self._policies, team, rules.team)
            running = self._teams[key] = RunningTeam(JointPlay(team.seats, rules.team), agents)
            n_persons = team.seats.count(PERSON)
            running.play.restore(read_team_history(self._study_dir, self._data, key, n_persons=n_persons))
        if running.members.get(team.seat) is not member:
            running.members[team.seat] = member
            running.play.presence.follow(team.seat, member.signs)
        return running

    def answer_ready(self, want: ReadyRequest, member: "TeamMember") -> SeatsReady | TeamLost | None:
        """Record that a member is ready, and return the start of the episode once all members are; None before.

        Return ``TeamLost`` if the team has ended, or goes on without this member.
        """
        running = self.take_seat(want.team, want.plan.block_name, want.rules, member)
        answer = running.play.answer_ready(want, self._now_s())
        self._notify_concerned(running)
        return answer

    def answer_joint(
        self, want: JointRequest, episode: TeamEpisode, member: "TeamMember"
    ) -> MessageGiven | SeatSighted | JointTaken | TeamLost | None:
        """Return a message of another member, a change in how a seat is seen, or the joint action of a step.

        A step's joint action is available once every seat's input is, or the step's time is over. Return ``TeamLost``
        if the team has ended or goes on without this member, and None while there is nothing to return.
        """
        running = self.take_seat(want.team, want.plan.block_name, want.rules, member)
        now_s = self._now_s()
        answer: MessageGiven | SeatSighted | JointTaken | TeamLost | None = running.play.answer_message(want, now_s)
        if answer is None:
            answer = running.play.find_news(want, now_s, is_real_time=episode.real_time)
        if answer is None:
            answer = self._submit_input(running, want, episode)
        self._notify_concerned(running)
        return answer

    def _submit_input(
        self, running: RunningTeam, want: JointRequest, episode: TeamEpisode
    ) -> JointTaken | TeamLost | None:
        """Submit a member's input to the present step; return the joint action if that closes the step."""
        play = running.play
        play.learn_steps(want.plan.episode, episode.joint_actions, episode.sources)
        answer = play.submit(want, self._now_s(), is_real_time=episode.real_time)
        if not isinstance(answer, StepDue):
            return answer
        steps = play.list_steps(want.plan.episode)
        chosen = {seat: running.agents.choose(seat, want.plan, steps) for seat in answer.agents}
        idle_action: int = episode.world.unwrapped.team.idle_action
        return play.close(answer, want.team.seat, chosen, idle_action)

    def leave(self, member: "TeamMember") -> None:
        """Remove a member whose session is over, so that no one waits for its input any more."""
        with self.lock:
            for lobby in self._lobbies.values():
                lobby.leave(member)
            for key, running in list(self._teams.items()):
                seats = [seat for seat, seated in running.members.items() if seated is member]
                for seat in seats:
                    del running.members[seat]
                    member.signs.lose_page("closed", self._now_s())
                    running.play.leave(seat)
                    self._notify_concerned(running)
                if not running.members:
                    running.agents.close()
                    del self._teams[key]


class TeamMember(RequestHandler):
    """Answers one session's requests to its team.

    Args:
        table: the study's teams.
        plan: the session's plan.
        patient: whether to wait for the others instead of returning None while there is no answer.
        changed: called when another member's input may have answered this one's request.
        signs: the signs of life of the session's page; None if there is no page, so that each request counts as a sign.
    """

    def __init__(
        self,
        table: TeamTable,
        plan: SessionPlan,
        *,
        patient: bool = False,
        changed: Callable[[], None] = lambda: None,
        signs: LifeSigns | None = None,
    ) -> None:
        self.table = table
        self.plan = plan
        self.changed = changed
        self._patient = patient
        self._is_in_page = signs is not None
        self.signs = signs or LifeSigns()

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Return what answers a request to the team: the team, the start of an episode, a joint action or a message.

        Return None while others are awaited, and for a request that is not to the team. A patient member waits instead.

        Args:
            want: the request.
            play: the running episode; None if no episode is running.
            t_ns: the session's time, which the answer gets.
        """
        if not isinstance(want, TeamRequest | ReadyRequest | JointRequest):
            return None
        has_submitted = not isinstance(want, JointRequest) or want.action is not None
        with self.table.lock:
            answer = self._ask(want, play)
            while answer is None and self._patient and has_submitted:
                self.table.lock.wait(timeout=_RECHECK_S)
                answer = self._ask(want, play)
            if isinstance(answer, Team) and isinstance(want, TeamRequest):
                self.table.take_seat(answer, want.block, want.plan, self)
                chat_token = ""
                if want.plan.team.chat and not self._patient:
                    chat_token = secrets.token_hex(16)
                return TeamJoined(t_ns, answer, chat_token)
        if answer is None or isinstance(answer, Team):
            return None
        return replace(answer, t_ns=t_ns)

    def _ask(
        self, want: TeamRequest | ReadyRequest | JointRequest, play: RunningEpisode | None
    ) -> Team | SeatsReady | JointTaken | TeamLost | MessageGiven | SeatSighted | None:
        """Return the table's present answer to a request; None if there is none yet."""
        if not self._is_in_page:
            self.signs.hear(self.table.read_clock_s())
        match want:
            case TeamRequest():
                return self.table.join(want, self)
            case ReadyRequest():
                return self.table.answer_ready(want, self)
            case JointRequest() if isinstance(play, TeamEpisode):
                return self.table.answer_joint(want, play, self)
        return None

    def close(self) -> None:
        """Leave the team, because the session is over."""
        self.table.leave(self)


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
