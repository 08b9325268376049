"""Contract tests of activities and of kinds of questions: a short session is simulated, drawn, logged and verified."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from minihuman.admin.verify.log import find_log_differences
from minihuman.display.drawing.questions import draw_question
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.activities.activity import find_kind
from minihuman.experiment.activities.block_plans import PlayPlan
from minihuman.experiment.activities.questions.question import AnswerDraft, Click, build_draft, find_question_kind
from minihuman.experiment.activities.questions.questionnaire import QuestionsActivity
from minihuman.experiment.machine.events import Answered, Event, PartEnded, SessionEnded, find_violations
from minihuman.experiment.machine.inputs import Input, PointerPressed, ScreenShown, TextInput
from minihuman.experiment.machine.screens import PlayScreen, QuestionScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.replay import copy_session
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import SimulatedWindow, simulate
from minihuman.simulation.participant import make_participant
from minihuman.testing.checks import build_study, require
from minihuman.web.screen_values import convert_screen
from minihuman.worlds.adapters.world import World

_SIZE_PX = (1280, 720)
_PLAYER = "random"
_MAX_INPUTS = 1_000
_STUDY: dict[str, Any] = {
    "study": {"name": "contract", "version": "1", "seed": 5, "participants": 4, "closing": ""},
    "keys": {"keyboard_check": False},
    "groups": [{"name": "everyone", "parts": ["part"]}],
}


def check_question(kind: str, **fields: Any) -> None:
    """Ask two questions of an installed kind in a short session.

    Args:
        kind: the name of its entry point in the group ``minihuman.questions``.
        fields: the fields of ``[[questions.items]]`` that it needs: ``options=["a", "b"]``, ``settings={"size": 5}``.

    Raises:
        ContractError: if a promise is not kept; it says which.
        ProtocolError: if no such kind is installed, or the fields are wrong.
    """
    found = find_question_kind(kind)
    require(found.name == kind, f"the entry point {kind!r} is a kind that calls itself {found.name!r}")
    items = [{"name": name, "kind": kind, "ask": "What?", **fields} for name in "ab"]
    protocol = build_study({**_STUDY, "questions": [{"name": "part", "items": items}]})
    _check_copies(protocol)
    for event in _check_part(protocol):
        if isinstance(event, Answered):
            _check_value(kind, event, build_draft(protocol.questions[0].items[0], rtl=False))


def check_activity(kind: str, *, block: dict[str, Any] | None = None, **settings: Any) -> None:
    """Run an installed kind of activity in a short session.

    Args:
        kind: the name of its entry point in the group ``minihuman.activities``.
        block: the fields of ``[[blocks]]`` beside its name: of the block itself, for a kind of block; else of a block
            that is played before the activity.
        settings: the ``settings`` in ``[[activities]]``.

    Raises:
        ContractError: if a promise is not kept; it says which.
        ProtocolError: if no such kind is installed, or its settings are wrong.
    """
    found = find_kind(kind)
    require(found.name == kind, f"the entry point {kind!r} is a kind that calls itself {found.name!r}")
    if issubclass(found.plan, PlayPlan):
        tables: dict[str, Any] = {"blocks": [{"name": "part", "kind": kind, **(block or {})}]}
    else:
        tables = {"activities": [{"name": "part", "kind": kind, "settings": settings}]}
        if block is not None:
            tables |= {"blocks": [{"name": "played", **block}]}
            tables |= {"groups": [{"name": "everyone", "parts": ["played", "part"]}]}
        read = found.read(settings)
        again = found.read(msgspec.json.decode(msgspec.json.encode(read)))
        require(read == again, f"the settings {read!r} are {again!r} after they were written as JSON and read")
    protocol = build_study({**_STUDY, **tables})
    list(_check_part(protocol))


def _check_part(protocol: Protocol) -> Iterator[Event]:
    """Check a session in memory, and one of a log; yield the first one's events."""
    first, again = _run(protocol), _run(protocol)
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


def _run(protocol: Protocol) -> list[Event]:
    clock, recorder = VirtualClock(), MemoryRecorder()
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    window = _DrawingWindow(make_participant(_PLAYER, np.random.default_rng(0)), session, clock)
    run_session(session, window, recorder, clock)
    if session.failure is not None:
        raise session.failure
    return list(recorder.events)


class _DrawingWindow(SimulatedWindow):
    """A window that draws every screen, and converts it as the page needs it."""

    _n_inputs = 0

    def wait(self, until_ns: int | None) -> list[Input]:
        """Count what is pressed: an activity that never ends would go on for ever."""
        self._n_inputs += 1
        what = f"the session did not come to its end in {_MAX_INPUTS} inputs; see what simulate() gives"
        require(self._n_inputs < _MAX_INPUTS, what)
        return super().wait(until_ns)

    def show(self, screen: Screen) -> ScreenShown:
        """Draw it; worlds draw no pictures for simulated participants."""
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
    """Require that what a simulated participant clicks on is drawn."""
    targets = {spot.name for spot in draw_question(screen, _SIZE_PX).spots}
    simulated = draft.simulate(lambda count: 0, lambda: True)
    if isinstance(simulated, Click):
        what = f"simulate() clicks on {simulated.target!r}; what is drawn has {', '.join(sorted(targets))}"
        require(simulated.target in targets, what)


def _check_copies(protocol: Protocol) -> None:
    """Require that a copied session, which a browser's host makes to look ahead, leaves its original alone."""
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    session.receive(ScreenShown(0, 0, 0))
    copied = copy_session(session, lambda *_: None)
    part, copied_part = session.part, copied.part
    assert isinstance(part, QuestionsActivity)
    assert isinstance(copied_part, QuestionsActivity)
    assert isinstance(session.screen, QuestionScreen)
    _check_targets(part.draft, session.screen)
    before = part.draft.widget()
    match part.draft.simulate(lambda count: count - 1, lambda: True):
        case Click(target, along):
            copied.receive(PointerPressed(1, 0.5, 0.5, target, along))
        case str() as text:
            copied.receive(TextInput(1, text))
    require(copied_part.draft.widget() != before, "what simulate() does changes nothing on the screen")
    require(part.draft.widget() == before, "a copied answer shares its state; keep it in lists, sets, dicts and values")


def _check_value(kind: str, event: Answered, draft: AnswerDraft) -> None:
    value, answer_type = msgspec.json.decode(event.value), find_question_kind(kind).answer_type
    codes = draft.question.all_codes
    fits = {
        "code": value in codes,
        "rating": value in codes,
        "codes": isinstance(value, list),
        "number": isinstance(value, int | float),
        "text": isinstance(value, str),
    }[answer_type]
    require(fits, f"the answer {value!r} is not a {answer_type}")
    require(bool(event.words), f"the answer {value!r} has no display_text")
