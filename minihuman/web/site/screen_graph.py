"""The graph of a session's screens, found by running copies of the real session machine on every input that leads on.

A node is a screen that the page shows, with the time at which the session goes on by itself and the nodes to which
inputs lead. An episode is one node: whatever is done in it, the session goes on by how it ended, so that each end is
tried once, in a world that is made to end so. A trial is one node, too, which a module of its kind runs in the page;
each response is tried once.
"""

import json
import re
import string
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
from numpy.typing import NDArray

from minihuman.experiment.machine.events import Event, Noted
from minihuman.experiment.machine.inputs import (
    FocusChanged,
    Input,
    KeyDown,
    ScreenShown,
    Tick,
)
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, QuestionScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.session_copy import copy_session
from minihuman.web.computed import PageWorld, can_compute
from minihuman.web.page_modules import find_module_address
from minihuman.web.prefetch import describe_screen
from minihuman.web.site.page_run import PageRun, build_page_run
from minihuman.web.site.screen_inputs import build_input_maker, list_inputs
from minihuman.web.site.site_error import SiteError

BODY_MARK = "\x00body\x00"  # in the place of a text that depends on the episode
MAX_NODES = 20_000
MAX_GROUP_NODES = 2_000  # of one question, or of a part whose questions depend on answers
OUTCOMES = ("goal", "failure", "timeout")
_LOOK_NS = 1_000
_FLIP_NS = 16_000_000
_FIXED_POINT = re.compile(r"\.\df")
_FIXED_FIELDS = ("outcome", "episode", "episodes")  # of a feedback, known for each of its nodes
_EPISODE_FIELDS = ("steps", "reward")


@dataclass(frozen=True, slots=True)
class FieldState:
    """A field or slider: the judgement that all answers of its node have in common, and the rules of judgement."""

    key: str  # by which the page keeps its answer
    judgement: str
    rules: Mapping[str, Any]
    shown_as: tuple[str, ...]  # the fields of the widget that depend on the answer


@dataclass(slots=True)
class ScreenNode:
    """A screen of the session and what it leads to.

    Attributes:
        name: the page's name of the screen: its digest, which the page reports when it was shown.
        screen: its values for the page.
        due_ns: when the session goes on by itself, after the screen was entered or shown; None if it does not.
        due_from: "entered" or "shown".
        edges: the node to which an input leads, whether it does so before the screen is on the display, and whether
            it gives consent.
        part: the number of the session's part.
        group: the question that the screen belongs to, to which a participant may return with the answer of before; ""
            for none, and where each answer leads to nodes of its own.
        returns: the node to which a participant returns who leaves this one with a note on it; -1 for none.
        answer_field: the field that is typed in, or the slider; None for none.
        judged: the node to which an answer in the field leads, by its judgement.
        repeats: whether a held key acts again on its pages: on those of a text it does, on a block's instructions not.
        template: the text of an episode's feedback, with the fields that depend on the episode; "" for none.
        looks: what the screen's digest is of, as JSON with marks in the place of that text, or of the typed one.
        episode: the index of the episode that is played here; -1 for none.
        ends: the node that follows each outcome of the episode, or each end of the run.
        run: what a module runs by itself while the screen is there: its address and values; None for nothing.
        resumed: the node that follows when what covered a run is gone.
        keeps_picture: whether the last picture of an episode stays on the display.
        overlays: the node of the screen over this one when the focus is lost, the session is paused, or Escape asks
            whether to end it.
        reason: why the session has ended here; "" if it has not.
    """

    name: int
    screen: dict[str, Any]
    due_ns: int | None = None
    due_from: str = "entered"
    edges: dict[str, tuple[int, bool, bool]] = field(default_factory=dict)
    part: int = 0
    group: str = ""
    returns: int = -1
    answer_field: FieldState | None = None
    judged: dict[str, int] = field(default_factory=dict)
    repeats: bool = False
    template: str = ""
    looks: str = ""
    episode: int = -1
    ends: dict[str, int] = field(default_factory=dict)
    run: dict[str, Any] | None = None
    resumed: int = -1
    keeps_picture: bool = False
    overlays: dict[str, int] = field(default_factory=dict)
    reason: str = ""


class EndingWorld:
    """A world whose next step ends the episode in a given way; all else is the world's own."""

    def __init__(self, world: Any, *, reward: float, terminated: bool) -> None:
        self._world = world
        self._reward = reward
        self._terminated = terminated

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def step(self, action: Any) -> Any:
        """Step the world, and change how the step ended."""
        stepped = self._world.step(action)
        return replace(stepped, reward=self._reward, terminated=self._terminated, truncated=not self._terminated)


_ENDINGS = {
    "goal": {"reward": 1.0, "terminated": True},
    "failure": {"reward": -1.0, "terminated": True},
    "timeout": {"reward": 0.0, "terminated": False},
}


class ScreenGraph:
    """Finds all screens of a session from its first one on.

    Args:
        session: the session after its first tick; it is not changed.
        number: gives a picture its number.
        describe_episode: called with each episode, once its world is reset.
    """

    def __init__(
        self,
        session: SessionMachine,
        number: Callable[[NDArray[Any]], int],
        describe_episode: Callable[[SessionMachine, RunningEpisode], None],
    ) -> None:
        self.nodes: list[ScreenNode] = []
        self._number = number
        self._describe_episode = describe_episode
        self._worlds: dict[str, PageWorld] = {}
        self._known: dict[object, int] = {}
        self._group_sizes: dict[str, int] = {}
        self._to_do: deque[tuple[int, SessionMachine, str]] = deque()
        self.start = self._visit(session, "")
        while self._to_do:
            self._look_from(*self._to_do.popleft())

    def close(self) -> None:
        """Close the worlds in which episodes were tried."""
        for world in self._worlds.values():
            world.close()

    def _lend(self, world_id: str, options: dict[str, Any]) -> PageWorld:
        key = json.dumps([world_id, options], sort_keys=True, default=str)
        if key not in self._worlds:
            self._worlds[key] = PageWorld(world_id, options)
        return self._worlds[key]

    def _copy(self, session: SessionMachine, *, shown: bool) -> SessionMachine:
        copied = copy_session(session, self._lend)
        if shown:
            flip_ns = copied.now_ns + _FLIP_NS
            copied.receive(ScreenShown(flip_ns, flip_ns, flip_ns))
        return copied

    # Nodes

    def _visit(self, session: SessionMachine, outcome: str) -> int:
        """Return the node of a session's present screen, which is looked from later if it is new."""
        if session.phase not in (Phase.HOLD, Phase.FEEDBACK):
            outcome = ""
        values, name = describe_screen(session, self._number)
        template = self._find_template(session, outcome)
        field_state = _find_field(session)
        page_run = build_page_run(session)
        history = _list_history(session)
        looks = ""
        key: object = (name, session.play is not None, outcome, history)
        if page_run is not None:
            looks = _encode_position(session, page_run.looks)
            key = (looks, history)
        elif template:
            looks = _encode_looks(session, values | {"body": BODY_MARK})
            key = (template, session.part.number, session.next_episode, history)
        elif field_state is not None:
            marked = values["item"] | {name: f"\x00{name}\x00" for name in field_state.shown_as}
            looks = _encode_looks(session, values | {"item": marked})
            key = (looks, field_state.judgement, history)
        if key in self._known:
            return self._known[key]
        node = ScreenNode(
            name,
            values,
            part=session.part.number,
            group=_find_group(session),
            answer_field=field_state,
            template=template,
            looks=looks,
            run=_describe_run(page_run),
        )
        self._known[key] = len(self.nodes)
        return self._add_node(node, session, outcome)

    def _add_node(self, node: ScreenNode, session: SessionMachine, outcome: str) -> int:
        """Add a node, which is looked from later unless the session has ended; return its number."""
        self.nodes.append(node)
        self._require_few(node, session)
        if session.over:
            node.reason = str(session.end_reason)
        else:
            self._to_do.append((len(self.nodes) - 1, session, outcome))
        return len(self.nodes) - 1

    def _require_few(self, node: ScreenNode, session: SessionMachine) -> None:
        group = node.group
        if session.part.history:
            group = f"part {session.part.number}"
        self._group_sizes[group] = self._group_sizes.get(group, 0) + 1
        if group and self._group_sizes[group] > MAX_GROUP_NODES:
            raise SiteError(
                f"part {session.part.part.name!r} has a question with more than {MAX_GROUP_NODES} answers (with those "
                "before it that others depend on), each of which a site holds as a screen; ask it as several "
                "questions, or serve the study with: minihuman serve"
            )
        if len(self.nodes) > MAX_NODES:
            raise SiteError(f"the session has more than {MAX_NODES} screens; serve the study with: minihuman serve")

    def _find_template(self, session: SessionMachine, outcome: str) -> str:
        """Return the present feedback's text if it has fields of the episode, with its other fields filled in."""
        if session.phase is not Phase.FEEDBACK or session.over or not outcome:
            return ""
        text: str = session.part.part.plan.feedback[outcome]
        fields = {str(name) for _, name, _, _ in string.Formatter().parse(text) if name is not None}
        if unknown := fields.difference(_FIXED_FIELDS, _EPISODE_FIELDS):
            raise SiteError(f"a feedback has the field {{{min(unknown)}}}, which no page fills in without a server")
        if fields.isdisjoint(_EPISODE_FIELDS):
            return ""
        episode = session.plan.episodes[session.next_episode - 1]
        words = session._context.words  # of the study, which a part's screens are made of
        known = {
            "outcome": words[f"outcome.{outcome}"],
            "episode": str(episode.episode_in_block + 1),
            "episodes": str(episode.episodes_in_block),
        }
        return "".join(map("".join, _fill_known(text, known)))

    # What leads on

    def _look_from(self, number: int, session: SessionMachine, outcome: str) -> None:
        node = self.nodes[number]
        if session.phase in (Phase.UNFOCUSED, Phase.PAUSED, Phase.QUIT_QUESTION):
            return
        self._find_overlays(node, session)
        page_run = build_page_run(session)
        if page_run is not None:
            self._look_from_run(node, session, page_run)
            return
        if session.play is not None:
            self._look_from_episode(node, session, session.play)
            return
        node.keeps_picture = isinstance(session.screen, PlayScreen)
        self._find_due(number, node, session, outcome)
        if node.answer_field is not None:
            self._find_judged(node, session)
        self._find_return(node, session)
        if isinstance(session.screen, PageScreen):
            copied = self._copy(session, shown=True)
            copied.receive(KeyDown(copied.now_ns + _LOOK_NS, "enter", "enter", repeat=True))
            node.repeats = self._visit(copied, outcome) != number
        for name, make_input in list_inputs(session):
            self._try(number, node, session, outcome, name, make_input)

    def _try(
        self,
        number: int,
        node: ScreenNode,
        session: SessionMachine,
        outcome: str,
        name: str,
        make_input: Callable[[int], Input],
    ) -> None:
        copied = self._copy(session, shown=True)
        events = copied.receive(make_input(copied.now_ns + _LOOK_NS))
        to = self._visit(copied, outcome)
        if to == number:
            return
        early = self._copy(session, shown=False)
        early.receive(make_input(early.now_ns + _LOOK_NS))
        node.edges[name] = (to, self._visit(early, outcome) == to, _gives_consent(events))

    def _find_judged(self, node: ScreenNode, session: SessionMachine) -> None:
        """Find where answers in the field lead: those of one judgement to one node."""
        answer_field = session.part.answer_field
        assert answer_field is not None, "the node has a field"
        for judgement, inputs in answer_field.examples.items():
            copied = self._copy(session, shown=True)
            for make_input in inputs:
                copied.receive(make_input(copied.now_ns + _LOOK_NS))
            node.judged[judgement] = self._visit(copied, "")

    def _find_return(self, node: ScreenNode, session: SessionMachine) -> None:
        """Find where a participant is who steps back from a question with a note, and then on again."""
        if not node.group or not node.screen["note"]:
            return
        copied = self._copy(session, shown=True)
        for name in ("point:back", "key:enter"):
            copied.receive(build_input_maker(name)(copied.now_ns + _LOOK_NS))
        if _find_group(copied) == node.group and not copied.screen.note:  # type: ignore[union-attr]
            node.returns = self._visit(copied, "")

    def _find_due(self, number: int, node: ScreenNode, session: SessionMachine, outcome: str) -> None:
        entered_due_ns = session.next_tick_ns
        copied = self._copy(session, shown=True)
        due_ns = copied.next_tick_ns
        if due_ns is None:
            return
        node.due_ns = due_ns - copied.now_ns
        node.due_from = "shown"
        if due_ns == entered_due_ns:
            node.due_ns = due_ns - session.now_ns
            node.due_from = "entered"
        copied.receive(Tick(max(due_ns, copied.now_ns)))
        node.edges["tick"] = (self._visit(copied, outcome), True, False)

    def _find_overlays(self, node: ScreenNode, session: SessionMachine) -> None:
        for name, make_input in (
            ("unfocused", lambda t_ns: FocusChanged(t_ns, focused=False)),
            ("paused", lambda t_ns: KeyDown(t_ns, "f8", "f8")),
            ("quit", lambda t_ns: KeyDown(t_ns, "escape", "escape")),
        ):
            copied = self._copy(session, shown=True)
            copied.receive(make_input(copied.now_ns + _LOOK_NS))
            if copied.phase in (Phase.UNFOCUSED, Phase.PAUSED, Phase.QUIT_QUESTION):
                node.overlays[name] = self._visit(copied, "")
            if copied.phase is Phase.QUIT_QUESTION:
                self._find_ending(node, copied)

    def _find_ending(self, node: ScreenNode, session: SessionMachine) -> None:
        """Find where Escape leads that is held over the question whether to end the session."""
        questioned = self._copy(session, shown=False)
        questioned.receive(KeyDown(questioned.now_ns + _LOOK_NS, "escape", "escape"))
        due_ns = questioned.next_tick_ns
        assert due_ns is not None, "it is held"
        questioned.receive(Tick(due_ns))
        node.overlays["ending"] = self._visit(questioned, "")

    def _look_from_run(self, node: ScreenNode, session: SessionMachine, page_run: PageRun) -> None:
        """Find where each end of a run leads, and where the session is when what covered the run is gone."""
        for name, list_inputs_to_end in page_run.ends.items():
            copied = self._copy(session, shown=False)
            for happened in list_inputs_to_end(copied.part):
                copied.receive(happened)
            node.ends[name] = self._visit(copied, "")
        covered = self._copy(session, shown=False)
        for is_focused in (False, True):
            covered.receive(FocusChanged(covered.now_ns + _LOOK_NS, focused=is_focused))
        node.resumed = self._visit(covered, "")

    def _look_from_episode(self, node: ScreenNode, session: SessionMachine, play: RunningEpisode) -> None:
        if not can_compute(play):
            raise SiteError(
                f"block {play.plan.block_name!r}: no page computes {play.plan.world}; "
                "serve the study with: minihuman serve"
            )
        node.episode = play.plan.episode
        play.world.reset(play.plan.seed)  # other copies have played in it
        self._describe_episode(session, play)
        for outcome, forced_end in _ENDINGS.items():
            copied = self._copy(session, shown=True)
            assert copied.play is not None, "the copy plays the episode, too"
            copied.play.world.reset(play.plan.seed)
            copied.play.world = EndingWorld(copied.play.world, **forced_end)  # type: ignore[assignment,arg-type]
            key = next(iter(play.plan.key_map.keys))
            copied.receive(KeyDown(copied.now_ns + _LOOK_NS, key, key))
            node.ends[outcome] = self._visit(copied, outcome)


def _fill_known(text: str, known: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield a template's literal texts, with braces doubled, and its fields, filled in where they are known."""
    for literal, name, form, _ in string.Formatter().parse(text):
        filled = ""
        if name in known:
            filled = format(known[name], form or "").replace("{", "{{").replace("}", "}}")
        elif name is not None:
            filled = _check_field(name, form or "")
        yield literal.replace("{", "{{").replace("}", "}}"), filled


def _check_field(name: str, form: str) -> str:
    """Return a field of an episode, if the page can format it as Python does."""
    if form and (name != "reward" or not _FIXED_POINT.fullmatch(form)):
        raise SiteError(f"a feedback has {{{name}:{form}}}; a site formats {{steps}}, {{reward}} and {{reward:.2f}}")
    if form:
        return f"{{{name}:{form}}}"
    return f"{{{name}}}"


def _describe_run(page_run: PageRun | None) -> dict[str, Any] | None:
    if page_run is None:
        return None
    return {"module": find_module_address(page_run.module), "values": page_run.values}


def _encode_looks(session: SessionMachine, looks: dict[str, Any]) -> str:
    return _encode_position(session, {name: looks[name] for name in looks if name != "picture"})


def _encode_position(session: SessionMachine, looks: object) -> str:
    position = (session.part.number, session.phase, session.next_episode)
    return msgspec.json.encode((looks, position)).decode()


def _find_group(session: SessionMachine) -> str:
    screen = session.screen
    if isinstance(screen, QuestionScreen) and not session.part.history:
        return json.dumps([session.part.number, screen.progress, screen.question])
    return ""


def _find_field(session: SessionMachine) -> FieldState | None:
    """Return the field or slider on a session's present screen; None if there is none."""
    answer_field = session.part.answer_field
    if answer_field is None or not isinstance(session.screen, QuestionScreen):
        return None
    key = json.dumps([session.part.number, answer_field.name])
    return FieldState(key, answer_field.judgement, answer_field.rules, answer_field.shown_as)


def _list_history(session: SessionMachine) -> tuple[object, ...]:
    """Return what a session's future depends on and its screen does not show: answers, and tries of quizzes."""
    following = {part.name for part in session.plan.parts[session.part.number :]}
    returns = any(getattr(part.plan, "back_to", None) is not None for part in session.plan.parts)
    tries = session._context.tries  # of a quiz that is over, only those count that it may be returned to
    return (*session.part.history, *sorted((name, tries[name]) for name in tries if returns or name in following))


def _gives_consent(events: list[Event]) -> bool:
    return any(isinstance(event, Noted) and event.kind == "consent" for event in events)
