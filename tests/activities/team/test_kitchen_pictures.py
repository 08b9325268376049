"""What two people see of a kitchen in their pages, which are sent each tile of it once, is what the server draws."""

import time
from pathlib import Path

import numpy as np
import pytest

from minihuman.activities.team.events import JointStepped, TeamFormed
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.agents.team_agents import KitchenView
from minihuman.experiment.machine.events import FrameShown
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.kitchen import Kitchen
from tests.activities.team.study import PEOPLE, team_study
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving
from tests.web.test_computed import picture_of

pytestmark = needs("chromium")

KITCHEN, SIZE_PX = "minihuman/Team-CrampedRoom-v0", (400, 300)
KEYS = {"up": "1", "down": "2", "left": "3", "right": "4", "interact": "5"}
RELOADS = {7: 0, 15: 1}  # who loads their page again, before which step


def until_shown(somebody: Somebody, right: np.ndarray) -> None:
    """Wait until a page shows a picture, to the pixel."""
    by_s = time.monotonic() + PATIENCE_S
    while not somebody.page.locator("#screen canvas").count() or not np.array_equal(picture_of(somebody), right):
        assert time.monotonic() < by_s, (somebody.state, somebody.errors)
        somebody.page.wait_for_timeout(10)


@pytest.mark.nightly
@pytest.mark.program
def test_both_pages_show_the_kitchen_to_the_pixel_also_after_they_were_loaded_again(tmp_path: Path) -> None:
    steps = count(16, 200)
    fixed = ", ".join(f'{key} = "{action}"' for action, key in KEYS.items())
    path = team_study(
        tmp_path,
        team=f"{PEOPLE}\npartner_wait_s = 3600.0",
        world=KITCHEN,
        episodes=1,
        max_steps=steps,
        block=f'key_map = "fixed"\nfixed_keys = {{ {fixed} }}',
    )
    text = path.read_text(encoding="utf-8").replace("[200, 150]", str([*SIZE_PX]))
    text = text.replace('pool = ["1", "2", "3"]', f"pool = {[*KEYS.values()]}")
    path.write_text(text.replace('"left", "right", "stay"', ", ".join(f'"{action}"' for action in KEYS)))
    kitchen, ahead = Kitchen(), Kitchen()  # of Cramped Room
    kitchen.reset(0)  # a kitchen draws nothing from its seed
    ahead.reset(0)
    seen, joints = set[bytes](), list[tuple[int, ...]]()
    with serving(path, tmp_path, links=2) as server, browsing() as sit_down:
        people = [sit_down(f"http://127.0.0.1:{server.port}/#t={token}") for token in server.tokens]
        by_s = time.monotonic() + PATIENCE_S
        while not all(somebody.state["playing"] and somebody.state["known"] for somebody in people):
            assert time.monotonic() < by_s, [somebody.screen() for somebody in people]
            for somebody in people:
                if somebody.state["kind"] not in ("", "play"):
                    somebody.press("enter")
            people[0].page.wait_for_timeout(60)
        until_either = time.monotonic() + PATIENCE_S
        while not (first := [seat for seat in (0, 1) if is_view_of(people[0], kitchen.frame(seat, *SIZE_PX))]):
            assert time.monotonic() < until_either
        seats = [*first, 1 - first[0]]
        for step in range(steps):
            if step in RELOADS:
                people[RELOADS[step]].page.reload()
            for somebody, seat in zip(people, seats, strict=True):
                until_shown(somebody, kitchen.frame(seat, *SIZE_PX))
                seen.add(kitchen.frame(seat, *SIZE_PX).tobytes())
            joint = tuple(choose_action(kitchen, seat) for seat in (0, 1))
            for somebody, seat in zip(people, seats, strict=True):
                somebody.press(KEYS[kitchen.action_names[joint[seat]]])
                if somebody is people[0]:  # who sees at once what their key does, with the other idle
                    ahead.restore(kitchen.save())
                    ahead.step([joint[each] if each == seat else ahead.idle_action for each in (0, 1)])
                    until_shown(somebody, ahead.frame(seat, *SIZE_PX))
            kitchen.step(joint)
            joints.append(joint)
        for somebody in people:
            somebody.to_end()
        assert [somebody.errors for somebody in people] == [[], []]
        server.stop()
    assert len(seen) > steps
    logs = {}
    for path in tmp_path.rglob("*.mcap"):
        events = list(read_events(path))
        [seat] = {event.seat for event in events if isinstance(event, TeamFormed)}
        logs[seat] = events
        assert list(find_log_differences(path, World)) == []
        assert [event.actions for event in events if isinstance(event, JointStepped)] == joints
        assert {event.step for event in events if isinstance(event, FrameShown)} >= set(range(steps))
    assert sorted(logs) == [0, 1]
    assert [good for _, good in verify_teams(tmp_path / "duet")] == [True]


def is_view_of(somebody: Somebody, right: np.ndarray) -> bool:
    return bool(somebody.page.locator("#screen canvas").count()) and np.array_equal(picture_of(somebody), right)


def choose_action(kitchen: Kitchen, seat: int) -> int:
    """What the scripted cook does next; one that would stay tries their hands instead, as no key stays."""
    action, _ = KitchenView(kitchen, seat).choose()
    return action if kitchen.action_names[action] in KEYS else kitchen.action_names.index("interact")
