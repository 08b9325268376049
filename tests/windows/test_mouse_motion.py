"""A quick mouse: its motion is handed on some 60 times a second, no pixel is lost, and a step has all of its own."""

from minihuman.display.windows.mouse_motion import PERIOD_NS, MouseMotion
from minihuman.experiment.machine.inputs import AxisChanged, Input

MS = 1_000_000


def _turn_at_a_thousand_hertz(motion: MouseMotion, lasts_ms: int) -> list[Input]:
    """Two pixels to the right and one up in each millisecond, and the window's wait after each."""
    heard: list[Input] = []
    for ms in range(lasts_ms):
        heard += motion.add({"mouse_x": 2, "mouse_y": -1}, ms * MS)
        heard += motion.report(ms * MS + MS // 2)
    return heard


def test_a_mouse_of_a_thousand_motions_a_second_is_heard_some_sixty_times() -> None:
    motion = MouseMotion()
    heard = [moved for moved in _turn_at_a_thousand_hertz(motion, 1000) if isinstance(moved, AxisChanged)]
    for axis, pixels in (("mouse_x", 2), ("mouse_y", -1)):
        own = [moved for moved in heard if moved.axis == axis]
        assert 60 <= len(own) <= 1 + 1000 * MS // PERIOD_NS
        assert sum(moved.value for moved in own) == pixels * (own[-1].t_ns // MS + 1), "all up to the latest motion"
        assert {moved.t_ns % MS for moved in own} == {0}, "each has the time of a motion"


def test_the_first_motion_is_heard_at_once_and_the_rest_when_it_is_due() -> None:
    motion = MouseMotion()
    assert motion.add({"mouse_x": 3}, 0) == [AxisChanged(0, "mouse_x", 3.0)]
    assert motion.due_ns is None
    assert motion.add({"mouse_x": 4}, 2 * MS) == []
    assert motion.due_ns == PERIOD_NS
    assert motion.report(PERIOD_NS) == [AxisChanged(2 * MS, "mouse_x", 4.0)]
    assert motion.report(9 * PERIOD_NS) == []


def test_a_step_has_the_motion_that_waits() -> None:
    motion = MouseMotion()
    motion.add({"mouse_x": 3}, 0)
    motion.add({"mouse_x": 4}, 2 * MS)
    assert motion.report(3 * MS, is_needed=True) == [AxisChanged(2 * MS, "mouse_x", 4.0)]


def test_motion_that_waits_goes_with_its_screen() -> None:
    motion = MouseMotion()
    motion.add({"mouse_x": 3}, 0)
    motion.add({"mouse_x": 4}, 2 * MS)
    motion.forget()
    assert motion.report(9 * PERIOD_NS, is_needed=True) == []
