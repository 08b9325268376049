"""Keeps a page ahead of the session in an episode: it computes the steps itself, or is sent the scenes they lead to.

An episode that the page computes needs only its first state. For any other episode, the next scenes are explored in a
separate world. This module uses no socket and no clock.
"""

from collections.abc import Sequence
from typing import Any

from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import Stepped
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
        self._look_ahead_world: World | None = None  # a world beside the session's, which may be reset
        self._can_restore = True  # whether that world can restore saved states of the session's world

    def forget(self, *, keeps_computed: bool) -> None:
        """Forget the current episode, because the page is new and has not received the episode's rules.

        Args:
            keeps_computed: whether to keep the computed episode, in case the reloaded page continues the same one.
        """
        self.plan = None
        self.graph = None
        if not keeps_computed:
            self.computed = None

    def begin(self, play: RunningEpisode, actions: Sequence[int], images: ImageCache, *, computes: bool) -> int:
        """Begin an episode; return the name of its current scene, or -1 if the page computes the episode.

        Args:
            play: the session's running episode.
            actions: the actions that can occur: those of keys, and the no-op if time makes steps.
            images: numbers and packs pictures.
            computes: whether the page computes the episode.
        """
        self.plan = play.plan
        self.graph = None
        self._can_restore = play.world.has_portable_copies
        if computes:
            if self.computed is None or self.computed.play is not play:  # it is the same if the page was reloaded
                self.computed = ComputedEpisode(play, self._picture_px)
            return -1
        self.computed = None
        look_ahead_world = None
        actual: World | None = play.world
        if self._can_restore:
            look_ahead_world = self._get_look_ahead_world(play.plan)
            actual = None
        # in both of these cases, the next step does not depend on one of a few known actions alone
        has_partners_ticks = play.is_joint and play.real_time
        combines_keys = play.repeats_held or not play.world.actions.is_discrete
        self.graph = LookAheadGraph(
            play.plan,
            self._make_world,
            actions,
            self._picture_px,
            images,
            world=look_ahead_world,
            blind=has_partners_ticks or combines_keys,
            actual=actual,
        )
        if play.steps:
            self.graph.move_to(play.world)
        play.keep_picture_hash(self.graph.picture_hash)
        return self.graph.root.name

    def step(self, action: int, play: RunningEpisode | None) -> int:
        """Follow the session's action; return the name of the scene that it led to, or -1 if the scene is unknown.

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

    def compare(self, message: messages.PageMessage, stepped: Stepped | None) -> str:
        """Return how the page's step for a message differs from the session's; "" if there is no new difference."""
        if self.computed is None or not isinstance(message, _STEPPING):
            return ""
        return self.computed.compare(message, stepped)

    def stop_if_slow(self, step_ns: int) -> None:
        """Stop looking ahead in a real-time world whose steps take ``step_ns``, if that is longer than their period."""
        if self.plan is not None and self.graph is not None and self.plan.pace == "real_time":
            self.graph.blind |= step_ns > self.plan.step_period_ms * 1e6

    def lend(self, world_id: str, options: dict[str, Any]) -> World | None:
        """Return the look-ahead world if it has the given id and options; None otherwise.

        The caller may reset it, because the graph restores one of its own scenes before each step.
        """
        if self.plan is None or not self._can_restore or (self.plan.world, self.plan.options) != (world_id, options):
            return None
        return self._get_look_ahead_world(self.plan)

    def _get_look_ahead_world(self, plan: EpisodePlan) -> World:
        """Return a look-ahead world for an episode: the last episode's if it has the same options, or a new one."""
        world = self._look_ahead_world
        if world is None or (world.id, world.options) != (plan.world, plan.options):
            if world is not None:
                world.close()
            world = self._make_world(plan.world, plan.options)
            self._look_ahead_world = world
        return world

    def close(self) -> None:
        """Close the look-ahead world."""
        if self._look_ahead_world is not None:
            self._look_ahead_world.close()
