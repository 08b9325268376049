"""Draw the tasks of a first study, a text file for each reader: first_study.py OUT [SEED]."""

import random
import sys
from pathlib import Path

from minihuman.worlds.catalogue import WORLDS

READERS = 3
EPISODES = (2, 3, 4, 6)
PARTICIPANTS = (12, 16, 24, 40)
CONSENTS = (
    "I am 18 or older, I have read the information sheet, and I agree to take part.",
    "You will find your way through three places. It takes fifteen minutes. You may stop at any time.",
    "This study is about orientation. We store your key presses and answers under a code, never your name.",
)
QUESTIONS = (
    ("I often lost my way.", "not at all", "all the time"),
    ("I remembered where I had been.", "never", "always"),
    ("The keys were easy to use.", "disagree", "agree"),
    ("I was bored.", "not at all", "very much"),
    ("How sure were you of your direction?", "unsure", "certain"),
    ("How demanding was the task?", "very low", "very high"),
)
TASK = """You are a researcher. You have never seen this program, which is installed: the command is `minihuman`. You
have its README.md and its site as text (site/index.txt is the home page), an empty folder, a shell and a text editor.
Write no Python. Note the time, then make this study, until you have the participants' links in hand; note it again.

- Three worlds, {first}, {second} and {third}, {episodes} episodes each.
- Two groups: one plays the worlds in this order, the other in the opposite one.
- Participants first agree to this text: "{consent}"
- After the last world, a questionnaire: "{scale}" on seven points from "{scale_low}" to "{scale_high}", and "{slider}"
  with a slider from "{slider_low}" to "{slider_high}".
- {participants} participants, each with a link to a page in a browser of this machine.

`minihuman check` has to accept the study. Report: the time from the first page that you opened to the links, every page
opened, every command and edit in order, what you typed, each error and how you found the way out, and the three
sentences or steps that cost you most.
"""


def draw_task(rng: random.Random) -> str:
    """A task: two worlds of the grid and one in first person, in any order, and all else that differs."""
    grid = [world.id for world in WORLDS if "MiniGrid" in world.id or "BabyAI" in world.id]
    worlds = [*rng.sample(grid, 2), rng.choice([world.id for world in WORLDS if "MiniWorld" in world.id])]
    rng.shuffle(worlds)
    (scale, scale_low, scale_high), (slider, slider_low, slider_high) = rng.sample(QUESTIONS, 2)
    return TASK.format(
        first=worlds[0],
        second=worlds[1],
        third=worlds[2],
        episodes=rng.choice(EPISODES),
        participants=rng.choice(PARTICIPANTS),
        consent=rng.choice(CONSENTS),
        scale=scale,
        scale_low=scale_low,
        scale_high=scale_high,
        slider=slider,
        slider_low=slider_low,
        slider_high=slider_high,
    )


def main() -> None:
    """Write OUT/task-1.txt and so on."""
    out = Path(sys.argv[1])
    rng = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 20261126)
    out.mkdir(parents=True, exist_ok=True)
    for reader in range(1, READERS + 1):
        (out / f"task-{reader}.txt").write_text(draw_task(rng), encoding="utf-8")


if __name__ == "__main__":
    main()
