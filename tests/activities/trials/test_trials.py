"""Trials: episodes that follow each other by the clock, with stimuli from a table, and response times from onset."""

import base64
import hashlib
import io
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.activities.trials.stimulus_table import read_table
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import find_log_differences, verify_session
from minihuman.dataset.included_episodes import IncludedEpisode
from minihuman.dataset.tables import select
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.machine.events import EpisodeEnded, EpisodeStarted, FrameShown, KeyPressed, Noted, Stepped
from minihuman.experiment.machine.inputs import KeyDown, KeyUp, ScreenShown
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.exporters.environment_specs import build_environment_spec
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import resolve_files
from tests.study.sessions import MS, Desk

SHIPPED = Path(__file__).parents[3] / "protocols" / "trials"
BLOCK_TOML = """
[study]
name = "trials"
version = "1"
seed = 5
closing = ""
[keys]
pool = ["f", "j"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["words"]
[[blocks]]
name = "words"
kind = "trials"
world = "minihuman/Stimulus-v0"
episodes = 4
actions = ["left", "right"]
key_map = "fixed"
fixed_keys = {{ f = "left", j = "right" }}
noop_action = "none"
response_deadline_ms = 1000
max_steps = 1
final_frame_ms = 0
{more}
"""
ROWS = 'stimuli.rows = [{ text = "L", correct = "left" }, { text = "R", correct = "right" }]\n'


def trials_plan(more: str = ROWS, files: dict[str, bytes] | None = None):
    protocol = decode_protocol(BLOCK_TOML.format(more=more).encode(), files=files)
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def phases(desk: Desk) -> list[str]:
    return [event.text for event in desk.of(Noted) if event.kind == "phase"]


def test_trials_follow_each_other_without_enter_and_end_at_the_deadline():
    desk = Desk(trials_plan(ROWS + 'ready = "first"\ninter_trial_interval_ms = 500\n'))
    desk.press("enter")
    for _ in range(4):
        desk.pass_ms(600)  # the interval
        assert desk.session.phase is Phase.PLAYING
        desk.show()
        desk.pass_ms(1001)
    assert phases(desk).count("ready") == 1
    assert [(event.key, event.reward) for event in desk.of(Stepped)] == [("", 0.0)] * 4
    assert [event.outcome for event in desk.of(EpisodeEnded)] == ["failure"] * 4
    assert list(compare_replay(desk.events, World)) == []


def test_a_response_before_the_deadline_is_timed_from_the_onset_and_judged():
    desk = Desk(trials_plan(ROWS + 'ready = "none"\n'))
    for _ in range(4):
        desk.show()
        shown_ns = desk.of(FrameShown)[-1].flip_ns
        desk.now_ns = shown_ns + 432 * MS
        desk.give(KeyDown(desk.now_ns, "f", "f"))
        desk.give(KeyUp(desk.now_ns + 1, "f", "f"))
    steps = desk.of(Stepped)
    assert [event.rt_ms for event in steps] == [432.0] * 4
    texts = [event.plan.options["text"] for event in desk.of(EpisodeStarted)]
    assert [event.reward for event in steps] == [float(text == "L") for text in texts]
    assert sorted(texts) == ["L", "L", "R", "R"]
    assert list(compare_replay(desk.events, World)) == []


def test_a_block_waits_for_a_scanners_trigger_and_later_triggers_are_counted():
    page = (Path(__file__).parents[3] / "docs/trials.md").read_text()
    [block] = re.findall(r"(\[\[blocks\]\]\nname = .wait-for-scanner.*?)```", page, re.DOTALL)
    toml = BLOCK_TOML.replace('pool = ["f", "j"]', 'pool = ["f", "j", "5"]').replace(
        '"words"]', '"wait-for-scanner", "words"]'
    )
    toml = toml.replace("[[blocks]]", block.replace("{", "{{").replace("}", "}}") + "\n[[blocks]]")
    protocol = decode_protocol(toml.format(more=ROWS + 'ready = "none"\ninter_trial_interval_ms = 500\n').encode())
    desk = Desk(expand_protocol(protocol, enrol_participant(protocol, 0)))
    desk.show()
    desk.pass_ms(60_000)
    desk.press("f", "enter")
    assert desk.of(Stepped) == [], "nothing but the trigger goes on"
    desk.press("5")
    [trigger] = desk.of(Stepped)
    assert (trigger.key, trigger.key_t_ns) == ("5", desk.of(KeyPressed)[-2].t_ns)
    desk.pass_ms(499)
    assert desk.session.phase is Phase.INTERVAL
    for _ in range(4):
        desk.pass_ms(2)
        if desk.session.phase is Phase.INTERVAL:
            desk.pass_ms(500)
        desk.show()
        desk.press("5")  # a volume
        assert desk.session.phase is Phase.PLAYING, "a trigger is no response"
        desk.press("j")
    assert sum(event.key == "5" and event.down for event in desk.of(KeyPressed)) == 5
    assert list(compare_replay(desk.events, World)) == []


def test_feedback_goes_by_itself_and_enter_does_not_shorten_it():
    desk = Desk(
        trials_plan(ROWS + 'ready = "none"\nfeedback = { goal = "Right", failure = "Wrong" }\nfeedback_ms = 600\n')
    )
    desk.show()
    desk.press("f")
    assert desk.session.phase is Phase.FEEDBACK
    assert desk.session.screen.prompt == ""
    desk.give(ScreenShown(desk.now_ns, desk.now_ns, desk.now_ns))
    desk.press("enter")
    assert desk.session.phase is Phase.FEEDBACK
    desk.pass_ms(601)
    assert desk.session.phase is Phase.PLAYING
    assert list(compare_replay(desk.events, World)) == []


def test_a_cell_is_a_number_only_where_it_is_written_as_one():
    table = b"text,correct,size\n007,left,0.25\n1_0,left,1\nnan,right,0.5\ninfinity,right,2\n12,left,-3\n"
    rows = [row.cells for row in read_table(StimuliSpec(file="table.csv"), {"table.csv": table})]
    assert [row["text"] for row in rows] == ["007", "1_0", "nan", "infinity", 12]
    assert [row["size"] for row in rows] == [0.25, 1, 0.5, 2, -3]


def test_intervals_are_drawn_in_the_plan_and_kept():
    plan = trials_plan(ROWS + 'ready = "none"\ninter_trial_interval_ms = [800, 1200]\n')
    drawn = plan.parts[0].plan.trial.intervals_ms
    assert len(drawn) == 4
    assert len(set(drawn)) > 1
    assert all(800 <= ms <= 1200 for ms in drawn)
    desk = Desk(plan)
    due_ms = []
    for _ in range(3):
        due_ms.append((desk.session.next_tick_ns - desk.now_ns) / MS)
        desk.pass_ms(due_ms[-1] + 0.001)
        assert desk.session.phase is Phase.PLAYING
        desk.show()
        desk.press("j")
    assert due_ms == pytest.approx(drawn[:3], abs=1.5)


def test_the_last_trial_of_drawn_intervals_has_its_feedback_and_the_block_ends():
    more = 'ready = "none"\ninter_trial_interval_ms = [10, 20]\nfeedback = { goal = "Right" }\nfeedback_ms = 50\n'
    desk = Desk(trials_plan(ROWS + more))
    for _ in range(40):
        if desk.session.over or desk.session.next_tick_ns is None:
            desk.show() if desk.session.phase is Phase.PLAYING else None
            desk.press("f")
        else:
            desk.pass_ms((desk.session.next_tick_ns - desk.now_ns) / MS + 0.001)
    assert desk.session.over
    assert desk.session.end_reason == "complete"


def test_a_table_beside_the_protocol_names_images_and_counts(tmp_path):
    picture = io.BytesIO()
    Image.new("RGB", (8, 8), "red").save(picture, "PNG")
    (tmp_path / "face.png").write_bytes(picture.getvalue())
    (tmp_path / "table.csv").write_text("image,correct,side,times\nface.png,left,left,3\n,right,right,1\n")
    path = tmp_path / "trials.toml"
    path.write_text(BLOCK_TOML.format(more='stimuli = { file = "table.csv" }'))
    protocol = read_protocol(path, trust=True)
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    images = [episode.options.get("image", "") for episode in plan.episodes]
    reference = f"sha256:{hashlib.sha256(picture.getvalue()).hexdigest()}"
    assert sorted(images) == ["", *[reference] * 3]
    assert resolve_files({"image": reference}) == {"image": base64.urlsafe_b64encode(picture.getvalue()).decode()}
    assert set(plan.files) == {"face.png", "table.csv"}
    world = World(plan.episodes[images.index("")].world, plan.episodes[0].options)
    world.reset(1)
    assert world.frame(size_px=(400, 300)).shape == (300, 400, 3)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('stimuli = { file = "none.csv" }', "not in the protocol's folder"),
        ("stimuli = { }", "a file or rows"),
        ('stimuli.rows = [{ text = "L", times = 0 }]', "times = 0"),
        (ROWS + "inter_trial_interval_ms = [900, 100]", "shortest, then the longest"),
        (ROWS + "feedback_ms = 100", "has no feedback"),
    ],
)
def test_what_makes_no_trials_is_refused(more, said):
    with pytest.raises(ProtocolError, match=said):
        trials_plan(more)


def test_a_table_with_a_ragged_row_is_refused_with_its_line():
    with pytest.raises(ProtocolError, match=r"table.csv:3: this row has more or fewer cells"):
        trials_plan('stimuli = { file = "table.csv" }', {"table.csv": b"text,correct\nL,left\nR\n"})


def test_an_option_that_a_stimulus_cannot_have_is_named():
    with pytest.raises(WorldError, match="correct is 'up'; use one of left, right, none"):
        World("minihuman/Stimulus-v0", {"correct": "up"})


@pytest.mark.parametrize(
    "name", ["bandit", "go-no-go", "stroop", "n-back", "two-step", "flanker", "stop-signal", "auditory-oddball"]
)
def test_a_shipped_classic_runs_is_logged_and_replays(name, tmp_path):
    protocol = read_protocol(SHIPPED / f"{name}.toml", trust=True)
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    desk = Desk(plan)
    for _ in range(200):
        if len(desk.of(EpisodeEnded)) == 6:
            break
        desk.give(ScreenShown(desk.now_ns, desk.now_ns, desk.now_ns))
        due_ns = desk.session.next_tick_ns
        if desk.session.phase is Phase.PLAYING and len(desk.of(EpisodeEnded)) % 2:
            started = len(desk.of(EpisodeEnded))
            desk.press(next(iter(plan.episodes[started].key_map.keys)))
            if len(desk.of(EpisodeEnded)) == started and due_ns is not None:  # a trial that ends by the clock
                desk.pass_ms(max(0.0, (due_ns - desk.now_ns) / MS) + 0.001)
        elif due_ns is not None:
            desk.pass_ms((due_ns - desk.now_ns) / MS + 0.001)
        else:
            desk.now_ns += MS
            desk.press(*(key for key, pressed in getattr(desk.session.screen, "keys", ()) if not pressed), "enter")
    assert len(desk.of(EpisodeEnded)) == 6
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize(
    "name",
    [
        "auditory-oddball",
        "flanker",
        "go-no-go",
        "n-back",
        "posner",
        "priming",
        "rsvp",
        "simon",
        "stop-signal",
        "stroop",
        "visual-search",
    ],
)
def test_a_classic_is_25_lines_of_toml(name):
    lines = [line for line in (SHIPPED / f"{name}.toml").read_text().splitlines() if not line.startswith("#")]
    assert len(lines) <= 25


def test_response_times_of_200_trials_are_the_keys_minus_the_onset_flips(tmp_path):
    plan = trials_plan(ROWS.replace("}]", ", times = 1 }]") + 'ready = "none"\ninter_trial_interval_ms = 50\n')
    plan = expand_protocol(
        protocol := decode_protocol(plan.protocol_toml.replace(b"episodes = 4", b"episodes = 200")),
        enrol_participant(protocol, 0),
    )
    clock = VirtualClock()

    class Person(ScriptedWindow):
        """Responds 300 ms after each picture's flip, and notes when."""

        sent_ms: list[float] = []  # noqa: RUF012 - one person

        def show(self, screen):
            shown = super().show(screen)
            if type(screen).__name__ == "PlayScreen":
                after_ms = 300 + len(self.sent_ms) % 7
                self.sent_ms.append(after_ms)
                at_ns = shown.flip_ns + round(after_ms * MS)
                self._script += [KeyDown(at_ns, "f", "f"), KeyUp(at_ns + 1, "f", "f")]
                self._script.sort(key=lambda happened: happened.t_ns)
            return shown

    window = Person([KeyUp(10_000_000 * MS, "x")], clock, frame_ns=16_666_667)
    session = SessionMachine(plan, World, {"machine": "script"})
    log = read_log(run_session(session, window, McapRecorder(tmp_path, plan, started_ns=0), clock))
    measured = [float(episode.rt_ms[0]) for episode in log.episodes]
    assert len(measured) == 200
    assert measured == pytest.approx(window.sent_ms[:200], abs=1e-6)
    assert replace(log.episodes[0], attempt=1).number == 1


def test_an_image_is_in_a_log_once_and_in_what_is_exported_whole(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (100, 100, 3), dtype=np.uint8)
    Image.fromarray(noise).save(picture := io.BytesIO(), "PNG")
    files = {"noise.png": picture.getvalue()}
    plan = trials_plan('stimuli.rows = [{ image = "noise.png" }]\nready = "none"\n', files)
    protocol = decode_protocol(plan.protocol_toml.replace(b"episodes = 4", b"episodes = 40"), files=files)
    plan, clock = expand_protocol(protocol, enrol_participant(protocol, 0)), VirtualClock()
    window = ScriptedWindow([KeyUp(10_000_000 * MS, "x")], clock, frame_ns=16_666_667)
    path = run_session(
        SessionMachine(plan, World, {"machine": "script"}), window, McapRecorder(tmp_path, plan, started_ns=0), clock
    )
    assert path.stat().st_size < 4 * len(picture.getvalue())
    assert [good for _, good in verify_session(path)] == [True]
    log = read_log(path)
    spec = build_environment_spec(IncludedEpisode(log, log.episodes[-1]))
    assert spec is not None
    assert base64.urlsafe_b64decode(spec.kwargs["image"]) == picture.getvalue()


def test_a_session_mixes_trials_and_a_maze_whose_cue_they_teach(tmp_path):
    protocol = read_protocol(SHIPPED / "cued-corridor.toml")
    [path] = simulate(protocol, tmp_path, participants=1, seed=1, player="human-like")
    assert list(find_log_differences(path, World)) == []
    rows = select(tmp_path / "cued-corridor").query("select block, labels from episodes where outcome = 'goal'")
    assert {row["block"] for row in rows.to_pylist()} == {"colours", "corridor"}
    assert Counter(row["labels"] for row in rows.to_pylist() if row["block"] == "corridor") == {
        '{"arm": "left", "cue": "blue"}': 4,
        '{"arm": "right", "cue": "yellow"}': 4,
    }
