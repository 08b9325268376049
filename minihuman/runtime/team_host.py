"""The team host: forms teams, lifts barriers and closes joint actions for the sessions of one process. No socket.

What it closes is the truth: a closed step never reopens. All it knows of an episode can be read from any member's
running session or log, so a server that was killed goes on from the longest of them.
"""

import math
import secrets
import threading
from bisect import bisect_left as bisect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.team.episode import TeamEpisode
from minihuman.activities.team.events import ActionSource, JointStepped, TeamEnded, TeamFormed
from minihuman.activities.team.message_events import MessageGiven, MessageShown
from minihuman.activities.team.messages import INTERVAL_NS
from minihuman.activities.team.plan import PERSON, SIMULATED, TeamPlan, TeamPlayPlan, find_seat_agent
from minihuman.activities.team.requests import (
    JointRequest,
    JointTaken,
    ReadyRequest,
    SeatsReady,
    Team,
    TeamJoined,
    TeamLost,
    TeamRequest,
)
from minihuman.admin.enrolment_entries import TeamRecorded, list_team_entries
from minihuman.admin.enrolment_log import now_text, record_team
from minihuman.admin.policies import PolicyStore
from minihuman.agents.agent import BaseAgent, is_registered_agent, make_agent, make_policy_agent
from minihuman.errors import AllocationError, WorldError
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.events import FINAL_END_REASONS, EpisodeStarted, SessionEnded
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import PART_SUFFIX, session_folder
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.read.session_reader import read_events
from minihuman.simulation.participant import make_participant
from minihuman.storage.system import monotonic_s
from minihuman.worlds.adapters.world import World

PRESENCE_S = 3.0  # who waits in a lobby asks several times a second
Row = tuple[tuple[int, ...], tuple[ActionSource, ...]]


def count_seats_at_machine(protocol: Protocol, group: str | None = None) -> int:
    """How many people sit at one machine: as many as its blocks of teams seat, where these say each seat's keys."""
    teams = [team for _, team in list_teams(protocol, group)]
    return max((len(team.persons) for team in teams if team.seat_keys), default=1)


def list_teams(protocol: Protocol, group: str | None) -> Iterator[tuple[str, TeamPlan]]:
    """The blocks' names and teams, in a group or in all."""
    for block in protocol.blocks:
        for name in [one.name for one in protocol.groups] if group is None else [group]:
            if (team := protocol.block_for(block.name, name).team) is not None:
                yield block.name, team


def require_one_process(protocol: Protocol, what: str, *, group: str | None = None, at_one_machine: int = 1) -> None:
    """Refuse a way to run a study in which its people would never meet.

    Args:
        protocol: the study.
        what: the way, and what to do instead, for the message.
        group: of the participant; None: any.
        at_one_machine: how many are there together.

    Raises:
        AllocationError: if several people sit in one world in a block of the group.
    """
    for block, team in list_teams(protocol, group):
        if (seats := len(team.persons)) not in (1, at_one_machine):
            raise AllocationError(f"block {block!r} is for {seats} people, who cannot play together {what}")


class SeatAgent:
    """An agent in one seat of one episode: follows the joint actions in a world of its own.

    Args:
        agent: chooses.
        plan: the episode, of any seat.
        team: whose index its random stream has.
        seat: the agent's.
        seed: the study's.
    """

    def __init__(self, agent: BaseAgent, plan: EpisodePlan, team: Team, seat: int, seed: int) -> None:
        self._world = World(plan.world, {**plan.options, "seat": seat})
        self._world.reset(plan.seed)
        self._agent, self._seat, self._steps, self._asked = agent, seat, 0, 0  # asked: in how many states so far
        self._stream = f"team-agent-{plan.block_name}-{plan.episode_in_block}-{seat}"
        self._seed, self._index = seed, team.index
        agent.begin(plan, self._world)

    def choose(self, rows: Sequence[Row]) -> int:
        """The action that follows these joint actions.

        Raises:
            WorldError: if the agent gives no chance to any action.
        """
        for actions, _ in rows[self._steps :]:
            if self._asked == self._steps:  # an agent with a memory has to see every state, and each once
                self._ask()
            self._world.unwrapped.joint = actions
            self._world.step(actions[self._seat])
            self._steps += 1
        chances = self._ask()
        if chances.shape != (len(self._world.action_names),) or not chances.sum() > 0:
            raise WorldError(
                f"the agent of seat {self._seat} must give a probability for each action, at least one of them above 0"
            )
        purpose = f"{self._stream}-{self._steps}"
        word = int(draw_words(1, seed=self._seed, purpose=purpose, index=self._index)[0])
        sums = np.cumsum(chances)
        return min(int(np.searchsorted(sums, (word >> 11) / 2**53 * sums[-1], side="right")), len(sums) - 1)

    def _ask(self) -> NDArray[np.float64]:
        self._asked = self._steps + 1
        return np.asarray(self._agent.action_probabilities(self._world), np.float64)

    def close(self) -> None:
        """Close its world."""
        self._world.close()


class _SimulatedAgent(BaseAgent):
    """A simulated participant in a seat: acts by the keys that it presses, and idles at a key without an action."""

    def __init__(self, argument: str, rng: np.random.Generator, pool: tuple[str, ...]) -> None:
        super().__init__(argument)
        self._participant, self._pool = make_participant(argument, rng), pool

    def begin(self, plan: EpisodePlan, world: World) -> None:
        self._keys: Mapping[str, str] = plan.key_map.keys
        self._participant.begin(plan, self._pool, world)

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        press, names = self._participant.press(world), world.action_names
        name = "" if press is None else self._keys.get(press.key, "")
        number: int = names.index(name) if name in names else world.unwrapped.team.idle_action
        return np.array([action == number for action in range(len(names))], np.float32)


@dataclass(slots=True)
class _Waiting:
    """A session in the lobby."""

    member: "TeamMember"
    before: tuple[str, ...]
    since_s: float
    asked_s: float = 0.0  # when it asked last: who is gone is not paired
    team: Team | None = None


@dataclass(slots=True)
class _TeamState:
    """A team that plays: its closed steps, and what is open."""

    team: Team  # of seat 0
    rules: TeamPlayPlan
    members: "dict[int, TeamMember]" = field(default_factory=dict)  # by seat, whose sessions are here
    ready: dict[int, set[int]] = field(default_factory=dict)  # by episode, the seats that are
    ready_since_s: dict[int, float] = field(default_factory=dict)
    rows: dict[int, list[Row]] = field(default_factory=dict)  # by episode
    open_step: tuple[int, int] = (-1, 0)  # episode and step
    inputs: dict[int, int] = field(default_factory=dict)  # of the open step, by seat
    open_since_s: float = 0.0
    keyed_s: dict[int, float] = field(default_factory=dict)  # by seat, when a key of its person's came last
    away: set[int] = field(default_factory=set)  # seats that the stand-in has
    left: bool = False  # a partner left, and the block ends
    declined: bool = False  # one left before the first step
    agents: dict[int, SeatAgent] = field(default_factory=dict)  # of the present episode, by seat
    agents_of: int = -1
    sent: dict[str, tuple[MessageShown, float]] = field(default_factory=dict)  # by digest, with when they came

    @property
    def is_over(self) -> bool:
        """Whether it never played and never will: its people go back to the lobby."""
        return self.declined and not any(self.rows.values())


class TeamTable:
    """All teams of a study in this process. Called by the threads of several sessions.

    Args:
        protocol: the study.
        data: the data folder.
        now_s: the clock that waiting is measured by.
        gather: pair only when so many sessions wait or are over, which makes a simulation's teams repeatable.
    """

    def __init__(
        self, protocol: Protocol, data: Path, now_s: Callable[[], float] = monotonic_s, *, gather: int = 0
    ) -> None:
        self._gather = gather
        self._protocol, self._study_dir, self._data = protocol, data / protocol.study.name, data
        self._now_s = now_s
        self.lock = threading.Condition(threading.RLock())  # notified of every change
        self._lobbies: dict[str, list[_Waiting]] = {}  # by block
        self._teams: dict[tuple[str, int, str], _TeamState] = {}  # by team, session and block, as long as they play
        self._policies = PolicyStore(self._study_dir)

    def depart(self) -> None:
        """One of those who are gathered comes to no further lobby."""
        with self.lock:
            self._gather -= 1
            self.lock.notify_all()

    def _tell(self, members: "Iterable[TeamMember]") -> None:
        self.lock.notify_all()
        for member in tuple(members):
            member.changed()

    # Forming

    def join(self, want: TeamRequest, member: "TeamMember") -> Team | TeamLost | None:
        """The team of a member, once there is one."""
        plan = want.plan.team
        if len(plan.persons) == 1:
            seed, index = self._protocol.study.seed, member.plan.participant.index
            name, seat = _name_team(seed, index, solo=True), plan.persons[0]
            self._record(want.block, name, index, {seat: member}, plan.seats, solo=True)
            return Team(name, index, seat, plan.seats)
        lobby = self._lobbies.setdefault(want.block, [])
        mine = next((one for one in lobby if one.member is member), None)
        if mine is None:
            if (known := self._find_recorded(want, member)) is not None:
                return known
            mine = _Waiting(member, want.before, self._now_s())
            lobby.append(mine)
        mine.asked_s = self._now_s()
        if self._gather:
            if sum(one.team is None for one in lobby) < self._gather:
                return None if mine.team is None else self._leave_lobby(lobby, mine)
            for one in sorted(lobby, key=lambda one: one.member.plan.participant.index):
                if one.team is None and (partners := self._match(plan, lobby, one)) is not None:
                    self._form(want, plan, partners)
        elif mine.team is None and (partners := self._match(plan, lobby, mine)) is not None:
            self._form(want, plan, partners)
        if mine.team is not None:
            return self._leave_lobby(lobby, mine)
        if not self._gather and self._now_s() - mine.since_s < plan.lobby_s:
            return None
        lobby.remove(mine)
        if plan.partner_leaves == "end":
            return TeamLost(0, "no_partner")
        return self._form(want, plan, [mine])[0]

    def _leave_lobby(self, lobby: list[_Waiting], mine: _Waiting) -> Team | None:
        lobby.remove(mine)
        return mine.team

    def _match(self, plan: TeamPlan, lobby: list[_Waiting], mine: _Waiting) -> list[_Waiting] | None:
        """Who plays with whom: all seats of people filled, this one among them; None as long as not."""
        count = len(plan.persons) - 1
        here_s = self._now_s() - PRESENCE_S if not self._gather else 0.0
        others = [one for one in lobby if one is not mine and one.team is None and one.asked_s >= here_s]
        index, group = mine.member.plan.participant.index, mine.member.plan.participant.group
        others = [one for one in others if one.member.plan.participant.group == group]
        if plan.pairing == "fixed":
            size, ranks = len(plan.persons), self._ranks(group)
            others = [one for one in others if ranks(one) // size == ranks(mine) // size]
        elif plan.pairing == "same" and mine.before:
            others = [one for one in others if one.before[-1:] == mine.before[-1:]]
        elif plan.pairing == "round_robin":
            others = [one for one in others if not set(one.before) & set(mine.before)]
        if len(others) < count:
            return None
        if plan.pairing in ("drawn", "round_robin"):
            seed, purpose = self._protocol.study.seed, f"pairing-{len(lobby)}"
            others.sort(key=lambda one: one.member.plan.participant.index)
            order = draw_permutation(len(others), seed=seed, purpose=purpose, index=index)
            others = [others[place] for place in order]
        return sorted([mine, *others[:count]], key=lambda one: one.member.plan.participant.index)

    def _ranks(self, group: str) -> Callable[[_Waiting], int]:
        """The order in which a group's places of the allocation list are taken."""
        places = [slot.index for slot in build_allocation_list(self._protocol) if slot.group == group]
        return lambda one: bisect(places, one.member.plan.participant.place)

    def _form(self, want: TeamRequest, plan: TeamPlan, partners: list[_Waiting]) -> list[Team]:
        seed, entries = self._protocol.study.seed, list_team_entries(self._study_dir)
        again = {one.before[-1:] for one in partners} if plan.pairing == "same" else set()
        kept = [entry.index for entry in entries if not entry.solo and {(entry.team,)} == again]
        index = kept[0] if kept else 1 + max((entry.index for entry in entries if not entry.solo), default=-1)
        name = _name_team(seed, index, solo=False)
        seats = [*plan.persons]
        order = draw_permutation(len(seats), seed=seed, purpose=f"seats-{want.block}", index=index)
        placed = {seats[order[place]]: one for place, one in enumerate(partners)}
        kinds = tuple(
            kind if kind != PERSON or seat in placed else plan.stand_in for seat, kind in enumerate(plan.seats)
        )
        self._record(want.block, name, index, {seat: one.member for seat, one in placed.items()}, kinds)
        for seat, one in placed.items():
            one.team = Team(name, index, seat, kinds)
        self._tell(one.member for one in partners)
        return [one.team for one in partners if one.team is not None]

    def _record(
        self,
        block: str,
        name: str,
        index: int,
        members: "dict[int, TeamMember]",
        seats: Sequence[str],
        *,
        solo: bool = False,
    ) -> None:
        session = next(iter(members.values())).plan.session
        codes = {str(seat): member.plan.participant.id for seat, member in members.items()}
        record_team(self._study_dir, TeamRecorded(name, index, block, session, codes, tuple(seats), now_text(), solo))

    def _find_recorded(self, want: TeamRequest, member: "TeamMember") -> Team | None:
        """The team that a member was recorded in before this process began, or before a page was lost."""
        code, session = member.plan.participant.id, member.plan.session
        for entry in reversed(list_team_entries(self._study_dir)):
            seat = next((int(seat) for seat, of in entry.members.items() if of == code), None)
            state = self._teams.get((entry.team, entry.session, entry.block))
            is_open = not entry.solo and not (state is not None and state.is_over)
            if is_open and seat is not None and (entry.block, entry.session) == (want.block, session):
                return Team(entry.team, entry.index, seat, entry.seats)
        return None

    # Playing

    def take_seat(self, team: Team, block: str, rules: TeamPlayPlan, member: "TeamMember") -> _TeamState:
        """What is known of a member's team in a block."""
        key = (team.team, member.plan.session, block)
        state = self._teams.get(key)
        if state is None:
            state = self._teams[key] = _TeamState(team, rules)
            self._restore(state, key)
        state.members[team.seat] = member
        return state

    def _restore(self, state: _TeamState, key: tuple[str, int, str]) -> None:
        """What the logs of a team that still plays hold of this block, where a process before this one closed it.

        Where every session of the team was over, it begins the episode anew that it did not complete.
        """
        people, done = self._people(state), set[int]()
        segments = {
            (int(started_ns), path, int(seat))
            for entry in list_team_entries(self._study_dir)
            if (entry.team, entry.session, entry.block) == key
            for seat, code in entry.members.items()
            for path in session_folder(self._data, self._protocol.study.name, code, entry.session).glob("*.mcap*")
            for started_ns in read_segment_starts(path, first=True).values()
        }
        until_ns = 0.0  # when the last of the sessions so far ended
        for start_ns, path, seat in [*sorted(segments), (math.inf, None, 0)]:
            if start_ns > until_ns or len(people) == 1:
                state.rows.clear()
                state.left = False
            if path is None:
                break
            joined, ours, end_ns = False, False, start_ns
            for event in read_events(path):
                end_ns = start_ns + event.t_ns
                match event:
                    case TeamFormed():
                        joined = event.team == key[0]
                    case EpisodeStarted():
                        ours = joined and event.plan.block_name == key[2]
                    case JointStepped() if ours:
                        rows = state.rows.setdefault(event.episode, [])
                        if event.step == len(rows) + 1:
                            rows.append((event.actions, event.sources))  # type: ignore[arg-type]
                    case TeamEnded() if ours:
                        state.left |= event.reason == "partner_left"
                    case SessionEnded() if event.reason in FINAL_END_REASONS:
                        done.add(seat)
            until_ns = max(until_ns, math.inf if path.name.endswith(PART_SUFFIX) else end_ns)
        for _, sources in state.rows[max(state.rows)][-1:] if state.rows else ():
            state.away = {seat for seat in people if sources[seat] == "agent"}
        if done:
            self._replace(state, done)

    def ready(self, want: ReadyRequest, member: "TeamMember") -> SeatsReady | TeamLost | None:
        """Whether an episode may begin."""
        state, episode, now_s = (
            self.take_seat(want.team, want.plan.block_name, want.rules, member),
            want.plan.episode,
            self._now_s(),
        )
        if state.is_over or state.left:
            return TeamLost(0, "declined" if state.is_over else "partner_left")
        if not self._may_return(state, want.team.seat) and state.rules.team.partner_return == "end":
            return TeamLost(0, "replaced")
        state.away.discard(want.team.seat)
        state.keyed_s[want.team.seat] = now_s
        here = state.ready.setdefault(episode, set())
        here.add(want.team.seat)
        since_s = state.ready_since_s.setdefault(episode, now_s)
        missing = self._people(state) - here - state.away
        if missing and not state.rows.get(episode):
            if now_s - since_s < state.rules.team.partner_wait_s:
                return None
            if not self._replace(state, missing):
                return TeamLost(0, "partner_left")
        self._tell(one for one in state.members.values() if one is not member)
        return SeatsReady(0, episode)

    def close_step(self, want: JointRequest, play: TeamEpisode, member: "TeamMember") -> JointTaken | TeamLost | None:
        """The joint action of a step, once every seat's input is there or its time is over."""
        state, episode, now_s = (
            self.take_seat(want.team, want.plan.block_name, want.rules, member),
            want.plan.episode,
            self._now_s(),
        )
        rows, seat = state.rows.setdefault(episode, []), want.team.seat
        rows += zip(play.joint_actions[len(rows) :], play.sources[len(rows) :], strict=True)
        may_return, absent = self._may_return(state, seat), self._is_absent(state, want, now_s)
        if want.action is not None and not may_return and state.rules.team.partner_return == "end":
            return TeamLost(0, "replaced")
        if want.step <= len(rows):
            if want.is_key and play.real_time and may_return:  # too late for this tick, in time for the next one
                state.away.discard(seat)
            actions, sources = rows[want.step - 1]
            return JointTaken(0, episode, want.step, actions, sources)
        if state.left:
            return TeamLost(0, "partner_left")
        if state.open_step != (episode, want.step):
            state.open_step, state.inputs = (episode, want.step), {}
        if absent and seat not in state.away and not self._replace(state, {seat}):
            return TeamLost(0, "partner_left")
        if want.action is not None and may_return and not absent:
            if not state.inputs:
                state.open_since_s = now_s
            state.away.discard(seat)
            state.inputs.setdefault(seat, want.action)
        if not state.inputs:
            return None
        missing = self._people(state) - state.inputs.keys() - state.away
        waited_s = now_s - state.open_since_s
        late: set[int] = set()
        if missing:
            if waited_s >= state.rules.team.partner_wait_s:
                if not self._replace(state, missing):
                    return TeamLost(0, "partner_left")
            elif play.real_time and waited_s * 1000 >= state.rules.team.late_ms:
                late = missing
            else:
                return None
        rows.append(self._decide(state, want.plan, play, late))
        self._tell(one for one in state.members.values() if one is not member)
        actions, sources = rows[-1]
        return JointTaken(0, episode, want.step, actions, sources)

    def pass_on(self, want: JointRequest, member: "TeamMember") -> MessageGiven | None:
        """The next of the others' messages that a seat has not received; words wait for it, a mark does not."""
        state, now_s = self.take_seat(want.team, want.plan.block_name, want.rules, member), self._now_s()
        if new := [message for message in want.sent if message.digest not in state.sent]:
            state.sent |= {message.digest: (message, now_s) for message in new}
            self._tell(one for one in state.members.values() if one is not member)
        others = [sent for sent in state.sent.values() if sent[0].seat != want.team.seat]
        due = (one for one, since_s in others if one.text or now_s - since_s < INTERVAL_NS / 1e9)
        return next((MessageGiven(0, one) for one in due if one.digest not in want.received), None)

    def _decide(self, state: _TeamState, plan: EpisodePlan, play: TeamEpisode, late: set[int]) -> Row:
        if state.agents_of != plan.episode:
            self._close_agents(state)
            state.agents_of = plan.episode
        actions: list[int] = []
        sources: list[ActionSource] = []
        idle: int = play.world.unwrapped.team.idle_action
        for seat, kind in enumerate(state.team.seats):
            if seat in state.inputs:
                actions.append(state.inputs[seat])
                sources.append("person")
            elif seat in late:
                actions.append(idle)
                sources.append("late")
            else:
                if seat not in state.agents:
                    name = find_seat_agent(state.rules.team.stand_in if kind == PERSON else kind)
                    seed = self._protocol.study.seed
                    agent = self._load(name, f"simulated-{plan.episode}-{seat}", state.team)
                    state.agents[seat] = SeatAgent(agent, plan, state.team, seat, seed)
                actions.append(state.agents[seat].choose(state.rows[plan.episode]))
                sources.append("agent")
        return tuple(actions), tuple(sources)

    def _load(self, name: str, purpose: str, team: Team) -> BaseAgent:
        what, _, player = name.partition(":")
        if what == SIMULATED:
            [word] = draw_words(1, seed=self._protocol.study.seed, purpose=purpose, index=team.index)
            return _SimulatedAgent(player, np.random.default_rng(int(word)), self._protocol.keys.pool)
        if is_registered_agent(name):
            return make_agent(name)
        return make_policy_agent(self._policies.checked(self._policies.keep(self._protocol.files[name])))

    def _people(self, state: _TeamState) -> set[int]:
        return {seat for seat, kind in enumerate(state.team.seats) if kind == PERSON}

    def _may_return(self, state: _TeamState, seat: int) -> bool:
        """Whether a seat is its person's, or is theirs again: who watches has it back if nobody else acts."""
        rule, others = state.rules.team.partner_return or "seat", self._people(state) - state.away
        return seat not in state.away or rule == "seat" or (rule == "watch" and not others)

    def _is_absent(self, state: _TeamState, want: JointRequest, now_s: float) -> bool:
        """Whether a page gives its seat's idle action at each tick while its person presses no key."""
        if want.is_key:
            state.keyed_s[want.team.seat] = now_s
        since_s = state.keyed_s.setdefault(want.team.seat, now_s)
        gone = want.team.seat in state.away or now_s - since_s >= state.rules.team.partner_wait_s
        others = self._people(state) - state.away - {want.team.seat}
        return want.action is not None and not want.is_key and gone and bool(others)

    def _replace(self, state: _TeamState, missing: set[int]) -> bool:
        """Give seats to the stand-in; False where the block ends instead."""
        if state.rules.team.partner_leaves == "end":
            state.left = True
            self._tell(state.members.values())
            return False
        state.away |= missing
        return True

    def leave(self, member: "TeamMember") -> None:
        """A member's session is over: nobody waits for its input any more."""
        with self.lock:
            for lobby in self._lobbies.values():
                lobby[:] = [one for one in lobby if one.member is not member]
            for key, state in list(self._teams.items()):
                for seat in [seat for seat, one in state.members.items() if one is member]:
                    del state.members[seat]
                    state.declined |= state.rules.team.pairing not in ("same", "fixed") and not any(state.rows.values())
                    self._replace(state, {seat})
                    self._tell(state.members.values())
                if not state.members:
                    self._close_agents(self._teams.pop(key))

    def _close_agents(self, state: _TeamState) -> None:
        for agent in state.agents.values():
            agent.close()
        state.agents.clear()


def _name_team(seed: int, index: int, *, solo: bool) -> str:
    """A team's id: random, and the same where the study is simulated again."""
    word = int(draw_words(1, seed=seed, purpose="solo-team-id" if solo else "team-id", index=index)[0])
    return f"{word:016x}"[:8]


class TeamMember(RequestHandler):
    """Answers one session's requests for its team, and hands others on.

    Args:
        table: the study's teams.
        plan: the session.
        then: answers the other requests; None where there are none.
        patient: wait for the others instead of saying that nothing is there yet.
        changed: called when another member's input may have an answer for this one.
    """

    def __init__(
        self,
        table: TeamTable,
        plan: SessionPlan,
        then: RequestHandler | None,
        *,
        patient: bool = False,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.table, self.plan, self.changed = table, plan, changed
        self._then, self._patient = then, patient

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """The team, the start of an episode or a joint action; None as long as others are waited for."""
        if not isinstance(want, TeamRequest | ReadyRequest | JointRequest):
            return None if self._then is None else self._then.answer(want, play, t_ns)
        waits = self._patient and not (isinstance(want, JointRequest) and want.action is None)
        with self.table.lock:
            while (found := self._ask(want, play)) is None and waits:
                self.table.lock.wait(timeout=0.5)
            if isinstance(found, Team) and isinstance(want, TeamRequest):
                self.table.take_seat(found, want.block, want.plan, self)
                writes = want.plan.team.chat and not self._patient
                return TeamJoined(t_ns, found, secrets.token_hex(16) if writes else "")
        return None if found is None or isinstance(found, Team) else replace(found, t_ns=t_ns)

    def _ask(
        self, want: TeamRequest | ReadyRequest | JointRequest, play: RunningEpisode | None
    ) -> Team | SeatsReady | JointTaken | TeamLost | MessageGiven | None:
        match want:
            case TeamRequest():
                return self.table.join(want, self)
            case ReadyRequest():
                return self.table.ready(want, self)
            case JointRequest() if isinstance(play, TeamEpisode):
                return self.table.pass_on(want, self) or self.table.close_step(want, play, self)
        return None

    def close(self) -> None:
        """The session is over."""
        self.table.leave(self)
        if self._then is not None:
            self._then.close()
