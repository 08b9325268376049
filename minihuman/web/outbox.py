"""The outbox of a session: screens, the state of an episode, and prefetched scenes. It uses no socket and no clock.

Messages stay here, numbered, until the page has them. What the next keys lead to is sent in advance: in an episode by
its rules (`episode_ahead`), outside of episodes by copies of the session (`page_contents`). The page also learns in
advance what an agent will do, so that keys and the agent's steps are shown at once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from minihuman.experiment.machine.activity import Steering, WorldFactory
from minihuman.experiment.machine.events import EpisodeBeginning, EpisodeEnding, EpisodeStep, Event, Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import ActivityScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.sounds import compute_digest
from minihuman.runtime.devices.sound import list_sound_cues
from minihuman.web import messages
from minihuman.web.computed import ComputedEpisode, can_compute
from minihuman.web.episode_ahead import EpisodeAhead
from minihuman.web.episode_steps import EpisodeSteps
from minihuman.web.held_actions import describe_held, describe_vectors, find_held
from minihuman.web.message_streams import OutgoingStream
from minihuman.web.page_contents import PageContents
from minihuman.web.prefetch import advances_by_itself, describe_screen
from minihuman.web.screen_values import ImageEncoding
from minihuman.web.traffic_limits import PREFETCH_BACKLOG


@dataclass(frozen=True, slots=True)
class PageSettings:
    """The protocol's settings for pages."""

    picture_px: tuple[int, int] = (400, 300)
    encoding: ImageEncoding = "auto"


_PACE_WEIGHT = 8  # a new duration of a step counts for an eighth in the moving average
_WITHOUT_EFFECT = (
    messages.DisplayedMessage,
    messages.RoundTripMessage,
    messages.LateInputMessage,
    messages.PageAlteration,
)


def build_rules(
    play: RunningEpisode, part_plan: object, *, computed: messages.WorldState | None, keep: int
) -> messages.EpisodeRules:
    """Build the message of an episode's rules.

    Args:
        play: the episode.
        part_plan: the plan of its part.
        computed: the world's state if the page computes the episode; None otherwise.
        keep: the number of the first picture that the page must keep.
    """
    plan = play.plan
    most_steps = plan.max_steps
    if play.world.step_limit is not None:
        most_steps = min(most_steps, play.world.step_limit)
    noop = None
    if plan.noop is not None:
        noop = play.world.action_names.index(plan.noop)
    team: messages.JointPace = ""
    if play.is_joint and play.real_time:
        team = "ticks"
    elif play.is_joint:
        team = "turns"
    return messages.EpisodeRules(
        episode=plan.episode,
        actions={key: play.world.action_names.index(name) for key, name in plan.key_map.keys.items()},
        real_time=plan.pace == "real_time" and not play.is_joint,
        period=max(1, round(plan.step_period_ms * 1e6)),
        noop=noop,
        auto_repeat=plan.auto_repeat,
        most_steps=most_steps,
        team=team,
        held=getattr(part_plan, "hold_ms", 0.0) > 0,
        keep=keep,
        motion=getattr(part_plan, "motion_ms", None) or 0.0,
        computed=computed,
        vectors=None if computed is None else describe_vectors(play),
        combines=None if computed is None else describe_held(play),
    )


def _list_sounds(session: SessionMachine, screen: Screen) -> list[messages.ScreenSound]:
    """List the sounds that begin with a screen; empty for an activity's screen, whose values contain its sounds."""
    if isinstance(screen, ActivityScreen):
        return []
    files = session.plan.files
    return [messages.ScreenSound(cue.number, compute_digest(cue.content, files)) for cue in list_sound_cues(session)]


class Outbox:
    """Sends a page the state of its session.

    Args:
        session: the session, new or resumed from its log.
        make_world: makes worlds to look ahead in.
        settings: the protocol's settings for pages.
        logged: the events of the log that the session is resumed from.
    """

    def __init__(
        self, session: SessionMachine, make_world: WorldFactory, settings: PageSettings, logged: Sequence[Event] = ()
    ) -> None:
        self.through = 0  # the number of the page's last message that was taken
        self.at_ns = 0  # the time of that message
        self.moved = 0  # the number of the last message whose answer the page waits for
        self.page_computes = False  # whether the page has compiled this server's rules
        self.steps = EpisodeSteps(logged)
        self._pace_ns = 0  # moving average of the time that a step's message takes
        self._session = session
        self._settings = settings
        self._ahead = EpisodeAhead(make_world, settings.picture_px)
        self._joint_texts: object = None  # the texts below the picture of a joint episode
        self._screen_id = 0
        self._page = PageContents(settings.encoding, self._ahead.lend)

    # What the page has

    @property
    def outgoing(self) -> OutgoingStream[messages.ServerMessage | messages.PictureMessage]:
        """Return the stream of messages to the page; a restart replaces it."""
        return self._page.outgoing

    @property
    def screen_name(self) -> int:
        """Return the name of the screen that was sent to the page last."""
        return self._page.screen_name

    def is_present(self, message: messages.DisplayedMessage) -> bool:
        """Return whether a displayed screen is the session's current screen."""
        if message.name:
            return message.name == self._page.screen_name
        return message.screen == self._screen_id

    def describe_correction(
        self, message: messages.DisplayedMessage, at_ns: int, submit_ns: int, flip_ns: int
    ) -> Event | None:
        """Return an event if a joint step differs from the picture that the page displayed for it; otherwise None.

        Args:
            message: the page's message about the displayed picture.
            at_ns: the message's time in the session, in nanoseconds.
            submit_ns: the time at which the picture was submitted.
            flip_ns: the time at which it was displayed.
        """
        if self._ahead.graph is None:
            return None
        play = self.steps.find_corrected(message, self._ahead.graph.pictures)
        if play is None:
            return None
        return play.describe_correction(at_ns, message.step, submit_ns, flip_ns)

    @property
    def _ignores_releases(self) -> bool:
        """Return whether the page needs no answer to a key release, because the participant plays an episode alone."""
        session = self._session
        return session.play is not None and not session.part.agent_plays

    def waits_for(self, message: messages.PageMessage) -> bool:
        """Return whether the page waits for the answer to a message.

        It does not wait after a step that it computed itself, nor for messages without an effect.
        """
        if isinstance(message, messages.KeyMessage):
            if message.down:
                return not message.digest
            return not self._ignores_releases
        if isinstance(message, messages.TickMessage):
            return not message.digest
        return not isinstance(message, _WITHOUT_EFFECT)

    def compare(self, message: messages.PageMessage, stepped: Stepped | None) -> str:
        """Return how the page's step for a message differs from the session's; "" if there is no new difference."""
        return self._ahead.compare(message, stepped)

    # Where the session went

    @property
    def is_computed(self) -> bool:
        """Return whether the page computes the episode."""
        return self._ahead.computed is not None

    def follow(self, events: list[Event]) -> None:
        """Move the look-ahead to the session's new state, and begin an episode that these events begin or prepare.

        New scenes and an episode's rules are sent; ``send_state`` then sends the session's state.
        """
        next_play = None
        if not self._session.over:
            next_play = self._session.part.next_play
        for event in events:
            match event:
                case EpisodeStep() if event.episode == self.steps.episode:
                    self._follow_step(event, ended=any(isinstance(other, EpisodeEnding) for other in events))
                case EpisodeBeginning() if self._session.play is not None:
                    self._begin_episode(self._session.play)
        if next_play is not None:
            self._begin_episode(next_play)

    def _follow_step(self, step: EpisodeStep, *, ended: bool) -> None:
        """Move the look-ahead along a step of the session, which may have ended the episode; send the scenes found."""
        play = None
        if not ended:
            play = self._session.play
        self.steps.append(self._ahead.step(step.action, play))
        if self._ahead.graph is not None and play is not None:
            self._page.send_scenes(self._ahead.graph)

    def _begin_episode(self, play: RunningEpisode) -> None:
        """Send, once, the rules of an episode that has begun or is about to begin, and its first scenes or state."""
        plan = play.plan
        if self._ahead.plan is plan:
            return
        self.send_prefetched()  # now, since the page forgets the pictures that it refers to
        self.steps.begin(play)
        possible = [play.world.action_names.index(name) for name in plan.key_map.keys.values()]
        if plan.noop is not None:
            possible.append(play.world.action_names.index(plan.noop))
        self._page.images.forget()
        keep = self._page.images.next
        scene = self._ahead.begin(play, possible, self._page.images, computes=self._computes(play))
        self.steps.place(play, scene)
        self._send_rules(play, keep)
        self._page.send_scenes(self._ahead.graph)

    def _send_rules(self, play: RunningEpisode, keep: int) -> None:
        """Send the rules of an episode, with the world's state if the page computes it.

        Args:
            play: the episode.
            keep: the number of the first picture that the page must keep.
        """
        world_state = None
        if self._ahead.computed is not None:
            world_state = self._page.send_world_state(self._ahead.computed)
        self.outgoing.add(build_rules(play, self._session.part.part.plan, computed=world_state, keep=keep))

    def _computes(self, play: RunningEpisode) -> bool:
        """Return whether the page is to compute an episode."""
        computed_by = getattr(self._session.part.part.plan, "computed", "server")
        return self.page_computes and computed_by == "page" and can_compute(play)

    @property
    def looks_ahead(self) -> bool:
        """Return whether scenes of the episode are explored ahead of the session."""
        return self._ahead.graph is not None

    def record_step_time(self, took_ns: int) -> None:
        """Record how long a step's message took, in nanoseconds; stop looking ahead in a world that is too slow."""
        before_ns = self._pace_ns or took_ns
        self._pace_ns = before_ns + (took_ns - before_ns) // _PACE_WEIGHT
        self._ahead.stop_if_slow(self._pace_ns)

    def grow(self, rtt_ns: int) -> bool:
        """Prepare one more picture of a film, or a scene or screen that may be needed; return False if none is left.

        ``send_prefetched`` sends what was prepared.

        Args:
            rtt_ns: the round-trip time in nanoseconds; the longer it is, the further ahead screens are explored.
        """
        session = self._session
        if session.over or self.outgoing.n_unacknowledged > PREFETCH_BACKLOG:
            return False
        if self._page.grow(session, rtt_ns):
            return True
        if self._ahead.graph is None:
            return False
        no_key_acts = session.part.agent_plays and not session.part.takes_over
        return not no_key_acts and self._ahead.graph.grow()

    def send_prefetched(self) -> None:
        """Send the page the scenes and screens that were found ahead."""
        self._page.send_prefetched()
        self._page.send_scenes(self._ahead.graph)

    def restart(self, open_questions: Iterable[int], *, has_begun: bool) -> None:
        """Send the page everything from the start.

        Args:
            open_questions: the numbers of the questions that the page has not answered.
            has_begun: whether the session has begun, so that there is a state to send.
        """
        self._page = PageContents(self._settings.encoding, self._ahead.lend)
        for number in open_questions:
            self.outgoing.add(messages.CommandMessage(number))
        self._ahead.forget(keeps_computed=self.page_computes)
        if not self._session.over and has_begun:
            play = self._session.part.play or self._session.part.next_play  # also behind a pause
            if play is not None:
                self._begin_episode(play)
            self.send_state()

    def send_state(self) -> None:
        """Send the page every change of the session's state since the last call."""
        play = self._present_play
        tick_ns = self._next_tick_ns
        computed = self._ahead.computed
        knows_screen = computed is not None and play is not None and play is self._page.screen_play  # but for its step
        self._page.screen_play = play
        if not knows_screen:
            self._send_screen(tick_ns)
        steering = None
        if play is not None:
            steering = self._session.part.describe_steering(play)
            if steering is not None:
                self._send_control(steering, play.plan.episode)
        if computed is not None:
            self._send_correction(computed, play)
        self._send_position(play, steering, tick_ns)

    @property
    def _present_play(self) -> RunningEpisode | None:
        """Return the running episode; None if no episode is being played."""
        if self._session.over:
            return None
        return self._session.play

    def _send_screen(self, tick_ns: int | None) -> None:
        """Send the session's screen, unless the page has it or advances to it by itself."""
        session = self._session
        page = self._page
        screen = session.screen
        if screen is page.screen:
            return
        values, name = describe_screen(session, page.images.number, page.screen_name)
        page.screen = screen
        texts = (values.get("controller_text"), values.get("messages"))
        has_new_texts = session.play is not None and session.play.is_joint and texts != self._joint_texts
        self._joint_texts = texts
        if name == page.screen_name and not has_new_texts and advances_by_itself(session):
            return
        self._screen_id += 1
        sounds = _list_sounds(session, screen)
        message = messages.ScreenMessage(self._screen_id, self.through, self.at_ns, tick_ns, values, name, sounds)
        page.send_screen(session, screen, message)

    def _send_position(self, play: RunningEpisode | None, steering: Steering | None, tick_ns: int | None) -> None:
        """Send the position in ``play``, the running episode, unless the page has it or, as it computes it, knows it.

        ``steering`` is given if an agent plays the episode; ``tick_ns`` is the time at which the page must send a tick.
        """
        step = -1
        episode = -1
        waited_for = 0
        controller = ""
        limit_ns = None
        action = None
        if play is not None:
            step = play.steps
            episode = self.steps.episode
            waited_for = self.moved
            action = play.open_action
        if steering is not None:
            controller = steering.controller
            limit_ns = steering.limit_ns
            action = steering.action
        if action is None:
            action = -1
        compared_step = step
        if self.is_computed:
            compared_step = min(step, 0)  # 0 in an episode, -1 outside, as the page counts the steps itself
        if self._page.record_state((tick_ns, waited_for, compared_step, controller, action, limit_ns)):
            return
        self.outgoing.add(
            messages.EpisodeState(
                through=self.through,
                tick=tick_ns,
                episode=episode,
                step=step,
                node=self.steps.find_scene(step),
                who=controller,
                action=action,
                limit=limit_ns,
                pace=self._pace_ns,
            )
        )

    @property
    def _next_tick_ns(self) -> int | None:
        """Return the session's time at which the page must send a tick; None if it need not send any.

        A page that computes real-time steps itself is only told the part's time limit.
        """
        session = self._session
        if session.over:
            return None
        if self.is_computed and session.part.real_time:
            return session.part.limit_ns
        return session.next_tick_ns

    def _send_correction(self, computed: ComputedEpisode, play: RunningEpisode | None) -> None:
        """Send the session's state to a page that computes, if the page may have diverged or fallen behind."""
        was_playing = self._page.plays
        self._page.plays = play is not None
        if play is None:
            return
        is_behind = not was_playing and computed.sent_step != play.steps
        if is_behind or computed.is_elsewhere:
            self.outgoing.add(
                messages.StateCorrection(self.through, play.plan.episode, computed.position(), find_held(play))
            )

    def _send_control(self, steering: Steering, episode: int) -> None:
        """Send the controls of an agent's episode, and the scene that the agent's next action leads to."""
        rules = steering.rules
        good, bad = rules.rating_keys
        self._page.send_control(
            messages.AgentControl(
                episode=episode,
                period=rules.period_ns,
                takes_over=rules.person_acts,
                hand_back=rules.hand_back_key,
                good=good,
                bad=bad,
                flash=rules.flash_ns,
                apart=rules.repeat_interval_ns,
                controller_texts=dict(rules.controller_texts),
            )
        )
        if self._ahead.graph is not None and steering.action is not None and steering.controller == "agent":
            self._ahead.graph.look(steering.action)
            self._page.send_scenes(self._ahead.graph)

    def close(self) -> None:
        """Close the look-ahead world."""
        self._ahead.close()
