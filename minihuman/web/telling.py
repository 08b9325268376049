"""What a page is told of a session: its screen, where an episode stands, and what would come. No socket, no clock.

Everything is in ``saying``, numbered, until the page has it. What is sent ahead is found by looking: along the keys of
an episode in a world of its own, outside of episodes in forks of the session.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.study.activities.agent_play import AgentPlaying
from minihuman.study.activities.correction_events import CorrectionBegun, CorrectionEnded, CorrectionStepped
from minihuman.study.events import EpisodeEnded, EpisodeStarted, Event, Stepped
from minihuman.study.play import Play
from minihuman.study.screens import Screen
from minihuman.study.session import Session
from minihuman.study.stage import MakeWorld
from minihuman.web import wire
from minihuman.web.ahead import Lookout, depth_for
from minihuman.web.album import Album, Encoding
from minihuman.web.guard import KEPT
from minihuman.web.onward import Ways, goes_on_by_itself, told_of
from minihuman.web.reels import Reels
from minihuman.web.steering import beside, steers
from minihuman.web.stream import Saying
from minihuman.worlds.adapt.world import World


@dataclass(frozen=True, slots=True)
class Settings:
    """What of the protocol is about pages."""

    picture_px: tuple[int, int] = (400, 300)
    encoding: Encoding = "auto"
    deepest: int = 6  # steps that are looked ahead; 0: none


class Telling:
    """Tells a page of a session.

    Args:
        session: new, or taken up from its log.
        make_world: makes worlds to look ahead in.
        settings: what of the protocol is about pages.
        logged: the events of the log that a session is taken up from.
    """

    def __init__(
        self, session: Session, make_world: MakeWorld, settings: Settings, logged: Sequence[Event] = ()
    ) -> None:
        self.saying: Saying[wire.Told | wire.Picture] = Saying()
        self.through = 0  # the last of the page's messages that was taken
        self.at_ns = 0  # when that was
        self.moved = 0  # the last of them that the page waits for, as it may lead somewhere
        self._session = session
        self._make_world = make_world
        self._settings = settings
        self._lookout: Lookout | None = None
        self._screen: Screen | None = None  # that the page has
        self._screen_id = self._screen_name = 0
        self._episode = -1  # whose steps these are
        self._scenes: list[int] = []  # the names of those that its steps led to; -1 for one that nobody named
        for event in logged:
            match event:
                case EpisodeStarted():
                    self._episode, self._scenes = event.plan.episode, [-1]
                case CorrectionBegun():
                    self._episode, self._scenes = event.episode, [-1] * (event.step + 1)
                case Stepped() | CorrectionStepped():
                    self._scenes.append(-1)
        self._told_now: tuple[object, ...] | None = None
        self._told_beside: wire.Beside | None = None
        self._album = Album(settings.encoding)
        self._ways = Ways(self._number, self._lent)
        self._reels = Reels(self._number)

    # What the page has

    def is_present(self, said: wire.Show) -> bool:
        """Whether a screen that was shown is what the session shows."""
        return said.name == self._screen_name if said.name else said.screen == self._screen_id

    def knows(self, said: wire.Show) -> bool:
        """Whether a picture that was shown is one of the present episode's steps."""
        return said.episode == self._episode and said.step < len(self._scenes)

    def difference(self, said: wire.Show) -> str:
        """How a step's picture was another than the session's; "" where it was the same."""
        scene = self._scenes[said.step]
        if not scene >= 0 <= said.node or scene == said.node:
            return ""
        return f"step {said.step} of episode {said.episode + 1} was shown as scene {said.node}, it is {scene}"

    @property
    def goes_by_presses(self) -> bool:
        """Whether the page waits for no word of a release: an episode is played, and by no agent."""
        session = self._session
        return not session.over and session.play is not None and not isinstance(session.part, AgentPlaying)

    # Where the session went

    def follow(self, events: list[Event]) -> None:
        """Bring the look-out to where the session is, and tell the page of it."""
        coming = None if self._session.over else self._session.part.coming
        ended = any(isinstance(event, EpisodeEnded | CorrectionEnded) for event in events)
        for event in events:
            match event:
                case EpisodeStarted() | CorrectionBegun() if self._session.play is not None:
                    self._look_from(self._session.play)
                case Stepped() | CorrectionStepped() if event.episode == self._episode:
                    self._stepped(event, ended=ended)
        if coming is not None and (self._lookout is None or self._lookout.plan is not coming.plan):
            self._look_from(coming)
        self._tell()

    def _look_from(self, play: Play) -> None:
        """Look ahead in an episode that has begun or is about to; told of it once."""
        plan = play.plan
        if self._lookout is not None and self._lookout.plan is plan:
            return
        self.tell_found()  # as long as its pictures are known
        actions = {key: play.world.action_names.index(name) for key, name in plan.key_map.keys.items()}
        noop = None if plan.noop is None else play.world.action_names.index(plan.noop)
        self._album.forget()
        keep = self._album.next
        can_happen = [*actions.values()] + ([] if noop is None else [noop])
        self._lookout = Lookout(
            plan, self._make_world, can_happen, self._settings.picture_px, self._album, world=self._world_for(play)
        )
        if play.steps:
            self._lookout.be_at(play.world)
        self._episode, self._scenes = plan.episode, [-1] * play.steps + [self._lookout.root.name]
        limits = [plan.max_steps] + ([] if play.world.step_limit is None else [play.world.step_limit])
        self.saying.say(
            wire.Rules(
                episode=plan.episode,
                actions=actions,
                real_time=plan.pace == "real_time",
                period=max(1, round(plan.step_period_ms * 1e6)),
                noop=noop,
                auto_repeat=plan.auto_repeat,
                most_steps=min(limits),
                held=getattr(self._session.part.part.plan, "hold_ms", 0.0) > 0,
                keep=keep,
            )
        )
        self._tell_ahead()

    def _world_for(self, play: Play) -> World | None:
        """The world that the last episode was looked ahead in, if it will do."""
        before, plan = self._lookout, play.plan
        same = before is not None and (before.plan.world, before.plan.options) == (plan.world, plan.options)
        if before is not None and not same:
            before.world.close()
        return before.world if before is not None and same else None

    def _stepped(self, stepped: Stepped | CorrectionStepped, *, ended: bool) -> None:
        assert self._lookout is not None
        if ended or self._session.play is None:  # its world may have been reset for the next episode
            scene = self._lookout.leads_to(stepped.action)
            self._scenes.append(-1 if scene is None else scene.name)
            return
        self._scenes.append(self._lookout.step(stepped.action, self._session.play.world).name)
        self._tell_ahead()

    def grow(self, rtt_ns: int, rate_hz: float) -> bool:
        """Draw one picture of a film, or look one scene or screen further ahead; False if nothing is left.

        What was found is told by ``tell_found``, or with whatever is told before.

        Args:
            rtt_ns: how long the line takes, there and back.
            rate_hz: keys a second.
        """
        lookout = self._lookout
        if self._session.over or self.saying.kept > KEPT:
            return False
        frame = self._reels.grow()
        if frame is not None:
            self._tell_pictures()
            self.saying.say(frame)
            return True
        if self._session.play is None and self._settings.deepest and self._ways.grow(rtt_ns):
            return True
        if lookout is None:
            return False
        deepest = self._settings.deepest
        part = self._session.part
        looks_on = isinstance(part, AgentPlaying) and not part.takes_over  # no key leads anywhere
        depth = 0 if looks_on else depth_for(rtt_ns, rate_hz)
        lookout.depth = min(deepest, depth)
        return lookout.grow()

    def tell_found(self) -> None:
        """Tell the page what was found ahead."""
        new = self._ways.take_new()
        self._tell_pictures()
        if new is not None:
            self.saying.say(new)
        if self._lookout is not None:
            self._tell_ahead()

    def begin_again(self, asked: Iterable[int], *, begun: bool) -> None:
        """Tell everything from the start.

        Args:
            asked: what the page was asked and has not answered.
            begun: whether there is anything to tell.
        """
        self.saying = Saying()
        self._album = Album(self._settings.encoding)
        self._ways = Ways(self._number, self._lent)
        self._reels = Reels(self._number)
        self._screen = self._told_now = self._told_beside = None
        self._screen_name = 0
        for number in asked:
            self.saying.say(wire.Ask(number))
        if self._lookout is not None:
            self._lookout.world.close()
            self._lookout = None
        if not self._session.over and begun:
            play = self._session.part.play or self._session.part.coming  # also behind a pause
            if play is not None:
                self._look_from(play)
            self._tell()

    def _tell(self) -> None:
        """Tell the page what it does not know of where the session is."""
        screen = self._session.screen
        tick_ns = self._session.next_tick_ns if not self._session.over else None
        if screen is not self._screen:
            told, name = told_of(self._session, self._number, self._screen_name)
            self._screen = screen
            if name != self._screen_name or not goes_on_by_itself(self._session):
                self._screen_id, self._screen_name = self._screen_id + 1, name
                self._ways.start_from(self._session, name)
                self._reels.start_from(screen, name)
                self._tell_pictures()
                self.saying.say(wire.ToShow(self._screen_id, self.through, self.at_ns, tick_ns, told, name))
        play, part = (None, None) if self._session.over else (self._session.play, self._session.part)
        step = -1 if play is None else play.steps
        who, action, limit_ns = "", -1, None
        if play is not None and isinstance(part, AgentPlaying):
            (who, action), limit_ns = steers(part, step), part.limit_ns
            self._tell_beside(part, play.plan.episode, action)
        now = tick_ns, self.moved if play is not None else 0, step, who, action, limit_ns
        if now != self._told_now:
            self._told_now = now
            node = self._scenes[step] if 0 <= step < len(self._scenes) else -1
            episode = self._episode if play else -1
            self.saying.say(wire.Now(self.through, tick_ns, episode, step, node, who, action, limit_ns))

    def _tell_beside(self, part: AgentPlaying, episode: int, action: int) -> None:
        """Tell what an agent means for this episode, and show the page where its next action leads."""
        told = beside(part, episode)
        if told != self._told_beside:
            self._told_beside = told
            self.saying.say(told)
        if self._lookout is not None and action >= 0 and part.who == "agent" and self._settings.deepest:
            self._lookout.look(action)
            self._tell_ahead()

    def _tell_ahead(self) -> None:
        assert self._lookout is not None
        new = self._lookout.take_new()
        self._tell_pictures()
        if new is not None:
            self.saying.say(new)

    def _number(self, picture: NDArray[np.uint8]) -> int:
        return self._album.number(picture)

    def _lent(self, world_id: str, options: dict[str, Any]) -> World | None:
        """The world that is looked ahead in, if it will do: it goes back to a scene of its own before each step."""
        lookout = self._lookout
        if lookout is None or (lookout.plan.world, lookout.plan.options) != (world_id, options):
            return None
        return lookout.world

    def _tell_pictures(self) -> None:
        for picture in self._album.take_new():
            self.saying.say(picture)

    def close(self) -> None:
        """Let go of the world that is looked ahead in."""
        if self._lookout is not None:
            self._lookout.world.close()
