"""The look-ahead graph: the scenes that keys would lead to, several steps deep, each simulated and drawn once. No I/O.

The graph has a world of its own, and is compared with the session's at each step. Scenes that two paths lead to are one
(`World.scene_hash`), so that turning left and right again costs nothing. The page counts the steps of an episode: a
scene does not know how old it is.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from minihuman.errors import MinihumanError
from minihuman.experiment.activities.activity import WorldFactory
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web.image_cache import ImageCache
from minihuman.web.messages import LookAheadUpdate
from minihuman.worlds.adapters.world import World

MAX_DEPTH = 6
_NAME_BITS = 2**52 - 1  # of a scene's hash: what a page's numbers hold
_LEAST_RATE, _MOST_RATE = 2.0, 8.0  # keys per second that are assumed


@dataclass(frozen=True, slots=True)
class SceneEdge:
    """Where an action leads."""

    scene: int  # a scene's number
    ends: bool  # the episode is over then


@dataclass(slots=True)
class SceneNode:
    """A state of the world but for its age."""

    number: int
    hash: int
    picture: int
    saved: Any
    edges: dict[int, SceneEdge] = field(default_factory=dict)
    closed: bool = False  # the episode is over in it

    @property
    def name(self) -> int:
        """What the page calls it: the same in every graph."""
        return name_scene(self.hash)


def name_scene(scene_hash: int) -> int:
    """What the page calls a scene."""
    return scene_hash & _NAME_BITS


def compute_depth(rtt_ns: int, rate_hz: float) -> int:
    """How many steps ahead hide the latency: those pressed during a round trip, and one.

    A round trip shorter than a quarter of the time between two presses needs only that one.
    """
    rate_hz = min(max(rate_hz, _LEAST_RATE), _MOST_RATE)
    return min(MAX_DEPTH, math.ceil(rtt_ns / 1e9 * rate_hz - 0.25) + 1)


class LookAheadGraph:
    """Looks ahead in one episode.

    Args:
        plan: the episode.
        make_world: makes a world for an id and its options.
        actions: those that can happen: what keys do, and the no-op where time makes steps.
        picture_px: the largest picture wanted, width and height.
        image_cache: numbers and packs pictures.
        world: one made for this episode's world before, to be used again.
    """

    def __init__(
        self,
        plan: EpisodePlan,
        make_world: WorldFactory,
        actions: Iterable[int],
        picture_px: tuple[int, int],
        image_cache: ImageCache,
        *,
        world: World | None = None,
    ) -> None:
        self.plan = plan
        self.depth = 1
        self.wrong = 0  # steps after which the session was elsewhere
        self.simulated = 0  # scenes
        self.blind = False  # this world cannot be looked ahead in
        self._actions = tuple(sorted(set(actions)))
        self._picture_px = picture_px
        self._image_cache = image_cache
        self._scenes: list[SceneNode] = []
        self._by_hash: dict[int, int] = {}
        self._n_sent_scenes = 0
        self._new_edges: list[tuple[int, int]] = []  # scenes and actions
        self._last_action = -1
        self._to_do: deque[tuple[int, int]] | None = None  # scenes and actions, the likeliest first
        self.world = world or make_world(plan.world, plan.options)
        self.world.reset(plan.seed)
        self.root = self._scene()

    @property
    def scenes(self) -> Sequence[SceneNode]:
        """All that were seen, by number."""
        return self._scenes

    def leads_to(self, action: int) -> SceneNode | None:
        """Where an action leads from here; None where that is not known."""
        edge = self.root.edges.get(action)
        return None if edge is None else self._scenes[edge.scene]

    def step(self, action: int, actual: World) -> SceneNode:
        """The session made a step: go where it went.

        Args:
            action: what it did.
            actual: its world, now; what it shows counts where the two differ.
        """
        edge = self.root.edges.get(action)
        if edge is None and not self.blind and not self.root.closed:
            edge = self._simulate(self.root, action)
        if edge is None or self._scenes[edge.scene].hash != actual.scene_hash():
            self.wrong += edge is not None
            self.move_to(actual)
        else:
            self.root = self._scenes[edge.scene]
        self._last_action, self._to_do = action, None
        return self.root

    def look(self, action: int) -> None:
        """See where an action leads from here, whatever the depth is."""
        if not self.blind and not self.root.closed and action not in self.root.edges:
            self._simulate(self.root, action)
            self._to_do = None

    def grow(self) -> bool:
        """Simulate one scene that is not known yet; False if all within the depth are."""
        if self.blind:
            return False
        if self._to_do is None:
            self._to_do = self._unknown()
        while self._to_do:
            number, action = self._to_do.popleft()
            if action in self._scenes[number].edges:
                continue
            known = len(self._scenes)
            self._simulate(self._scenes[number], action)
            if len(self._scenes) > known or not self._to_do:
                self._to_do = None  # what is behind it may be likelier than what is left
            return True
        return False

    def take_new(self) -> LookAheadUpdate | None:
        """What the page does not know yet."""
        nodes = [(scene.name, scene.picture) for scene in self._scenes[self._n_sent_scenes :]]
        edges = []
        for number, action in self._new_edges:
            edge = self._scenes[number].edges[action]
            edges.append((self._scenes[number].name, action, self._scenes[edge.scene].name, edge.ends))
        self._n_sent_scenes, self._new_edges = len(self._scenes), []
        return LookAheadUpdate(self.plan.episode, nodes, edges) if nodes or edges else None

    def _unknown(self) -> deque[tuple[int, int]]:
        """Scenes within the depth and actions not tried in them, nearest first, the last action's branch before."""
        found: list[tuple[int, int, int, int]] = []
        costs = {self.root.number: 0}
        level = [(self.root.number, self._last_action, 0)]
        for depth in range(self.depth):
            following: dict[int, tuple[int, int]] = {}
            for number, before, turns in level:
                scene = self._scenes[number]
                if scene.closed:
                    continue
                for action in self._actions:
                    cost = turns + (action != before)
                    edge = scene.edges.get(action)
                    if edge is None:
                        found.append((depth + cost, depth, number, action))
                    elif not edge.ends and costs.get(edge.scene, math.inf) > depth + 1 + cost:
                        costs[edge.scene] = depth + 1 + cost
                        following[edge.scene] = action, cost
            level = [(number, action, cost) for number, (action, cost) in following.items()]
        return deque((number, action) for _, _, number, action in sorted(found))

    def _simulate(self, scene: SceneNode, action: int) -> SceneEdge | None:
        """Try an action in a scene; None where only its age ends the episode there."""
        world = self.world
        try:
            world.restore(scene.saved)
            terminated, truncated = world.advance(action)
        except MinihumanError:
            self.blind = True
            return None
        if truncated and not terminated:
            scene.closed = True  # the copy is too old to go on from; nothing is known of a younger one
            return None
        self.simulated += 1
        found = self._scene(closed=terminated)
        edge = scene.edges[action] = SceneEdge(found.number, terminated)
        self._new_edges.append((scene.number, action))
        return edge

    def _scene(self, *, closed: bool = False) -> SceneNode:
        """The scene that the world is in."""
        here = self.world.scene_hash()
        known = self._by_hash.get(here)
        if known is not None:
            return self._scenes[known]
        return self._add(self.world, here, closed=closed)

    def _add(self, world: World, here: int, *, closed: bool) -> SceneNode:
        picture = self._image_cache.number(world.frame(self.plan.view, self._picture_px, self.plan.palette))
        saved = None
        if not closed and not self.blind:
            try:
                saved = world.save()
            except MinihumanError:
                self.blind = True
        scene = SceneNode(len(self._scenes), here, picture, saved, closed=closed or saved is None)
        self._scenes.append(scene)
        self._by_hash[here] = scene.number
        return scene

    def move_to(self, actual: World) -> None:
        """Be where the session is, by its own world."""
        here = actual.scene_hash()
        known = self._by_hash.get(here)
        if known is not None and not self._scenes[known].closed:
            self.root = self._scenes[known]
        else:
            self.root = self._add(actual, here, closed=False)
