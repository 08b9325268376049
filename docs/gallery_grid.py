"""Draw the gallery of grid worlds: a picture of each, and the page that shows them.

python docs/gallery_grid.py
"""

from pathlib import Path

import gymnasium
from PIL import Image

import minihuman  # noqa: F401  # registers the worlds
from minihuman.worlds.grid.catalogue import ENTRIES

SEED = 3
WIDTH_PX = 176  # of a picture at most, which a page shows three abreast
HEAD = """# Grid worlds: the gallery

Every grid world at seed 3, the agent's field of view lit. Drawn by `python docs/gallery_grid.py`.
"""


def write(folder: Path) -> None:
    """Write ``gallery-grid.md`` and the pictures it shows into a folder."""
    pictures = folder / "gallery-grid"
    pictures.mkdir(parents=True, exist_ok=True)
    lines = [HEAD, "| | | |", "|---|---|---|"]
    cells = []
    for entry in ENTRIES:
        env = gymnasium.make(entry.id)
        env.reset(seed=SEED)
        image = Image.fromarray(env.unwrapped.picture(view="full", size_px=(WIDTH_PX, WIDTH_PX)))
        image.quantize(64).save(pictures / f"{entry.name}.png", optimize=True)
        mission = env.unwrapped.mission or "no mission"
        cells.append(f"![{entry.summary}](gallery-grid/{entry.name}.png)<br>**{entry.name}**<br>{mission}")
    for start in range(0, len(cells), 3):
        lines.append("| " + " | ".join(cells[start : start + 3]) + " |")
    (folder / "gallery-grid.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(__file__).parent)
