"""Contract tests of the parts of an experiment: activities, kinds of questions and adaptive designs.

For an activity or a kind of question, a short session is simulated, drawn, logged and verified. An adaptive design must
make the same decision from the same history, in values that JSON can represent.
"""

import json
import math
import warnings
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.activity import QuestionsActivity
from minihuman.activities.questions.question import AnswerDraft, Click, build_draft, find_question_kind, list_codes
from minihuman.admin.verify.log import find_log_differences
from minihuman.display.drawing.questions import draw_question
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import Answered, Event, PartEnded, SessionEnded
from minihuman.experiment.machine.inputs import Input, PointerPressed, ScreenShown, TextInput
from minihuman.experiment.machine.screens import AnswerWidget, PlayScreen, QuestionScreen, Screen, ShapeCanvas
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.designs import (
    GROUP,
    Design,
    DesignSpec,
    EnrolledParticipant,
    EnrolmentDesign,
    PlayedEpisode,
    make_design,
    make_enrolment_design,
)
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.random_streams import make_draw
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.session_copy import copy_session
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.plugins import load_plugin
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import simulate
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.testing.checks import build_study, require
from minihuman.web.screen_values import convert_screen
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import hash64

_SIZE_PX = (1280, 720)
_PLAYER = "random"
_MAX_INPUTS = 1_000
_STUDY: dict[str, Any] = {
    "study": {"name": "contract", "version": "1", "seed": 5, "participants": 4, "closing": ""},
    "keys": {"keyboard_check": False},
    "groups": [{"name": "everyone", "parts": ["part"]}],
}


def check_question(kind: str, **fields: Any) -> None:
    """Ask two questions of an installed kind in a short session, and check the answers.

    Args:
        kind: the name of its entry point in the group ``minihuman.questions``.
        fields: the fields of ``[[questions.items]]`` that the kind needs, such as ``settings={"size": 5}``; by default
            those of its ``example``.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        ProtocolError: if no such kind is installed, or the fields are invalid.
    """
    question_kind = find_question_kind(kind)
    require(question_kind.name == kind, f"the entry point {kind!r} is a kind that calls itself {question_kind.name!r}")
    items = [{"name": name, "kind": kind, "ask": "What?", **(fields or question_kind.example)} for name in "ab"]
    protocol = build_study({**_STUDY, "questions": [{"name": "part", "items": items}]})
    _check_copies(protocol)
    for event in _check_part(protocol):
        if isinstance(event, Answered):
            _check_value(kind, event, build_draft(protocol.questions[0].items[0], rtl=False))


def check_activity(kind: str, *, block: dict[str, Any] | None = None, **settings: Any) -> None:
    """Run an installed kind of activity in a short session, and check it.

    Args:
        kind: the name of its entry point in the group ``minihuman.activities``.
        block: the fields of ``[[blocks]]`` except its name; for a kind of block, those of the block itself, otherwise
            those of a block that is played before the activity.
        settings: the ``settings`` in ``[[activities]]``.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        ProtocolError: if no such kind is installed, or its settings are invalid.
    """
    activity_kind = find_kind(kind)
    require(activity_kind.name == kind, f"the entry point {kind!r} is a kind that calls itself {activity_kind.name!r}")
    if issubclass(activity_kind.plan, PlayPlan):
        tables: dict[str, Any] = {"blocks": [{"name": "part", "kind": kind, **(block or {})}]}
    else:
        tables = {"activities": [{"name": "part", "kind": kind, "settings": settings}]}
        if block is not None:
            tables |= {"blocks": [{"name": "played", **block}]}
            tables |= {"groups": [{"name": "everyone", "parts": ["played", "part"]}]}
        read = activity_kind.read(settings)
        again = activity_kind.read(msgspec.json.decode(msgspec.json.encode(read)))
        require(read == again, f"the settings {read!r} are {again!r} after they were written as JSON and read")
    protocol = build_study({**_STUDY, **tables})
    list(_check_part(protocol))


def _check_part(protocol: Protocol) -> Iterator[Event]:
    """Check a session in memory and one that is logged; yield the events of the session in memory."""
    first = _run_study(protocol)
    again = _run_study(protocol)
    require(repr(first) == repr(again), "the same inputs gave other events; it reads a clock, or draws by itself")
    for rule in find_violations(first):
        require(False, rule)
    ended = [event for event in first if isinstance(event, PartEnded | SessionEnded)]
    complete = isinstance(ended[-1], SessionEnded) and ended[-1].reason == "complete"
    require(complete, f"the session did not come to its end: {ended[-1]}")
    with TemporaryDirectory() as folder:
        for log in simulate(protocol, Path(folder), participants=1, seed=1, player=_PLAYER):
            for difference in find_log_differences(log, World):
                require(False, f"the log of a session does not replay: {difference}")
    yield from first


def _run_study(protocol: Protocol) -> list[Event]:
    """Run a simulated session of a protocol in memory; return its events."""
    clock = VirtualClock()
    recorder = MemoryRecorder()
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    window = _DrawingWindow(make_participant(_PLAYER, np.random.default_rng(0)), session, clock)
    run_session(session, window, recorder, clock)
    if session.failure is not None:
        raise session.failure
    return list(recorder.events)


class _DrawingWindow(SimulatedWindow):
    """A window that draws every screen, and converts it for the web page."""

    _n_inputs = 0

    def wait(self, until_ns: int | None) -> list[Input]:
        """Return the next inputs, and fail after too many, because an activity that never ends would go on forever."""
        self._n_inputs += 1
        problem = f"the session did not come to its end in {_MAX_INPUTS} inputs; see what simulate() gives"
        require(self._n_inputs < _MAX_INPUTS, problem)
        return super().wait(until_ns)

    def show(self, screen: Screen) -> ScreenShown:
        """Draw and convert a screen, except a play screen: worlds draw no pictures for simulated participants."""
        if isinstance(screen, PlayScreen):
            return super().show(screen)
        height, width, _ = compose_screen(screen, _SIZE_PX).shape
        require((width, height) == _SIZE_PX, f"{type(screen).__name__} is drawn in {width} x {height} px")
        msgspec.json.encode(convert_screen(screen, lambda _: 0))
        part = self._session.part
        if isinstance(screen, QuestionScreen) and isinstance(part, QuestionsActivity):
            _check_targets(part.draft, screen)
        return super().show(screen)


def _check_targets(draft: AnswerDraft, screen: QuestionScreen) -> None:
    """Require that the target on which a simulated participant clicks is drawn."""
    targets = {spot.name for spot in draw_question(screen, _SIZE_PX).spots}
    simulated = draft.simulate(lambda count: 0, lambda: True)
    if isinstance(simulated, Click):
        problem = f"simulate() clicks on {simulated.target!r}; what is drawn has {', '.join(sorted(targets))}"
        require(simulated.target in targets, problem)


def _warn_of_nameless_shapes(widget: AnswerWidget) -> None:
    """Warn of shapes that can be clicked, but of which screen readers and language models learn no name."""
    if not isinstance(widget, ShapeCanvas):
        return
    nameless = [shape.target for shape in widget.shapes if shape.target and not (shape.accessible_name or shape.label)]
    if nameless:
        warnings.warn(
            f"{len(nameless)} shapes have no name, the first with the target {nameless[0]!r}; give each a label or an "
            "accessible_name",
            FutureWarning,
            stacklevel=4,
        )


def _check_copies(protocol: Protocol) -> None:
    """Require that a copied session, which a browser's host uses to look ahead, does not change the original."""
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    session.receive(ScreenShown(0, 0, 0))
    copied = copy_session(session, lambda *_: None)
    part = session.part
    copied_part = copied.part
    assert isinstance(part, QuestionsActivity)
    assert isinstance(copied_part, QuestionsActivity)
    assert isinstance(session.screen, QuestionScreen)
    _check_targets(part.draft, session.screen)
    _warn_of_nameless_shapes(session.screen.item)
    before = part.draft.widget()
    match part.draft.simulate(lambda count: count - 1, lambda: True):
        case Click(target, along):
            copied.receive(PointerPressed(1, 0.5, 0.5, target, along))
        case str() as text:
            copied.receive(TextInput(1, text))
    require(copied_part.draft.widget() != before, "what simulate() does changes nothing on the screen")
    require(part.draft.widget() == before, "a copied answer shares its state; keep it in lists, sets, dicts and values")


def _check_value(kind: str, event: Answered, draft: AnswerDraft) -> None:
    """Require that an answer is of the type that its kind of question declares."""
    value = msgspec.json.decode(event.value)
    answer_type = find_question_kind(kind).answer_type
    codes = list_codes(draft.question)
    hint = ""
    if answer_type in ("code", "rating", "order"):
        hint = f"; its codes are {', '.join(map(str, codes))}: a kind of its own gives them as QuestionKind.codes"
    require(_is_of_type(value, answer_type, codes), f"the answer {value!r} is not a {answer_type}{hint}")
    require(bool(event.words), f"the answer {value!r} has no display_text")


def _is_of_type(value: Any, answer_type: str, codes: Collection[Any]) -> bool:
    match answer_type:
        case "code" | "rating":
            return value in codes
        case "codes":
            return isinstance(value, list)
        case "order":
            has_each_once = isinstance(value, list) and len(set(value)) == len(value)
            return has_each_once and set(value) <= set(codes)
        case "number":
            return isinstance(value, int | float)
    return isinstance(value, str)


def check_design(
    make: str | type[Design | EnrolmentDesign],
    settings: Mapping[str, Any] | None = None,
    *,
    n: int = 12,
    seed: int = 0,
) -> None:
    """Ask a design for decisions on random histories, twice and in another order, and compare the decisions.

    Args:
        make: the design's registered name, or its class.
        settings: the design's settings in a protocol.
        n: the number of episodes or participants in the longest history.
        seed: the seed of the histories.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        ProtocolError: if the design refuses the settings.
    """
    designs = [_make_any_design(make, settings or {}) for _ in range(2)]
    rng = np.random.default_rng(seed)
    if isinstance(designs[0], EnrolmentDesign):
        people = [
            EnrolledParticipant(str(rng.choice(["a", "b"])), str(rng.choice(["x", "y"])), round(float(rng.random()), 3))
            for _ in range(n)
        ]
        decisions = [_ask_study(designs[0], people, length) for length in range(n + 1)]
        again = [_ask_study(designs[1], people, length) for length in reversed(range(n + 1))][::-1]
    else:
        decisions = []
        history = list[PlayedEpisode]()
        for length in range(n + 1):
            decisions.append(_decide_once(designs[0], history[:length]))
            options, episode_seed, *_ = decisions[-1]
            outcome = str(rng.choice(["goal", "failure", "timeout"]))
            history.append(PlayedEpisode(dict(options), episode_seed or 0, outcome, 3, float(outcome == "goal")))
        again = [_decide_once(designs[1], history[:length]) for length in reversed(range(n + 1))][::-1]
    require(decisions == again, "the same history led to another decision; a design draws and keeps nothing of its own")


def _make_any_design(
    make: str | type[Design | EnrolmentDesign], settings: Mapping[str, Any]
) -> Design | EnrolmentDesign:
    """Make the design by its name or its class, whether it decides at enrolment or between episodes."""
    if not isinstance(make, str):
        require(issubclass(make, Design | EnrolmentDesign), f"{make.__name__} is no Design and no EnrolmentDesign")
        return make(settings)
    spec = DesignSpec(make, dict(settings))
    kind = load_plugin(GROUP, make, ProtocolError, noun="design")
    if issubclass(kind, EnrolmentDesign):
        return make_enrolment_design(spec)
    return make_design(spec)


def _decide_once(design: Design | EnrolmentDesign, history: list[PlayedEpisode]) -> tuple[Any, ...]:
    """Ask a design for one decision, check it, and return it in a comparable form."""
    assert isinstance(design, Design)
    decided = design.decide(tuple(history), make_draw(1, "check", len(history)))
    require(decided.seed is None or 0 <= decided.seed < 2**63, f"seed is {decided.seed}; use 0 to 2**63 - 1, or None")
    known = _check_estimates(decided.estimates), hash64(decided.posterior)
    return _check_json(dict(decided.options), "options"), decided.seed, decided.stop, *known


def _ask_study(design: EnrolmentDesign | Design, people: list[EnrolledParticipant], length: int) -> tuple[Any, ...]:
    assert isinstance(design, EnrolmentDesign)
    statistics = _check_json(design.compute_statistics(people[:length], {"a": 1, "b": 1}), "statistics")
    decided = design.decide(statistics, "x", make_draw(1, "check", length))
    require(decided.group in ("", "a", "b"), f"group {decided.group!r} is none of the study's")
    return statistics, decided.group, decided.stop, _check_estimates(decided.estimates)


def _check_json(value: dict[str, Any], field: str) -> dict[str, Any]:
    back = json.loads(json.dumps(value, default=repr))
    require(back == value, f"{field} {value!r} are not the same after JSON; use texts, numbers, lists and dicts")
    return value


def _check_estimates(estimates: Mapping[str, float]) -> dict[str, float]:
    finite = all(isinstance(value, int | float) and math.isfinite(value) for value in estimates.values())
    require(finite, f"estimates are {dict(estimates)!r}; use numbers")
    return dict(estimates)
