"""A model in a participant's place: a scripted endpoint plays whole sessions, and every call is proved from the log."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, cast

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from minihuman import export, report, simulate, verify
from minihuman.activities.team.events import JointStepped
from minihuman.cli import main
from minihuman.display.drawing.screen import repaint_screen
from minihuman.errors import AllocationError, SimulationError, WorldError
from minihuman.experiment.machine.events import Answered, ModelCall, PointerUsed
from minihuman.experiment.machine.inputs import Input
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.reporting.scorecard import build_scorecard, write_scorecard
from minihuman.runtime.model_run import RunStoppedError
from minihuman.runtime.model_window import ModelWindow, SessionLeft
from minihuman.simulation import model_conversation
from minihuman.simulation.chat_client import ModelUnavailableError
from minihuman.simulation.model_conversation import AnswerRule, Conversation
from tests.models.endpoint import KEY, Endpoint, Reply, play, serve_endpoint, text_of
from tests.models.studies import study

pytestmark = pytest.mark.program


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setattr("minihuman.runtime.model_window.RETRY_WAIT_S", 0.0)
    return monkeypatch


def run(
    folder: Path, text: str, reply: Reply, patch: pytest.MonkeyPatch, *, participants: int = 1, **options: Any
) -> tuple[list[SessionLog], Endpoint]:
    (folder / "study.toml").write_text(text)
    with serve_endpoint(reply) as endpoint:
        patch.setenv("OPENAI_BASE_URL", endpoint.url)
        logs = list(
            simulate(
                folder / "study.toml",
                participants=participants,
                data=folder / "data",
                player="model:scripted",
                **options,
            )
        )
    return [read_log(log) for log in sorted(logs)], endpoint


def calls(log: SessionLog, state: str = "answered") -> list[ModelCall]:
    return [event for event in log.part_events if isinstance(event, ModelCall) and event.state == state]


def all_as_logged(folder: Path) -> bool:
    return not [line for line in verify(folder / "data") if not line.ok]


def test_a_model_agrees_plays_and_answers_every_kind_of_question(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    (log,), endpoint = run(tmp_path, study(), play, environment)
    assert (log.end_reason, log.player, log.plan.participant.id) == ("complete", "model:scripted", "model-01")
    assert [len(episode.actions) for episode in log.episodes] == [4, 4]
    answers = {event.item: event.value for event in log.part_events if isinstance(event, Answered)}
    assert list(answers.values()) == ["1", "[1]", '"it was fine"', "1", "1", "30"]
    found = calls(log)
    assert len(found) == len(endpoint.requests) == 1 + 8 + 6
    assert {call.model for call in found} == {"scripted-2026"}
    assert found[0].price == pytest.approx((1000 * 1 + 10 * 2) / 1e6)
    assert all_as_logged(tmp_path)


def test_it_is_sent_what_a_person_sees(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    _, endpoint = run(tmp_path, study(), play, environment)
    system, *_, latest = endpoint.requests[1]
    assert "You agree to take part." in system["content"]
    assert "Find the green square." in system["content"]
    text, picture = latest["content"]
    assert "Episode 1 of 2" in text["text"]
    assert "a green goal 2 steps right and 2 steps forward" in text["text"]
    assert picture["image_url"]["url"].startswith("data:image/png;base64,")
    assert sum("The episode ended" in text_of(request) for request in endpoint.requests) == 2
    assert all(len(request) <= 2 + 2 * 2 for request in endpoint.requests), "history is 2"


@pytest.mark.parametrize(("rules", "repeated"), [(2, [0, 1, 2, 1, 4, 4]), (3, [0, 1, 2, 3, 4, 4])])
def test_a_prompt_repeats_the_last_screens_and_older_sessions_are_proved_as_they_were(
    rules: int, repeated: list[int]
) -> None:
    conversation = Conversation(ModelSpec(history=4))
    counts = []
    for _ in repeated:
        counts.append(len(conversation._list_history(rules)))
        conversation.take(cast(ModelCall, SimpleNamespace(answer="0", verdict="valid")))
    assert counts == repeated


@pytest.mark.parametrize(("modality", "pictures"), [("picture", True), ("text", False)])
def test_a_protocol_says_what_it_is_sent(
    tmp_path: Path, environment: pytest.MonkeyPatch, modality: str, pictures: bool
) -> None:
    (log,), endpoint = run(tmp_path, study(modality), play, environment)
    assert ("steps forward" in str(endpoint.requests[2])) is not pictures
    assert ("data:image/png" in str(endpoint.requests[2])) is pictures
    assert all(bool(call.picture_sha256) == (pictures and call.screen == "play") for call in calls(log))
    assert all_as_logged(tmp_path)


def test_what_is_no_answer_is_never_a_key(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    def hesitate(messages: list[dict[str, Any]], number: int) -> str:
        return "I would rather press 9" if number % 2 else play(messages, number)

    (log,), _ = run(tmp_path, study(), hesitate, environment)
    assert log.end_reason == "complete"
    verdicts = Counter(call.verdict for call in calls(log))
    assert verdicts["valid"] == 15
    assert verdicts["invalid"] >= 9, "what is none of the keys, buttons and options"
    assert {call.reading for call in calls(log) if call.verdict == "invalid"} == {""}
    assert sum(len(episode.actions) for episode in log.episodes) == 8
    assert all_as_logged(tmp_path)


def test_only_a_question_that_may_be_left_out_offers_to_skip_it(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    text = study("text", invalid="end").replace('ask = "What did you do?"', 'ask = "What did?"\nrequired = false')

    def skip(question: str) -> Reply:
        return lambda messages, number: "Answer: skip" if question in text_of(messages) else play(messages, number)

    for number, (rules, question, offers) in enumerate(
        [
            ("1", "What did?", 6),  # as sessions were recorded until 26 November 2026
            (model_conversation.ANSWER_RULES, "What did?", 1),
            (model_conversation.ANSWER_RULES, "Was it hard?", 0),
        ]
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        with pytest.MonkeyPatch.context() as before:
            before.setattr("minihuman.runtime.model_sessions.ANSWER_RULES", rules)
            (log,), endpoint = run(folder, text, skip(question), environment)
        offered = [request for request in endpoint.requests if "'skip'" in text_of(request)]
        assert len(offered) == offers
        assert rules == "1" or all("What did?" in text_of(request) for request in offered)
        answers = {event.item: event.value for event in log.part_events if isinstance(event, Answered)}
        assert (log.end_reason, answers.get("said")) == (("complete", "null") if offers else ("player_failed", None))
        assert all_as_logged(folder)


@pytest.mark.parametrize(("invalid", "asked"), [("retry", 3), ("no_op", 3), ("end", 1)])
def test_after_too_many_invalid_answers_the_session_ends(
    tmp_path: Path, environment: pytest.MonkeyPatch, invalid: str, asked: int
) -> None:
    (log,), endpoint = run(tmp_path, study(invalid=invalid), lambda *_: "perhaps", environment)
    assert log.end_reason == "player_failed"
    assert len(endpoint.requests) == asked
    assert ("not valid" in text_of(endpoint.requests[-1])) is (invalid == "retry")
    assert all_as_logged(tmp_path)


def test_a_model_that_gives_no_valid_answer_ends_the_command_with_an_error(
    tmp_path: Path, environment: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "study.toml").write_text(study(invalid="end"))
    with serve_endpoint(lambda *_: "perhaps") as endpoint:
        environment.setenv("OPENAI_BASE_URL", endpoint.url)
        arguments = ("--participants", "2", "--data", str(tmp_path / "data"), "--player", "model:scripted")
        environment.setattr("sys.argv", ["minihuman", "simulate", str(tmp_path / "study.toml"), *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
    printed = capsys.readouterr()
    assert ended.value.code == SimulationError.exit_code
    assert len(printed.out.splitlines()) == 2
    assert "model:scripted ended 2 sessions before the last episode" in printed.err
    assert "with 0 of 2 episodes" in printed.err


def test_a_model_may_decline(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    (log,), endpoint = run(tmp_path, study(), lambda *_: "Answer: decline", environment)
    assert (log.end_reason, len(endpoint.requests), log.episodes) == ("declined", 1, ())
    assert all_as_logged(tmp_path)


def test_in_real_time_the_world_does_not_wait_for_an_answer(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    def slowly(messages: list[dict[str, Any]], number: int) -> str:
        time.sleep(0.02)
        return "Answer: wait" if number == 3 else play(messages, number)

    block = 'pace = "real_time"\nstep_period_ms = 8\nnoop_action = "left"'
    (log,), _ = run(tmp_path, study(block=block), slowly, environment)
    keys = [key for episode in log.episodes for key in episode.step_keys]
    assert len(keys) == 8
    assert keys.count("") >= 4, "20 ms are two ticks without a key"
    assert all_as_logged(tmp_path)


def test_limits_end_a_session_or_stop_a_run_that_is_then_resumed(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    price = (1000 * 1 + 10 * 2) / 1e6
    with pytest.raises(RunStoppedError, match="limit"):
        run(tmp_path, study(), play, environment, max_price=3 * price)
    (log,), endpoint = run(tmp_path, study(), play, environment)
    assert len(endpoint.requests) == 15 - 3, "what was paid for is not asked again"
    assert [call.call for call in calls(log)] == list(range(1, 16))
    assert all_as_logged(tmp_path)
    (tmp_path / "two").mkdir()
    (log,), endpoint = run(tmp_path / "two", study(model="max_session_tokens = 3000"), play, environment)
    assert (log.end_reason, len(endpoint.requests)) == ("player_failed", 3)


def test_a_server_that_fails_is_asked_again_and_then_the_session_waits(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    (log,), _ = run(tmp_path, study(), lambda messages, n: 429 if n % 2 else play(messages, n), environment)
    assert {call.error for call in calls(log, "failed")} == {"HTTP 429: [key] at [...]"}
    assert (len(calls(log, "failed")), len(calls(log))) == (15, 15)
    assert all_as_logged(tmp_path)
    with pytest.raises(ModelUnavailableError, match="HTTP 401"):
        run(tmp_path, study(), lambda messages, n: 401 if n > 4 else play(messages, n), environment)
    (log,), endpoint = run(tmp_path, study(), play, environment)
    assert (log.plan.participant.id, log.end_reason, len(endpoint.requests)) == ("model-02", "complete", 11)


def test_a_model_without_a_name_is_refused(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    (tmp_path / "study.toml").write_text(study("text"))
    with pytest.raises(SimulationError, match="player 'model' is unknown"):
        list(simulate(tmp_path / "study.toml", participants=1, data=tmp_path / "data", player="model:"))
    assert not (tmp_path / "data").exists()


def test_models_have_slots_of_their_own_and_the_keys_of_the_people_with_their_number(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    models, _ = run(tmp_path, study(), play, environment, participants=3, parallel=3)
    people = [read_log(log) for log in simulate(tmp_path / "study.toml", participants=3, data=tmp_path / "data")]
    assert [log.plan.participant.id for log in models] == ["model-01", "model-02", "model-03"]
    assert [log.plan.participant.id for log in people] == ["sub-01", "sub-02", "sub-03"]
    assert [log.plan.episodes for log in models] == [log.plan.episodes for log in people]
    assert not list((tmp_path / "data" / "seat").glob("model-*"))


@pytest.mark.nightly
def test_nothing_written_holds_the_key_or_the_address(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    """Neither files nor messages in them, nor what a report, an export, a scorecard and the terminal say."""

    def echo(messages: list[dict[str, Any]], number: int) -> str | int:
        return {2: 500, 20: 401}.get(number, f"{KEY}\n{play(messages, number)}")

    (tmp_path / "study.toml").write_text(study())
    environment.setenv("OPENAI_API_KEY", KEY + "\r\n")
    command = [sys.executable, "-m", "minihuman", "simulate", "study.toml", "--data", "data", "--player", "model:x"]
    with serve_endpoint(echo) as endpoint:
        environment.setenv("OPENAI_BASE_URL", endpoint.url + "\r\n")
        said = [
            subprocess.run([*command, "--participants", count], cwd=tmp_path, capture_output=True, check=False)
            for count in ("1", "2")
        ]
    assert [one.returncode for one in said] == [0, 2], "the second run meets the error 401"
    assert b"HTTP 401: [key] at [...]" in said[1].stderr
    assert endpoint.keys == {f"Bearer {KEY}"}
    (whole,) = (tmp_path / "data").rglob("*.mcap")
    log = read_log(whole)
    assert "[key]" in calls(log)[0].answer
    assert "[key]" in calls(log)[0].reasoning
    report(tmp_path / "data" / "models" / "seat", tmp_path / "report")
    export("csv", tmp_path / "data" / "models" / "seat", tmp_path / "export")
    write_scorecard(build_scorecard([tmp_path / "data" / "seat"], draws=50), tmp_path / "scores")
    read = "".join(repr(event) for event in log.part_events) + repr(log.facts)
    written = {"events": read.encode(), "terminal": b"".join(one.stdout + one.stderr for one in said)}
    for path in (path for path in tmp_path.rglob("*") if path.is_file()):
        written[str(path)] = path.read_bytes()
        if path.suffix in (".mcap", ".part"):
            with path.open("rb") as file:
                found = [(channel.topic, message.data) for _, channel, message in raw_messages(file)]
            assert {"/model/call", "/frame"} <= {topic for topic, _ in found}
            written[f"messages of {path}"] = b"".join(data for _, data in found)
    secrets = [
        KEY.encode(),
        KEY[:9].encode(),
        endpoint.url.encode(),
        b"127.0.0.1",
        b"chatcmpl-secret",
        b"/home/somebody",
    ]
    assert {name: secret for name, content in written.items() for secret in secrets if secret in content} == {}


def raw_messages(file: IO[bytes]) -> Iterator[tuple[Any, Any, Any]]:
    """Schema, channel and message of a log's records, decompressed; of a live file as far as it goes."""
    channels: dict[int, Any] = {}
    try:
        for record in StreamReader(file, record_size_limit=None).records:
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                yield None, channels[record.channel_id], record
    except EndOfFile:
        return


def draw_otherwise(canvas: Any, before: Any, screen: Any) -> None:
    repaint_screen(canvas, None, screen)
    canvas[0, 0] = (1, 2, 3)


@pytest.mark.parametrize(
    ("owner", "name", "changed", "found"),
    [
        (model_conversation, "RULES", "Play well.", "the prompt sent has digest"),
        (model_conversation, "repaint_screen", draw_otherwise, "the picture sent has digest"),
        (AnswerRule, "read", lambda *_: "key 2", "the answer is read as"),
        (AnswerRule, "read", lambda *_: None, "the answer is read as"),
    ],
)
def test_a_changed_prompt_picture_or_reading_is_found(
    tmp_path: Path, environment: pytest.MonkeyPatch, owner: Any, name: str, changed: Any, found: str
) -> None:
    run(tmp_path, study(), play, environment)
    environment.setattr(owner, name, changed)
    assert any(found in line.text for line in verify(tmp_path / "data") if not line.ok)


@pytest.mark.parametrize(("unknown", "reason", "answered"), [("repeat", "complete", 15), ("end", "player_failed", 2)])
def test_a_call_whose_answer_was_lost_is_repeated_or_ends_the_session(
    tmp_path: Path, environment: pytest.MonkeyPatch, unknown: str, reason: str, answered: int
) -> None:
    read, text = ModelWindow._read_answer, study("text", model=f'unknown = "{unknown}"')

    def lose_the_third(window: ModelWindow, asked: ModelCall, *rest: Any) -> ModelCall:
        if asked.call == 3:
            window._recorder.leave = True
            raise SessionLeft(RunStoppedError("killed"))
        return read(window, asked, *rest)

    environment.setattr(ModelWindow, "_read_answer", lose_the_third)
    with pytest.raises(RunStoppedError, match="killed"):
        run(tmp_path, text, play, environment)
    environment.setattr(ModelWindow, "_read_answer", read)
    (log,), _ = run(tmp_path, text, play, environment)
    assert (log.end_reason, len(calls(log, "unknown")), len(calls(log))) == (reason, 1, answered)
    assert all_as_logged(tmp_path)


KITCHEN = """
kind = "team"
view = "full"
options = { layout = "drawn", ends_at_soup = true }
team = { seats = ["person", "scripted:cook"], partner_disclosure = "debrief" }
"""


def kitchen_study(more: str = "") -> str:
    text = study("picture", block=KITCHEN).replace('"left", "right", "forward"', '"left", "up", "interact"')
    return (
        text.replace("MiniGrid-Empty-5x5", "Team-ForcedCoordination").replace("max_steps = 4", "max_steps = 9") + more
    )


def test_a_model_takes_a_seat_beside_an_agent_and_after_a_kill_the_agent_does_the_same(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    def press_the_first(messages: list[dict[str, Any]], number: int) -> str:
        return "Answer: 1" if "one key of" in text_of(messages) else play(messages, number)

    (whole,), _ = run(tmp_path, kitchen_study(), press_the_first, environment)
    (tmp_path / "killed").mkdir()
    joint = [event.actions for event in whole.part_events if isinstance(event, JointStepped)]
    assert (whole.end_reason, len(joint), len(calls(whole))) == ("complete", 18, 1 + 18 + 6)
    assert len({action for _, action in joint}) > 2, "the agent acts"
    read, lost = ModelWindow._read_answer, iter((5, 16))

    def lose_some(window: ModelWindow, asked: ModelCall, *rest: Any) -> ModelCall:
        if asked.call == wanted[0]:
            wanted[0] = next(lost, 0)
            window._recorder.leave = True
            raise SessionLeft(RunStoppedError("killed"))
        return read(window, asked, *rest)

    wanted = [next(lost)]
    environment.setattr(ModelWindow, "_read_answer", lose_some)
    for _ in range(2):
        with pytest.raises(RunStoppedError, match="killed"):
            run(tmp_path / "killed", kitchen_study(), press_the_first, environment)
    (log,), _ = run(tmp_path / "killed", kitchen_study(), press_the_first, environment)
    assert [event.actions for event in log.part_events if isinstance(event, JointStepped)] == joint
    assert (log.end_reason, len(calls(log)), len(calls(log, "unknown"))) == ("complete", 25, 2)
    assert all_as_logged(tmp_path)
    assert all_as_logged(tmp_path / "killed")


def test_a_team_of_two_people_is_refused_a_model(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    with pytest.raises(AllocationError, match="is for 2 people, who cannot play together with a language model"):
        run(tmp_path, kitchen_study().replace('"scripted:cook"', '"person"'), play, environment)
    assert not (tmp_path / "data").exists()


def test_a_world_without_words_is_refused_before_anything_is_asked(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    text = (
        study("text")
        .replace("MiniGrid-Empty-5x5", "MiniWorld-FourRooms")
        .replace('"left", "right", "forward"', '"turn_left", "turn_right", "move_forward"')
    )
    with pytest.raises(WorldError, match="modality = 'picture'"):
        run(tmp_path, text, play, environment)


def test_a_session_that_had_ended_before_the_kill_is_only_finished(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    with pytest.MonkeyPatch.context() as killed:
        killed.setattr(McapRecorder, "close", McapRecorder.leave)
        run(tmp_path, study("text"), play, environment)
    assert len(list((tmp_path / "data").rglob("*.mcap.part"))) == 1
    (log,), endpoint = run(tmp_path, study("text"), play, environment)
    assert (log.end_reason, len(calls(log)), endpoint.requests) == ("complete", 15, [])
    assert all_as_logged(tmp_path)


def test_a_session_left_between_the_inputs_of_an_answer_goes_on_with_the_rest(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    """A choice is a press on the option and one on "Next"; the last answer's release may come in between."""
    wait, inputs = ModelWindow.wait, Counter[str]()

    def leave_after_each_input(window: ModelWindow, until_ns: int | None) -> list[Input]:
        if inputs["now"] == 1:
            window._recorder.leave, inputs["now"] = True, 0
            raise SessionLeft(RunStoppedError("left"))
        happened = wait(window, until_ns)
        inputs["now"] += bool(happened) and window._session.next_episode == 2
        return happened

    environment.setattr(ModelWindow, "wait", leave_after_each_input)
    log = None
    while log is None:
        try:
            (log,), _ = run(tmp_path, study("text"), play, environment)
        except RunStoppedError:
            continue
    assert log.end_reason == "complete"
    assert [len(calls(log, state)) for state in ("asked", "answered")] == [15, 15]
    pressed, released = (
        Counter(one.target for one in log.part_events if isinstance(one, PointerUsed) and one.what == what)
        for what in ("pressed", "released")
    )
    assert pressed == released
    assert all_as_logged(tmp_path)


def test_two_programs_of_one_study_at_once_share_its_slots(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    (tmp_path / "study.toml").write_text(study("text"))
    command = [sys.executable, "-m", "minihuman", "simulate", "study.toml", "--data", "data", "--player", "model:x"]
    with serve_endpoint(play) as endpoint:
        environment.setenv("OPENAI_BASE_URL", endpoint.url)
        options = ["--participants", "3", "--parallel", "3"]
        both = [subprocess.Popen([*command, *options], cwd=tmp_path, stdout=subprocess.DEVNULL) for _ in range(2)]
        assert [one.wait() for one in both] == [0, 0]
    logs = [read_log(path) for path in (tmp_path / "data").rglob("*.mcap")]
    assert {log.plan.participant.id for log in logs} == {f"model-{number:02}" for number in range(1, 7)}
    assert [(log.end_reason, len(calls(log))) for log in logs] == [("complete", 15)] * 6


def find_in_flight(data: Path) -> set[tuple[str, int]]:
    """The calls of live files that have no end: whose, and which."""
    found = set()
    for part in data.rglob("*.mcap.part"):
        for event in read_events(part):
            if isinstance(event, ModelCall):
                (found.add if event.state == "asked" else found.remove)((part.name, event.call))
    return found


KILLS = 100 if os.environ.get("MINIHUMAN_NIGHTLY") else 3


@pytest.mark.nightly
def test_after_a_kill_no_stored_answer_is_asked_again(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    """Eight sessions at a time are killed again and again, a few requests after each start and with one to eight calls
    in flight, until all are done.
    """
    (tmp_path / "study.toml").write_text(study("text"))
    command = [sys.executable, "-m", "minihuman", "simulate", "study.toml", "--data", "data", "--player", "model:x"]
    sessions, parallel = max(8, KILLS * 2 // 3), 8
    process: list[subprocess.Popen[bytes]] = []
    kill_at: list[int] = []
    in_flight: list[set[tuple[str, int]]] = []  # after each kill; the next may come before all are resumed
    full, kill = threading.Event(), 0  # so many calls are in flight as are to be at this kill

    def reply(messages: list[dict[str, Any]], number: int) -> str:
        if kill_at and number >= kill_at[0]:
            full.wait(5.0) if number < kill_at[0] + kill % parallel else full.set()
            process[-1].send_signal(signal.SIGKILL)
        return play(messages, number)

    with serve_endpoint(reply) as endpoint:
        environment.setenv("OPENAI_BASE_URL", endpoint.url)
        for kill in range(KILLS + 1):
            full.clear()
            kill_at[:] = [len(endpoint.requests) + 1 + kill * 5 % 13] if kill < KILLS else []
            left = str(sessions - len(list((tmp_path / "data").rglob("*.mcap"))))
            options = ["--participants", left, "--parallel", str(parallel)]
            process.append(subprocess.Popen([*command, *options], cwd=tmp_path, stdout=subprocess.DEVNULL))
            process[-1].wait()
            in_flight.append(find_in_flight(tmp_path / "data"))
        assert process[-1].returncode == 0
    logs = [read_log(path) for path in (tmp_path / "data").rglob("*.mcap")]
    states = Counter(call.state for log in logs for call in log.part_events if isinstance(call, ModelCall))
    assert len(logs) == sessions
    assert states["answered"] == sessions * 15
    assert states["asked"] == states["answered"] + states["unknown"]
    assert len(endpoint.requests) <= states["asked"], "each request was on the disk before it was sent"
    counts = Counter(len(calls) for calls in in_flight[:-1])
    print(f"{KILLS} kills, {len(endpoint.requests)} requests, {states}, in flight {sorted(counts.items())}")
    assert max(counts) <= parallel
    assert states["unknown"] == len(set().union(*in_flight)), "each is counted, once"
    assert all(call.price > 0 for log in logs for call in calls(log, "unknown"))
    assert all_as_logged(tmp_path)
