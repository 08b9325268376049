"""Small studies of teams, as protocol files."""

from pathlib import Path

TOML = """
[study]
name = "{name}"
version = "1"
seed = 7
participants = {participants}
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[web]
image_size_px = [200, 150]
reconnect_timeout_s = 86_400
idle_timeout_s = 0
[[groups]]
name = "all"
blocks = [{names}]
"""
BLOCK = """
[[blocks]]
name = "{name}"
kind = "team"
world = "{world}"
episodes = {episodes}
actions = [{actions}]
max_steps = {max_steps}
final_frame_ms = 0
{block}
[blocks.team]
{team}
"""
DUET, FOUR_ROOMS = "tests.worlds.duet:Duet-v0", "minihuman/Team-FourRooms-v0"
PEOPLE = 'seats = ["person", "person"]\nstand_in = "scripted:random"\npartner_disclosure = "always"'
WITH_AGENT = 'seats = ["person", "scripted:random"]\npartner_disclosure = "always"'


def team_study(
    folder: Path,
    *,
    team: str = PEOPLE,
    name: str = "duet",
    world: str = DUET,
    episodes: int = 2,
    max_steps: int = 12,
    participants: int = 8,
    block: str = "",
    blocks: tuple[str, ...] = ("together",),
    days: int = 1,
    more: str = "",
) -> Path:
    """A protocol of team blocks, played on each of so many days, written into a folder."""
    actions = '"left", "right", "forward"' if world == FOUR_ROOMS else '"left", "right", "stay"'
    fields = {"world": world, "episodes": episodes, "actions": actions, "max_steps": max_steps}
    toml = TOML.format(name=name, participants=participants, names=", ".join(f'"{one}"' for one in blocks)) + more
    if days > 1:
        parts = ", ".join(f'"{one}"' for one in blocks)
        toml = toml.replace(f"blocks = [{parts}]\n", "")
        toml += "".join(f'[[sessions]]\nname = "day-{day + 1}"\nparts = [{parts}]\n' for day in range(days))
    toml += "".join(BLOCK.format(name=one, block=block, team=team, **fields) for one in blocks)
    path = folder / f"{name}.toml"
    path.write_text(toml, encoding="utf-8")
    return path
