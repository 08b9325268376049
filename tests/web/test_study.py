"""Both days of `protocols/two-days.toml` in the browser, in Chinese: by the keyboard alone, and with the mouse."""

import csv
import random
import re
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import chain
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered, PartEnded, PointerUsed
from minihuman.log.read.session_reader import read_log
from minihuman.web.eligibility import load_page_texts
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving

pytestmark = needs("chromium")

STUDY = Path(__file__).parents[2] / "protocols" / "two-days.toml"
RIGHT = {"您要走到哪里": "1", "每走一步会怎样": "2"}
PATIENCE_S = count(1_200, 5_400)


def study_in(folder: Path, *, shortened: bool = True) -> Path:
    """The study with its second day on the first; shortened to an episode a block, of a few steps."""
    text = STUDY.read_text().replace("days_after_previous = [1, 3]", "days_after_previous = [0, 3]")
    if shortened:
        text = re.sub(r"episodes = \d+", "episodes = 1", text)
        text = re.sub(r"max_steps = \d+", "max_steps = 5", text)
        text = re.sub(r"stop_criterion = .*\n", "", text)
    path = folder / "two-days.toml"
    path.write_text(text)
    return path


class Participant:
    """Reads, answers and plays.

    Args:
        somebody: in front of a page.
        mouse: whether what has a button or can be clicked is clicked.
    """

    def __init__(self, somebody: Somebody, *, mouse: bool = False) -> None:
        self.somebody, self.mouse = somebody, mouse
        self.seen: list[str] = []  # the words of each screen that was a new one
        self._rng = random.Random(1)

    def take_part(self, look: Callable[[str], None] = lambda _: None) -> None:
        """To the end; ``look`` is told the kind of each screen that is a new one."""
        somebody, until_s = self.somebody, time.monotonic() + PATIENCE_S
        somebody.until("s.finished || (s.welcomed && s.kind !== '')")
        while not somebody.state["finished"]:
            assert time.monotonic() < until_s, somebody.screen()
            kind, words = somebody.state["kind"], somebody.screen()
            if kind != "play" and words not in self.seen[-1:]:
                self.seen.append(words)
                look(kind)
            self._do(kind, words)
            waited = 0
            while kind in ("question", "page") and somebody.screen() == words and waited < 100:
                somebody.page.wait_for_timeout(20)
                waited += 1
            somebody.page.wait_for_timeout(20)

    def _do(self, kind: str, words: str) -> None:
        somebody, seen = self.somebody, self.somebody.page.locator
        match kind:
            case "play" if somebody.state["playing"] and not somebody.state["ended"]:
                somebody.press(self._rng.choice("123456"))
            case "text" if seen(".keyboard").count():
                somebody.press(*seen(".keyboard li .cap span").all_inner_texts())
            case "question":
                self._answer(words)
                somebody.until_seen()  # nobody answers without looking
                self._go_on()
            case "page":
                self._go_on()
            case "text":
                somebody.press("enter")

    def _answer(self, words: str) -> None:
        somebody, seen = self.somebody, self.somebody.page.locator
        right = next((key for ask, key in RIGHT.items() if ask in words), "1")
        if seen(".slider").count():
            if self.mouse:
                seen(".slider").click(position={"x": 40 + 20 * self._rng.random(), "y": 10})
            else:
                somebody.press("right", "right")
        elif seen(".entry").count():
            somebody.press("3", "0")
        elif self.mouse:
            seen(".option").nth(int(right) - 1).click()
        else:
            somebody.press(right)

    def _go_on(self) -> None:
        button = self.somebody.page.locator("[data-target=go_on]")
        if self.mouse and button.count():
            button.click()
        else:
            self.somebody.press("tab" if self.somebody.page.locator(".entry").count() else "enter")


def both_days(folder: Path, *, shortened: bool, mouse: tuple[bool, bool]) -> list[Path]:
    """Somebody takes part on both days, by the same link, with keys alone or the mouse too; the logs."""
    with serving(study_in(folder, shortened=shortened), folder) as served, browsing() as sit_down:
        address = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        first = Participant(sit_down(address), mouse=mouse[0])
        first.take_part()
        assert first.somebody.errors == []
        assert any("这是您" in screen and "这是目标" in screen for screen in first.seen), "the example's labels"
        assert first.somebody.page.evaluate("document.documentElement.lang") == "zh"
        assert "谢谢" in first.somebody.screen() or "感谢" in first.somebody.screen()
        served.stop()
        served.again()
        second = Participant(sit_down(address), mouse=mouse[1])
        second.take_part()
        assert second.somebody.errors == []
        assert "欢迎回来" in second.seen[0], "the second day begins with its own words"
        assert "谢谢" in second.somebody.screen() or "感谢" in second.somebody.screen()
    return sorted(folder.rglob("*.mcap"))


def check(paths: list[Path], *, episodes: tuple[int, int], mouse: tuple[bool, bool]) -> None:
    """Both logs hold all that was asked and played, and are proven."""
    assert [path.name for path in paths] == ["sub-01_ses-01.mcap", "sub-01_ses-02.mcap"]
    first, second = map(read_log, paths)
    for log, least, clicked in zip((first, second), episodes, mouse, strict=True):
        assert log.end_reason == "complete"
        assert "abandoned" not in [episode.outcome for episode in log.episodes]
        assert len(log.episodes) >= least
        assert sum(isinstance(event, PartEnded) for event in log.part_events) == len(log.plan.parts)
        assert any(isinstance(event, PointerUsed) for event in log.part_events) == clicked
    answered = [event for log in (first, second) for event in log.part_events if isinstance(event, Answered)]
    assert {event.item for event in answered} >= {"goal", "points"}
    assert sum(event.part_name == "load" for event in answered) == 12, "the six scales, on both days"
    assert all(event.shown_ns > 0 for event in answered), "when a question was seen is not known"
    maps = {tuple(sorted(episode.plan.key_map.keys.items())) for episode in chain(first.episodes, second.episodes)}
    assert len(maps) == 1, "the keys of the second day are those of the first"
    for path in paths:
        assert list(find_log_differences(path, World)) == []


def told(*words: str) -> str:
    """What the program prints; it must end well."""
    done = subprocess.run([sys.executable, "-m", "minihuman", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.nightly
@pytest.mark.program
def test_both_days_in_chinese_are_verified_reported_and_exported(tmp_path: Path) -> None:
    mouse = (False, True)
    paths = both_days(tmp_path, shortened=True, mouse=mouse)
    check(paths, episodes=(5, 4), mouse=mouse)
    study = tmp_path / "two-days"
    assert "as logged" in told("verify", *map(str, paths))
    told("report", str(study), "--out", str(tmp_path / "report"))
    assert (tmp_path / "report" / "report.html").exists()
    told("export", "csv", str(study), str(tmp_path / "csv"))
    with (tmp_path / "csv" / "participants.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["session"] for row in rows] == ["1", "2"]
    assert {row["window"] for row in rows} == {"web"}, "how they took part is a column"


EARLY = """
[study]
name = "early"
version = "1"
seed = 1
language = "zh"
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
[[sessions]]
name = "first"
parts = ["page"]
[[sessions]]
name = "second"
parts = ["page"]
days_after_previous = [1, 3]
[[pages]]
name = "page"
text = "您好"
"""


@pytest.mark.program
def test_the_second_day_is_refused_before_its_time_in_the_studys_language(tmp_path: Path) -> None:
    path = tmp_path / "early.toml"
    path.write_text(EARLY)
    with serving(path, tmp_path) as served, browsing() as sit_down:
        address = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        Participant(sit_down(address)).take_part()
        served.stop()
        served.again()
        early = sit_down(address)
        early.until("s.finished")
        assert early.screen().strip() == load_page_texts()["zh"]["not_today"]


@pytest.mark.nightly
@pytest.mark.program
def test_two_whole_days_with_nothing_left_out(tmp_path: Path) -> None:
    mouse = (True, False)
    check(both_days(tmp_path, shortened=False, mouse=mouse), episodes=(16, 16), mouse=mouse)
