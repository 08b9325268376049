"""Small studies for the page."""

from pathlib import Path

GRID = "minihuman/MiniGrid-FourRooms-v0", ("left", "right", "forward")
FIRST_PERSON = "minihuman/MiniWorld-FourRooms-v0", ("turn_left", "turn_right", "move_forward")


def study(
    folder: Path,
    world: tuple[str, tuple[str, ...]] = GRID,
    *,
    episodes: int = 2,
    max_steps: int = 20,
    more: str = "",
    block: str = "",
    web: str = "image_size_px = [400, 300]",
) -> Path:
    """Write a protocol of one block; its keys are 1, 2 and 3, whatever they do."""
    path = folder / "tried.toml"
    path.write_text(
        f"""
{more}
[study]
name = "tried"
version = "1.0"
seed = 7
participants = 500

[keys]
pool = ["1", "2", "3"]
keyboard_check = false

[web]
{web}

[[groups]]
name = "everyone"
blocks = ["tried"]

[[blocks]]
name = "tried"
world = "{world[0]}"
episodes = {episodes}
actions = {list(world[1])}
max_steps = {max_steps}
feedback = "{{outcome}}"
{block}
"""
    )
    return path


def asking(folder: Path, *kinds: str, web: str = "") -> Path:
    """Write a protocol of one question of each kind."""
    items = "".join(f'[[questions.items]]\nname = "{kind}"\nkind = "{kind}"\nask = "{kind}?"\n' for kind in kinds)
    path = folder / "asked.toml"
    path.write_text(
        '[study]\nname = "asked"\nversion = "1.0"\nseed = 7\nparticipants = 50\n'
        f'[web]\n{web}\n[[groups]]\nname = "everyone"\nparts = ["asked"]\n[[questions]]\nname = "asked"\n{items}'
    )
    return path
