"""Team: a block that people and agents play in a world with several bodies, with one session machine for each person.

A machine submits its own person's action and waits for the joint action, which a team host closes. The joint action is
an input, so one log alone replays all bodies. Other members appear as seat 0, 1, ... and never by their codes. The plan
leaves the team, its seat and the seeds of its episodes open; `TeamFormed` resolves them before the first reset.
"""

import math
from dataclasses import replace
from typing import Any, cast

import msgspec

from minihuman.activities.play.activity import PLAY_TRANSITIONS, PlayActivity
from minihuman.activities.team.episode import Submission, TeamEpisode
from minihuman.activities.team.events import (
    ActionSource,
    GoneReason,
    InputLate,
    JointStepped,
    SeatHolder,
    SeatSeen,
    SeatsReadied,
    SeatTaken,
    TeamEnded,
    TeamFormed,
)
from minihuman.activities.team.message_events import MessageEdited, MessageGiven, MessageShown, MessageTyped
from minihuman.activities.team.messages import INTERVAL_NS, TeamMessages
from minihuman.activities.team.plan import PERSON, TeamPlayPlan
from minihuman.activities.team.presence import PRESENCE_RULES
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
from minihuman.activities.team.rules import check_block
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import (
    ActivityKind,
    ActivityRequest,
    SessionContext,
)
from minihuman.experiment.machine.events import ActivityEvent
from minihuman.experiment.machine.inputs import ActivityInput, Input, KeyDown, TextChange, TextEdited, TextInput
from minihuman.experiment.machine.life_signs import SeatState
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.transitions import Phase, PhaseTransition, TransitionCause, TransitionTable
from minihuman.experiment.plan.random_streams import draw_seeds
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart

# The text on a partner who is gone, by `partner_disclosure`: only under "always" does it say that an agent took over.
_WORDS_OF_ABSENCE = {"always": "team.partner_replaced", "debrief": "team.partner_away", "": "team.partner_away"}
POLL_NS = 250_000_000  # how often a waiting machine asks again, if nothing else happens


TEAM_TRANSITIONS: "TransitionTable[Any]" = TransitionTable(
    [
        PhaseTransition(Phase.INSTRUCTIONS, TransitionCause.DONE, Phase.LOBBY),
        PhaseTransition(Phase.LOBBY, TransitionCause.DONE, Phase.PREPARING),
        PhaseTransition(Phase.READY, TransitionCause.DONE, Phase.WAITING),
        PhaseTransition(Phase.WAITING, TransitionCause.DONE, Phase.INTERVAL),
        PhaseTransition(Phase.WAITING, TransitionCause.GO_BACK, Phase.LOBBY),
        *PLAY_TRANSITIONS.rows,
    ]
)


class TeamPlayActivity(PlayActivity):
    """An activity that plays a block's episodes in one seat of a team."""

    plan: TeamPlayPlan
    can_copy = False
    transitions = TEAM_TRANSITIONS
    typed_event = MessageTyped

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        super().__init__(number, part, context)
        self.formed: Team | None = None
        self._holders: tuple[SeatHolder, ...] = ()
        self._states: tuple[SeatState, ...] = ()  # of the seats, as they were seen last
        self._lobby_ns = 0  # when the lobby was entered
        self._messages = TeamMessages(self.plan.team, context)

    @property
    def next_plan(self) -> EpisodePlan:
        """Return the plan of the next episode, with the seed, the seat and the keys that the team resolved."""
        plan = super().next_plan
        assert self.formed is not None, "a team is formed before its first episode"
        options = {**plan.options, "seat": self.formed.seat}
        keys = self.plan.team.seat_keys or ()
        key_map = plan.key_map
        if keys:
            key_map = msgspec.structs.replace(key_map, keys=keys[self.formed.seat], spare_keys=())
        return msgspec.structs.replace(plan, options=options, seed=self._find_layout_seed(plan), key_map=key_map)

    def _find_layout_seed(self, plan: EpisodePlan) -> int:
        """Return the seed of an episode's layout, which is the same for all members of the team."""
        assert self.formed is not None
        if self.plan.seeds == "listed":
            return plan.seed
        session_plan = self.context.plan
        seed_index = 0 if self.plan.seeds == "same" else plan.episode_in_block
        n_kinds_of_agents = len(set(self.formed.seats) - {PERSON})
        purpose = f"team-layouts-{plan.block_name}-session-{session_plan.session}-{n_kinds_of_agents}"
        seeds = draw_seeds(seed_index + 1, seed=session_plan.study_seed, purpose=purpose, index=self.formed.index)
        return seeds[-1]

    def _make_episode(self, plan: EpisodePlan) -> RunningEpisode:
        """Make a team's running episode of a plan, seen from this seat."""
        assert self.formed is not None
        return TeamEpisode(
            plan,
            self.context.world(plan.world, plan.options),
            self.formed,
            picture_px=self.context.picture_px,
            keys_down=self.context.keys_down,
        )

    @property
    def team_episode(self) -> TeamEpisode:
        """Return the present episode, as a team's episode."""
        assert isinstance(self._play, TeamEpisode)
        return self._play

    # From outside

    @property
    def request(self) -> ActivityRequest | None:  # type: ignore[override]
        """Return the request for a team, an episode's start or the next joint action; None if no request is due."""
        if self.phase is Phase.LOBBY:
            return TeamRequest(self.number, self.part.name, self.plan, self.context.teams)
        if self.phase is Phase.WAITING and self.formed is not None:
            return ReadyRequest(self.formed, self.team_episode.plan, self.plan)
        if self.playing and self.formed is not None:
            play = self.team_episode
            return self._build_joint_request(play, play.submitted)
        return None

    def _build_joint_request(self, play: TeamEpisode, submission: Submission | None) -> JointRequest:
        """Build the request for the next joint step; without an input of this seat, it only waits for the others."""
        assert self.formed is not None
        action = None
        is_key = False
        is_held = False
        if submission is not None:
            action = submission.action
            is_key = bool(submission.key)
            is_held = is_key and not submission.is_new
        return JointRequest(
            team=self.formed,
            plan=play.plan,
            rules=self.plan,
            step=play.steps + 1,
            action=action,
            is_key=is_key,
            sent=self._messages.sent,
            received=self._messages.received,
            is_held=is_held,
            states=self._states,
        )

    def receive(self, happened: Input) -> None:
        """Handle an input, including answers from the team host."""
        match happened:
            case TeamJoined() if self.phase is Phase.LOBBY:
                self._join_team(happened.team, happened.salt)
            case SeatsReady() if self.phase is Phase.WAITING and happened.episode == self.team_episode.plan.episode:
                self.context.emit(SeatsReadied(self.context.now_ns, happened.episode, self.team_episode.poses()))
                self._move(TransitionCause.DONE)
            case JointTaken() if self.playing:
                self._let_time_pass()
                self._make_joint_step(happened)
            case SeatSighted() if self.playing:
                self._note_sighting(happened)
            case MessageGiven() if self.playing and happened.message.seat != self._messages.seat:
                self._messages.show(happened.message, self.team_episode)
            case TextInput() if self.playing:
                self._messages.type_text(happened.text)
            case TextEdited() if self.playing:
                self._messages.edit_text(happened)
            case TeamLost() if self.phase in (Phase.LOBBY, Phase.WAITING, Phase.PLAYING):
                self._lose_team(happened.reason)
            case ActivityInput():
                pass
            case _:
                super().receive(happened)

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that caused an event, from the team host or the person's typing; None for other events."""
        match event:
            case TeamFormed():
                return TeamJoined(event.t_ns, Team(event.team, event.index, event.seat, event.seats), event.salt)
            case MessageTyped():
                return TextInput(event.t_ns, event.text)
            case MessageEdited():
                began_ns = event.t_ns - event.waited_ns
                return TextEdited(
                    event.t_ns, event.text, cast("tuple[TextChange, ...]", event.changes), event.keys, began_ns
                )
            case MessageShown():
                return MessageGiven(event.t_ns, event)
            case SeatsReadied():
                return SeatsReady(event.t_ns, event.episode)
            case JointStepped():
                return JointTaken(
                    event.t_ns,
                    event.episode,
                    event.step,
                    event.actions,
                    cast("tuple[ActionSource, ...]", event.sources),
                    event.silent_ms,
                )
            case SeatSeen():
                return SeatSighted(event.t_ns, event.seat, event.state, event.for_ms)
            case TeamEnded():
                return TeamLost(event.t_ns, event.reason)
        return None

    def _join_team(self, team: Team, salt: str) -> None:
        """Take the seat that the team assigned, log the team, and leave the lobby.

        ``salt`` is the secret with which the digests of this seat's messages are made.
        """
        self.formed = team
        self._messages.seat = team.seat
        self._messages.salt = salt
        self._count_waiting()
        holders: dict[bool, SeatHolder] = {True: "person", False: "agent"}
        self._holders = tuple(holders[kind == PERSON] for kind in team.seats)
        self._states = tuple[SeatState, ...]("here" for _ in team.seats)
        roles = self.plan.team.roles
        context = self.context
        role = roles[team.seat] if roles else ""
        context.teams = (*context.teams, team.team)
        self._note_partners()
        context.emit(TeamFormed(context.now_ns, self.number, team.team, team.index, team.seat, role, team.seats, salt))
        self._move(TransitionCause.DONE)

    def _note_partners(self) -> None:
        """Record for the session which kinds of partner, person or agent, the participant has had."""
        assert self.formed is not None
        self.context.partners |= {holder for seat, holder in enumerate(self._holders) if seat != self.formed.seat}

    def _count_waiting(self) -> None:
        """Add the time in the lobby to the session's waiting time."""
        self.context.waited_ns += self.context.now_ns - self._lobby_ns

    def _move(self, cause: TransitionCause) -> None:
        """Enter the next phase, and note when the lobby was entered."""
        super()._move(cause)
        if self.phase is Phase.LOBBY:
            self._lobby_ns = self.context.now_ns

    def _lose_team(self, reason: GoneReason) -> None:
        """Log why the team ended, and end the block; return to the lobby if a partner left before the first step."""
        self.context.emit(TeamEnded(self.context.now_ns, self.number, reason))
        if reason == "declined":
            self.formed = None
            self.context.teams = self.context.teams[:-1]
            self._move(TransitionCause.GO_BACK)
            return
        if self.phase is Phase.LOBBY:
            self._count_waiting()
        self.context.stranded |= reason != "replaced"
        self.sequence.stop(reason)
        if self.playing:
            self._episode_ended("partner_left")
        else:
            self._end()

    def _make_joint_step(self, joint: JointTaken) -> None:
        """Make and log a step with the joint action of all seats; ignore a joint action for a different step."""
        if not self.playing or (joint.episode, joint.step) != (self._current.plan.episode, self._current.steps + 1):
            return
        play = self.team_episode
        now_ns = self.context.now_ns
        seat = self.team_episode.team.seat
        stepped, rewards, submission = play.step_joint(now_ns, joint)
        self.context.emit(
            JointStepped(
                t_ns=now_ns,
                episode=joint.episode,
                step=joint.step,
                actions=joint.actions,
                rewards=rewards,
                sources=joint.sources,
                digest=play.digest,
                poses=play.poses(),
                silent_ms=joint.silent_ms,
            )
        )
        if submission is not None and submission.key and joint.sources[seat] != "person":
            self.context.emit(
                InputLate(now_ns, joint.episode, joint.step, submission.action, submission.key, submission.key_t_ns)
            )
        self._note_holders(joint)
        self._note_partners()
        self._stepped(stepped)

    def _note_holders(self, joint: JointTaken) -> None:
        """Record who acts for each seat and emit an event for each change; a late person still holds their seat."""
        holders = list(self._holders)
        for seat, source in enumerate(joint.sources):
            if source != "late" and source != holders[seat]:
                holders[seat] = source
                self.context.emit(SeatTaken(self.context.now_ns, joint.episode, joint.step, seat, source))
        self._holders = tuple(holders)

    def _note_sighting(self, sighted: SeatSighted) -> None:
        """Record and log the visible state of a person's seat, which may be this one."""
        self._states = (*self._states[: sighted.seat], sighted.state, *self._states[sighted.seat + 1 :])
        play = self.team_episode
        self.context.emit(
            SeatSeen(
                self.context.now_ns, play.plan.episode, play.steps + 1, sighted.seat, sighted.state, sighted.for_ms
            )
        )

    # Keys and time

    def _key_in_play(self, press: KeyDown) -> None:
        """Handle a key press during an episode: a message, or this seat's action for the next joint step."""
        play = self.team_episode
        action = play.action_of(press.key)
        if self._messages.take_key(press, play):
            return
        if play.real_time or action is None or press.repeat:
            super()._key_in_play(press)
        elif play.submitted is None:
            self.context.emit_key(press, "queued", self.phase, action)
            play.submitted = Submission(action, press.key, press.t_ns)
        else:
            self.context.emit_key(press, "not_playing", self.phase, action)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the earliest time of the next tick, the next repeated request, and the removal of a cell's mark.

        None means that none of them is due.
        """
        tick_ns = super().next_tick_ns
        has_submitted = self.playing and self.team_episode.submitted is not None
        times_ns = []
        if tick_ns is not None:
            times_ns.append(tick_ns)
        if has_submitted or self.phase in (Phase.LOBBY, Phase.WAITING):
            times_ns.append(self.context.now_ns + POLL_NS)
        if self.playing:
            times_ns += [mark.t_ns + INTERVAL_NS for mark in self._messages.marks]
        return min(times_ns, default=None)

    # What is seen

    @property
    def _look(self) -> object:
        """Return further state on which the screen depends: the awaited inputs, the seats' holders, and messages."""
        return self._is_awaiting_others, self._holders, self._messages.look(self._play)

    @property
    def _is_awaiting_others(self) -> bool:
        """Return whether this seat's input is submitted and the others' are awaited."""
        return isinstance(self._play, TeamEpisode) and not self._play.real_time and self._play.submitted is not None

    def _screen(self) -> Screen:
        """Build the screen of the present phase; the lobby and the ready screen differ from those of `PlayActivity`."""
        words = self.context.words
        match self.phase:
            case Phase.LOBBY | Phase.WAITING:
                body = words["team.not_ready"]
                if self.phase is Phase.LOBBY:
                    longest_wait_min = math.ceil(self.plan.team.lobby_s / 60)
                    body = words["team.lobby"].replace("{minutes}", str(longest_wait_min))
                return screen_texts.build_notice_screen(words, words["team.title"], body)
            case Phase.READY:
                return self._ready_screen()
        return super()._screen()

    def _ready_screen(self) -> TextScreen:
        """Build the ready screen, with the participant's role and, if that is disclosed, the kinds of the partners."""
        ready = self._view.build_ready(self._current)
        lines = list(self._describe_role())
        if self.plan.team.partner_disclosure == "always":
            lines += self._describe_partners()
        if not lines:
            return ready
        return replace(ready, body="\n\n".join(filter(None, (ready.body, *lines))))

    @property
    def _is_partner_replaced(self) -> bool:
        """Return whether an agent acts in another person's seat; false under older rules, which announce nothing."""
        if self.formed is None or self.context.facts.get("presence_rules", "1") != PRESENCE_RULES:
            return False
        partner_seats = [
            seat for seat, kind in enumerate(self.formed.seats) if kind == PERSON and seat != self.formed.seat
        ]
        return any(self._holders[seat] == "agent" for seat in partner_seats)

    def _describe_role(self) -> tuple[str, ...]:
        """Return the line that names the participant's role; an empty tuple without roles or a team."""
        roles = self.plan.team.roles
        if roles and self.formed:
            return (self.context.words.fill("team.role", role=roles[self.formed.seat]),)
        return ()

    def _describe_partners(self) -> tuple[str, ...]:
        """Return a line for each kind of partner, person before agent."""
        assert self.formed is not None
        partners = [holder for seat, holder in enumerate(self._holders) if seat != self.formed.seat]
        return tuple(
            self.context.words[f"team.is_{holder_kind}"]
            for holder_kind in ("person", "agent")
            if holder_kind in partners
        )

    def _play_screen(self) -> PlayScreen:
        """Build the screen of a running episode, with messages and a line on the partners' or the seat's state."""
        words = self.context.words
        screen = replace(super()._play_screen(), page_fields=self._messages.list_page_fields(self._play))
        text = "  ".join(self._describe_role())
        if self.playing and self.formed is not None and self._holders[self.formed.seat] == "agent":
            text = words["team.replaced"]
        elif self.playing and self._is_awaiting_others:
            text = words["team.waits"]
        elif self.playing and self._is_partner_replaced:
            text = words[_WORDS_OF_ABSENCE[self.plan.team.partner_disclosure]]
        if text:
            return replace(screen, controller="person", controller_text=text)
        return screen


TEAM = ActivityKind(
    "team",
    TeamPlayPlan,
    TeamPlayActivity,
    messages="minihuman.activities.team.rows:TEAM_ROWS",
    tables="minihuman.activities.team.tables:TEAM_TABLES",
    report="minihuman.activities.team.report:build_section",
    page_fields="minihuman.activities.team.screens:TeamPageFields",
    check_block=check_block,
    is_for_players=True,
)
