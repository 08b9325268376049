"""Draws the first-person section of docs/play.md: each world as the agent sees it and from above.

python docs/gallery_first_person.py [FOLDER]
"""

import sys
from pathlib import Path

import gymnasium
from gallery_section import replace_section
from PIL import Image

from minihuman.worlds.catalogue import FIRST_PERSON_WORLDS
from minihuman.worlds.first_person.env import FirstPersonEnv

SEEDS = range(40)  # the first of those that show most is drawn
SIZE_PX = (320, 240)


def draw_gallery(folder: Path, *, limit: int | None = None) -> list[Path]:
    """Write the section into the folder's play.md, and its pictures beside it; return the files written.

    ``limit`` draws only the first worlds of the catalogue.
    """
    pictures = folder / "gallery-first-person"
    pictures.mkdir(parents=True, exist_ok=True)
    lines = [
        "Each world at the start of an episode: what the agent sees, and the plan with the agent in red.",
        "Drawn by `python docs/gallery_first_person.py`.",
        "",
        "A block of a protocol names `actions` out of the third column; its `max_steps` is no more than the fourth.",
        "",
        "| world | what one does in it | actions | longest episode | seen by the agent | from above |",
        "|---|---|---|---|---|---|",
    ]
    written = []
    for entry in FIRST_PERSON_WORLDS[:limit]:
        world = gymnasium.make(entry.id).unwrapped
        world.reset(seed=_showing_most(world))
        cells = []
        for view in ("partial", "full"):
            file = pictures / f"{entry.name}-{view}.png"
            image = Image.fromarray(world.picture(view=view, size_px=SIZE_PX))
            image.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(file, optimize=True)
            written.append(file)
            cells.append(f"![{entry.name}, {view}]({pictures.name}/{file.name})")
        world.close()
        actions = ", ".join(f"`{name}`" for name in world.action_names)
        longest = f"{world.max_steps} steps" if world.max_steps else "no limit"
        lines.append(f"| `{entry.id}` | {entry.summary} | {actions} | {longest} | {cells[0]} | {cells[1]} |")
    page = folder / "play.md"
    replace_section(page, "gallery-first-person", lines)
    return [page, *written]


def _showing_most(world: FirstPersonEnv) -> int:
    """The seed whose first view has the most things in it, and of those the one with the most contrast."""

    def shown(seed: int) -> tuple[int, float]:
        world.reset(seed=seed)
        return len(world.visible_entities()), float(world.picture(size_px=(80, 60)).std())

    return max(SEEDS, key=shown)


if __name__ == "__main__":
    import minihuman  # noqa: F401  registers the worlds

    for path in draw_gallery(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)):
        print(path)
