"""What `check` says of a timeline that can be played, or not, but hardly as it was meant."""

import msgspec
import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import describe_plan
from minihuman.experiment.plan.stimulus_check import check_stimuli
from tests.activities.trials.test_timelines import decode, plan_of

ROWS = 'stimuli = { order = "fixed", rows = [{ go = "<", side = "left", mask = "" }, { go = ">", mask = "" }] }'
FIXATION = '{ name = "fixation", text = "+", duration_ms = 400 }'
GO = '{ name = "go", text = "{go}", onset_ms = 400, until = "response" }'


def check(*stimuli: str, more: str = "", rows: str = ROWS) -> list[str]:
    """Return the notices of a timeline with these stimuli."""
    timeline = f"timeline.stimuli = [{', '.join(stimuli)}]\n{more}"
    return [notice for notice in check_stimuli(decode(timeline, rows), "p.toml") if "labels" not in notice]


def test_an_ordinary_timeline_has_no_notice():
    assert check(FIXATION, GO, '{ name = "tone", sound = "tone", onset_ms = 0, duration_ms = 50 }') == []


@pytest.mark.parametrize(
    ("stimuli", "more", "notice"),
    [
        (
            (FIXATION, GO, '{ name = "late", text = "x", onset_ms = 9000, duration_ms = 50 }'),
            'timeline.target = "go"',
            "stimulus 'late' never appears, as every trial is over by its onset; begin it earlier, or let",
        ),
        (
            (FIXATION, '{ name = "mask", text = "{mask}", duration_ms = 50 }', GO),
            "",
            "stimulus 'mask' never appears, as its cell is empty in every row; fill it in, or remove it",
        ),
        (
            (GO, '{ name = "click", sound = "noise", onset_ms = 0, duration_ms = 5 }'),
            'timeline.target = "go"',
            "sound 'click' lasts 5 ms in rows[0], which is shorter than a frame of 16.7 ms at 60 Hz; make it longer",
        ),
        (
            (
                '{ name = "a", sound = "noise", onset_ms = 0, duration_ms = 500 }',
                '{ name = "b", sound = "tone", ear = "left", onset_ms = 300, duration_ms = 100 }',
                GO,
            ),
            "",
            "sounds 'a' and 'b' overlap in one ear in rows[0], from 300 to 400 ms; change an onset",
        ),
    ],
)
def test_each_oddity_is_one_sentence_with_block_and_stimulus(stimuli, more, notice):
    [written] = check(*stimuli, more=more)
    assert written.startswith("block 'words': " + notice)


def test_sounds_after_each_other_or_in_two_ears_do_not_overlap():
    left = '{ name = "a", sound = "noise", ear = "left", onset_ms = 0, duration_ms = 300 }'
    right = '{ name = "b", sound = "tone", ear = "right", onset_ms = 100, duration_ms = 300 }'
    later = '{ name = "c", sound = "tone", onset_ms = 400, duration_ms = 100 }'
    assert check(left, right, later, GO) == []


def test_a_window_for_responses_that_ends_before_it_opens_is_refused_once():
    message = (
        r"stimuli: block 'words': timeline: responses are taken from 1000 ms after the onset of stimulus 'go', but "
        r"only until 1000 ms after it; raise response_deadline_ms or lower opens_ms$"
    )
    with pytest.raises(ProtocolError, match=message):
        check(FIXATION, GO, more="timeline.opens_ms = 1000")


def test_a_trial_that_nothing_ends_is_refused_with_its_row():
    timeline = 'timeline.stimuli = [{ name = "go", text = "{mask}", onset_ms = 400, until = "response" }]'
    protocol = decode(timeline, ROWS)
    [block] = protocol.blocks
    protocol = msgspec.structs.replace(protocol, blocks=(msgspec.structs.replace(block, response_deadline_ms=0.0),))
    with pytest.raises(ProtocolError, match=r"rows\[0\]: block 'words': timeline: nothing ends.*of stimulus 'go'"):
        check_stimuli(protocol, "p.toml")


def test_check_and_methods_say_what_a_trial_shows_and_lets_hear():
    stimuli = [
        '{ name = "tone", sound = "tone", hz = "{hz}", ear = "left", onset_ms = 0, duration_ms = 50 }',
        '{ name = "word", sound = "{word}", level_db = -6, ear = "{side}", onset_ms = 200, until = "end" }',
        '{ name = "buzz", sound = "noise", duration_ms = 90, feedback = "failure" }',
    ]
    rows = 'stimuli.rows = [{ hz = 500, word = "tone.wav", side = "left", correct = "left" }]'
    more = 'feedback = { failure = "No" }\nfeedback_ms = 500'
    lines = [
        line.strip() for line in describe_plan(plan_of(f"timeline.stimuli = [{', '.join(stimuli)}]\n{more}", rows))
    ]
    trial = [line.removeprefix("trial").strip() for line in lines if line.startswith("trial ")]
    shown, feedback, responses = trial
    tone, word = shown.split(" on for 50 ms, ")
    assert tone.endswith("'tone' (a tone of the frequency in column 'hz' at -20 dB for the left ear) from 0 ms")
    assert word.startswith("'word' (the sound in column 'word' at -6 dB for the ear in column 'side') from 200 ms on")
    assert feedback == "white noise at -20 dB began with the feedback after the outcome 'failure'"
    assert responses == "response times count from the onset of 'word'; responses were taken after it, at most 1000 ms"
