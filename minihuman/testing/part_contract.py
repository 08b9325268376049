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
            _check_answer(kind, event, build_draft(protocol.questions[0].items[0], rtl=False))


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
        plan = activity_kind.read(settings)
        decoded_plan = activity_kind.read(msgspec.json.decode(msgspec.json.encode(plan)))
        is_equal = plan == decoded_plan
        require(is_equal, f"the settings {plan!r} are {decoded_plan!r} after they were written as JSON and read")
    protocol = build_study({**_STUDY, **tables})
    list(_check_part(protocol))


def _check_part(protocol: Protocol) -> Iterator[Event]:
    """Check a study by two equal sessions in memory and a logged one; then yield the events of a session in memory."""
    events = _run_study(protocol)
    repeated_events = _run_study(protocol)
    is_repeatable = repr(events) == repr(repeated_events)
    require(is_repeatable, "the same inputs gave other events; it reads a clock, or draws by itself")
    for violation in find_violations(events):
        require(False, violation)
    last_end = [event for event in events if isinstance(event, PartEnded | SessionEnded)][-1]
    has_completed = isinstance(last_end, SessionEnded) and last_end.reason == "complete"
    require(has_completed, f"the session did not come to its end: {last_end}")
    with TemporaryDirectory() as folder:
        for log in simulate(protocol, Path(folder), participants=1, seed=1, player=_PLAYER):
            for difference in find_log_differences(log, World):
                require(False, f"the log of a session does not replay: {difference}")
    yield from events


def _run_study(protocol: Protocol) -> list[Event]:
    """Run a simulated session of a protocol in memory, and return its events; raise the error of a failed world."""
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
        """Return the next inputs; after too many calls raise a ContractError, because an activity may never end."""
        self._n_inputs += 1
        problem = f"the session did not come to its end in {_MAX_INPUTS} inputs; see what simulate() gives"
        require(self._n_inputs < _MAX_INPUTS, problem)
        return super().wait(until_ns)

    def show(self, screen: Screen) -> ScreenShown:
        """Draw and convert a screen, except a play screen, for which no picture is drawn here; return its display."""
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
    """Require that the target on which a simulated participant clicks is among those that are drawn."""
    targets = {spot.name for spot in draw_question(screen, _SIZE_PX).spots}
    simulated = draft.simulate(lambda count: 0, lambda: True)
    if isinstance(simulated, Click):
        problem = f"simulate() clicks on {simulated.target!r}; what is drawn has {', '.join(sorted(targets))}"
        require(simulated.target in targets, problem)


def _warn_of_nameless_shapes(widget: AnswerWidget) -> None:
    """Warn of shapes that can be clicked, but have no name for screen readers and language models."""
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
    widget_before = part.draft.widget()
    match part.draft.simulate(lambda count: count - 1, lambda: True):
        case Click(target, along):
            copied.receive(PointerPressed(1, 0.5, 0.5, target, along))
        case str() as text:
            copied.receive(TextInput(1, text))
    require(copied_part.draft.widget() != widget_before, "what simulate() does changes nothing on the screen")
    is_unchanged = part.draft.widget() == widget_before
    require(is_unchanged, "a copied answer shares its state; keep it in lists, sets, dicts and values")


def _check_answer(kind: str, event: Answered, draft: AnswerDraft) -> None:
    """Require that an answer is of the type that its kind of question declares, and has a text to display."""
    answer = msgspec.json.decode(event.value)
    answer_type = find_question_kind(kind).answer_type
    codes = list_codes(draft.question)
    hint = ""
    if answer_type in ("code", "rating", "order"):
        hint = f"; its codes are {', '.join(map(str, codes))}: a kind of its own gives them as QuestionKind.codes"
    require(_is_of_type(answer, answer_type, codes), f"the answer {answer!r} is not a {answer_type}{hint}")
    require(bool(event.words), f"the answer {answer!r} has no display_text")


def _is_of_type(answer: Any, answer_type: str, codes: Collection[Any]) -> bool:
    """Return whether an answer is of a type; ``codes`` are those of the question's options, if the type uses them."""
    match answer_type:
        case "code" | "rating":
            return answer in codes
        case "codes":
            return isinstance(answer, list)
        case "order":
            is_without_repeats = isinstance(answer, list) and len(set(answer)) == len(answer)
            return is_without_repeats and set(answer) <= set(codes)
        case "number":
            return isinstance(answer, int | float)
    return isinstance(answer, str)


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
        decisions = [_decide_enrolment(designs[0], people, length) for length in range(n + 1)]
        repeated_decisions = [_decide_enrolment(designs[1], people, length) for length in reversed(range(n + 1))][::-1]
    else:
        decisions = []
        history: list[PlayedEpisode] = []
        for length in range(n + 1):
            decisions.append(_decide_episode(designs[0], history[:length]))
            options, episode_seed, *_ = decisions[-1]
            outcome = str(rng.choice(["goal", "failure", "timeout"]))
            history.append(PlayedEpisode(dict(options), episode_seed or 0, outcome, 3, float(outcome == "goal")))
        repeated_decisions = [_decide_episode(designs[1], history[:length]) for length in reversed(range(n + 1))][::-1]
    is_repeatable = decisions == repeated_decisions
    require(is_repeatable, "the same history led to another decision; a design draws and keeps nothing of its own")


def _make_any_design(
    make: str | type[Design | EnrolmentDesign], settings: Mapping[str, Any]
) -> Design | EnrolmentDesign:
    """Return the design of episodes or of enrolment with a registered name or of a class, made with ``settings``."""
    if not isinstance(make, str):
        require(issubclass(make, Design | EnrolmentDesign), f"{make.__name__} is no Design and no EnrolmentDesign")
        return make(settings)
    spec = DesignSpec(make, dict(settings))
    kind = load_plugin(GROUP, make, ProtocolError, noun="design")
    if issubclass(kind, EnrolmentDesign):
        return make_enrolment_design(spec)
    return make_design(spec)


def _decide_episode(design: Design | EnrolmentDesign, history: list[PlayedEpisode]) -> tuple[Any, ...]:
    """Return a design's decision after the episodes of a history, checked, as a tuple that can be compared."""
    assert isinstance(design, Design)
    decision = design.decide(tuple(history), make_draw(1, "check", len(history)))
    is_valid_seed = decision.seed is None or 0 <= decision.seed < 2**63
    require(is_valid_seed, f"seed is {decision.seed}; use 0 to 2**63 - 1, or None")
    options = dict(decision.options)
    estimates = dict(decision.estimates)
    _require_finite(estimates)
    _require_json(options, "options")
    return options, decision.seed, decision.stop, estimates, hash64(decision.posterior)


def _decide_enrolment(
    design: EnrolmentDesign | Design, people: list[EnrolledParticipant], length: int
) -> tuple[Any, ...]:
    """Return a design's decision after the first ``length`` people, checked, as a tuple that can be compared."""
    assert isinstance(design, EnrolmentDesign)
    statistics = design.compute_statistics(people[:length], {"a": 1, "b": 1})
    _require_json(statistics, "statistics")
    decision = design.decide(statistics, "x", make_draw(1, "check", length))
    require(decision.group in ("", "a", "b"), f"group {decision.group!r} is none of the study's")
    estimates = dict(decision.estimates)
    _require_finite(estimates)
    return statistics, decision.group, decision.stop, estimates


def _require_json(values: dict[str, Any], field: str) -> None:
    """Require that ``values``, the field of a decision that ``field`` names, are the same once read from JSON."""
    decoded = json.loads(json.dumps(values, default=repr))
    require(decoded == values, f"{field} {values!r} are not the same after JSON; use texts, numbers, lists and dicts")


def _require_finite(estimates: dict[str, float]) -> None:
    is_finite = all(isinstance(number, int | float) and math.isfinite(number) for number in estimates.values())
    require(is_finite, f"estimates are {estimates!r}; use numbers")
