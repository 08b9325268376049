"""The activity interface: what an activity implements, the session context it works in, how a kind is described,
and the registry of kinds: the entry-point group `minihuman.activities`, which names the built-in ones too.
"""

import abc
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Any

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import (
    ActivityEvent,
    EndReason,
    Event,
    KeyPressed,
    KeyVerdict,
    Noted,
    PartEnd,
    PauseReason,
    TextTyped,
)
from minihuman.experiment.machine.inputs import ActivityInput, Input, KeyDown, KeyUp
from minihuman.experiment.machine.running_episode import RunningEpisode, catch_world_errors
from minihuman.experiment.machine.screens import ActivityScreen, Screen
from minihuman.experiment.plan.session_plan import KeyMap, PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords
from minihuman.plugins import list_plugin_names, load_plugin

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


WorldFactory = Callable[[str, dict[str, Any]], "World"]
ENTER_KEYS = ("enter", "kp_enter")


class SessionContext:
    """The state that outlives a part, the open world, and the events of the current input."""

    def __init__(
        self,
        plan: SessionPlan,
        make_world: WorldFactory,
        picture_px: tuple[int, int] | None,
        *,
        renders_steps: bool = True,
        facts: Mapping[str, str] | None = None,
    ) -> None:
        self.plan = plan
        self.facts = facts or {}  # the rules that the session follows; in a replay, those of the log
        self.words = InterfaceWords(plan.language, plan.words, plan.fonts)
        self.picture_px = picture_px
        self.renders_steps = renders_steps
        self.now_ns = 0
        self.next_episode = plan.first_episode  # index of the episode being played or to be played next
        self.completed = 0  # episodes of this segment
        self.key_map: KeyMap | None = None  # in force
        self.points = plan.standing.points
        self.tries = dict(plan.standing.tries)
        self.waited_ns = plan.standing.waited_ns or 0  # in lobbies
        self.stranded = bool(plan.standing.stranded)  # without a partner, in a block that ended for it
        self.teams: tuple[str, ...] = ()  # that the segment was in, the latest last
        self.partners: set[str] = set()  # what the others in them were: "person", "agent"
        self.keys_down: dict[str, int] = {}  # the latest last, with when each went down
        self.axes: dict[str, float] = {}  # where those of the gamepad are
        self._make_world = make_world
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._events: list[Event] = []

    def emit(self, *events: Event) -> None:
        """Emit events, in order."""
        self._events += events

    def emit_key(self, key: KeyDown | KeyUp, verdict: KeyVerdict, phase: str, action: int | None = None) -> None:
        """Emit a key and its verdict."""
        down, waited_ns = isinstance(key, KeyDown), self.now_ns - key.t_ns
        self.emit(KeyPressed(self.now_ns, key.key, key.symbol, down, action, verdict, phase, waited_ns))

    def pop_events(self) -> list[Event]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events

    def has_world(self, world_id: str, options: dict[str, Any]) -> bool:
        """Whether that world is the one that is open."""
        return self._world is not None and self._world[0] == (world_id, options)

    def world(self, world_id: str, options: dict[str, Any]) -> "World":
        """The one world that is open; another is closed first."""
        key = (world_id, options)
        if self._world is None or self._world[0] != key:
            with catch_world_errors():
                self.close()
                self._world = (key, self._make_world(world_id, options))
        return self._world[1]

    def close(self) -> None:
        """Close the world."""
        if self._world:
            self._world[1].close()
            self._world = None


@dataclass(frozen=True, slots=True)
class PartEnding:
    """How a part ended, and where the session goes on."""

    end: PartEnd = "done"
    back_to: int | None = None  # a part's index; None: the next part
    reason: EndReason | None = None  # the whole session ends, for this reason
    detail: str = ""


class ActivityRequest:
    """What a part needs from its session host; a kind of activity adds the fields. The answer is an input."""


class RequestHandler(abc.ABC):
    """Answers the requests of parts, in a session of a window, of a browser or simulated."""

    @abc.abstractmethod
    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """An input for the session; None if there is no answer yet.

        Args:
            want: the request.
            play: the running episode; None between episodes.
            t_ns: the session's time.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Stop the processes."""


class Activity(abc.ABC):
    """One part of a session while it runs. No clock, file or window: time comes with the inputs.

    Args:
        number: the part's index in the plan.
        part: its kind, name and plan.
        context: the session, which takes the events.
    """

    phase: StrEnum
    ended: PartEnding | None = None  # set when it is over
    next_tick_ns: int | None = None  # when it needs a Tick, unless another input comes first
    playing = False  # whether it can be paused now
    can_copy = False  # whether its state is numbers, texts, drafts, and lists, sets and dicts of them: see copy_session
    real_time = False  # whether time, not a key, makes steps now
    play: RunningEpisode | None = None  # the running episode, for simulated participants that look at its world
    next_play: RunningEpisode | None = None  # the next one, its world reset, so that its pictures can be prepared
    request: ActivityRequest | None = None  # to the session host
    typed_event: Callable[[int, str], Event] = TextTyped  # what is logged of text

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        self.number = number
        self.part = part
        self.context = context

    @abc.abstractmethod
    def begin(self) -> None:
        """Start; ``ended`` may be set at once if there is nothing to do."""

    @abc.abstractmethod
    def receive(self, happened: Input) -> None:
        """Deal with an input: a key that the session has no use for, text, a pointer, a picture shown, time passed."""

    @abc.abstractmethod
    def screen(self) -> Screen:
        """What to show now."""

    def suspend(self, reason: PauseReason) -> None:  # noqa: B027 - most kinds have nothing to stop
        """Stop until ``resume``: a pause, a question or another window is in front."""

    def resume(self) -> None:
        """Go on."""
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def stop(self) -> None:  # noqa: B027
        """The session ends in the middle of this part."""

    def simulate(self, choose: Callable[[int], int]) -> str | None:
        """The key that a simulated participant presses now; None does what other screens of the type ask for.

        Args:
            choose: draws a number below its argument.
        """
        return None

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """The input that led to an event of this kind, for replays; None if no input did."""
        return None


@dataclass(frozen=True, slots=True)
class ActivityKind:
    """A kind of activity: one row of the registry, which says what is in the kind's folder.

    What logs, tables, windows, the page and the report need of a kind is named by "module:attribute" and loaded when it
    is needed, so that a session imports none of it. Built-in kinds use what a plug-in can use.

    Args:
        name: the protocol's word for it, and its entry point's name.
        plan: the type of a part's plan: a `PartPlan`, to say what the session asks of one; a ``PlayPlan`` for blocks.
        activity: what runs a part.
        messages: a tuple of ``minihuman.log.codec.EventRow``, one for each event of its own.
        browser: whether it can be done in a browser.
        block_field: the plan's field that names a block of the protocol, if it has one.
        tables: a tuple of ``minihuman.dataset.activity_tables.ActivityTable``.
        screens: its own screens; each names its drawing, and how the page shows it.
        report: a function that makes a ``ReportSection`` of a ``SectionSource`` (``minihuman.reporting``), or None.
        check_block: yields what is wrong with a block of the kind in a protocol, each as a field and what is wrong; it
            is given the block and the keys that may have an action.
        find_early_parts: yields the kind's parts in a plan that was recorded before plans had parts, each with its
            place: 0 consent, 1 keyboard check, 2 blocks, 3 closing words.
    """

    name: str
    plan: type[msgspec.Struct]
    activity: type[Activity]
    messages: str = ""
    browser: bool = True
    block_field: str = ""
    tables: str = field(default="", kw_only=True)
    screens: tuple[type[ActivityScreen], ...] = field(default=(), kw_only=True)
    report: str = field(default="", kw_only=True)
    check_block: Callable[[Any, tuple[str, ...]], Iterable[tuple[str, str]]] | None = field(default=None, kw_only=True)
    find_early_parts: Callable[[SessionPlan], Iterable[tuple[int, PlannedPart]]] | None = field(
        default=None, kw_only=True
    )

    def read(self, plan: Any) -> msgspec.Struct:
        """A part's plan from what JSON gave."""
        return msgspec.convert(plan, self.plan)


GROUP = "minihuman.activities"


def list_built_in_kinds() -> tuple[str, ...]:
    """The names of this package's kinds."""
    return list_plugin_names(GROUP, built_in=True)


@cache
def find_kind(name: str) -> ActivityKind:
    """The kind of that name.

    Raises:
        ProtocolError: if none is installed.
    """
    kind = load_plugin(GROUP, name, ProtocolError, what="activity")
    if not isinstance(kind, ActivityKind):
        raise ProtocolError(
            f"activity {name!r} is of type {type(kind).__name__}; register an instance of minihuman.ext.ActivityKind"
        )
    return kind


def build_activity(number: int, part: PlannedPart, context: SessionContext) -> Activity:
    """An activity for a part of a plan."""
    return find_kind(part.kind).activity(number, part, context)
