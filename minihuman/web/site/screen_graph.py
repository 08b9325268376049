"""The graph of a session's screens, found by running copies of the real session machine on every input that leads on.

A node is a screen that the page shows, with the time at which the session goes on by itself and the nodes to which
inputs lead. An episode is one node. Only its outcome decides how the session goes on, so each outcome is tried once, in
a world that is made to end the episode in this way. A trial is one node, too, which a module of its kind runs in the
page; each response is tried once.
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

BODY_MARK = "\x00body\x00"  # in place of a text that depends on the episode
MAX_NODES = 20_000
MAX_GROUP_NODES = 2_000  # of one question, or of a part whose questions depend on answers
OUTCOMES = ("goal", "failure", "timeout")
_LOOK_NS = 1_000  # assumed time from a screen's display to an input
_FLIP_NS = 16_000_000  # assumed time until a screen is displayed
_FIXED_POINT = re.compile(r"\.\df")
_FIXED_FIELDS = ("outcome", "episode", "episodes")  # fields of a feedback's text that are the same for the whole node
_EPISODE_FIELDS = ("steps", "reward")  # fields that the page fills in after the episode


@dataclass(frozen=True, slots=True)
class FieldState:
    """A field or slider, whose answers have the same judgement in the whole node, and the rules of judgement."""

    key: str  # under which the page keeps the answer
    judgement: str
    rules: Mapping[str, Any]
    shown_as: tuple[str, ...]  # the fields of the widget that depend on the answer


@dataclass(slots=True)
class ScreenNode:
    """A screen of the session, and the nodes to which it leads; nodes are named by their numbers.

    Attributes:
        name: the page's name of the screen, its digest, which the page reports when the screen was shown.
        screen: the screen's values for the page.
        due_ns: the time in ns after which the session goes on by itself; None if it does not.
        due_from: whether this time counts from when the screen was "entered" or "shown".
        edges: by input: the node to which the input leads, whether it does so even before the screen is on the display,
            and whether it gives consent.
        part: the number of the session's part.
        group: the question to which the screen belongs, and to which a participant may return with the earlier answer;
            "" for none, and if each answer leads to separate nodes.
        returns: the node to which a participant returns who has left this node while it shows a note; -1 for none.
        answer_field: the text field or the slider; None for none.
        judged: the node to which an answer in the field leads, by the answer's judgement.
        repeats: whether a held key acts repeatedly: it does on the pages of a text, but not on a block's instructions.
        template: the text of an episode's feedback, with the fields that depend on the episode; "" for none.
        looks: the content from which the screen's digest is computed, as JSON with marks in place of the feedback's or
            the answer's text; "" if the screen has neither.
        episode: the index of the episode that is played here; -1 for none.
        ends: the node that follows each outcome of the episode, or each end of the run.
        run: the address and the values of the module that runs the screen by itself; None for none.
        resumed: the node that follows when a run is no longer covered by another screen.
        keeps_picture: whether the last picture of an episode stays on the display.
        overlays: the node of the screen over this one when the focus is lost, the session is paused, or Escape asks
            whether to end it.
        reason: the reason why the session has ended here; "" if it has not.
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
    """Wraps a world: a step has a given reward, and terminates the episode or, if not ``terminated``, truncates it."""

    def __init__(self, world: Any, *, reward: float, terminated: bool) -> None:
        self._world = world
        self._reward = reward
        self._terminated = terminated

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def step(self, action: Any) -> Any:
        """Step the world, and change the reward and the ending of the step."""
        stepped = self._world.step(action)
        return replace(stepped, reward=self._reward, terminated=self._terminated, truncated=not self._terminated)


_ENDINGS = {
    "goal": {"reward": 1.0, "terminated": True},
    "failure": {"reward": -1.0, "terminated": True},
    "timeout": {"reward": 0.0, "terminated": False},
}


class ScreenGraph:
    """Finds all screens to which a session can lead from its first screen.

    Args:
        session: the session after its first tick; it is not changed.
        number: gives a picture its number.
        describe_episode: called with each episode, after its world was reset.

    Raises:
        SiteError: if the session has a screen that needs a server, or too many screens.
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
        self._numbers: dict[object, int] = {}  # the numbers of the nodes by what distinguishes them
        self._group_sizes: dict[str, int] = {}
        self._to_do: deque[tuple[int, SessionMachine, str]] = deque()  # nodes to explore, with the last outcome
        self.start = self._visit(session, "")
        while self._to_do:
            self._explore(*self._to_do.popleft())

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
        """Return a copy of a session, after telling it that its screen was displayed if ``shown``."""
        copied = copy_session(session, self._lend)
        if shown:
            flip_ns = copied.now_ns + _FLIP_NS
            copied.receive(ScreenShown(flip_ns, flip_ns, flip_ns))
        return copied

    # Nodes

    def _visit(self, session: SessionMachine, outcome: str) -> int:
        """Return the number of the node of a session's present screen; a new node is explored later.

        Args:
            session: the session.
            outcome: the outcome of the last episode, used only while its last picture is held or its feedback shown.
        """
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
        if key in self._numbers:
            return self._numbers[key]
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
        self._numbers[key] = len(self.nodes)
        return self._add_node(node, session, outcome)

    def _add_node(self, node: ScreenNode, session: SessionMachine, outcome: str) -> int:
        """Add a node, which is explored later unless the session has ended; return its number."""
        self.nodes.append(node)
        self._count_node(node, session)
        if session.over:
            node.reason = str(session.end_reason)
        else:
            self._to_do.append((len(self.nodes) - 1, session, outcome))
        return len(self.nodes) - 1

    def _count_node(self, node: ScreenNode, session: SessionMachine) -> None:
        """Count a new node in its group or part; raise SiteError if the group, the part or the graph is too large."""
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
        """Return the text of the present feedback, in which only the episode's steps and reward are not filled in.

        Returns:
            The text; "" if the screen is no feedback, or its text has no such fields.

        Raises:
            SiteError: if the text has a field that a page cannot fill in.
        """
        if session.phase is not Phase.FEEDBACK or session.over or not outcome:
            return ""
        text: str = session.part.part.plan.feedback[outcome]
        fields = {str(name) for _, name, _, _ in string.Formatter().parse(text) if name is not None}
        if unknown := fields.difference(_FIXED_FIELDS, _EPISODE_FIELDS):
            raise SiteError(f"a feedback has the field {{{min(unknown)}}}, which no page fills in without a server")
        if fields.isdisjoint(_EPISODE_FIELDS):
            return ""
        episode = session.plan.episodes[session.next_episode - 1]
        words = session._context.words  # the study's words, which its screens use
        field_texts = {
            "outcome": words[f"outcome.{outcome}"],
            "episode": str(episode.episode_in_block + 1),
            "episodes": str(episode.episodes_in_block),
        }
        return "".join(literal + filled for literal, filled in _fill_fields(text, field_texts))

    # Edges

    def _explore(self, number: int, session: SessionMachine, outcome: str) -> None:
        """Add to the node ``number`` the nodes to which inputs, time and the ends of an episode or a run lead.

        ``outcome`` is that of ``_visit``.
        """
        node = self.nodes[number]
        if session.phase in (Phase.UNFOCUSED, Phase.PAUSED, Phase.QUIT_QUESTION):
            return
        self._add_overlays(node, session)
        page_run = build_page_run(session)
        if page_run is not None:
            self._explore_run(node, session, page_run)
            return
        if session.play is not None:
            self._explore_episode(node, session, session.play)
            return
        node.keeps_picture = isinstance(session.screen, PlayScreen)
        self._add_tick_edge(node, session, outcome)
        if node.answer_field is not None:
            self._add_judged_edges(node, session)
        self._add_return(node, session)
        if isinstance(session.screen, PageScreen):
            copied = self._copy(session, shown=True)
            copied.receive(KeyDown(copied.now_ns + _LOOK_NS, "enter", "enter", repeat=True))
            node.repeats = self._visit(copied, outcome) != number
        for name, make_input in list_inputs(session):
            self._try_input(number, node, session, outcome, name, make_input)

    def _try_input(
        self,
        number: int,
        node: ScreenNode,
        session: SessionMachine,
        outcome: str,
        name: str,
        make_input: Callable[[int], Input],
    ) -> None:
        """Add to the node ``number`` the edge of an input, unless the input leads back to the node.

        ``outcome`` is that of ``_visit``; ``name`` and ``make_input`` are an input's as ``list_inputs`` yields them.
        """
        copied = self._copy(session, shown=True)
        events = copied.receive(make_input(copied.now_ns + _LOOK_NS))
        target = self._visit(copied, outcome)
        if target == number:
            return
        early = self._copy(session, shown=False)
        early.receive(make_input(early.now_ns + _LOOK_NS))
        node.edges[name] = (target, self._visit(early, outcome) == target, _gives_consent(events))

    def _add_judged_edges(self, node: ScreenNode, session: SessionMachine) -> None:
        """Add to a node the nodes to which answers in its field lead, one for each judgement."""
        answer_field = session.part.answer_field
        assert answer_field is not None, "the node has a field"
        for judgement, inputs in answer_field.examples.items():
            copied = self._copy(session, shown=True)
            for make_input in inputs:
                copied.receive(make_input(copied.now_ns + _LOOK_NS))
            node.judged[judgement] = self._visit(copied, "")

    def _add_return(self, node: ScreenNode, session: SessionMachine) -> None:
        """Add to a node that shows a note the node of a participant who goes back from it, and then on again."""
        if not node.group or not node.screen["note"]:
            return
        copied = self._copy(session, shown=True)
        for name in ("point:back", "key:enter"):
            copied.receive(build_input_maker(name)(copied.now_ns + _LOOK_NS))
        if _find_group(copied) == node.group and not copied.screen.note:  # type: ignore[union-attr]
            node.returns = self._visit(copied, "")

    def _add_tick_edge(self, node: ScreenNode, session: SessionMachine, outcome: str) -> None:
        """Add to a node the time at which the session goes on by itself, and the node to which it goes on."""
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
        node.edges["tick"] = (self._visit(copied, outcome), True, False)  # even before it is shown; without consent

    def _add_overlays(self, node: ScreenNode, session: SessionMachine) -> None:
        """Add to a node the nodes of the screens that cover it when the focus is lost, or F8 or Escape is pressed."""
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
                self._add_ending_overlay(node, copied)

    def _add_ending_overlay(self, node: ScreenNode, session: SessionMachine) -> None:
        """Add to a node the node to which the question whether to end the session leads if Escape is held."""
        questioned = self._copy(session, shown=False)
        questioned.receive(KeyDown(questioned.now_ns + _LOOK_NS, "escape", "escape"))
        due_ns = questioned.next_tick_ns
        assert due_ns is not None, "the session ends once Escape was held long enough"
        questioned.receive(Tick(due_ns))
        node.overlays["ending"] = self._visit(questioned, "")

    def _explore_run(self, node: ScreenNode, session: SessionMachine, page_run: PageRun) -> None:
        """Add to a node the nodes to which the ends of its run lead, and the node after a screen that covered it."""
        for name, list_inputs_to_end in page_run.ends.items():
            copied = self._copy(session, shown=False)
            for run_input in list_inputs_to_end(copied.part):
                copied.receive(run_input)
            node.ends[name] = self._visit(copied, "")
        covered = self._copy(session, shown=False)
        for is_focused in (False, True):
            covered.receive(FocusChanged(covered.now_ns + _LOOK_NS, focused=is_focused))
        node.resumed = self._visit(covered, "")

    def _explore_episode(self, node: ScreenNode, session: SessionMachine, play: RunningEpisode) -> None:
        """Describe an episode, and add to its node the nodes to which its outcomes lead.

        Raises:
            SiteError: if no page can compute the episode.
        """
        if not can_compute(play):
            raise SiteError(
                f"block {play.plan.block_name!r}: no page computes {play.plan.world}; "
                "serve the study with: minihuman serve"
            )
        node.episode = play.plan.episode
        play.world.reset(play.plan.seed)  # the world is shared with other copies
        self._describe_episode(session, play)
        for outcome, forced_end in _ENDINGS.items():
            copied = self._copy(session, shown=True)
            assert copied.play is not None, "the copy plays the episode, too"
            copied.play.world.reset(play.plan.seed)
            copied.play.world = EndingWorld(copied.play.world, **forced_end)  # type: ignore[assignment,arg-type]
            key = next(iter(play.plan.key_map.keys))
            copied.receive(KeyDown(copied.now_ns + _LOOK_NS, key, key))
            node.ends[outcome] = self._visit(copied, outcome)


def _fill_fields(text: str, field_texts: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield a format string's literal parts, each with the field after it or ""; fill in fields that have a text.

    Braces are doubled, so that the joined parts are a format string again.
    """
    for literal, name, form, _ in string.Formatter().parse(text):
        filled = ""
        if name in field_texts:
            filled = _escape_braces(format(field_texts[name], form or ""))
        elif name is not None:
            filled = _format_field(name, form or "")
        yield _escape_braces(literal), filled


def _escape_braces(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


def _format_field(name: str, form: str) -> str:
    """Return the replacement field for a field of an episode; raise SiteError if a page cannot format it as Python."""
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
    """Encode a screen's values, except the picture's number, and the session's position in its plan, as JSON."""
    return _encode_position(session, {name: looks[name] for name in looks if name != "picture"})


def _encode_position(session: SessionMachine, looks: object) -> str:
    """Encode the content of a screen and the session's position in its plan, as JSON."""
    position = (session.part.number, session.phase, session.next_episode)
    return msgspec.json.encode((looks, position)).decode()


def _find_group(session: SessionMachine) -> str:
    """Return the name of the group of nodes that belong to the present question; "" as in ``ScreenNode``."""
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
    """Return what a session's future depends on although its screen does not show it: answers, and tries of quizzes.

    The tries of a quiz that is over matter only if a part of the session can lead back to it.
    """
    following_parts = {part.name for part in session.plan.parts[session.part.number :]}
    can_go_back = any(getattr(part.plan, "back_to", None) is not None for part in session.plan.parts)
    tries = session._context.tries
    relevant_tries = [(name, tries[name]) for name in tries if can_go_back or name in following_parts]
    return (*session.part.history, *sorted(relevant_tries))


def _gives_consent(events: list[Event]) -> bool:
    return any(isinstance(event, Noted) and event.kind == "consent" for event in events)
