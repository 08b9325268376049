"""A person who goes through a whole study by what the screen shows: with keys, or with a finger on a phone.

The same plan is followed the same way at a site's page and at a served one, so that their records can be compared.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium

from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from tests.counts import PATIENCE_S

_LOOK = """(() => {
  const s = minihuman.state, shows = (selector) => document.querySelector(selector)?.getClientRects().length > 0;
  return {
    ...s, words: document.querySelector("#screen").innerText,
    has_field: shows("[data-target=field]"), has_slider: shows("[data-target=slider]"), has_options: shows(".option"),
    caps: [...document.querySelectorAll(".keyboard .cap span")].map((cap) => cap.innerText.toLowerCase()),
  };
})()"""
_PASSING = "One moment, please."  # until the page has a screen that it was told of
_SEE = """new Promise((resolve) => {
  requestAnimationFrame(() => requestAnimationFrame(() => resolve(true)));
  setTimeout(() => resolve(false), 2000);
})"""


def list_path_keys(episode: EpisodePlan) -> list[str]:
    """Return the keys of the shortest path of an episode, from its first picture to the goal."""
    env = gymnasium.make(episode.world, **episode.options).unwrapped
    env.reset(seed=episode.seed)
    names = {action: key for key, action in episode.key_map.keys.items()}
    keys = [names[env.action_names[int(action)]] for action in env.shortest_path()]
    env.close()
    return keys


class Hands:
    """Keys of a keyboard in Chromium; the other browsers' hands have the same methods."""

    def __init__(self, page: Any) -> None:
        self._page = page

    def find(self, expression: str) -> Any:
        """Return what an expression comes to in the page."""
        return self._page.evaluate(expression)

    def take_focus(self) -> None:
        """Give the page the focus, as a window that is opened has it."""

    def press(self, *keys: str) -> None:
        """Press keys, by the names that a log has."""
        for key in keys:
            self._page.keyboard.press({"enter": "Enter"}.get(key, key))

    def choose(self, number: int) -> None:
        """Choose an option, counted from 1, and give it as the answer."""
        self.press(str(number), "enter")

    def type_answer(self, text: str) -> None:
        """Type a text, and give it as the answer."""
        self.press(*text, "enter")

    def go_on(self, _: Mapping[str, Any]) -> None:
        """Leave a text."""
        self.press("enter")


class FirefoxHands(Hands):
    """Keys of a keyboard in Firefox, which without a window of its own never says that it has the focus."""

    def find(self, expression: str) -> Any:
        return self._page.find(expression)

    def take_focus(self) -> None:
        notice = "document.querySelector('#screen').innerText.startsWith('Your keys do not')"
        self._page.until(f"s.welcomed && (document.hasFocus() || {notice})")
        if not self._page.find("document.hasFocus()"):
            self.press("enter")  # the page's notice that keys do not arrive goes with the first that does
            self._page.until(f"!{notice}")

    def press(self, *keys: str) -> None:
        self._page.press(*keys)


class Fingers(Hands):
    """A finger on a phone: buttons stand for keys; texts are typed on the phone's own keyboard."""

    def __init__(self, phone: Any, keyboard: Hands) -> None:
        super().__init__(phone)
        self._keyboard = keyboard

    def find(self, expression: str) -> Any:
        return self._page.find(expression)

    def press(self, *keys: str) -> None:
        for key in keys:
            self._page.tap(f"#touch [data-key='{key}']")

    def choose(self, number: int) -> None:
        self._page.tap(f"[data-target='option:{number - 1}']")
        self._page.tap("[data-target=go_on]")

    def type_answer(self, text: str) -> None:
        self._page.tap("[data-target=field]")
        self._keyboard.press(*text)
        self._page.tap("[data-target=go_on]")

    def go_on(self, look: Mapping[str, Any]) -> None:
        buttons = ["[data-target=go_on]", "#touch [data-key='enter']"]
        find_shown = f"{buttons}.find((name) => document.querySelector(name)?.getClientRects().length > 0)"
        until_s = time.monotonic() + PATIENCE_S
        while not (shown := self.find(find_shown)) and not self.find("minihuman.state.finished"):
            assert time.monotonic() < until_s, f"a finger has nothing to go on with: {look}"
            time.sleep(0.02)
        if shown:
            self._page.tap(shown)


class StudyWalk:
    """Goes through a session: shortest paths in the worlds, the second option, 34 in a field.

    Args:
        hands: what presses and taps.
        plan: the session's plan, by which the keys are known.
        before_act: called before each press or answer.
    """

    def __init__(self, hands: Hands, plan: SessionPlan, before_act: Callable[[], None] = lambda: None) -> None:
        self._hands = hands
        self._before_act = before_act
        self._paths = [list_path_keys(episode) for episode in plan.episodes]
        self.n_begun = 0  # episodes
        self._is_in_episode = False
        self.words: list[str] = []  # of each screen, in order

    def walk(self) -> None:
        """Go to the end."""
        self._hands.take_focus()
        look = self._wait_for({})
        while not look["finished"]:
            self.words.append(look["words"])
            if look["playing"]:
                self._play(look["step"])
            else:
                self._is_in_episode = False
                self._before_act()
                self._answer(look)
            look = self._wait_for(look)

    def come_back(self, hands: Hands) -> None:
        """Go on to the end in a page that was opened again."""
        self._hands = hands
        self._before_act = lambda: None
        self.walk()

    def _answer(self, look: Mapping[str, Any]) -> None:
        if look["has_field"]:
            self._hands.type_answer("34")
        elif look["has_options"]:
            self._hands.choose(2)
        elif look["caps"]:
            self._hands.press(*look["caps"])
        else:
            self._hands.go_on(look)

    def _play(self, from_step: int) -> None:
        self.n_begun += not self._is_in_episode
        self._is_in_episode = True
        for step, key in list(enumerate(self._paths[self.n_begun - 1]))[from_step:]:
            self._wait_until(lambda look, step=step: look["step"] == step and look["known"])
            self._before_act()
            self._hands.press(key)
        self._wait_until(lambda look: look["ended"] or not look["playing"])

    def _wait_for(self, before: Mapping[str, Any]) -> dict[str, Any]:
        """Return another screen than before, once it waits for an answer and is on the display."""

        def waits(look: dict[str, Any]) -> bool:
            if look["finished"]:
                return True
            in_play = look["playing"] and look["kind"] == "play" and not look["ended"]
            asks = not look["playing"] and look["kind"] not in ("", "play", "blank")
            asks &= look["words"] not in ("", _PASSING)
            is_other = any(look[name] != before.get(name) for name in ("words", "kind", "playing"))
            is_other &= not (look["caps"] and before.get("caps"))  # a keyboard whose keys are marked one by one
            return bool(look["welcomed"] and is_other and (in_play or asks))

        return self._wait_until(waits)

    def _wait_until(self, holds: Any) -> dict[str, Any]:
        until_s = time.monotonic() + PATIENCE_S
        while True:
            look = self._hands.find(_LOOK)
            if holds(look):
                if not look["finished"]:
                    self._hands.find(_SEE)
                return look
            assert time.monotonic() < until_s, look
            time.sleep(0.02)
