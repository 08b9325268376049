"""Sounds in trials: their samples and times, what the log has of them, and what is refused before a session."""

import io
import re
import sys

import msgspec
import numpy as np
import pytest

from minihuman.activities.trials.events import SoundPlayed, StimuliShown
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import find_log_differences
from minihuman.dataset.tables import select
from minihuman.errors import DeviceError, ProtocolError, WorldError
from minihuman.experiment.machine.events import EpisodeEnded, KeyPressed, Stepped
from minihuman.experiment.machine.inputs import TRIAL_RULES, FocusChanged, SoundStarted
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.trials import list_protocol_sounds, list_sounds
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.experiment.sounds import SoundContent, SoundCue, compute_digest, encode_wav, render_sound
from minihuman.runtime.devices.sound import ClockFit, SimulatedOutput, list_sound_cues, require_sound_device
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.activities.trials.test_timelines import TOML, decode, plan_of, show_next
from tests.activities.trials.test_trials import SHIPPED
from tests.machine import needs
from tests.study.sessions import MS, Desk

RATE_HZ = 48_000
ROWS = 'stimuli = { order = "fixed", rows = [{ go = "<<", hz = 880, correct = "left" }] }'
TONE = """
timeline.target = "tone"
timeline.stimuli = [
  { name = "fixation", text = "+", until = "end" },
  { name = "tone", sound = "tone", hz = "{hz}", onset_ms = 300, duration_ms = 70 },
]
"""
TONE_CONTENT = SoundContent(source="tone", hz=1000.0, level_db=-20.0, ear="both", lasts_ms=50.0)
EARLY = TONE.replace("onset_ms = 300", "onset_ms = 20")


def content(**changed: object) -> SoundContent:
    return msgspec.structs.replace(TONE_CONTENT, **changed)


def begin_sound(desk: Desk, *, late_ms: float = 0.0, uncertainty_ms: float = 0.5) -> SoundCue:
    """Let the session's next sound begin when it is due, or later."""
    [cue] = list_sound_cues(desk.session)
    onset_ns = cue.due_ns + round(late_ms * MS)
    desk.pass_ms(max(0.0, (onset_ns - desk.now_ns) / MS))
    desk.give(SoundStarted(desk.now_ns, cue.number, cue.due_ns, onset_ns, round(uncertainty_ms * MS)))
    return cue


# The samples


def test_a_tone_has_its_frequency_level_and_length_and_begins_softly():
    samples = render_sound(content(), {}, RATE_HZ)
    assert samples.shape == (2_400, 2)
    spectrum = np.abs(np.fft.rfft(samples[:, 0]))
    assert np.argmax(spectrum) * RATE_HZ / len(samples) == 1_000
    assert np.abs(samples).max() == pytest.approx(0.1, rel=0.01)
    assert np.abs(samples[:10]).max() < 0.001
    assert np.array_equal(samples[:, 0], samples[:, 1])


def test_a_sound_for_one_ear_is_silent_in_the_other():
    left = render_sound(content(source="noise", ear="left"), {}, RATE_HZ)
    assert left[:, 0].std() > 0.01
    assert not left[:, 1].any()
    right = render_sound(content(source="noise", ear="right"), {}, RATE_HZ)
    assert np.array_equal(left[:, 0], right[:, 1]), "the noise is the same in each trial"


@needs("sound")
@pytest.mark.parametrize(("kind", "rate_hz"), [("WAV", 48_000), ("FLAC", 44_100), ("OGG", 22_050)])
def test_a_file_is_heard_at_the_devices_rate(kind, rate_hz):
    soundfile = pytest.importorskip("soundfile")
    tone = 0.5 * np.sin(2 * np.pi * 1000 * np.arange(rate_hz // 2) / rate_hz)
    file = io.BytesIO()
    soundfile.write(file, tone, rate_hz, format=kind)
    samples = render_sound(content(source="a.x", lasts_ms=0, level_db=-6.0), {"a.x": file.getvalue()}, RATE_HZ)
    assert abs(len(samples) - RATE_HZ // 2) <= 1
    middle = samples[4_800:-4_800, 0]
    assert np.argmax(np.abs(np.fft.rfft(middle))) * RATE_HZ / len(middle) == pytest.approx(1000, abs=3)
    assert np.abs(middle).max() == pytest.approx(0.25, rel=0.1)


def test_equal_sounds_have_one_digest_whatever_their_files_names():
    files = {"a.wav": b"1", "b.wav": b"1", "c.wav": b"2"}
    digests = [compute_digest(content(source=name), files) for name in files]
    assert digests[0] == digests[1] != digests[2]


@needs("sound")
def test_what_a_page_gets_decodes_to_the_same_samples():
    soundfile = pytest.importorskip("soundfile")
    for ear in ("both", "left"):
        samples = render_sound(content(ear=ear), {}, RATE_HZ)
        decoded, rate_hz = soundfile.read(io.BytesIO(encode_wav(samples, RATE_HZ)), always_2d=True)
        assert rate_hz == RATE_HZ
        assert np.abs(decoded - samples[:, : decoded.shape[1]]).max() < 1e-4


# A session


@pytest.mark.parametrize(("rules", "count"), [(TRIAL_RULES, 1), ("1", 0)], ids=["now", "a session of before"])
def test_a_sound_is_logged_that_a_busy_machine_hears_of_after_the_trials_time(rules, count):
    desk = Desk(plan_of(TONE, ROWS), trial_rules=rules)
    desk.show()
    show_next(desk)
    [cue] = list_sound_cues(desk.session)
    late_ns = cue.due_ns + 5_000 * MS  # by then the trial is over by the clock
    desk.give(SoundStarted(late_ns, cue.number, cue.due_ns, cue.due_ns, 1))
    desk.pass_ms(5)
    assert len(desk.of(SoundPlayed)) == count
    assert desk.of(EpisodeEnded)[-1].t_ns >= late_ns
    assert list(compare_replay(desk.events, World)) == []


def test_a_sound_is_due_after_the_first_flip_and_the_response_is_timed_from_its_onset():
    desk = Desk(plan_of(TONE, ROWS))
    assert list_sound_cues(desk.session) == ()
    desk.show()
    cue = begin_sound(desk, late_ms=3)
    assert (cue.due_ns - desk.of(StimuliShown)[0].flip_ns) / MS == 300
    assert cue.content.hz == 880
    desk.pass_ms(250)
    desk.press("f")
    [played] = desk.of(SoundPlayed)
    assert (played.sound, (played.onset_ns - played.due_ns) / MS, played.uncertainty_ms) == ("tone", 3, 0.5)
    [stepped] = desk.of(Stepped)
    assert (stepped.rt_ms, stepped.reward) == (251.0, 1.0)
    assert list_sound_cues(desk.session) == (), "what still plays as the trial ends, stops"
    assert list(compare_replay(desk.events, World)) == []


def test_a_key_before_the_target_sound_is_no_response():
    desk = Desk(plan_of(TONE, ROWS))
    desk.show()
    desk.press("f")
    assert desk.of(Stepped) == []
    assert [event.verdict for event in desk.of(KeyPressed) if event.down] == ["not_playing"]


def test_an_early_sound_is_handed_over_before_the_first_picture_which_waits_for_it():
    desk = Desk(plan_of(EARLY, ROWS))
    desk.show()
    [empty] = desk.of(StimuliShown)
    assert (empty.frame, empty.stimuli) == (-1, ())
    [cue] = list_sound_cues(desk.session)
    assert (cue.due_ns - empty.flip_ns) / MS == 170
    show_next(desk)
    first = desk.of(StimuliShown)[1]
    assert (first.frame, (first.flip_ns - empty.flip_ns) / MS) == (0, 150)
    begin_sound(desk)
    [played] = desk.of(SoundPlayed)
    assert played.onset_ns == played.due_ns
    desk.press("f")
    assert list(compare_replay(desk.events, World)) == []


def test_a_pause_stops_the_sound_and_its_late_report_is_ignored():
    desk = Desk(plan_of(TONE, ROWS))
    desk.show()
    [cue] = list_sound_cues(desk.session)
    desk.give(FocusChanged(desk.now_ns + MS, False))
    assert list_sound_cues(desk.session) == ()
    desk.give(SoundStarted(cue.due_ns, cue.number, cue.due_ns, cue.due_ns, 0))
    desk.give(FocusChanged(desk.now_ns + MS, True))
    desk.pass_ms(5)
    desk.show()
    assert desk.of(SoundPlayed) == []
    [repeated] = list_sound_cues(desk.session)
    assert repeated.number != cue.number
    begin_sound(desk)
    assert len(desk.of(SoundPlayed)) == 1


FEEDBACK = """
timeline.stimuli = [
  { name = "go", text = "{go}", until = "response" },
  { name = "buzz", sound = "tone", hz = 220, duration_ms = 150, feedback = "failure" },
]
feedback = { goal = "Right", failure = "Wrong" }
feedback_ms = 600
"""


def test_a_feedback_tone_begins_with_its_text_and_is_heard_after_errors_alone():
    desk = Desk(plan_of(FEEDBACK, ROWS))
    desk.show()
    desk.pass_ms(300)
    assert list_sound_cues(desk.session) == ()
    desk.press("j")
    [stepped] = desk.of(Stepped)
    desk.show()
    cue = begin_sound(desk, late_ms=4)
    assert (cue.content.hz, cue.due_ns) == (220, stepped.t_ns)
    [played] = desk.of(SoundPlayed)
    assert (played.sound, (played.onset_ns - played.due_ns) / MS) == ("feedback", 4)
    desk.pass_ms(700)
    assert list_sound_cues(desk.session) == ()
    desk.show()
    desk.pass_ms(300)
    desk.press("f")
    assert list_sound_cues(desk.session) == ()
    assert list(compare_replay(desk.events, World)) == []


def test_simulated_people_hear_the_oddball_and_the_log_is_proven(tmp_path):
    protocol = read_protocol(SHIPPED / "auditory-oddball.toml")
    [path] = simulate(protocol, tmp_path, participants=1, seed=1, player="human-like")
    assert list(find_log_differences(path, World)) == []
    query = select(tmp_path / "auditory-oddball").query
    [row] = query("select count(*) as n, max(abs(late_ms)) as late from trial_sounds").to_pylist()
    assert (row["n"], row["late"]) == (100, 0)
    rows = query("select response, count(*) as n from trials where correct = 'press' group by 1").to_pylist()
    assert max(rows, key=lambda counted: counted["n"])["response"] == "press"


def test_the_sounds_of_a_session_are_known_before_it_begins():
    protocol = read_protocol(SHIPPED / "auditory-oddball.toml")
    assert [sound.hz for sound in list_protocol_sounds(protocol)] == [1000, 1500]
    assert list_sounds(plan_of(TONE, ROWS)) == [content(hz=880.0, lasts_ms=70.0)]
    assert list_sounds(plan_of()) == []


# What is refused


@pytest.mark.parametrize(
    ("stimulus", "message"),
    [
        ('sound = "tone", text = "x", duration_ms = 50', "stands beside what is shown"),
        ('sound = "noise", until = "end"', r"duration_ms.*is missing; say how long the noise lasts"),
        ('sound = "tone", duration_ms = [50, 90]', "is not drawn"),
        ('sound = "a.wav", each_ms = 50', "applies to the words of a text"),
        (
            'sound = "tone", duration_ms = 50, feedback = "goal" }, { name = "b", text = "b", until = "end"',
            "give that a text",
        ),
    ],
)
def test_a_sound_that_cannot_be_played_is_refused(stimulus, message):
    with pytest.raises(ProtocolError, match=message):
        decode(f'timeline.stimuli = [{{ name = "a", {stimulus} }}]')


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (b"go,file\n<,tone\n>,b.wav\n", r"words\.csv:3: sound 'b\.wav' is not in the protocol's folder"),
        (b"go,file,hz\n<,tone,high\n", r"words\.csv:2: timeline: stimulus 'a': hz is 'high'; use a number from 20"),
        (b"go,file,ear\n<,tone,up\n", r"words\.csv:2: timeline: stimulus 'a': ear is 'up'; use one of both, left"),
    ],
)
def test_each_row_whose_sound_cannot_be_played_is_named(table, message):
    columns = table.decode().partition("\n")[0].split(",")
    cells = "".join(f', {name} = "{{{name}}}"' for name in columns if name in ("hz", "ear"))
    timeline = f'timeline.stimuli = [{{ name = "a", sound = "{{file}}", duration_ms = 50{cells} }}]'
    protocol = decode(timeline, 'stimuli.file = "words.csv"', **{"words.csv": table})
    with pytest.raises(ProtocolError, match=message):
        check_worlds(protocol, "p.toml")


@needs("sound")
def test_a_file_that_is_no_sound_is_named_with_its_row():
    timeline = 'timeline.stimuli = [{ name = "a", sound = "{file}", until = "end" }]'
    files = {"words.csv": b"go,file\n<,a.wav\n", "a.wav": b"RIFF, but cut off"}
    protocol = decode(timeline, 'stimuli.file = "words.csv"', **files)
    with pytest.raises(ProtocolError, match=r"words\.csv:2: sound 'a\.wav' is no WAV, FLAC or OGG"):
        check_worlds(protocol, "p.toml")


def test_a_file_without_its_decoder_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "soundfile", None)
    with pytest.raises(WorldError, match=r"sound 'a\.wav' needs the package soundfile; pip install .*\[sound\]"):
        render_sound(content(source="a.wav"), {"a.wav": b""}, RATE_HZ)


def test_a_study_with_sound_is_refused_where_no_device_can_be_opened(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(DeviceError, match=r"sounddevice is missing; pip install .*\[sound\]"):
        require_sound_device(read_protocol(SHIPPED / "auditory-oddball.toml"))
    require_sound_device(read_protocol(SHIPPED / "stroop.toml"))


# The device's clock


def feed(fit: ClockFit, buffers: range, rng: np.random.Generator, *, offset_s: float) -> None:
    for buffer in buffers:
        frame = 512 * buffer
        fit.add(frame, offset_s + frame / RATE_HZ + rng.normal(0, 0.001))


def test_the_devices_clock_is_known_better_than_a_buffers_time():
    fit = ClockFit(RATE_HZ)
    feed(fit, range(512), np.random.default_rng(1), offset_s=2.0)
    assert fit.find_time_s(48_000) == pytest.approx(3.0, abs=0.0003)
    assert fit.find_frame(3.0) == pytest.approx(48_000, abs=15)
    assert 0.001 <= fit.uncertainty_s < 0.005


def test_buffers_that_are_late_move_nothing_and_an_interruption_begins_anew():
    fit = ClockFit(RATE_HZ)
    rng = np.random.default_rng(1)
    feed(fit, range(300), rng, offset_s=2.0)
    feed(fit, range(300, 304), rng, offset_s=2.5)
    assert fit.offset_s == pytest.approx(2.0, abs=0.001)
    feed(fit, range(304, 370), rng, offset_s=2.5)
    assert fit.offset_s == pytest.approx(2.5, abs=0.001)


def test_a_simulated_device_says_each_sound_once_when_it_is_due():
    now_ns = 0
    output = SimulatedOutput(lambda: now_ns)
    cues = [SoundCue(7, content(), 20), SoundCue(8, content(), 10)]
    output.follow(cues)
    assert (output.read(), output.next_report_ns) == ([], 10)
    now_ns = 30
    assert [report.cue for report in output.read()] == [8, 7]
    output.follow(cues)
    assert (output.read(), output.next_report_ns) == ([], None)


def test_the_blocks_of_the_docs_set_the_volume_and_end_at_six_right_answers_in_a_row(tmp_path):
    docs = (SHIPPED.parents[1] / "docs" / "trials.md").read_text(encoding="utf-8")
    [blocks] = re.findall(r"(\[\[blocks\]\]\nname = .volume.*?)```", docs, re.DOTALL)
    head = TOML.partition("[[blocks]]")[0].replace('["words"]', '["volume", "hearing"]')
    head = head.replace('pool = ["f", "j"]', 'pool = ["space", "left", "right"]').replace('"1"', '"1.0"')
    protocol = decode_protocol((head + blocks).encode(), "p.toml")
    check_worlds(protocol, "p.toml")
    [path] = simulate(protocol, tmp_path, participants=1, seed=1, player="human-like")
    rows = select(tmp_path / "trials").query("select block, outcome from episodes order by episode").to_pylist()
    assert [row["block"] for row in rows].count("volume") == 1
    assert [row["outcome"] for row in rows][-6:] == ["goal"] * 6
    assert {row["block"] for row in rows[-6:]} == {"hearing"}
    assert list(find_log_differences(path, World)) == []


def test_an_interruption_is_uncertain_at_once_though_the_line_follows_later():
    fit = ClockFit(RATE_HZ)
    for buffer in range(200):
        fit.add(480 * buffer, 10 + buffer / 100)
    assert fit.uncertainty_s == 0.001
    for buffer in range(200, 206):
        fit.add(480 * buffer, 10.005 + buffer / 100)
    assert fit.find_time_s(0) == pytest.approx(10)
    assert fit.uncertainty_s >= 0.005
