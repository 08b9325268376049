"""Trials with a time course: resolved before the first picture, timed from it, proven, and checked row by row."""

import re

import msgspec
import pytest

from minihuman.activities.trials.events import ResponseTaken, StimuliShown, TrialResolved
from minihuman.activities.trials.plan import TimelineSpec, TimelineStimulus
from minihuman.activities.trials.schedule import TrialSchedule, resolve_trial
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.tables import select
from minihuman.display.drawing.screen import compose_screen
from minihuman.errors import ProtocolError, WorldError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeEnded, EpisodeStarted, KeyPressed, Paused, Resumed, Stepped
from minihuman.experiment.machine.inputs import TRIAL_RULES, FocusChanged, ScreenShown
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.codec import decode_event, encode_event
from minihuman.log.segment_schema import has_timelines
from minihuman.reporting.build import build_report
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.activities.trials.test_stimulus_tables import N_MUTANTS, check_or_refuse, mutate, write_picture
from tests.activities.trials.test_trials import BLOCK_TOML, SHIPPED
from tests.counts import count
from tests.study.sessions import MS, Desk

TOML = BLOCK_TOML.replace("final_frame_ms = 0\n{more}", 'ready = "none"\n{rows}\n{timeline}')
ROWS = 'stimuli = { rows = [{ prime = "<<", go = "<<", correct = "left" }], order = "fixed" }'
PRIMING = """
timeline.stimuli = [
  { name = "fixation", text = "+", duration_ms = 500 },
  { name = "prime", text = "{prime}", duration_ms = 33 },
  { name = "mask", text = "XXXX", duration_ms = 67 },
  { name = "target", text = "{go}", until = "response" },
]
"""


def decode(timeline: str = PRIMING, rows: str = ROWS, *, more: str = "", **files: bytes):
    return decode_protocol((TOML.format(timeline=timeline, rows=rows) + more).encode(), "p.toml", files)


def plan_of(timeline: str = PRIMING, rows: str = ROWS, *, more: str = ""):
    protocol = decode(timeline, rows, more=more)
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def resolve(
    stimuli: list[dict[str, object]], cells: dict[str, object], *, share: float = 0.5, **settings
) -> TrialSchedule:
    timeline = msgspec.convert({"stimuli": stimuli} | settings, TimelineSpec)
    return resolve_trial(timeline, cells, 1000, lambda place: share)


def show_next(desk: Desk, *, late_ms: float = 0.0) -> None:
    """Let the next picture be prepared, and be on the display when it is due, or later."""
    due_ns = desk.session.next_tick_ns
    assert due_ns is not None
    desk.pass_ms(max(0, due_ns - desk.now_ns) / MS)
    due_ns = getattr(desk.session.screen, "due_ns", None)
    flip_ns = max(desk.now_ns, due_ns or 0) + round(late_ms * MS)
    desk.give(ScreenShown(flip_ns, flip_ns, flip_ns))


def show_to_target(desk: Desk) -> None:
    desk.show()
    while desk.of(StimuliShown)[-1].stimuli != ("target",):
        show_next(desk)


def names_shown(desk: Desk) -> list[tuple[str, ...]]:
    return [event.stimuli for event in desk.of(StimuliShown)]


# The scheduler


def test_times_count_from_the_trial_another_onset_or_another_end():
    schedule = resolve(
        [
            {"name": "a", "text": "a", "duration_ms": 100},
            {"name": "b", "text": "b", "duration_ms": [10, 30]},
            {"name": "c", "text": "c", "since": "b", "onset_ms": "{soa}", "until": "end"},
            {"name": "d", "text": "d", "after": "a", "onset_ms": 5, "duration_ms": 1},
            {"name": "e", "text": "e", "onset_ms": 400, "duration_ms": 50},
        ],
        {"soa": 250},
        target="c",
    )
    spans_ms = {
        stimulus.name: (stimulus.onset_ns / MS, stimulus.end_ns and stimulus.end_ns / MS)
        for stimulus in schedule.stimuli
    }
    assert spans_ms == {"a": (0, 100), "b": (100, 120), "c": (350, None), "d": (105, 106), "e": (400, 450)}
    assert (schedule.opens_ns, schedule.closes_ns) == (350 * MS, 1350 * MS)


def test_several_stimuli_are_visible_at_once_the_highest_layer_in_front():
    schedule = resolve(
        [
            {"name": "above", "text": "a", "onset_ms": 0, "duration_ms": 100, "layer": 1},
            {"name": "below", "text": "b", "onset_ms": 50, "until": "end"},
        ],
        {},
    )
    assert [time // MS for time in schedule.changes_ns] == [0, 50, 100]
    visible = [[stimulus.name for stimulus in schedule.find_visible(time)] for time in schedule.changes_ns]
    assert visible == [["above"], ["below", "above"], ["below"]]


def test_an_empty_cell_shows_nothing_and_keeps_its_time():
    stimuli = [
        {"name": "cue", "text": "{cue}", "duration_ms": 100},
        {"name": "target", "text": "x", "until": "response"},
    ]
    with_cue = resolve(stimuli, {"cue": "<"})
    without = resolve(stimuli, {})
    assert [stimulus.name for stimulus in without.stimuli] == ["target"]
    assert without.target_ns == with_cue.target_ns == 100 * MS


def test_the_words_of_a_stream_come_one_after_the_other():
    schedule = resolve(
        [{"name": "s", "text": "{w}", "each_ms": 100}, {"name": "q", "text": "?", "until": "response"}], {"w": "A B C"}
    )
    assert [(stimulus.name, stimulus.onset_ns // MS) for stimulus in schedule.stimuli] == [
        ("s-1", 0),
        ("s-2", 100),
        ("s-3", 200),
        ("q", 300),
    ]


@pytest.mark.parametrize(
    ("stimulus", "message"),
    [
        ({"duration_ms": "{soa}"}, "stimulus 'a': duration_ms is 'soon'; use a number from 0"),
        ({"until": "end", "x": "{soa}"}, "x is 'soon'; use a number from 0 to 1"),
        ({"until": "end", "size": "{none}"}, "size is ''"),
    ],
)
def test_a_cell_that_is_no_time_or_number_is_named_with_its_stimulus(stimulus, message):
    with pytest.raises(WorldError, match=message):
        resolve([{"name": "a", "text": "a"} | stimulus], {"soa": "soon"})


# A session


def test_a_masked_prime_is_shown_as_planned_and_the_response_timed_from_the_target():
    desk = Desk(plan_of())
    show_to_target(desk)
    assert names_shown(desk) == [("fixation",), ("prime",), ("mask",), ("target",)]
    first_ns = desk.of(StimuliShown)[0].flip_ns
    assert [(event.flip_ns - first_ns) / MS for event in desk.of(StimuliShown)] == [0, 500, 533, 600]
    desk.pass_ms(312)
    desk.press("f")
    [stepped] = desk.of(Stepped)
    assert (stepped.rt_ms, stepped.reward, stepped.key) == (313.0, 1.0, "f")
    [taken] = desk.of(ResponseTaken)
    assert (taken.pressed_ns - taken.target_ns) / MS == 313
    assert list(compare_replay(desk.events, World)) == []


def test_the_resolved_trial_precedes_its_first_picture_and_reads_as_it_was_written():
    desk = Desk(plan_of())
    show_to_target(desk)
    kinds = [type(event) for event in desk.events]
    assert kinds.index(TrialResolved) < kinds.index(StimuliShown)
    for event in [*desk.of(TrialResolved), *desk.of(StimuliShown), *desk.of(ResponseTaken)]:
        topic, message = encode_event(event)
        assert decode_event(topic, message.SerializeToString()) == event
    schedule = msgspec.json.decode(desk.of(TrialResolved)[0].schedule, type=TrialSchedule)
    assert schedule.target_ns == 600 * MS
    assert has_timelines(desk.plan)


def test_a_key_before_the_target_is_logged_and_is_no_response():
    desk = Desk(plan_of())
    desk.show()
    desk.press("j")
    assert desk.of(Stepped) == []
    assert desk.of(ResponseTaken) == []
    assert [event.verdict for event in desk.of(KeyPressed) if event.down] == ["not_playing"]
    assert list(compare_replay(desk.events, World)) == []


def test_a_late_flip_is_in_the_log_and_delays_nothing_after_it():
    desk = Desk(plan_of())
    desk.show()
    show_next(desk, late_ms=12)
    show_next(desk)
    prime, mask = desk.of(StimuliShown)[1:]
    assert (prime.flip_ns - prime.due_ns) / MS == 12
    assert (mask.flip_ns - mask.due_ns) / MS == 0
    assert list(compare_replay(desk.events, World)) == []


def test_without_a_response_the_trial_ends_at_the_deadline():
    desk = Desk(plan_of())
    show_to_target(desk)
    desk.pass_ms(999)
    assert desk.of(Stepped) == []
    desk.pass_ms(2)
    [stepped] = desk.of(Stepped)
    assert (stepped.key, stepped.rt_ms) == ("", None)
    assert list(compare_replay(desk.events, World)) == []


RHYTHM = """
timeline = { ends = "time", soa_ms = 1500, stimuli = [{ name = "letter", text = "{go}", duration_ms = 400 }] }
"""


def test_trials_at_a_rhythm_begin_by_the_clock_whatever_the_response_and_the_flips():
    desk = Desk(plan_of(RHYTHM))
    desk.show()
    for late_ms in (0, 7, 3):
        desk.pass_ms(250)
        desk.press("f")
        trial = len(desk.of(EpisodeEnded))
        while len(desk.of(EpisodeEnded)) == trial:
            show_next(desk)
        while not desk.of(StimuliShown)[-1].episode > trial:
            show_next(desk, late_ms=late_ms)
    starts = [event for event in desk.of(StimuliShown) if event.frame == 0 and event.due_ns]
    first_ns = desk.of(StimuliShown)[0].flip_ns
    assert [(event.due_ns - first_ns) / MS for event in starts] == [1500, 3000, 4500]
    assert [(event.flip_ns - event.due_ns) / MS for event in starts] == [0, 7, 3]
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize("rules", [TRIAL_RULES, "1"], ids=["now", "a session of before"])
@pytest.mark.parametrize("reason", ["participant", "focus_lost"])
def test_a_pause_voids_the_trial_which_is_repeated_with_the_same_times(rules, reason):
    drawn = PRIMING.replace("duration_ms = 500", "duration_ms = [300, 900]")
    desk = Desk(plan_of(drawn), trial_rules=rules)
    desk.show()
    show_next(desk)
    if reason == "participant":
        desk.press("f8")
        desk.press("f8")
    else:
        desk.give(FocusChanged(desk.now_ns + MS, False))
        desk.give(FocusChanged(desk.now_ns + MS, True))
    desk.pass_ms(5)
    pauses = [event.reason for event in desk.of(Paused)]
    assert pauses == ([reason] if rules == TRIAL_RULES else [])
    assert len(desk.of(Resumed)) == len(pauses)
    assert desk.session.phase is Phase.PLAYING
    assert [event.outcome for event in desk.of(EpisodeEnded)] == ["abandoned"]
    assert [event.plan.episode for event in desk.of(EpisodeStarted)] == [0, 0]
    first, second = desk.of(TrialResolved)
    assert first.schedule == second.schedule
    show_to_target(desk)
    desk.press("f")
    assert [event.outcome for event in desk.of(EpisodeEnded)] == ["abandoned", "goal"]
    assert find_violations(desk.events) == []
    assert list(compare_replay(desk.events, World)) == []


def test_a_session_that_is_quit_in_a_trial_replays():
    desk = Desk(plan_of())
    desk.show()
    show_next(desk)
    desk.quit()
    assert desk.session.over
    assert list(compare_replay(desk.events, World)) == []


STOP = """
timeline = { target = "go", stimuli = [
  { name = "go", text = "{go}", until = "response" },
  { name = "stop", text = "{stop}", since = "go", onset_ms = "{delay_ms}", until = "response" } ] }
design.name = "staircase"
design.settings.option = "delay_ms"
design.settings.only.correct = "none"
design.settings.values = [100, 200, 300]
design.settings.down = 1
design.settings.start = 1
"""
STOP_ROWS = (
    'stimuli = { order = "fixed", rows = [{ go = "<", stop = "X", correct = "none" }, { go = "<", correct = "left" }] }'
)


def test_a_stop_signals_delay_follows_the_stop_trials_alone():
    desk = Desk(plan_of(STOP, STOP_ROWS))
    desk.show()
    show_next(desk)
    assert names_shown(desk)[-1] == ("go", "stop")
    desk.pass_ms(1200)  # withheld: the next delay is longer
    desk.show()
    desk.pass_ms(1200)  # an omission in a go trial changes nothing
    desk.show()
    show_next(desk)
    stops = [event.due_ns - event.flip_ns for event in desk.of(StimuliShown) if "stop" in event.stimuli]
    assert stops == [0, 0]
    delays = [event.plan.options["delay_ms"] for event in desk.of(EpisodeStarted)]
    assert delays == [200, 300, 300]
    assert list(compare_replay(desk.events, World)) == []


# What `check` refuses


@pytest.mark.parametrize(
    ("timeline", "message"),
    [
        ('timeline.stimuli = []', "timeline.stimuli.*is empty"),
        ('timeline.stimuli = [{ name = "a", text = "a" }]', "needs one of duration_ms, each_ms and until"),
        ('timeline.stimuli = [{ name = "a", until = "end" }]', "shows nothing"),
        ('timeline.stimuli = [{ name = "a", text = "a", since = "b", until = "end" }]', "'b', which is no"),
        ('timeline = { target = "z", stimuli = [{ name = "a", text = "a", until = "end" }] }', "'z', which is no"),
        ('timeline = { soa_ms = 1050, stimuli = [{ name = "a", text = "a", until = "end" }] }', "use at most 950"),
        ('timeline.stimuli = [{ name = "a", text = "a", duration_ms = [5, 1], until = "end" }]', "the shortest, then"),
    ],
)  # fmt: skip
def test_a_timeline_that_makes_no_trial_is_refused(timeline, message):
    with pytest.raises(ProtocolError, match=message):
        decode(timeline)


@pytest.mark.parametrize(
    ("table", "stimulus", "message"),
    [
        (b"go,soa\n<,100\n>,late\n", 'onset_ms = "{soa}"', r"words\.csv:3: timeline: stimulus 'a': onset_ms is 'late'"),
        (b"go,soa\n<,100\n", 'onset_ms = "{sao}"', r"stimulus 'a', onset_ms: there is no column 'sao'; .*go, soa"),
        (b"go,ink\n<,red\n>,rde\n", 'colour = "{ink}"', r"words\.csv:3: 'rde' is not a colour"),
        (b"go,kind\n<,star\n", 'shape = "{kind}"', r"words\.csv:2: shape is 'star'; use one of circle"),
        (b"go,face\n<,a.png\n", 'image = "{face}"', r"words\.csv:2: image 'a\.png' is not in the protocol's folder"),
        (b"go,place\n<,up\n", 'x = "{place}"', r"words\.csv:2: timeline: stimulus 'a': x is 'up'"),
    ],
)
def test_each_row_whose_timeline_cannot_be_shown_is_named(table, stimulus, message):
    timeline = f'timeline.stimuli = [{{ name = "a", text = "{{go}}", {stimulus}, until = "end" }}]'
    rows = 'stimuli.file = "words.csv"'
    protocol = decode(timeline, rows, **{"words.csv": table})
    with pytest.raises(ProtocolError, match=message):
        check_worlds(protocol, "p.toml")


def test_a_trial_that_is_longer_than_the_rhythm_is_refused_with_its_row():
    rows = 'stimuli = { rows = [{ go = "<", ms = 100 }, { go = ">", ms = 1500 }] }'
    stimulus = '{ name = "a", text = "{go}", duration_ms = "{ms}" }'
    protocol = decode(f'timeline = {{ ends = "time", soa_ms = 1500, stimuli = [{stimulus}] }}', rows)
    with pytest.raises(ProtocolError, match=r"rows\[1\]: timeline: the trial lasts 1500 ms; .* 1400 at most"):
        check_worlds(protocol, "p.toml")


def test_columns_that_a_timeline_shows_are_not_taken_for_labels_that_nobody_sees():
    [notice] = check_worlds(decode(rows='stimuli = { rows = [{ prime = "<", go = "<", level = 1 }] }'), "p.toml")
    assert notice == "block 'words': its table of stimuli has labels, which are not shown: level"


def test_the_methods_say_what_a_trial_showed_and_when():
    cue = {"name": "cue", "text": "<", "duration_ms": 100}
    star = {"name": "star", "text": "*", "since": "cue", "onset_ms": "{soa}", "until": "response"}
    timeline = msgspec.convert({"stimuli": [cue, star]}, TimelineSpec)
    shown, responses = timeline.describe(1500)
    assert shown == (
        "each trial showed 'cue' for 100 ms, 'star' the time in column 'soa' after the onset of 'cue' until the "
        "response"
    )
    assert responses == (
        "response times count from the onset of 'star'; responses were taken after it, at most 1500 ms"
    )


DOCS = (SHIPPED.parents[1] / "docs" / "trials.md").read_text(encoding="utf-8")
FIELDS = re.findall(r"^\| `(\w+)` \| `([^|]*=[^|]*)` \|", DOCS, re.MULTILINE)
CUE = '{ name = "cue", text = "<", duration_ms = 100 }'


def test_the_docs_explain_each_field_of_a_timeline():
    names = [*TimelineStimulus.__struct_fields__, *TimelineSpec.__struct_fields__]
    assert sorted(name for name, _ in FIELDS) == sorted(names)


@pytest.mark.parametrize(("name", "example"), FIELDS)
def test_each_example_of_the_docs_is_a_timeline_that_can_be_shown(name, example, tmp_path):
    rows = 'stimuli = { rows = [{ word = "<", ink = "red", side = "left", soa = 250 }] }'
    timeline = f"timeline = {{ stimuli = [{CUE}], {example} }}"
    if name == "stimuli":
        timeline = f"timeline = {{ {example} }}"
    elif name in TimelineStimulus.__struct_fields__:
        named = "" if name == "name" else 'name = "field", '
        shown = "" if name in ("text", "shape", "image", "sound") else 'text = "A B", '
        shown = 'sound = "tone", duration_ms = 70, ' if name in ("hz", "level_db", "ear") else shown
        ends = "" if name in ("duration_ms", "each_ms", "until") else ', until = "end"'
        ends = ", duration_ms = 70" if name == "sound" else ends
        if name == "feedback":
            shown, ends = 'sound = "tone", duration_ms = 70, ', ""
        timeline = f"timeline = {{ stimuli = [{CUE}, {{ {named}{shown}{example}{ends} }}] }}"
    if name == "feedback":
        timeline += '\nfeedback = { failure = "Wrong" }\nfeedback_ms = 500'
    write_picture(tmp_path / "face.png")
    protocol = decode(timeline, rows, **{"face.png": (tmp_path / "face.png").read_bytes()})
    check_worlds(protocol, "p.toml")


def test_the_practice_of_the_docs_ends_at_nine_right_of_the_last_ten():
    [block] = re.findall(r"(\[\[blocks\]\]\nname = .practice.*?)```", DOCS, re.DOTALL)
    head = TOML.partition("[[blocks]]")[0].replace('["words"]', '["practice"]')
    protocol = decode_protocol((head + block).encode())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    desk = Desk(plan)
    desk.press("enter")
    for _ in range(400):
        if desk.session.over:
            break
        desk.show()
        if desk.session.phase is Phase.PLAYING:
            episode = plan.episodes[len(desk.of(EpisodeEnded))]
            keys = {action: key for key, action in episode.key_map.keys.items()}
            desk.pass_ms(300)
            desk.press(keys[episode.options["correct"]])
        elif desk.session.next_tick_ns is not None:
            desk.pass_ms(max(0, desk.session.next_tick_ns - desk.now_ns) / MS)
        else:
            desk.press("enter")
    assert [event.outcome for event in desk.of(EpisodeEnded)] == ["goal"] * 9


MUTABLE = """
timeline.stimuli = [
  { name = "cue", text = "{side}", duration_ms = "{soa}" },
  { name = "word", text = "{text}", colour = "{colour}", size = "{size}", x = "{side}", since = "cue", onset_ms = "{soa}", until = "response" },
]
"""  # noqa: E501 - TOML's


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("seed", range(count(12, N_MUTANTS)))
def test_a_timeline_of_a_mutated_table_is_refused_by_check_or_played_to_its_end(seed, tmp_path):
    (tmp_path / "words.csv").write_bytes(mutate(seed))
    write_picture(tmp_path / "face.png")
    (tmp_path / "p.toml").write_text(TOML.format(timeline=MUTABLE, rows='stimuli.file = "words.csv"'))
    protocol, refusal = check_or_refuse(tmp_path / "p.toml")
    if protocol is None:
        assert re.search(r"words\.csv:\d+: .*(column|this row|header|stimulus|colour)", refusal), refusal
        return
    desk = Desk(expand_protocol(protocol, enrol_participant(protocol, 0)))
    for _ in range(100):
        if len(desk.of(EpisodeEnded)) == 4:
            break
        assert compose_screen(desk.session.screen, (160, 120)).shape == (120, 160, 3)
        desk.show()
        if desk.session.next_tick_ns is not None:
            desk.pass_ms(max(0, desk.session.next_tick_ns - desk.now_ns) / MS)
    assert [event.outcome for event in desk.of(EpisodeEnded) if event.outcome == "abandoned"] == []
    assert len(desk.of(EpisodeEnded)) == 4
    assert desk.session.failure is None


@pytest.mark.program
@pytest.mark.nightly(by_day=["priming"])
@pytest.mark.parametrize(
    "name", ["flanker", "go-no-go", "n-back", "posner", "priming", "rsvp", "simon", "stroop", "visual-search"]
)
def test_a_classic_is_simulated_by_default_proven_and_reported(name, tmp_path):
    toml = (SHIPPED / f"{name}.toml").read_text()
    (tmp_path / f"{name}.toml").write_text(re.sub(r"(?m)^episodes = .*", "episodes = 12", toml))
    for table in SHIPPED.glob(f"{name}.csv"):
        (tmp_path / table.name).write_bytes(table.read_bytes())
    protocol = read_protocol(tmp_path / f"{name}.toml", trust=True)
    for log in simulate(protocol, tmp_path / "data", participants=2, seed=1, player="human-like"):
        assert all(is_proven for _, is_proven in verify_session(log))
    with select(tmp_path / "data" / name) as tables:
        build_report(tables, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "RT median (ms)" in page
