"""Gamepads and clicks: what axes, buttons and spots do to an action, and that a log proves it."""

import json
from pathlib import Path

import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.display.typefaces import select_typefaces
from minihuman.errors import ProtocolError
from minihuman.experiment.keys import PAD_AXES, PAD_BUTTONS, PadAxes
from minihuman.experiment.machine.events import Noted, PointerUsed, Stepped
from minihuman.experiment.machine.inputs import AxisChanged, PointerPressed, PointerReleased, Tick
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import needs_gamepad
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.experiment.words import InterfaceWords
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, Desk, corridor_plan
from tests.study.studies import CORRIDOR, protocol
from tests.study.test_held_keys import levers_plan, play_script

AXES = "axes = { pad_left_x = { component = 0, scale = 0.5 }, pad_left_y = { component = 1, scale = -1.0 } }"
SPOT = 'spot = { x = 1, y = 2, action = "choice_0_2" }'


def verified(data: Path) -> list[str]:
    [log] = data.rglob("*.mcap")
    return [text for text, ok in verify_session(log) if not ok]


def test_axes_move_the_action_with_the_keys_that_are_held(tmp_path):
    script = [
        (0, "pad_left_x", 1.0),
        (150, "pad_left_y", -0.5),
        (250, "left", True),
        (350, "pad_left_x", 0.0),
        (450, "left", False),
        (460, "pad_left_y", 0.0),
    ]
    episode = play_script(levers_plan(max_steps=6, more=AXES), script, tmp_path)
    # half as sensitive to the right; upwards is inverted, towards the end at 2
    assert episode.actions_taken == [(0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (-0.5, 1.0), (-1.0, 1.0), (0.0, 0.0)]
    assert list(episode.step_keys) == ["", "", "", "left", "left", ""]
    assert verified(tmp_path) == []
    with StudyStore(StudySessions(tmp_path / "levers"), with_shortest=False) as store:
        rows = store.tables.table("other_inputs").to_pylist()
    assert [(row["what"], row["target"], row["along"]) for row in rows][:2] == [
        ("axis", "pad_left_x", 1.0),
        ("axis", "pad_left_y", -0.5),
    ]


MOUSE = "axes = { mouse_x = { component = 0, scale = -0.01 }, mouse_y = { component = 1, scale = 0.02 } }"


def test_the_motion_of_the_mouse_adds_up_from_tick_to_tick(tmp_path):
    script = [
        (15, "mouse_x", 20.0),
        (20, "mouse_x", 15.0),
        (110, "mouse_x", -400.0),  # further than a whole step: what is beyond is gone
        (210, "mouse_y", 12.0),
        (220, "mouse_y", -2.0),
        (250, "left", True),
        (260, "mouse_x", -30.0),
        (350, "left", False),
    ]
    episode = play_script(levers_plan(max_steps=6, more=MOUSE), script, tmp_path)
    assert episode.actions_taken == [
        (0.0, 0.0),
        (pytest.approx(-0.35), 0.0),
        (1.0, 0.0),
        (pytest.approx(0.3 - 1.0), pytest.approx(0.4)),  # with the key that is held
        (0.0, 0.0),  # a mouse that rests moves nothing
        (0.0, 0.0),
    ]
    assert verified(tmp_path) == []


def test_the_motion_of_the_mouse_before_an_episode_and_in_a_pause_is_none_of_it():
    desk = Desk(levers_plan(max_steps=6, more=MOUSE))
    desk.give(AxisChanged(desk.now_ns, "mouse_x", 50.0))
    desk.press("enter")
    desk.show()
    assert desk.session.screen.axes == ("mouse_x", "mouse_y")
    desk.give(AxisChanged(desk.now_ns, "mouse_x", 50.0))
    desk.press("f8")
    assert not hasattr(desk.session.screen, "axes"), "a pause gives the mouse back"
    desk.press("enter")
    desk.show()
    desk.now_ns += 150 * MS
    desk.give(Tick(desk.now_ns))
    assert [step.action_vector for step in desk.of(Stepped)] == [(0.0, 0.0)]


def board_plan(pace):
    plan = levers_plan("board", max_steps=4, hold="once", more=SPOT)
    if pace == "real_time":
        return plan
    toml = plan.protocol_toml.decode()
    for line in ('pace = "real_time"', "step_period_ms = 100.0", 'noop_action = "rest"', 'hold = "once"'):
        assert line in toml
        toml = toml.replace(line, "")
    study = decode_protocol(toml.encode())
    return expand_protocol(study, enrol_participant(study, 0))


def test_a_click_that_had_to_wait_for_a_picture_keeps_its_own_time_in_log_and_replay():
    desk = Desk(board_plan("on_key"))
    desk.press("enter")
    desk.show()
    clicked_ns = desk.now_ns + 30 * MS
    desk.now_ns = clicked_ns
    desk.give(PointerPressed(clicked_ns, 0.0, 0.0, "picture"))
    desk.now_ns += 90 * MS  # the next picture takes that long
    desk.show()
    desk.give(PointerPressed(clicked_ns + 40 * MS, 0.5, 0.5, "picture"))
    used = [event.t_ns - event.waited_ns for event in desk.of(PointerUsed)]
    assert used == [clicked_ns, clicked_ns + 40 * MS]
    assert [step.key_t_ns for step in desk.of(Stepped)] == used
    assert list(compare_replay(desk.events, World)) == []


def test_a_click_of_a_browser_that_came_late_while_a_world_is_made_replays():
    desk = Desk(corridor_plan(instruction="Walk."))
    for kind in (PointerPressed, PointerReleased):
        desk.now_ns += 20 * MS
        late = kind(desk.now_ns - 5 * MS, 0.5, 0.5, "go_on")
        desk.recorder.write(desk.session.receive(late, at_ns=desk.now_ns))
    desk.press("enter")
    desk.show()
    assert [event.text for event in desk.of(Noted) if event.kind == "phase"][-2:] == ["ready", "playing"]
    assert list(compare_replay(desk.events, World)) == []


@pytest.mark.parametrize("pace", ["on_key", "real_time"])
def test_a_click_is_an_action_with_its_place(pace, tmp_path):
    clicks = [(5, "picture", (0.0, 0.999)), (50, "picture", (0.5, 0.25)), (150, "", (0.5, 0.5))]
    plan = board_plan(pace)
    episode = play_script(plan, clicks, tmp_path)
    assert episode.actions_taken[:2] == [(2.0, 0.0, 63.0), (2.0, 32.0, 16.0)]
    assert list(episode.step_keys)[:2] == ["pointer", "pointer"]
    assert (2.0, 32.0, 32.0) not in episode.actions_taken, "a click beside the picture is none"
    assert episode.rt_ms[0] >= 0
    assert verified(tmp_path) == []


@pytest.mark.parametrize(
    ("kind", "more", "said"),
    [
        ("chords", SPOT, r"spot.*has Discrete.*bind keys"),
        ("board", SPOT.replace("y = 2", "y = 3"), r"component 3 does not exist"),
        ("board", SPOT.replace("0_2", "0_7"), r"no action 'choice_0_7'"),
    ],
)
def test_a_click_that_cannot_act_is_named_by_check(kind, more, said):
    plan = levers_plan(kind, hold="once", more=more)
    with pytest.raises(ProtocolError, match=said):
        check_worlds(decode_protocol(plan.protocol_toml))


@pytest.mark.parametrize(
    ("hold", "more", "said"),
    [
        ("once", AXES, "axes .*are read at each tick; use pace"),
        ("repeat", SPOT, "held keys combine; use hold = 'once'"),
        (
            "repeat",
            "axes = { mouse_x = { component = 0 } }",
            "mouse_x with the scale 1.0, at most 0.25: it is the share",
        ),
        ("repeat", "axes = { pad_lft_x = { component = 0 } }", "'pad_lft_x', which is no axis; axes: pad_left_x"),
    ],
)
def test_a_binding_that_does_nothing_is_refused(hold, more, said):
    with pytest.raises(ProtocolError, match=said):
        levers_plan(hold=hold, more=more)


def test_key_maps_are_drawn_over_the_buttons_of_a_gamepad():
    rest = '[[groups]]\nname = "all"\nparts = ["corridor"]\n' + CORRIDOR
    pads = '["pad_south", "pad_east", "pad_west", "pad_north", "pad_up", "stick_left"]'
    toml = protocol(rest).toml.decode().replace('["1", "2", "3", "4", "5", "6"]', pads)
    study = decode_protocol(toml.encode())
    plans = [expand_protocol(study, enrol_participant(study, index)) for index in range(6)]
    assert all(set(plan.episodes[0].key_map.keys) <= set(json.loads(pads)) for plan in plans)
    assert {plan.episodes[0].key_map.keys.get("pad_south") for plan in plans} >= {"back", "forward", "dive", "crash"}
    assert needs_gamepad(plans[0])
    assert not needs_gamepad(expand_protocol(protocol(rest), enrol_participant(protocol(rest), 0)))


def test_every_button_of_a_gamepad_has_a_label_that_can_be_drawn():
    labels = [cap for _, cap, _ in InterfaceWords("he").labels(PAD_BUTTONS)]
    assert len({*labels}) == len(labels)
    assert select_typefaces("he").missing("".join(labels)) == ""


def test_an_axis_rests_in_its_dead_zone_and_is_logged_in_steps():
    axes = PadAxes()
    assert axes.move("pad_left_x", 0.09) == (None, [])
    assert axes.move("pad_left_x", 0.55) == (0.5, [])
    assert axes.move("pad_left_x", 0.5501) == (None, [])
    assert axes.move("pad_left_x", 1.0) == (1.0, [("stick_right", True)])
    assert axes.move("pad_left_x", 0.5) == (0.4453125, []), "it does not flutter around the middle"
    assert axes.move("pad_left_x", -1.0) == (-1.0, [("stick_left", True), ("stick_right", False)])
    assert axes.move("pad_left_trigger", 1.0)[1] == [("pad_left_trigger", True)]
    assert {*PAD_AXES} & {*PAD_BUTTONS} == {"pad_left_trigger", "pad_right_trigger"}
