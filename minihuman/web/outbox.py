"""The outbox of a session: screens, the state of an episode, and what was prefetched. No socket, no clock.

Messages stay here, numbered, until the page has them. An episode that the page computes needs its first state alone.
Along the keys of any other the future is computed in a world of its own, outside of episodes in copies of the session.
The page learns in advance what an agent will do, so that keys and the agent's steps show at once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from minihuman.activities.agent_blocks.activity import AgentPlayActivity
from minihuman.activities.correction.events import CorrectionBegun, CorrectionEnded, CorrectionStepped
from minihuman.activities.rating.activity import FLASH_NS, REPEAT_INTERVAL_NS
from minihuman.activities.team.episode import TeamEpisode
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import EpisodeEnded, EpisodeStarted, Event, Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web import messages
from minihuman.web.computed import ComputedEpisode, can_compute
from minihuman.web.messages import PREFETCH_BACKLOG, AgentControl, OutgoingStream
from minihuman.web.prefetch import FilmPrefetcher, LookAheadGraph, ScreenPrefetcher, advances_by_itself, describe_screen
from minihuman.web.screen_values import ImageCache, ImageEncoding
from minihuman.worlds.adapters.world import World


def describe_agent_control(part: AgentPlayActivity, episode: int) -> AgentControl:
    """What the page has to know to go ahead of the session."""
    good, bad = part.rating_keys
    return AgentControl(
        episode=episode,
        period=part.period_ns,
        takes_over=part.takes_over,
        hand_back=part.hand_back_key,
        good=good,
        bad=bad,
        flash=FLASH_NS,
        apart=REPEAT_INTERVAL_NS,
        controller_texts={who: part.control_text(who) for who in ("agent", "person")},
    )


@dataclass(frozen=True, slots=True)
class PageSettings:
    """What of the protocol is about pages."""

    picture_px: tuple[int, int] = (400, 300)
    encoding: ImageEncoding = "auto"


_WITHOUT_EFFECT = (messages.DisplayedMessage, messages.RoundTripMessage, messages.LateInputMessage)
_STEPPING = (messages.KeyMessage, messages.TickMessage)
_ENDS = (EpisodeEnded, CorrectionEnded)


class Outbox:
    """Sends a page the state of its session.

    Args:
        session: new, or resumed from its log.
        make_world: makes worlds to look ahead in.
        settings: what of the protocol is about pages.
        logged: the events of the log that a session is resumed from.
    """

    def __init__(
        self, session: SessionMachine, make_world: WorldFactory, settings: PageSettings, logged: Sequence[Event] = ()
    ) -> None:
        self.through = 0  # the last of the page's messages that was taken
        self.at_ns = 0  # when that was
        self.moved = 0  # the last of them that the page waits for, as it may lead somewhere
        self.pace_ns = 0  # what a step has taken lately
        self.page_computes = False  # it has compiled the rules that are here
        self._session = session
        self._make_world = make_world
        self._settings = settings
        self._computed: ComputedEpisode | None = None  # by the page; else there is a graph
        self._own_world: World | None = None  # that may be reset
        self._said: object = None  # below its picture
        self._screen_id = 0
        self._episode = -1  # whose steps these are
        self._scenes: list[int] = []  # the names of those that its steps led to; -1 if unknown
        self._of_team = False  # it is a team's: the page shows the own action before the others'
        self._early: messages.DisplayedMessage | None = None  # such a picture, until the step is closed
        for event in logged:
            match event:
                case EpisodeStarted():
                    self._episode, self._scenes = event.plan.episode, [-1]
                case CorrectionBegun():
                    self._episode, self._scenes = event.episode, [-1] * (event.step + 1)
                case Stepped() | CorrectionStepped():
                    self._scenes.append(-1)
        self._forget_page()

    def _forget_page(self) -> None:
        """Begin with a page that has nothing."""
        self.outgoing: OutgoingStream[messages.ServerMessage | messages.PictureMessage] = OutgoingStream()
        self._plan: EpisodePlan | None = None  # of the episode that the page has the rules of
        self._look_ahead_graph: LookAheadGraph | None = None
        self._arrays: set[str] = set()  # that the page has
        self._page_plays = False  # an episode
        self._screen: Screen | None = None  # that the page has
        self._screen_name = 0
        self._screen_play: RunningEpisode | None = None  # that was played then
        self._sent_state: tuple[object, ...] | None = None
        self._sent_control: messages.AgentControl | None = None
        self._image_cache = ImageCache(self._settings.encoding)
        self._screen_prefetcher = ScreenPrefetcher(self._image_cache.number, self._lent)
        self._film_prefetcher = FilmPrefetcher(self._image_cache.number)

    # What the page has

    def is_present(self, message: messages.DisplayedMessage) -> bool:
        """Whether a screen that was shown is what the session shows."""
        return message.name == self._screen_name if message.name else message.screen == self._screen_id

    def knows(self, message: messages.DisplayedMessage) -> bool:
        """Whether a picture that was shown is one of the present episode's steps."""
        return message.episode == self._episode and message.step < len(self._scenes)

    def keep_early(self, message: messages.DisplayedMessage) -> None:
        """Keep word of a picture that a team's page showed before its step was closed."""
        if self._of_team and (message.episode, message.step) == (self._episode, len(self._scenes)):
            self._early = message

    def take_early(self) -> messages.DisplayedMessage | None:
        """What was kept, once its step is closed."""
        early = self._early
        if early is None or not self.knows(early):
            return None
        self._early = None
        return early

    def is_corrected(self, message: messages.DisplayedMessage) -> bool:
        """Whether a team's step came out otherwise than a picture had shown it."""
        if not self._of_team or self._look_ahead_graph is None:
            return False
        pictures, scene = self._look_ahead_graph.pictures, self._scenes[message.step]
        return scene in pictures and pictures.get(message.node, -1) not in (-1, pictures[scene])

    def difference(self, message: messages.DisplayedMessage) -> str:
        """How a step's picture was another than the session's; "" where it was the same."""
        scene = self._scenes[message.step]
        if self._of_team or not scene >= 0 <= message.node or scene == message.node:
            return ""
        return f"step {message.step} of episode {message.episode + 1} was shown as scene {message.node}, it is {scene}"

    @property
    def _ignores_releases(self) -> bool:
        """Whether the page waits for no word of a release: an episode is played, and by no agent."""
        session = self._session
        return not session.over and session.play is not None and not isinstance(session.part, AgentPlayActivity)

    def waits_for(self, message: messages.PageMessage) -> bool:
        """Whether the page waits for word of where a message led: it knows of a step that it computed."""
        if isinstance(message, messages.KeyMessage):
            return not message.digest if message.down else not self._ignores_releases
        if isinstance(message, messages.TickMessage):
            return not message.digest
        return not isinstance(message, _WITHOUT_EFFECT)

    def compare(self, message: messages.PageMessage, events: Sequence[Event]) -> str:
        """Compare a message's step in the page with the session's; how they differ, "" if they do not."""
        if self._computed is None or not isinstance(message, _STEPPING):
            return ""
        return self._computed.compare(message, events)

    # Where the session went

    @property
    def is_computed(self) -> bool:
        """Whether the page computes the episode."""
        return self._computed is not None

    def follow(self, events: list[Event]) -> None:
        """Move the look-ahead where the session went; ``send_state`` then tells the page."""
        coming = None if self._session.over else self._session.part.next_play
        for event in events:
            match event:
                case Stepped() | CorrectionStepped() if event.episode == self._episode:
                    if self._look_ahead_graph is None:
                        self._scenes.append(-1)
                    else:
                        self._stepped(event, ended=any(isinstance(each, _ENDS) for each in events))
                case EpisodeStarted() | CorrectionBegun() if self._session.play is not None:
                    self._look_from(self._session.play)
        if coming is not None:
            self._look_from(coming)

    def _look_from(self, play: RunningEpisode) -> None:
        """Send the rules of an episode that has begun or is about to, once, and what the page goes ahead by."""
        plan = play.plan
        if self._plan is plan:
            return
        self.send_prefetched()  # as long as its pictures are known
        self._plan = plan
        actions = {key: play.world.action_names.index(name) for key, name in plan.key_map.keys.items()}
        of_team = self._of_team = isinstance(play, TeamEpisode)
        self._early = None
        noop = None if plan.noop is None else play.world.action_names.index(plan.noop)
        self._image_cache.forget()
        keep = self._image_cache.next
        last, self._computed, self._look_ahead_graph = self._computed, None, None
        if self._computes(play):
            is_known = last is not None and last.play is play  # by a page that was loaded again
            self._computed = last if is_known else ComputedEpisode(play, self._settings.picture_px)
        else:
            self._look_ahead_graph = LookAheadGraph(
                plan,
                self._make_world,
                [*actions.values()] + ([] if noop is None else [noop]),
                self._settings.picture_px,
                self._image_cache,
                world=self._world_for(plan),
                # a team's ticks also have the others' actions; where keys combine, any step is possible
                blind=(of_team and play.real_time) or play.repeats_held or not play.world.actions.is_discrete,
            )
            if play.steps:
                self._look_ahead_graph.move_to(play.world)
        root = -1 if self._look_ahead_graph is None else self._look_ahead_graph.root.name
        self._episode, self._scenes = plan.episode, [-1] * play.steps + [root]
        limits = [plan.max_steps] + ([] if play.world.step_limit is None else [play.world.step_limit])
        self.outgoing.add(
            messages.EpisodeRules(
                episode=plan.episode,
                actions=actions,
                real_time=plan.pace == "real_time" and not of_team,
                period=max(1, round(plan.step_period_ms * 1e6)),
                noop=noop,
                auto_repeat=plan.auto_repeat,
                most_steps=min(limits),
                team=("ticks" if play.real_time else "turns") if of_team else "",
                held=getattr(self._session.part.part.plan, "hold_ms", 0.0) > 0,
                keep=keep,
                motion=getattr(self._session.part.part.plan, "motion_ms", None) or 0.0,
                computed=None if self._computed is None else self._page_state(self._computed),
            )
        )
        self._send_look_ahead()

    def record_step_time(self, took_ns: int) -> None:
        """Take note of what a step's message took. A world too slow for its period is not looked ahead in as well."""
        before_ns = self.pace_ns or took_ns
        self.pace_ns = before_ns + (took_ns - before_ns) // 8
        plan, graph = self._plan, self._look_ahead_graph
        if plan is not None and graph is not None and plan.pace == "real_time":
            graph.blind |= self.pace_ns > plan.step_period_ms * 1e6

    def _page_state(self, computed: ComputedEpisode) -> messages.WorldState:
        """Where the session is, once the page has the arrays for it."""
        for each in computed.arrays:
            if each.name not in self._arrays:
                self._arrays.add(each.name)
                self.outgoing.add(each)
        return computed.state()

    def _computes(self, play: RunningEpisode) -> bool:
        """Whether the page computes an episode."""
        computed = getattr(self._session.part.part.plan, "computed", "server")
        return self.page_computes and computed == "page" and can_compute(play)

    def _world_for(self, plan: EpisodePlan) -> World:
        """A world of the outbox's own for an episode, the last one's if it will do."""
        own = self._own_world
        if own is None or (own.id, own.options) != (plan.world, plan.options):
            if own is not None:
                own.close()
            own = self._own_world = self._make_world(plan.world, plan.options)
        return own

    def _stepped(self, stepped: Stepped | CorrectionStepped, *, ended: bool) -> None:
        assert self._look_ahead_graph is not None
        if ended or self._session.play is None:  # its world may have been reset for the next episode
            edge = self._look_ahead_graph.root.edges.get(stepped.action)
            self._scenes.append(-1 if edge is None else edge[0].name)
            return
        if self._of_team:  # others acted, too
            self._look_ahead_graph.move_to(self._session.play.world)
            self._scenes.append(self._look_ahead_graph.root.name)
        else:
            self._scenes.append(self._look_ahead_graph.step(stepped.action, self._session.play.world).name)
        self._send_look_ahead()

    def grow(self, rtt_ns: int) -> bool:
        """Draw one picture of a film, or look one scene or screen further ahead; False if nothing is left.

        ``send_prefetched`` sends what was found. ``rtt_ns`` is the round trip.
        """
        if self._session.over or self.outgoing.kept > PREFETCH_BACKLOG:
            return False
        frame = self._film_prefetcher.grow()
        if frame is not None:
            self._send_pictures()
            self.outgoing.add(frame)
            return True
        if self._session.play is None and self._screen_prefetcher.grow(rtt_ns):
            return True
        if self._look_ahead_graph is None:
            return False
        part = self._session.part
        looks_on = isinstance(part, AgentPlayActivity) and not part.takes_over  # no key leads anywhere
        return not looks_on and self._look_ahead_graph.grow()

    def send_prefetched(self) -> None:
        """Tell the page what was found ahead."""
        new = self._screen_prefetcher.take_new()
        self._send_pictures()
        if new is not None:
            self.outgoing.add(new)
        self._send_look_ahead()

    def restart(self, asked: Iterable[int], *, begun: bool) -> None:
        """Tell everything from the start.

        Args:
            asked: what the page was asked and has not answered.
            begun: whether there is anything to tell.
        """
        self._forget_page()
        for number in asked:
            self.outgoing.add(messages.CommandMessage(number))
        self._computed = self._computed if self.page_computes else None
        if not self._session.over and begun:
            play = self._session.part.play or self._session.part.next_play  # also behind a pause
            if play is not None:
                self._look_from(play)
            self.send_state()

    def send_state(self) -> None:
        """Tell the page what it does not know of where the session is."""
        play, part = (None, None) if self._session.over else (self._session.play, self._session.part)
        tick_ns = self._next_tick_ns
        is_known = self._computed is not None and play is not None and play is self._screen_play  # but for its step
        self._screen_play = play
        if not is_known and (screen := self._session.screen) is not self._screen:
            values, name = describe_screen(self._session, self._image_cache.number, self._screen_name)
            self._screen = screen
            said, self._said = self._said, (values.get("controller_text"), values.get("messages"))  # of a team
            of_team = isinstance(self._session.play, TeamEpisode) and said != self._said
            if name != self._screen_name or of_team or not advances_by_itself(self._session):
                self._screen_id, self._screen_name = self._screen_id + 1, name
                self._screen_prefetcher.start_from(self._session, name)
                self._film_prefetcher.start_from(screen, name)
                self._send_pictures()
                self.outgoing.add(
                    messages.ScreenMessage(self._screen_id, self.through, self.at_ns, tick_ns, values, name)
                )
        step = -1 if play is None else play.steps
        who, action, limit_ns = "", -1, None
        if play is not None and isinstance(part, AgentPlayActivity):
            who, limit_ns, advised = part.who, part.limit_ns, part.advised
            action = advised.action if advised is not None and advised.step == step else -1
            self._send_control(part, play.plan.episode, action)
        elif isinstance(play, TeamEpisode) and not play.real_time and play.submitted is not None:
            action = play.submitted.action
        if self._computed is not None:
            self._correct(play)
            step = min(step, 0)  # the page knows how far it went
        now = tick_ns, self.moved if play is not None else 0, step, who, action, limit_ns
        if now != self._sent_state:
            self._sent_state = now
            step = -1 if play is None else play.steps
            node = self._scenes[step] if 0 <= step < len(self._scenes) else -1
            episode = self._episode if play else -1
            pace_ns = self.pace_ns
            self.outgoing.add(
                messages.EpisodeState(self.through, tick_ns, episode, step, node, who, action, limit_ns, pace_ns)
            )

    @property
    def _next_tick_ns(self) -> int | None:
        """When the page is to tell the time; the steps of real time that it computes it makes by itself."""
        session = self._session
        if session.over:
            return None
        computes = self._computed is not None and session.part.real_time
        return getattr(session.part, "limit_ns", None) if computes else session.next_tick_ns

    def _correct(self, play: RunningEpisode | None) -> None:
        """Tell a page that computes where the session is, if it may be elsewhere or does not know since a pause."""
        assert self._computed is not None
        resumes = not self._page_plays and play is not None and self._computed.sent_step != play.steps
        self._page_plays = play is not None
        if play is not None and (resumes or self._computed.is_elsewhere):
            self.outgoing.add(messages.StateCorrection(self.through, play.plan.episode, self._computed.position()))

    def _send_control(self, part: AgentPlayActivity, episode: int, action: int) -> None:
        """Tell what an agent means for this episode, and show the page where its next action leads."""
        control = describe_agent_control(part, episode)
        if control != self._sent_control:
            self._sent_control = control
            self.outgoing.add(control)
        if self._look_ahead_graph is not None and action >= 0 and part.who == "agent":
            self._look_ahead_graph.look(action)
            self._send_look_ahead()

    def _send_look_ahead(self) -> None:
        new = None if self._look_ahead_graph is None else self._look_ahead_graph.take_new()
        self._send_pictures()
        if new is not None:
            self.outgoing.add(new)

    def _lent(self, world_id: str, options: dict[str, Any]) -> World | None:
        """The outbox's own world, if it will do: a graph goes back to a scene of its own before each step."""
        plan = self._plan
        return None if plan is None or (plan.world, plan.options) != (world_id, options) else self._world_for(plan)

    def _send_pictures(self) -> None:
        for picture in self._image_cache.take_new():
            self.outgoing.add(picture)

    def close(self) -> None:
        """Let go of the outbox's own world."""
        if self._own_world is not None:
            self._own_world.close()
