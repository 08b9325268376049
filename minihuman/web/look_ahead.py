"""Look-ahead, where a page does not compute: the scenes that the next key would lead to, each simulated and drawn once.

No I/O. It has a world of its own, compared with the session's at each step; where that cannot be saved, nothing is
looked for and the page waits for the session. Scenes that two paths lead to are one (`World.scene_hash`), so that
turning left and right again costs nothing. The page counts the steps of an episode: a scene does not know its age.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from minihuman.errors import MinihumanError
from minihuman.experiment.activities.activity import WorldFactory
from minihuman.experiment.machine.running_episode import WorldFailedError, catch_world_errors
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web.image_cache import ImageCache
from minihuman.web.messages import LookAheadUpdate
from minihuman.worlds.adapters.world import World

_NAME_BITS = 2**52 - 1  # of a scene's hash: what a page's numbers hold


@dataclass(slots=True, eq=False)
class SceneNode:
    """A state of the world but for its age."""

    hash: int
    picture: int
    saved: Any
    closed: bool  # nothing is known of what follows: the episode is over in it, or it cannot be gone on from
    edges: "dict[int, tuple[SceneNode, bool]]" = field(default_factory=dict)  # by action; whether the episode ends then

    @property
    def name(self) -> int:
        """What the page calls it: the same in every graph."""
        return name_scene(self.hash)


def name_scene(scene_hash: int) -> int:
    """What the page calls a scene."""
    return scene_hash & _NAME_BITS


class LookAheadGraph:
    """Looks ahead in one episode.

    Args:
        plan: the episode.
        make_world: makes a world for an id and its options.
        actions: those that can happen: what keys do, and the no-op where time makes steps.
        picture_px: the largest picture wanted, width and height.
        image_cache: numbers and packs pictures.
        world: one made for this episode's world before, to be used again.
        blind: look at what the session does alone, one round trip later.
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
        blind: bool = False,
    ) -> None:
        self.plan = plan
        self.wrong = 0  # steps after which the session was elsewhere
        self.blind = blind  # this world cannot be looked ahead in
        self._actions = tuple(sorted(set(actions)))
        self._picture_px = picture_px
        self._image_cache = image_cache
        self.pictures: dict[int, int] = {}  # their numbers, by the scenes' names
        self._scenes: dict[int, SceneNode] = {}  # by hash
        self._new_nodes: list[tuple[int, int]] = []  # as the page is sent them
        self._new_edges: list[tuple[int, int, int, bool]] = []
        self.world = world or make_world(plan.world, plan.options)
        self.world.reset(plan.seed)
        self.root = self._scene(self.world)

    def step(self, action: int, actual: World) -> SceneNode:
        """The session made a step: go where it went.

        Args:
            action: what it did.
            actual: its world, now; what it shows counts where the two differ.
        """
        self.look(action)
        edge = self.root.edges.get(action)
        if edge is None or edge[0].hash != actual.scene_hash():
            self.wrong += edge is not None
            self.move_to(actual)
        else:
            self.root = edge[0]
        return self.root

    def move_to(self, actual: World) -> None:
        """Be where the session is, by its own world."""
        self.root = self._scene(actual)

    def grow(self) -> bool:
        """Look at one action that is not known from here; False if all are."""
        return any(self.look(action) for action in self._actions)

    def look(self, action: int) -> bool:
        """See where an action leads from here; False if that is known or cannot be."""
        root, world = self.root, self.world
        if self.blind or root.closed or action in root.edges:
            return False
        try:
            with catch_world_errors():
                world.restore(root.saved)
                terminated, truncated = world.advance(action)
        except (MinihumanError, WorldFailedError):
            self.blind = True
            return False
        if truncated and not terminated:
            root.closed = True  # the copy is too old to go on from; nothing is known of a younger one
            return False
        found = self._scene(world, closed=terminated)
        root.edges[action] = found, terminated
        self._new_edges.append((root.name, action, found.name, terminated))
        return True

    def take_new(self) -> LookAheadUpdate | None:
        """What the page does not know yet."""
        nodes, edges, self._new_nodes, self._new_edges = self._new_nodes, self._new_edges, [], []
        return LookAheadUpdate(self.plan.episode, nodes, edges) if nodes or edges else None

    def _scene(self, world: World, *, closed: bool = False) -> SceneNode:
        """The scene that a world is in."""
        here = world.scene_hash()
        known = self._scenes.get(here)
        if known is not None and (closed or not known.closed):
            return known
        picture = self._image_cache.number(world.frame(self.plan.view, self._picture_px, self.plan.palette))
        saved = None
        if not closed and not self.blind:
            try:
                saved = world.save()
            except MinihumanError:
                self.blind = True
        scene = self._scenes[here] = SceneNode(here, picture, saved, closed or self.blind)
        self.pictures[scene.name] = picture
        self._new_nodes.append((scene.name, picture))
        return scene
