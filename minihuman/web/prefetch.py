"""Prefetching of the screens, film pictures and scenes that a page may show next. No I/O, no clock.

Outside of episodes, copies of the session try each likely input to find the screens that it leads to. If the copy's
screen differs from the session's, the session's counts. In an episode that the page does not compute itself, look-ahead
finds the scenes that the next keys lead to. Films are drawn one picture at a time, since a whole episode at once would
keep all other participants waiting.
"""

import hashlib
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import MinihumanError, WorldError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.inputs import Input, KeyDown, PointerPressed, ScreenShown, Tick
from minihuman.experiment.machine.running_episode import RunningEpisode, WorldFailedError, catch_world_errors
from minihuman.experiment.machine.screens import (
    BlankScreen,
    Button,
    FilmsScreen,
    PageScreen,
    PlayScreen,
    QuestionScreen,
    Screen,
    TextScreen,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.session_copy import WorldLender, can_copy_session, copy_session
from minihuman.web.messages import FilmFrame, LookAheadUpdate, PrefetchedScreen, ScreenPrefetch
from minihuman.web.screen_values import ImageCache, NumberPicture, convert_screen
from minihuman.worlds.adapters.world import World
from minihuman.worlds.picture_hash import hash_picture

_NAME_MASK = 2**52 - 1  # keeps 52 bits of a scene's hash, which a page's numbers hold exactly


@dataclass(slots=True, eq=False)
class SceneNode:
    """A state of the world, regardless of how many steps it took to reach."""

    hash: int
    picture: int
    saved: Any
    closed: bool  # whether no action can be tried from it, as the episode is over or the world cannot be restored
    edges: "dict[int, tuple[SceneNode, bool]]" = field(default_factory=dict)  # by action: next scene, whether it ends

    @property
    def name(self) -> int:
        """Return the name by which the page knows the scene, which is the same in every graph."""
        return name_scene(self.hash)


def name_scene(scene_hash: int) -> int:
    """Return the name by which the page knows a scene: the lower bits of the scene's hash."""
    return scene_hash & _NAME_MASK


class LookAheadGraph:
    """Finds the scenes to which the next actions of one episode lead.

    Args:
        plan: the episode.
        make_world: makes a world from an id and its options.
        actions: the actions that can occur: those of keys, and the no-op if time makes steps.
        picture_px: the largest picture wanted, as width and height.
        image_cache: numbers and packs pictures.
        world: a world made earlier for the same id and options, to be reused.
        blind: whether to follow only the session's own steps, one round trip later, without looking ahead.
        actual: the session's own world, if no other world can restore its copies; the graph is then blind, too.
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
        actual: World | None = None,
    ) -> None:
        self.plan = plan
        self.wrong = 0  # steps that were predicted wrongly
        self.blind = blind or actual is not None
        self._actions = tuple(sorted(set(actions)))
        self._picture_px = picture_px
        self._image_cache = image_cache
        self.pictures: dict[int, int] = {}  # the pictures' numbers by their scenes' names
        self._picture_hashes: dict[int, int] = {}  # by scenes' names; 0 in built-in worlds
        self._scenes: dict[int, SceneNode] = {}  # by hash
        self._new_nodes: list[tuple[int, int]] = []  # scene and picture, not sent yet
        self._new_edges: list[tuple[int, int, int, bool]] = []
        if actual is not None:
            self.world = actual
        else:
            self.world = world or make_world(plan.world, plan.options)
            self.world.reset(plan.seed)
        self.root = self._find_scene(self.world)

    def step(self, action: int, actual: World) -> SceneNode:
        """Follow a step of the session; return the scene that it led to.

        Args:
            action: the session's action.
            actual: the session's world after the step, whose scene is used if the predicted one differs.
        """
        self.look(action)
        edge = self.root.edges.get(action)
        if edge is None:
            self.move_to(actual)
            return self.root
        predicted, _ = edge
        if predicted.hash == actual.scene_hash():
            self.root = predicted
        else:
            self.wrong += 1
            self.move_to(actual)
        return self.root

    def move_to(self, actual: World) -> None:
        """Move to the scene that the session's own world is in."""
        self.root = self._find_scene(actual)

    def grow(self) -> bool:
        """Find the scene to which one untried action leads from the present scene; return False if none is left."""
        untried = [action for action in self._actions if action not in self.root.edges]
        return any(self.look(action) for action in untried)  # ``any`` stops at the first that is found

    def look(self, action: int) -> bool:
        """Find the scene to which an action leads from the present scene, and add it to the graph.

        Returns:
            Whether the action was tried now; False if it was tried before, or its scene cannot be found.
        """
        root = self.root
        world = self.world
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
            root.closed = True  # the saved world is at its step limit, which the session may reach later
            return False
        scene = self._find_scene(world, closed=terminated)
        root.edges[action] = scene, terminated
        self._new_edges.append((root.name, action, scene.name, terminated))
        return True

    @property
    def picture_hash(self) -> int:
        """Return the hash of the picture that the page shows for the present scene; 0 if none was computed."""
        return self._picture_hashes.get(self.root.name, 0)

    def take_new(self) -> LookAheadUpdate | None:
        """Return the scenes and edges found since the last call, to be sent to the page; None if there are none."""
        nodes = self._new_nodes
        edges = self._new_edges
        self._new_nodes = []
        self._new_edges = []
        if nodes or edges:
            return LookAheadUpdate(self.plan.episode, nodes, edges)
        return None

    def _find_scene(self, world: World, *, closed: bool = False) -> SceneNode:
        """Return the scene that a world is in; add it to the graph if it is new, or was closed and is open now.

        Args:
            world: the world.
            closed: whether the episode is over in this scene, so that no action can be tried from it.
        """
        scene_hash = world.scene_hash()
        existing = self._scenes.get(scene_hash)
        if existing is not None and (closed or not existing.closed):
            return existing
        picture, picture_hash = self._number_picture(world)
        saved = None
        if not closed and not self.blind:
            try:
                saved = world.save()
            except MinihumanError:
                self.blind = True
        scene = self._scenes[scene_hash] = SceneNode(scene_hash, picture, saved, closed or self.blind)
        self.pictures[scene.name] = picture
        self._picture_hashes[scene.name] = picture_hash
        self._new_nodes.append((scene.name, picture))
        return scene

    def _number_picture(self, world: World) -> tuple[int, int]:
        """Draw the picture of the scene that a world is in; return its number and its hash, 0 in a built-in world."""
        look = (self.plan.view, self._picture_px, self.plan.palette)
        tiles = world.picture_tiles(*look)
        if tiles is not None:
            return self._image_cache.number_tiles(tiles), 0
        pixels = np.ascontiguousarray(world.frame(*look))
        picture_hash = 0
        if not world.is_built_in:
            picture_hash = hash_picture(pixels)
        return self._image_cache.number(pixels, picture_hash=picture_hash), picture_hash


NEAR_RTT_NS = 40_000_000  # a shorter round trip is near
_NEAR_DEPTH = 1  # inputs to look ahead for a near page
_FAR_DEPTH = 3  # inputs to look ahead for any other page
_MOST_TRIES = 48  # of inputs, from one screen of the session
_FLIP_NS = 16_000_000  # assumed time until a screen is displayed
_LOOK_NS = 200_000_000  # assumed time from then to an input
_TICK = "tick"
_MOVING = ("step", "controller", "controller_text")  # fields that the page itself changes while a screen is shown


@dataclass(slots=True)
class _CopiedScreen:
    """A screen, with the copied session that shows it."""

    name: int
    session: SessionMachine
    depth: int  # inputs from the session's present screen


class ScreenPrefetcher:
    """Finds the screens to which inputs lead from the session's present screen.

    Args:
        number: gives a picture its number; the picture is sent before the screen that contains it.
        lend: lends a world with a given id and options, which may be reset; returns None if there is none to lend.
    """

    def __init__(self, number: NumberPicture, lend: WorldLender) -> None:
        self._number = number
        self._lend = lend
        self._to_do: deque[tuple[_CopiedScreen, str]] = deque()
        self._tries_left = 0
        self._looked_from: set[int] = set()  # names of the screens whose inputs are tried from the session's screen
        self._screens: set[int] = set()  # names of the screens that the page has
        self._edges: dict[tuple[int, str], int] = {}
        self._new_screens: list[PrefetchedScreen] = []
        self._new_edges: list[tuple[int, str, int]] = []

    def start_from(self, session: SessionMachine, name: int) -> None:
        """Start again from the session's present screen, which has the name ``name``."""
        self._to_do.clear()
        self._tries_left = _MOST_TRIES
        self._looked_from = set()
        if not session.over and can_copy_session(session) and session.phase is session.part.phase:
            self._schedule_inputs(_CopiedScreen(name, session, 0))

    def grow(self, rtt_ns: int) -> bool:
        """Try one input; return False if no input is left that the page may need within the given round-trip time."""
        max_depth = _FAR_DEPTH
        if rtt_ns < NEAR_RTT_NS:
            max_depth = _NEAR_DEPTH
        while self._to_do and self._tries_left:
            copied, input_name = self._to_do.popleft()
            if copied.depth < max_depth:
                self._tries_left -= 1
                self._try_input(copied, input_name)
                return True
        return False

    def take_new(self) -> ScreenPrefetch | None:
        """Return the screens and edges found since the last call, to be sent to the page; None if there are none."""
        screens = self._new_screens
        edges = self._new_edges
        self._new_screens = []
        self._new_edges = []
        if not edges:
            return None
        return ScreenPrefetch(screens, edges)

    def _schedule_inputs(self, copied: _CopiedScreen) -> None:
        """Schedule a screen's likely inputs to be tried, unless they were scheduled before."""
        if copied.name not in self._looked_from:
            self._looked_from.add(copied.name)
            self._to_do.extend((copied, input_name) for input_name in list_likely_inputs(copied.session))

    def _try_input(self, copied: _CopiedScreen, input_name: str) -> None:
        """Try an input in a copy of the session, and record the screen that it leads to."""
        tried = copy_session(copied.session, self._lend)
        _, at_ns = _mark_shown(tried)
        due_ns = tried.next_tick_ns
        if input_name == _TICK and due_ns is not None:
            at_ns = max(at_ns, due_ns)
        try:
            tried.receive(_make_input(input_name, at_ns))
        except WorldError:  # the world is not available here
            return
        if tried.over or tried.failure is not None or not can_copy_session(tried):
            return
        values, name = describe_screen(tried, self._number)
        playing = tried.play
        if name not in self._screens:
            due_ns = tried.next_tick_ns
            after_ns = None
            if due_ns is not None:
                after_ns = max(0, due_ns - at_ns)
            self._screens.add(name)
            self._new_screens.append(PrefetchedScreen(name, values, after_ns, *_locate_beginning(playing)))
        if self._edges.get((copied.name, input_name)) != name:
            self._edges[copied.name, input_name] = name
            self._new_edges.append((copied.name, input_name, name))
        if playing is None:
            self._schedule_inputs(_CopiedScreen(name, tried, copied.depth + 1))


def _locate_beginning(play: RunningEpisode | None) -> tuple[int, int]:
    """Return the number of an episode that begins with a screen, and its first scene's name; -1 and -1 for None."""
    if play is None:
        return -1, -1
    return play.plan.episode, name_scene(play.world.scene_hash())


def describe_screen(session: SessionMachine, number: NumberPicture, page_screen: int = 0) -> tuple[dict[str, Any], int]:
    """Return the values of a session's screen for the page, and the screen's name.

    The name depends on the screen's content and the session's state alone, so a copy of the session yields the same
    name.

    Args:
        session: the session in its present state.
        number: gives a picture its number.
        page_screen: the name of the screen that the page has. If it is the session's screen, and that shows films, no
            values are needed, and those returned are empty.
    """
    screen = session.screen
    if isinstance(screen, FilmsScreen):
        name = _name_screen(screen.identity, session)
        if name == page_screen:
            return {}, name
        return convert_screen(screen, number), name
    values = convert_screen(screen, number)
    if isinstance(screen, PlayScreen) and session.play is None:
        values["picture"] = number(screen.picture)
    unnamed_fields = {"picture"}  # fields on which the name does not depend
    if advances_by_itself(session):
        unnamed_fields.update(_MOVING)
    content = {key: value for key, value in values.items() if key not in unnamed_fields}
    return values, _name_screen(content, session)


def _name_screen(content: object, session: SessionMachine) -> int:
    """Return a screen's name, a hash of its content and of the session's position in its plan."""
    position = (session.part.number, session.phase, session.next_episode)
    digest = hashlib.blake2b(msgspec.json.encode((content, position)), digest_size=8).digest()
    return name_scene(int.from_bytes(digest, "little"))


def advances_by_itself(session: SessionMachine) -> bool:
    """Return whether the page advances the screen by itself: in an episode, or while films are shown."""
    return session.play is not None or isinstance(session.screen, FilmsScreen)


def list_likely_inputs(session: SessionMachine) -> Iterator[str]:
    """Yield the names of likely inputs, such as "key:enter", "point:go_on" or "tick", likeliest first."""
    screen: Screen = session.screen
    if session.next_tick_ns is not None:
        yield _TICK
    match screen:
        case TextScreen(keys=keys) if keys:
            yield from (f"key:{key}" for key, pressed in keys if not pressed)
        case TextScreen() if screen.prompt:
            yield "key:enter"
        case PageScreen(buttons=buttons):
            yield from ("key:enter", "point:go_on", "key:right", "key:left")
            if _has_back_button(buttons):
                yield "point:back"
        case QuestionScreen(item=item, buttons=buttons):
            yield from ("key:enter", "key:tab", "point:go_on")
            yield from item.list_likely_inputs()
            if _has_back_button(buttons):
                yield from ("key:page_up", "point:back")


def _has_back_button(buttons: Sequence[Button]) -> bool:
    return any(button.name == "back" for button in buttons)


def _mark_shown(session: SessionMachine) -> tuple[int, int]:
    """Tell a session that its screen was displayed; return the assumed times of the display and of the next input."""
    flip_ns = session.now_ns + _FLIP_NS
    if isinstance(session.screen, BlankScreen | TextScreen | PlayScreen):
        session.receive(ScreenShown(flip_ns, flip_ns, flip_ns))
    return flip_ns, flip_ns + _LOOK_NS


def _make_input(input_name: str, at_ns: int) -> Input:
    """Make the input with a name such as "key:enter" or "point:option:2", or a tick for any other name."""
    kind, _, target = input_name.partition(":")
    match kind:
        case "key":
            return KeyDown(at_ns, target, "")
        case "point":
            return PointerPressed(at_ns, 0.5, 0.5, target, 0.5)  # in the middle of the picture and of the target
    return Tick(at_ns)


class FilmPrefetcher:
    """Draws the remaining pictures of the films on the screen, one at a time.

    Args:
        number: gives a picture its number; the picture is sent before the frame that contains it.
    """

    def __init__(self, number: NumberPicture) -> None:
        self._number = number
        self._name = 0  # of the screen
        self._films: tuple[Sequence[NDArray[np.uint8]], ...] = ()
        self._to_do: deque[tuple[int, int]] = deque()  # films and indices in them, the next to be seen first

    def start_from(self, screen: Screen, name: int) -> None:
        """Start again with the films of a screen, if it has any; their current pictures were sent with the screen."""
        self._name = name
        self._films = ()
        step = 0
        if isinstance(screen, FilmsScreen):
            self._films = screen.films
            step = screen.shown_step
        to_draw = []
        for side, film in enumerate(self._films):
            current = min(step, len(film) - 1)
            for picture in range(len(film)):
                distance = (picture - current) % len(film)  # a film begins again after its end
                if distance:
                    to_draw.append((distance, side, picture))
        self._to_do = deque((side, picture) for _, side, picture in sorted(to_draw))

    def grow(self) -> FilmFrame | None:
        """Draw the next picture and return its frame; return None if none is left."""
        if not self._to_do:
            return None
        side, picture = self._to_do.popleft()
        return FilmFrame(self._name, side, picture, self._number(self._films[side][picture]))
