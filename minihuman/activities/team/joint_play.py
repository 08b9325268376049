"""The play of one team in a block: it opens the barrier before each episode and closes the joint actions. No I/O.

The seats' requests and the time are passed in, and the answers are returned; agents' choices are requested from the
caller. The play combines who is present (`TeamPresence`), which inputs have come (`OpenStep`), how long the step has
been open (`StepClock`) and when the inputs were due (`TickSchedule`).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from minihuman.activities.team.events import ActionSource
from minihuman.activities.team.joint_step import JointAction, OpenStep, StepDue
from minihuman.activities.team.message_events import MessageGiven
from minihuman.activities.team.message_exchange import MessageExchange
from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.team.presence import TeamPresence
from minihuman.activities.team.requests import (
    JointRequest,
    JointTaken,
    ReadyRequest,
    SeatSighted,
    SeatsReady,
    TeamLost,
)
from minihuman.activities.team.step_clock import MS_PER_S, Delay, StepClock
from minihuman.activities.team.tick_schedule import TickSchedule

_UNSTAMPED_NS = 0  # the time of an answer until the caller stamps it with the session's own time


@dataclass(slots=True)
class ReadyBarrier:
    """The seats that are ready for an episode."""

    since_s: float  # when the first seat was ready
    seats: set[int] = field(default_factory=set)


@dataclass(slots=True)
class TeamHistory:
    """The history of a block that an earlier process hosted, as the team's logs record it."""

    steps: dict[int, list[JointAction]] = field(default_factory=dict)  # by episode
    has_ended: bool = False  # a partner left, and the block ended for it
    finished: set[int] = field(default_factory=set)  # seats whose session is over for good


class JointPlay:
    """The play of one team in one block.

    Args:
        kinds: by seat, "person" or the name of an agent.
        rules: the protocol's ``[blocks.team]`` table.
    """

    def __init__(self, kinds: tuple[str, ...], rules: TeamPlan) -> None:
        self._rules = rules
        self._steps: dict[int, list[JointAction]] = {}  # the closed steps, by episode
        self._barriers: dict[int, ReadyBarrier] = {}  # by episode
        self._open_step = OpenStep(len(kinds))
        self._clock = StepClock(rules.late_ms, rules.thinking_limit_s)
        self._schedules: dict[int, TickSchedule] = {}  # by episode
        self._concerned: set[int] = set()  # seats whose next answer may differ from their last
        self._has_declined = False  # a person of a newly paired team left before the first step
        self.presence = TeamPresence(kinds, rules)
        self.messages = MessageExchange()

    @property
    def is_over(self) -> bool:
        """Return whether the team ended before its first step, so that its people return to the lobby."""
        return self._has_declined and not self._has_played

    @property
    def _has_played(self) -> bool:
        return any(self._steps.values())

    def pop_concerned(self) -> set[int]:
        """Return the seats whose next answer may have changed since the last call."""
        seats = self._concerned
        self._concerned = set()
        return seats

    def restore(self, history: TeamHistory) -> None:
        """Restore the state that the logs record: closed steps, the block's end, and the seats that agents hold."""
        self._steps = history.steps
        self.presence.has_ended = history.has_ended
        latest_steps = self._steps[max(self._steps)] if self._steps else []
        if latest_steps:
            sources = latest_steps[-1].sources
            self.presence.restore(seat for seat in self.presence.persons if sources[seat] == "agent")
        if history.finished:
            self._hand_over(history.finished)

    def list_steps(self, episode: int) -> Sequence[JointAction]:
        """Return the closed steps of the episode with an index, in order."""
        return self._steps.setdefault(episode, [])

    def learn_steps(
        self, episode: int, actions: Sequence[tuple[int, ...]], sources: Sequence[tuple[ActionSource, ...]]
    ) -> None:
        """Add those steps of an episode that this play lacks, such as steps closed before this process began.

        Args:
            episode: the episode's index in the session.
            actions: for each step from the first, the action of each seat.
            sources: for each step from the first, who acted in each seat.
        """
        steps = self._steps.setdefault(episode, [])
        n_present = len(steps)
        new_steps = zip(actions[n_present:], sources[n_present:], strict=True)
        steps += [JointAction(step_actions, step_sources) for step_actions, step_sources in new_steps]

    # What seats ask

    def answer_ready(self, want: ReadyRequest, now_s: float) -> SeatsReady | TeamLost | None:
        """Record that a seat is ready for an episode and return whether the episode begins.

        Returns:
            ``SeatsReady`` if the episode begins, ``TeamLost`` if the team is lost; None while partners are awaited.
        """
        seat = want.team.seat
        episode = want.plan.episode
        if self.is_over:
            return TeamLost(_UNSTAMPED_NS, "declined")
        if self.presence.has_ended:
            return TeamLost(_UNSTAMPED_NS, "partner_left")
        if self.presence.is_shut_out(seat):
            return TeamLost(_UNSTAMPED_NS, "replaced")
        barrier = self._barriers.setdefault(episode, ReadyBarrier(now_s))
        if seat not in barrier.seats or not self.presence.has_acted(seat):
            self.presence.note_input(seat, now_s)
        barrier.seats.add(seat)
        if self.presence.has_returned(seat):
            self.presence.take_back(seat)
        self.presence.begin_wait({seat}, now_s)
        if not self._steps.get(episode):
            if not self._replace_missing(barrier, seat, now_s):
                return TeamLost(_UNSTAMPED_NS, "partner_left")
            if self.presence.present - barrier.seats:
                return None
        self._schedules.setdefault(episode, TickSchedule(now_s))
        self._concern_others(seat)
        return SeatsReady(_UNSTAMPED_NS, episode)

    def find_news(self, want: JointRequest, now_s: float, *, is_real_time: bool) -> SeatSighted | None:
        """Return the new visible state of a seat if it differs from what the requesting seat knows; None if none does.

        The seat returned may be the requesting seat itself.
        """
        news = self.presence.find_news(want.states, now_s, is_real_time=is_real_time)
        if news is None:
            return None
        return SeatSighted(_UNSTAMPED_NS, news.seat, news.state, round(news.for_s * MS_PER_S))

    def answer_message(self, want: JointRequest, now_s: float) -> MessageGiven | None:
        """Accept a seat's messages and return the next message that it has not received; None if there is none."""
        if self.messages.send(want.sent, now_s):
            self._concern_others(want.team.seat)
        message = self.messages.find_next(want.team.seat, want.received, now_s)
        if message is None:
            return None
        return MessageGiven(_UNSTAMPED_NS, message)

    def submit(self, want: JointRequest, now_s: float, *, is_real_time: bool) -> JointTaken | TeamLost | StepDue | None:
        """Accept a seat's input for a step and return the answer to it; None while other inputs are awaited.

        Args:
            want: the request, with the step and the input.
            now_s: the present time in seconds.
            is_real_time: whether steps happen by the clock, so that no tick waits for a late input.

        Returns:
            The joint action of a closed step, the loss of the team, or a step that is due: the caller asks its
            agents for their actions and passes them to `close`.
        """
        seat = want.team.seat
        episode = want.plan.episode
        if want.is_key and not self._open_step.has_submitted(seat, episode, want.step):
            self.presence.note_input(seat, now_s, is_held=want.is_held)
        schedule = self._schedules.setdefault(episode, TickSchedule(now_s))
        if want.action is not None:
            schedule.record_input(seat, want.step, now_s)
        if want.action is not None and self.presence.is_shut_out(seat):
            return TeamLost(_UNSTAMPED_NS, "replaced")
        is_back = want.is_key and self.presence.may_act(seat) and self.presence.has_returned(seat)
        steps = self.list_steps(episode)
        if want.step <= len(steps):
            if is_back:  # too late for this step, in time for the next one
                self.presence.take_back(seat)
            return _build_joint_taken(episode, want.step, steps[want.step - 1])
        if self.presence.has_ended:
            return TeamLost(_UNSTAMPED_NS, "partner_left")
        self._open_step.open(episode, want.step)
        overdue = self.presence.find_overdue(seat, now_s, is_real_time=is_real_time)
        if not self._hand_over(overdue, now_s):
            return TeamLost(_UNSTAMPED_NS, "partner_left")
        self._open_step.withdraw_idle(overdue)
        if want.action is not None and (is_back or seat in self.presence.present):
            if not self._open_step.has_input:
                self._clock.open(now_s)
            self.presence.take_back(seat)
            self._open_step.submit(seat, want.action, is_key=want.is_key)
        return self._judge_open_step(want, now_s, is_real_time=is_real_time)

    def close(self, due: StepDue, seat: int, agent_actions: Mapping[int, int], idle_action: int) -> JointTaken:
        """Close a step for good and return its joint action.

        Args:
            due: the step to close.
            seat: the seat whose request closes the step; it is answered at once.
            agent_actions: the agents' actions, by seat.
            idle_action: the action of a seat whose input is late.
        """
        joint_action = due.close(agent_actions, idle_action)
        self._steps[due.episode].append(joint_action)
        self._concern_others(seat)
        return _build_joint_taken(due.episode, due.step, joint_action)

    def leave(self, seat: int) -> None:
        """Record that the session of a seat is over, and give the seat to the stand-in or end the block.

        A newly paired team that has not played a step ends instead, so that its other people return to the lobby.
        """
        if self._rules.pairing not in ("same", "fixed") and not self._has_played:
            self._has_declined = True
        self._hand_over({seat})
        self._concerned |= self.presence.persons

    # How a step closes

    def _judge_open_step(self, want: JointRequest, now_s: float, *, is_real_time: bool) -> StepDue | TeamLost | None:
        """Return the open step if it can close, or the loss of the team; None while inputs are awaited.

        In real time, a step closes without late inputs. In turns, the seats of people who have thought for too long
        are given to the stand-in.
        """
        if not self._open_step.has_input:
            return None
        missing = self.presence.present - self._open_step.seats
        delay = self._find_delay(want, missing, now_s) if missing else "in_time"
        if is_real_time and delay != "in_time":
            return self._find_due(missing, now_s, is_real_time=True)
        if delay == "overdue":
            if not self._hand_over(self.presence.find_thinkers(missing, now_s), now_s):
                return TeamLost(_UNSTAMPED_NS, "partner_left")
            missing = self.presence.present - self._open_step.seats
        if missing:
            return None
        return self._find_due(frozenset(), now_s, is_real_time=is_real_time)

    def _find_due(self, late: frozenset[int], now_s: float, *, is_real_time: bool) -> StepDue:
        """Return the open step as it would close now, with the time since each person's last sign of life.

        Args:
            late: the seats whose input did not come in time.
            now_s: the present time in seconds.
            is_real_time: whether steps happen by the clock.
        """
        silent_ms = self.presence.measure_silence_ms(now_s, is_real_time=is_real_time)
        return replace(self._open_step.find_due(late), silent_ms=silent_ms)

    def _find_delay(self, want: JointRequest, missing: Collection[int], now_s: float) -> Delay:
        """Return how late the inputs of the ``missing`` seats are by the server's clock.

        The times that pages report do not count.
        """
        period_s = want.plan.step_period_ms / MS_PER_S
        due_s = self._schedules[want.plan.episode].find_due_s(missing, want.step, self._clock.opened_s, period_s)
        return self._clock.find_delay(now_s, due_s)

    def _replace_missing(self, barrier: ReadyBarrier, asking: int, now_s: float) -> bool:
        """Give the stand-in the seats of people who are away or not ready in time; return False if the block ends.

        Args:
            barrier: the seats that are ready for the episode.
            asking: the seat whose request is answered; it is the last to count as away.
            now_s: the present time in seconds.
        """
        missing = self.presence.present - barrier.seats
        replaced = missing & set(self.presence.find_overdue(asking, now_s, is_real_time=False))
        if now_s - barrier.since_s >= self._rules.thinking_limit_s:
            replaced |= set(self.presence.find_thinkers(missing, now_s))
        return self._hand_over(replaced, now_s)

    def _hand_over(self, seats: Collection[int], now_s: float = -math.inf) -> bool:
        """Give seats to the stand-in at a time in seconds; return False if the block ends instead.

        By default the time precedes all others, so that any act of the person counts as later.
        """
        if not seats or self.presence.hand_over(seats, now_s):
            return True
        self._concerned |= self.presence.persons
        return False

    def _concern_others(self, seat: int) -> None:
        """Record that the next answer to every person but the given seat's may have changed."""
        self._concerned |= self.presence.persons - {seat}


def _build_joint_taken(episode: int, step: int, joint_action: JointAction) -> JointTaken:
    return JointTaken(_UNSTAMPED_NS, episode, step, joint_action.actions, joint_action.sources, joint_action.silent_ms)
