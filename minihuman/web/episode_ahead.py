"""Keeps a page ahead of the session in an episode: it computes the steps itself, or is sent the scenes they lead to.

An episode that the page computes needs only its first state. For any other episode, the next scenes are explored in a
separate world. This module uses no socket and no clock.
"""

from collections.abc import Sequence
from typing import Any

from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web import messages
from minihuman.web.computed import ComputedEpisode
from minihuman.web.prefetch import LookAheadGraph
from minihuman.web.screen_values import ImageCache
from minihuman.worlds.adapters.world import World

_STEPPING = (messages.KeyMessage, messages.TickMessage)


class EpisodeAhead:
    """Keeps the page ahead of the session in the current episode, by the page's own computation or by look-ahead.

    Args:
        make_world: makes worlds to look ahead in.
        picture_px: the largest picture wanted, as width and height.
    """

    def __init__(self, make_world: WorldFactory, picture_px: tuple[int, int]) -> None:
        self.plan: EpisodePlan | None = None
        self.computed: ComputedEpisode | None = None  # an episode that the page computes
        self.graph: LookAheadGraph | None = None  # for any other episode
        self._make_world = make_world
        self._picture_px = picture_px
        self._own_world: World | None = None  # a world beside the session's, which may be reset
        self._lends = True  # whether that world can restore copies of the session's

    def forget(self, *, keeps_computed: bool) -> None:
        """Start over for a page that has no episode rules yet.

        Args:
            keeps_computed: whether to keep the computed episode, in case the reloaded page continues the same one.
        """
        self.plan = None
        self.graph = None
        if not keeps_computed:
            self.computed = None

    def begin(self, play: RunningEpisode, actions: Sequence[int], images: ImageCache, *, computes: bool) -> int:
        """Begin an episode; return its current scene, or -1 if the page computes it.

        Args:
            play: the session's running episode.
            actions: the actions that can occur: those of keys, and the no-op if time makes steps.
            images: numbers and packs pictures.
            computes: whether the page computes the episode.
        """
        self.plan = play.plan
        self.graph = None
        self._lends = play.world.has_portable_copies
        if computes:
            if self.computed is None or self.computed.play is not play:  # it is the same if the page was reloaded
                self.computed = ComputedEpisode(play, self._picture_px)
            return -1
        self.computed = None
        own_world = None
        actual: World | None = play.world
        if self._lends:
            own_world = self._find_world(play.plan)
            actual = None
        # in both cases, the next step is not one of a few known actions
        has_partners_ticks = play.is_joint and play.real_time
        combines_keys = play.repeats_held or not play.world.actions.is_discrete
        self.graph = LookAheadGraph(
            play.plan,
            self._make_world,
            actions,
            self._picture_px,
            images,
            world=own_world,
            blind=has_partners_ticks or combines_keys,
            actual=actual,
        )
        if play.steps:
            self.graph.move_to(play.world)
        play.keep_picture_hash(self.graph.picture_hash)
        return self.graph.root.name

    def step(self, action: int, play: RunningEpisode | None) -> int:
        """Follow the session's action; return the scene that it led to, -1 if that is unknown.

        Args:
            action: the action that the session took.
            play: the session's running episode; None if it is over and its world may have been reset for the next one.
        """
        if self.graph is None:
            return -1
        if play is None:
            edge = self.graph.root.edges.get(action)
            if edge is None:
                return -1
            return edge[0].name
        if play.is_joint:  # the step also had the others' actions
            self.graph.move_to(play.world)
            return self.graph.root.name
        scene = self.graph.step(action, play.world)
        play.keep_picture_hash(self.graph.picture_hash)
        return scene.name

    def compare(self, message: messages.PageMessage, events: Sequence[Event]) -> str:
        """Return how the page's step for a message differs from the session's; "" if it does not."""
        if self.computed is None or not isinstance(message, _STEPPING):
            return ""
        return self.computed.compare(message, events)

    def stop_if_slow(self, step_ns: int) -> None:
        """Stop looking ahead in a real-time world whose steps take longer than their period."""
        if self.plan is not None and self.graph is not None and self.plan.pace == "real_time":
            self.graph.blind |= step_ns > self.plan.step_period_ms * 1e6

    def lend(self, world_id: str, options: dict[str, Any]) -> World | None:
        """Return the look-ahead world if it has this id and these options; None otherwise.

        The borrower may reset it, because the graph restores one of its scenes before each step.
        """
        if self.plan is None or not self._lends or (self.plan.world, self.plan.options) != (world_id, options):
            return None
        return self._find_world(self.plan)

    def _find_world(self, plan: EpisodePlan) -> World:
        """Return a look-ahead world for an episode, reusing the last episode's if that suits."""
        own = self._own_world
        if own is None or (own.id, own.options) != (plan.world, plan.options):
            if own is not None:
                own.close()
            own = self._make_world(plan.world, plan.options)
            self._own_world = own
        return own

    def close(self) -> None:
        """Close the look-ahead world."""
        if self._own_world is not None:
            self._own_world.close()
