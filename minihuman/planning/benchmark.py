"""The baseline set: levels of several families, with fresh seeds for each set, played by automatic players.

A set is an ordinary protocol: people, models and policies play it with the same commands, and `minihuman score` scores
them. Levels that a model may have seen in training are replaced by choosing another seed.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.tables import select
from minihuman.errors import LearnError, PlayerFailedError, SimulationError
from minihuman.log.paths import PART_SUFFIX
from minihuman.reporting.scorecard import Scorecard, build_scorecard
from minihuman.runtime.simulated_session import simulate

LEVELS_PER_FAMILY = 5
TURNS = ("left", "right", "forward")
HANDS = (*TURNS, "pickup", "drop", "toggle")
COOK = ("up", "down", "left", "right", "interact", "stay")


@dataclass(frozen=True, slots=True)
class Family:
    """A family of levels in one world, with the settings of its block."""

    name: str
    world: str
    actions: tuple[str, ...]
    max_steps: int
    instructions: str = "Do what the line above the picture says. You are the triangle."
    settings: str = ""  # further lines of its block


# the step limits are those that eight in ten simulated people keep (analysis/baseline_difficulty.py)
_LOOK = "You see the world from inside. Find the red box."
_SERVE = (
    "You are the cook with the white ring; your partner is in the other room. Cook a soup of three onions together and "
    "bring it to the serving hatch. Put what your partner needs on the counters between you."
)
_TEAM = """\
kind = "team"
view = "full"
options = { layout = "drawn", ends_at_soup = true }
team = { seats = ["person", "scripted:cook"], partner_disclosure = "always" }
"""
FAMILIES: dict[str, tuple[Family, ...]] = {
    "grid": (
        Family("empty", "MiniGrid-Empty-8x8-v0", TURNS, 20),
        Family("four-rooms", "MiniGrid-FourRooms-v0", TURNS, 70),
        Family("crossing", "MiniGrid-SimpleCrossingS9N2-v0", TURNS, 35),
        Family("door-key", "MiniGrid-DoorKey-6x6-v0", HANDS, 25),
        Family("unlock", "MiniGrid-Unlock-v0", HANDS, 20),
        Family("key-corridor", "MiniGrid-KeyCorridorS3R2-v0", HANDS, 45),
        Family("go-to-local", "BabyAI-GoToLocal-v0", HANDS, 10),
        Family("go-to", "BabyAI-GoTo-v0", HANDS, 135),
        Family("pick-up", "BabyAI-PickupLoc-v0", HANDS, 10),
        Family("put-next", "BabyAI-PutNextLocal-v0", HANDS, 20),
    ),
    "first-person": (
        Family("rooms", "MiniWorld-FourRooms-v0", ("turn_left", "turn_right", "move_forward"), 175, _LOOK),
        Family("hallway", "MiniWorld-Hallway-v0", ("turn_left", "turn_right", "move_forward"), 65, _LOOK),
    ),
    "kitchen": (Family("kitchen", "Team-ForcedCoordination-v0", COOK, 60, _SERVE, _TEAM),),
}
_PROTOCOL_START = """\
# Baseline levels: {count} levels in {families}, drawn from seed {seed}. Written by `minihuman bench new`.

[study]
name = "{name}"
version = "{seed}"
seed = {seed}
participants = 1000
consent = "You are asked to play short games of finding things. You may stop at any time."

[model]
modality = "{modality}"

[keys]
pool = ["1", "2", "3", "4", "5", "6"]
keyboard_check = false

[[groups]]
name = "everyone"
blocks = [{blocks}]
"""
_BLOCK_TABLE = """
[[blocks]]
name = "{name}"
world = "minihuman/{world}"
episodes = {episodes}
seeds = {seeds}
actions = [{actions}]
max_steps = {max_steps}
key_map = "shown"
instructions = "{instructions}"
{settings}"""


def compose_baseline(kind: str, seed: int, *, levels: int = LEVELS_PER_FAMILY) -> str:
    """Return the protocol of a set of levels, as TOML.

    Args:
        kind: "grid", "first-person" or "kitchen".
        seed: the seed from which the seeds of the levels are drawn; a new one gives unseen levels.
        levels: the number of levels per family.
    """
    families = FAMILIES[kind]
    flat_seeds = np.random.SeedSequence([seed, list(FAMILIES).index(kind)]).generate_state(len(families) * levels)
    seeds = flat_seeds.reshape(len(families), levels).tolist()
    n_families = "1 family" if len(families) == 1 else f"{len(families)} families"
    protocol_start = _PROTOCOL_START.format(
        count=len(families) * levels,
        families=n_families,
        seed=seed,
        name=f"baseline-{kind}-{seed}",
        modality="both" if kind == "grid" else "picture",
        blocks=_quote_names(family.name for family in families),
    )
    blocks = (
        _BLOCK_TABLE.format(
            name=family.name,
            world=family.world,
            episodes=levels,
            seeds=family_seeds,
            actions=_quote_names(family.actions),
            max_steps=family.max_steps,
            instructions=family.instructions,
            settings=family.settings,
        )
        for family, family_seeds in zip(families, seeds, strict=True)
    )
    return protocol_start + "".join(blocks)


def _quote_names(names: Iterable[str]) -> str:
    """Return names as the elements of a TOML array."""
    return ", ".join(f'"{name}"' for name in names)


def parse_players(text: str) -> dict[str, int]:
    """Parse players and their numbers of runs, as in "human-like=12,random=3".

    Raises:
        SimulationError: if a player or a number of runs is missing or invalid.
    """
    runs_by_player = {}
    for part in filter(None, text.split(",")):
        name, _, runs = part.rpartition("=")
        if not name or not runs.isdecimal() or not int(runs):
            raise SimulationError(
                f"{part!r} does not give a player and its number of runs; write NAME=RUNS, as in random=3"
            )
        runs_by_player[name] = int(runs)
    return runs_by_player


def run_baseline(
    protocols: Sequence[Path],
    data: Path,
    players: dict[str, int],
    *,
    seed: int = 1,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Scorecard:
    """Simulate players on sets of levels, without repeating complete runs, and return the scores of all in ``data``.

    Args:
        protocols: the protocols of the sets.
        data: the folder in which each player gets a folder.
        players: the number of runs of each player, by name; one that cannot play a set gets a note on the scorecard.
        seed: the seed of the players and of the scores.
        on_progress: a function that is called with a message before each player begins.

    Raises:
        MinihumanError: if a set is not a valid protocol, or a player fails while it plays.
    """
    studies: list[Path] = []
    notes: list[str] = []
    for path in protocols:
        protocol = read_protocol(path)
        for player, runs in players.items():
            folder = data / player.replace(":", "-").replace("/", "-")
            studies.append(folder / protocol.study.name)
            n_missing = runs - _count_complete_sessions(studies[-1])
            on_progress(f"{player} plays {protocol.study.name}")
            if n_missing <= 0:
                continue
            try:
                list(simulate(protocol, folder, participants=n_missing, seed=seed, player=player))
            except PlayerFailedError:
                raise
            except (SimulationError, LearnError) as error:
                notes.append(f"{player} does not play {protocol.study.name}: {error}")
        studies.append(data / protocol.study.name)  # of people and models, by the ordinary commands
    card = build_scorecard(studies, seed=seed)
    return replace(card, notes=(*card.notes, *notes))


def _count_complete_sessions(study: Path) -> int:
    """Return the number of complete sessions in a study's folder, or 0 if the folder does not exist yet."""
    if not study.is_dir():
        return 0
    with select(study) as tables:
        tables.require(("participants",))
        participants = tables.frame("participants", ["participant", "session", "end_reason"])
        complete_rows = participants[participants["end_reason"] == "complete"]
        complete_sessions = set(zip(complete_rows["participant"], complete_rows["session"], strict=True))
        return sum(
            (session.outline.participant, session.outline.session) in complete_sessions
            for session in tables.sessions
            if session.outline is not None and _is_finished(Path(session.path))
        )


def _is_finished(log: Path) -> bool:
    """Return whether a log was written to its end; for a folder of segments, whether all of them were."""
    paths = [log]
    if log.is_dir():
        paths = list(log.iterdir())
    return not any(path.name.endswith(PART_SUFFIX) for path in paths)
