"""The activity interface and the registry of activity kinds.

An `Activity` runs one part of a session within a `SessionContext`. An `ActivityKind` describes a kind of activity; the
entry-point group `minihuman.activities` registers the kinds, the built-in ones included.
"""

import abc
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.keys import MOUSE_AXES
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
from minihuman.experiment.machine.inputs import ActivityInput, AxisChanged, Input, KeyDown, KeyUp
from minihuman.experiment.machine.running_episode import RunningEpisode, catch_world_errors
from minihuman.experiment.machine.screens import ActivityScreen, Screen
from minihuman.experiment.plan.session_plan import KeyMap, PlannedPart, SessionPlan
from minihuman.experiment.sounds import SoundCue
from minihuman.experiment.words import InterfaceWords
from minihuman.plugins import list_plugin_names, load_plugin, remember_by_name

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


WorldFactory = Callable[[str, dict[str, Any]], "World"]
ENTER_KEYS = ("enter", "kp_enter")


class SessionContext:
    """The state of a session that outlives its parts, the open world, and the events of the current input."""

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
        self.key_map: KeyMap | None = None  # the one in force
        self.points = plan.standing.points
        self.tries = dict(plan.standing.tries)
        self.waited_ns = plan.standing.waited_ns or 0  # the time spent in lobbies
        self.stranded = bool(plan.standing.stranded)  # whether a block ended for lack of a partner
        self.teams: tuple[str, ...] = ()  # the teams of this segment, the latest last
        self.partners: set[str] = set()  # the kinds of the others in them: "person", "agent"
        self.keys_down: dict[str, int] = {}  # the time of each press in ns, the latest last
        self.axes: dict[str, float] = {}  # positions of a gamepad's axes, and the mouse's motion since the last tick
        self._make_world = make_world
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._events: list[Event] = []

    def emit(self, *events: Event) -> None:
        """Add events to those of the current input, in order."""
        self._events += events

    def move_axis(self, moved: AxisChanged) -> None:
        """Record an axis's motion: set a gamepad's or touch stick's axis to the value; add pixels to a mouse axis."""
        pixels_before = self.axes.get(moved.axis, 0.0) if moved.axis in MOUSE_AXES else 0.0
        self.axes[moved.axis] = pixels_before + moved.value

    def emit_key(self, key: KeyDown | KeyUp, verdict: KeyVerdict, phase: str, action: int | None = None) -> None:
        """Emit the event of a key press or release.

        Args:
            key: the press or release.
            verdict: what the session made of it.
            phase: the name of the phase in which it was handled.
            action: the number of the action that the key has; None if it has none, or if that does not matter.
        """
        is_down = isinstance(key, KeyDown)
        waited_ns = self.now_ns - key.t_ns
        self.emit(KeyPressed(self.now_ns, key.key, key.symbol, is_down, action, verdict, phase, waited_ns))

    def pop_events(self) -> list[Event]:
        """Return and clear the events since the last call."""
        events = self._events
        self._events = []
        return events

    def has_world(self, world_id: str, options: dict[str, Any]) -> bool:
        """Return whether the open world is the one with the given id and options."""
        return self._world is not None and self._world[0] == (world_id, options)

    def world(self, world_id: str, options: dict[str, Any]) -> "World":
        """Return the world with the given id and options; if another world is open, close it and open this one.

        Raises:
            WorldFailedError: if the world cannot be made, or the other one fails while it is closed.
        """
        key = (world_id, options)
        if self._world is None or self._world[0] != key:
            with catch_world_errors():
                self.close()
                self._world = (key, self._make_world(world_id, options))
        return self._world[1]

    def close(self) -> None:
        """Close the open world, if there is one."""
        if self._world:
            self._world[1].close()
            self._world = None


@dataclass(frozen=True, slots=True)
class PartEnding:
    """How a part ended, and where the session continues."""

    end: PartEnd = "done"
    back_to: int | None = None  # the index of the part that follows; None for the next part
    reason: EndReason | None = None  # why the whole session ends; None if it continues
    detail: str = ""


class ActivityRequest:
    """A part's request to its session host, which answers with an input. Kinds of activity add fields in subclasses."""

    awaits_others: ClassVar[bool] = False  # whether others' sessions answer it, so that it is repeated without an input

    @property
    def takes_long(self) -> bool:
        """Return whether the session continues, rather than waits, while the host computes the answer."""
        return False


@dataclass(frozen=True, slots=True)
class SteeringRules:
    """The effects of keys and time in an episode that an agent plays, for a window that runs ahead of the session."""

    period_ns: int  # from the picture of one of the agent's steps to the next step
    person_acts: bool  # whether a key that has an action takes control
    hand_back_key: str  # "" where control cannot be handed back
    rating_keys: tuple[str, str]  # good and bad; "" where steps are not rated
    flash_ns: int  # the time for which a rating is shown
    repeat_interval_ns: int  # the shortest time between two ratings by a held key
    controller_texts: Mapping[str, str]  # the text below the picture, by controller


@dataclass(frozen=True, slots=True)
class Steering:
    """Who controls a running episode that an agent plays, and the agent's next action."""

    controller: str
    action: int | None  # the agent's next action; None until it is known
    limit_ns: int | None  # the time from which keys have no effect; None without a limit
    rules: SteeringRules


class RequestHandler(abc.ABC):
    """A session host's interface for answering the requests of parts."""

    @abc.abstractmethod
    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Return the input that answers a request; None if there is no answer yet.

        Args:
            want: the request.
            play: the running episode; None between episodes.
            t_ns: the session's time in nanoseconds.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Stop the processes that compute answers."""


@dataclass(frozen=True, slots=True)
class AnswerField:
    """A field whose answer a page without a server judges, as it has too many values to prepare a screen for each.

    Attributes:
        name: the question's name.
        judgement: the judgement of the present answer.
        rules: the rules of judgement, as JSON values.
        shown_as: the fields of the widget that depend on the answer; the others depend on its judgement alone.
        examples: by judgement, functions that make the inputs of an answer with that judgement; each takes a time in
            nanoseconds. What follows an answer depends on its judgement alone.
    """

    name: str
    judgement: str
    rules: Mapping[str, Any]
    shown_as: tuple[str, ...]
    examples: Mapping[str, tuple[Callable[[int], Input], ...]]


class Activity(abc.ABC):
    """One part of a session while it runs.

    It has no clock, file or window: time arrives with the inputs.

    Args:
        number: the part's index in the plan.
        part: the part's kind, name and plan.
        context: the session's context, which receives the events.
    """

    phase: StrEnum
    ended: PartEnding | None = None  # how the part ended; None while it runs
    next_tick_ns: int | None = None  # the time at which it needs a Tick, unless another input comes first
    playing = False  # whether it can be paused now
    can_copy = False  # whether its state is of types that `copy_session` copies
    real_time = False  # whether time, not a key, makes steps now
    play: RunningEpisode | None = None  # the running episode, for simulated participants that look at its world
    next_play: RunningEpisode | None = None  # the next one, its world reset, so that its pictures can be prepared
    request: ActivityRequest | None = None  # to the session host
    agent_plays: ClassVar[bool] = False  # whether an agent makes steps, beside the person or alone
    takes_over: ClassVar[bool] = False  # whether the person's keys make steps where an agent plays
    sound_cues: tuple[SoundCue, ...] = ()  # the sounds that play now or are scheduled; any other sound stops
    limit_ns: int | None = None  # the time at which play is over, if it is limited
    typed_event: Callable[[int, str], Event] = TextTyped  # makes the event that logs text, from its time and the text

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        self.number = number
        self.part = part
        self.context = context

    @abc.abstractmethod
    def begin(self) -> None:
        """Start the part. Set ``ended`` at once if there is nothing to do."""

    @abc.abstractmethod
    def receive(self, happened: Input) -> None:
        """Handle an input that the session passes on: a key, text, a pointer, a picture shown, or passing time."""

    @abc.abstractmethod
    def screen(self) -> Screen:
        """Return the present screen."""

    def describe_steering(self, play: RunningEpisode) -> Steering | None:
        """Return who controls a running episode; None if no agent plays."""
        return None

    @property
    def answer_field(self) -> AnswerField | None:
        """Return the field to type in on the present screen; None without one, or if only a server can judge it."""
        return None

    @property
    def history(self) -> tuple[object, ...]:
        """Return the state that decides how the part continues, in addition to its screen and the texts shown so far.

        Two runs of the part with equal screens, texts and history continue in the same way.
        """
        return ()

    def suspend(self, reason: PauseReason) -> None:  # noqa: B027 - most kinds have nothing to stop
        """Stop all clocks until ``resume``, because a pause, a question or another window covers the part."""

    def resume(self) -> None:
        """Continue after ``suspend``, and log the part's phase."""
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def stop(self) -> None:  # noqa: B027
        """End whatever is in progress because the session ends within this part."""

    def simulate(self, choose: Callable[[int], int]) -> str | None:
        """Return the key that a simulated participant presses now; None for the default of the screen's type.

        Args:
            choose: draws a whole number from 0 up to but not including its argument.
        """
        return None

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that led to an event of this kind, for replays; None if no input did."""
        return None


@dataclass(frozen=True, slots=True)
class ActivityKind:
    """A kind of activity with everything that is registered for it: plan, activity, log rows, tables and drawing.

    What logs, tables, windows, the page and the report need of a kind is named as "module:attribute" and loaded on
    demand, so that a session imports none of it. Built-in kinds use no more than plug-ins can use.

    Args:
        name: the kind's name in protocols, which is also the name of its entry point.
        plan: the type of a part's plan: a `PartPlan`, or a ``PlayPlan`` for blocks.
        activity: the class that runs a part.
        messages: a tuple of ``minihuman.log.codec.EventRow``, one for each event type of the kind.
        browser: whether a browser can run the kind.
        block_field: the field of the plan that names a block of the protocol; "" if there is none.
        tables: a tuple of ``minihuman.dataset.activity_tables.ActivityTable``.
        presentations: a function that yields a ``minihuman.dataset.presented_stimuli.Presentation`` for each picture
            and sound of the kind's stimuli in a ``SessionLog``.
        screens: the kind's own screen types; each names its drawing and its view on the page.
        page_fields: a ``TypedDict`` of the fields that the kind adds to the page's screen of play; the page's types
            are generated from it.
        measures: the kind's measures of a participant, as labels by name; the rows of the table ``trial_measures``
            contain them.
        report: a function that builds a ``ReportSection`` from a ``SectionSource`` (``minihuman.reporting``), or None.
        simulator: a ``PartSimulator`` (``minihuman.simulation``), which acts in simulated sessions; without one, the
            activity's own `Activity.simulate` acts, with defaults for the screens that all kinds share.
        page_run: a function that builds a ``PageRun`` (``minihuman.web.site.page_run``) of an activity, or None: what a
            page without a server runs by itself on the present screen.
        check_block: a function that yields the errors of a block of the kind in a protocol, each as a field and a
            message; its arguments are the block and the keys that may have an action.
        find_early_parts: a function that yields the kind's parts in a plan that was recorded before plans had parts,
            each with its position: 0 consent, 1 keyboard check, 2 blocks, 3 closing text.
        find_server_needs: a function that yields what in a part of the kind needs a server, each as a clause about the
            part; None if every part does.
        is_played_alone: whether only the participant acts in a block's worlds, so that a touch screen's buttons, axes
            and clicks can play it and its actions may be of any space.
        is_plain_play: whether a block consists of nothing but its worlds' steps by one person's keys, so that a page
            can compute it and a study can be tried without sessions.
        is_for_players: whether a language model, or a simulated player that decides on each key, can do it.
        has_trials: whether the kind's episodes are trials, and are described as such.
        is_check: whether a participant who is screened out in it has failed a check rather than a block's criterion.
    """

    name: str
    plan: type[msgspec.Struct]
    activity: type[Activity]
    messages: str = ""
    browser: bool = True
    block_field: str = ""
    tables: str = field(default="", kw_only=True)
    presentations: str = field(default="", kw_only=True)
    screens: tuple[type[ActivityScreen], ...] = field(default=(), kw_only=True)
    page_fields: str = field(default="", kw_only=True)
    measures: str = field(default="", kw_only=True)
    report: str = field(default="", kw_only=True)
    simulator: str = field(default="", kw_only=True)
    page_run: str = field(default="", kw_only=True)
    check_block: Callable[[Any, tuple[str, ...]], Iterable[tuple[str, str]]] | None = field(default=None, kw_only=True)
    find_early_parts: Callable[[SessionPlan], Iterable[tuple[int, PlannedPart]]] | None = field(
        default=None, kw_only=True
    )
    find_server_needs: Callable[[PlannedPart], Iterable[str]] | None = field(default=None, kw_only=True)
    is_played_alone: bool = field(default=False, kw_only=True)
    is_plain_play: bool = field(default=False, kw_only=True)
    is_for_players: bool = field(default=False, kw_only=True)
    has_trials: bool = field(default=False, kw_only=True)
    is_check: bool = field(default=False, kw_only=True)

    @property
    def plan_fields(self) -> tuple[str, ...]:
        """Return the names of the fields of a part's plan; a table of a block fills the field that has its name."""
        return self.plan.__struct_fields__

    def read(self, plan: Any) -> msgspec.Struct:
        """Convert a part's plan from decoded JSON to the kind's plan type.

        Raises:
            msgspec.ValidationError: if the plan does not fit the type.
        """
        return msgspec.convert(plan, self.plan)


GROUP = "minihuman.activities"


def list_built_in_kinds() -> tuple[str, ...]:
    """Return the names of this package's kinds of activity in alphabetical order."""
    return list_plugin_names(GROUP, built_in=True)


@remember_by_name
def find_kind(name: str) -> ActivityKind:
    """Return the activity kind of a given name.

    Raises:
        ProtocolError: if no kind of that name is installed, or the entry point is no `ActivityKind`.
    """
    kind = load_plugin(GROUP, name, ProtocolError, noun="activity")
    if not isinstance(kind, ActivityKind):
        raise ProtocolError(
            f"activity {name!r} is of type {type(kind).__name__}; register an instance of minihuman.ext.ActivityKind"
        )
    return kind


def find_installed_kind(name: str) -> ActivityKind | None:
    """Return the activity kind of a given name; None if it is not installed or its entry point is no `ActivityKind`."""
    try:
        return find_kind(name)
    except ProtocolError:
        return None


def list_kinds(condition: Callable[[ActivityKind], bool]) -> tuple[str, ...]:
    """Return the names of the built-in kinds that meet a condition, in alphabetical order."""
    return tuple(name for name in list_built_in_kinds() if condition(find_kind(name)))


def build_activity(number: int, part: PlannedPart, context: SessionContext) -> Activity:
    """Build the activity that runs a part; ``number`` is the part's index in the plan."""
    return find_kind(part.kind).activity(number, part, context)


def needs_no_server(part: PlannedPart) -> Iterable[str]:
    """Return (), as a page can run the part without a server; a kind may use this as its ``find_server_needs``."""
    return ()
