"""Draw the galleries of grid worlds and of levels: a picture of each, and their sections of play.md.

python docs/gallery_grid.py
"""

from pathlib import Path

import gymnasium
from gallery_section import replace_section
from PIL import Image

import minihuman  # noqa: F401  # registers the worlds
from minihuman.worlds import catalogue, catalogue as levels
from minihuman.worlds.catalogue import CatalogueEntry

SEED = 3
WIDTH_PX = 176  # of a picture at most, which a page shows three abreast
GRID = """Every grid world at seed 3, the agent's field of view lit, and the most that a block's `max_steps` may be. The
actions are `left`, `right`, `forward`, `pickup`, `drop`, `toggle` and `done`, in DynamicObstacles the first three.
Drawn by `python docs/gallery_grid.py`.
"""
LEVELS = """Every level at seed 3 with what it says, the agent's field of view lit, and the most that a block's
`max_steps` may be. The actions are `left`, `right`, `forward`, `pickup`, `drop`, `toggle` and `done`.
Drawn by `python docs/gallery_grid.py`.
"""


def write(folder: Path) -> None:
    """Write both sections into the folder's play.md, and the pictures that they show beside it."""
    write_section(folder, "gallery-grid", GRID, catalogue.GRID_WORLDS)
    write_section(folder, "gallery-levels", LEVELS, levels.BABYAI_WORLDS)


def write_section(folder: Path, name: str, head: str, entries: tuple[CatalogueEntry, ...]) -> None:
    """Write one section, and its pictures into a folder of its name."""
    pictures = folder / name
    pictures.mkdir(parents=True, exist_ok=True)
    lines = [head, "| | | |", "|---|---|---|"]
    cells = []
    for entry in entries:
        env = gymnasium.make(entry.id)
        longest = f"at most {env.unwrapped.max_steps} steps"  # before an instruction with several clauses adds to it
        env.reset(seed=SEED)
        image = Image.fromarray(env.unwrapped.picture(view="full", size_px=(WIDTH_PX, WIDTH_PX)))
        image.quantize(64).save(pictures / f"{entry.name}.png", optimize=True)
        mission = env.unwrapped.mission or "no mission"
        cells.append(f"![{entry.summary}]({name}/{entry.name}.png)<br>**{entry.name}**<br>{mission}<br>{longest}")
    for start in range(0, len(cells), 3):
        lines.append("| " + " | ".join(cells[start : start + 3]) + " |")
    replace_section(folder / "play.md", name, lines)


if __name__ == "__main__":
    write(Path(__file__).parent)
