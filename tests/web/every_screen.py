"""A study that has every kind of screen, and somebody who goes through it, looking at each."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.web.browser import PATIENCE_MS, Somebody

CODE = "C1A2"
KINDS = (  # each is on some screen
    "Consent",
    "keyboard",
    "options",
    "points",
    "slider",
    "entry",
    "example",
    "cross",
    "play|",
    "mark",
    "End the session?",
    "steers agent",
    "steers person",
    "steers good",
    "film",
    "Show what",
    "pair",
    "code",
)
TOML = """
[study]
name = "screens"
version = "1"
seed = 3
consent = "May we?"
closing = "Thank you."
[keys]
pool = ["left", "right", "up"]
keyboard_check = true
[web]
image_size_px = [160, 160]
completion_codes = { complete = "C1A2" }
[allocation]
stratify_by = "about.hand"
[[groups]]
name = "some"
parts = ["about", "how", "walk", "teach", "rate", "correct", "compare"]
[[groups]]
name = "others"
parts = ["about", "how", "walk", "teach", "rate", "correct", "compare"]
[[pages]]
name = "how"
title = "How it works"
text = "Find the green square."
example = { world = "minihuman/MiniGrid-Empty-5x5-v0", marks = { agent = "this is you" } }
[[questions]]
name = "about"
title = "About you"
items = [
  { name = "hand", kind = "choice", ask = "Which hand?", options = ["left", "right"] },
  { name = "many", kind = "choices", ask = "Which of these?", options = ["this", "that"] },
  { name = "scale", kind = "likert", ask = "How much?", points = 5, low = "little", high = "much" },
  { name = "along", kind = "slider", ask = "How far?", maximum = 10, low = "near", high = "far" },
  { name = "number", kind = "number", ask = "How many?", minimum = 0, maximum = 9 },
  { name = "why", kind = "text", ask = "Why?" },
]
[[blocks]]
name = "walk"
max_steps = 3
episodes = 1
instructions = "Walk."
fixation_ms = 3000
final_frame_ms = 4000
feedback = "{outcome}"
show_outcome = true
WORLD
[[blocks]]
name = "teach"
kind = "takeover"
max_steps = 6
episodes = 1
instructions = "Take over."
final_frame_ms = 300
WORLD
agent = { policy = "optimal:0.3", step_ms = 3000 }
[[blocks]]
name = "rate"
kind = "rating"
max_steps = 4
episodes = 1
instructions = "J is good."
final_frame_ms = 300
WORLD
agent = { policy = "optimal:0.3", step_ms = 3000 }
[[activities]]
name = "correct"
kind = "correction"
settings = { source = "teach", episodes = 1, steps = 2 }
[[activities]]
name = "compare"
kind = "preferences"
settings = { source = "teach", pairs = 1, steps = 2, step_ms = 200 }
""".replace(
    "WORLD",
    """world = "minihuman/MiniGrid-Empty-16x16-v0"
actions = ["left", "right", "forward"]
key_map = "fixed"
fixed_keys = { left = "left", right = "right", up = "forward" }
show_keys = true""",
)
_ANSWERS = {"options": "1", "slider": "right", "entry": "4", "points": "2"}
_LOOKS = """() => {
  const words = (what) => document.querySelector(what)?.innerText ?? '';
  const forms = ['options', 'points', 'slider', 'entry', 'keyboard', 'example', 'mark', 'cross', 'code', 'framed'];
  const form = forms.filter((one) => document.querySelector(`.${one}`)).join(' ');
  const hand = document.querySelector('.steers .on')?.dataset.of;
  const steers = hand ? `steers ${hand}` : '';
  return [document.querySelector('main').className, form, `${steers} ${words('.steers')}`, words('h1'), words('.body')]
    .join('|');
}"""

_UNTIL_OTHERWISE = """(before) => new Promise((resolve) => {
  let looks = 20;
  const look = () => {
    const { kind, playing, ended, finished } = minihuman.state;
    if (before !== JSON.stringify([LOOKS(), kind, playing, ended, finished]) || --looks === 0) resolve();
    else setTimeout(look, 30);
  };
  look();
})""".replace("LOOKS", f"({_LOOKS})")

Look = Callable[[Any, str], None]  # the page, and what is on it in short


def every_screen(folder: Path, language: str = "en", *, needs_keyboard: bool = True) -> Path:
    """Write the study, with the interface in a language, or those parts of it that can be done without a keyboard."""
    toml = TOML.replace("[keys]", f'language = "{language}"\n[keys]', 1)
    if not needs_keyboard:
        toml = toml.partition('[[blocks]]\nname = "teach"')[0].replace(', "teach", "rate", "correct", "compare"', "")
        toml = toml.replace("[web]", "[web]\nrequire_keyboard = false")
    path = folder / "screens.toml"
    path.write_text(toml)
    return path


def go_through(somebody: Somebody, look: Look, *, correcting: str = "Show what") -> list[str]:
    """From the consent to the code, by the keyboard alone; the looks, each of which was looked at once.

    Args:
        somebody: at the study.
        look: looks at a screen.
        correcting: words that only the screen has on which a person shows what should have been done.
    """
    page, looked, paused = somebody.page, list[str](), False
    until_s = time.monotonic() + PATIENCE_MS / 1000
    somebody.until("s.welcomed && s.kind !== ''")
    while True:
        assert time.monotonic() < until_s, f"{somebody.state} {looked[-1]}"
        state, looks = somebody.state, page.evaluate(_LOOKS)
        if looks not in looked:
            looked.append(looks)
            look(page, looks)
            until_s = time.monotonic() + PATIENCE_MS / 1000  # for the next one
        if state["finished"]:
            return looked
        if looks.startswith("play") and state["playing"] and not paused:
            paused = True
            somebody.press("escape")  # a question whether they want to stop
        elif not _acts(somebody, state, looks, correcting, corrected=any(correcting in one for one in looked)):
            state_now = [state[name] for name in ("kind", "playing", "ended", "finished")]
            page.evaluate(_UNTIL_OTHERWISE, json.dumps([looks, *state_now], separators=(",", ":"), ensure_ascii=False))


def _acts(somebody: Somebody, state: dict[str, Any], looks: str, correcting: str, *, corrected: bool) -> bool:
    """Do what the screen asks for; False where it asks for nothing."""
    kind = state["kind"]
    match kind:
        case "text" if "keyboard" in looks:
            somebody.press("left", "right", "up")
        case "question":
            answer = next((key for form, key in _ANSWERS.items() if form in looks), "1")
            somebody.press(answer)
            somebody.page.wait_for_timeout(60)  # a key counts once what it answers was seen
            somebody.press("tab" if "entry" in looks else "enter")
            somebody.page.wait_for_timeout(60)
        case "page" | "text":
            somebody.press("enter")
            somebody.page.wait_for_timeout(60)
        case "play" if not state["playing"] or state["ended"]:
            return False
        case "play" if correcting in looks:  # a correction goes on until they end it
            somebody.press("left", "space")
            somebody.until("s.kind !== 'play'")
        case "play" if "steers" not in looks:
            somebody.press("left")
        case (
            "play"
        ):  # taken over, and handed back; or rated: well before the agent's next step, however long looking takes
            somebody.press(*["space"] if "steers person" in looks else ["left", "j"])
            somebody.page.wait_for_timeout(60)
        case "film":
            somebody.press(*["enter"] if corrected else ["period", "space"])
            somebody.until("s.kind !== 'film'")
        case "pair":
            somebody.press("f")
            somebody.page.wait_for_timeout(60)
    return True
