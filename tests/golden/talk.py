"""A frozen study whose people write to each other: letter by letter, as sessions edited messages once."""

from pathlib import Path

from minihuman.experiment.machine.inputs import TextInput
from tests.activities.team.machines import Seat, sit_down
from tests.activities.team.study import FOUR_ROOMS, PEOPLE, team_study
from tests.activities.team.test_return import step
from tests.golden.typed import OLD_FACTS

_FACTS = {"player": "human", "platform": "golden", **OLD_FACTS, "text_rules": "2", "presence_rules": "2"}


def make_chat(data: Path) -> None:
    """Write two messages, one with a correction, while another waits in its line; mark a cell and report words."""
    path = team_study(
        data,
        name="chat",
        team=f'{PEOPLE}\nchat = true\nping = "m"',
        world=FOUR_ROOMS,
        episodes=1,
        max_steps=3,
        block='view = "full"',
    )
    seats, _, _ = sit_down(path, data, facts=_FACTS)
    path.unlink()
    seats[0].to_play(seats[1])
    for seat in seats:
        if seat.part._messages.draft is not None:  # an Enter that came with the episode's start
            seat.press("enter")
    first, second = sorted(seats, key=lambda seat: seat.part.formed.seat if seat.part.formed else 0)
    first.press("enter")
    first.take(TextInput(first._now_ns, " onions frst\u00a0"))
    first.press("left", "left", "left")
    first.take(TextInput(first._now_ns, "i"))
    first.press("1", "enter")
    second.wait(2100)
    second.press("f2", "m", "enter")
    second.take(TextInput(second._now_ns, "fine"))
    second.press("enter")
    second.wait(2100)
    second.press("enter")
    first.wait(2100)
    _play_to_end(first, second)


def _play_to_end(*seats: Seat) -> None:
    for _ in range(3):
        step(*seats, action="left")
    for seat in seats:
        seat.wait(600)
        seat.press("enter", "enter", "enter")
        seat.save()
