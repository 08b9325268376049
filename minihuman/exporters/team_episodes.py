"""Export episodes of teams with all bodies: PettingZoo-style episodes, and Overcooked-AI trajectories of kitchens.

A team's episode is written once, from the first of its members' logs. Each episode is replayed from its seed and joint
actions, and its last state is compared with the log. These formats have no place for episodes with a single body, which
are excluded.
"""

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.errors import ExportError, WorldError
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.study_metadata import describe_episode
from minihuman.log.model.session_log import TeamRecord
from minihuman.worlds.adapters.world import World

if TYPE_CHECKING:
    from minihuman.worlds.grid.kitchen import Kitchen

NO_TEAM = "was played by one body"


def export_pettingzoo(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write a folder per world, with a line per episode in ``episodes.jsonl`` and a file of observations per episode.

    Agents have the names of PettingZoo's parallel API, beginning with ``body_0``. The array ``body_i`` in an episode's
    ``.npz`` file holds the observations of body i, (steps + 1, ...); actions and rewards are lists by step and agent.
    ``people`` has the participant in each person's seat, with the laboratory's columns.

    Raises:
        ExportError: if an episode does not replay.
    """
    episodes_by_folder: dict[str, list[dict[str, Any]]] = defaultdict(list)
    left_out: list[str] = []
    paths = []
    steps = 0
    for included, team, people in _list_team_episodes(chosen, left_out):
        folder = _name_world_folder(included.episode.plan.world)
        agents = [f"body_{seat}" for seat in range(len(team.seats))]
        number = len(episodes_by_folder[folder])
        path = out / folder / f"episode_{number:05d}.npz"
        _write_observations(path, included, agents)
        paths.append(path)
        facts = {"episode": number, "observations": path.name, "people": people}
        episodes_by_folder[folder].append(facts | _describe_team_episode(included, team, agents))
        steps += len(team.actions)
    for folder, episodes in episodes_by_folder.items():
        path = out / folder / "episodes.jsonl"
        path.write_text("".join(json.dumps(episode) + "\n" for episode in episodes), encoding="utf-8", newline="\n")
        paths.append(path)
    return ExportResult(tuple(paths), sum(map(len, episodes_by_folder.values())), steps, left_out=tuple(left_out))


def _name_world_folder(world: str) -> str:
    """Return the last part of a world's id in lower case: ``team-crampedroom-v0``."""
    return world.rpartition("/")[-1].rpartition(":")[-1].lower()


def _write_observations(path: Path, included: IncludedEpisode, agents: Sequence[str]) -> None:
    """Replay an episode, and write each body's observations as an array with its agent's name."""
    observations: dict[str, list[Any]] = {agent: [] for agent in agents}
    for world in _replay_states(included):
        for seat, agent in enumerate(agents):
            observations[agent].append(world.unwrapped.team.observation(seat))
    path.parent.mkdir(exist_ok=True)
    arrays: dict[str, Any] = {agent: np.stack(frames) for agent, frames in observations.items()}
    np.savez_compressed(path, **arrays)


def _describe_team_episode(included: IncludedEpisode, team: TeamRecord, agents: list[str]) -> dict[str, Any]:
    """Describe a team's episode for its line in ``episodes.jsonl``."""
    plan = included.episode.plan
    return {
        "world": plan.world,
        "options": included.episode.shared_options,
        "seed": plan.seed,
        "team": team.team,
        "block": plan.block_name,
        "episode_in_block": plan.episode_in_block,
        "agents": agents,
        "seats": team.seats,
        "action_names": included.episode.start.action_names,
        "actions": team.actions.tolist(),
        "rewards": team.rewards.tolist(),
        "sources": team.sources,
        "terminated": bool(included.episode.terminated[-1:].any()),
        "truncated": bool(included.episode.truncated[-1:].any()),
        "outcome": included.episode.outcome_word,
        "digest": f"{team.digest:016x}",
    }


def export_overcooked(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write kitchens as Overcooked-AI trajectories: one JSON file per layout and version of the rules.

    ``AgentEvaluator.load_traj_from_json`` reads each file, and Overcooked-AI reproduces the states under the rules of
    1.1.0. A kitchen that a protocol defines is named by its floor plan.

    Raises:
        ExportError: if an episode does not replay.
    """
    from minihuman.worlds.grid.kitchen import KITCHENS, Kitchen

    files: dict[str, dict[str, list[Any]]] = {}
    left_out: list[str] = []
    steps = 0
    for included, team, people in _list_team_episodes(chosen, left_out):
        kitchen: Any = None
        states: list[dict[str, Any]] = []
        for world in _replay_states(included):
            kitchen = world.unwrapped.team
            if not isinstance(kitchen, Kitchen):
                break
            states.append(describe_state(kitchen, len(states)))
        if not states:
            left_out.append(f"{describe_episode(included)} is in no kitchen")
            continue
        built_in_names = [name for name, layout in KITCHENS.items() if layout == kitchen.layout]
        layout_name = built_in_names[0] if built_in_names else kitchen.layout.plan
        name = _name_trajectories(layout_name, kitchen.rules)
        trajectory = _describe_trajectory(included, team, kitchen, layout_name, states) | {"people": people}
        columns = files.setdefault(name, {key: [] for key in trajectory})
        for key, part in trajectory.items():
            columns[key].append(part)
        steps += len(team.rewards)
    paths = []
    for name, trajectories in files.items():
        paths.append(out / f"{name}.json")
        paths[-1].write_text(json.dumps(trajectories), encoding="utf-8", newline="\n")
    episodes = sum(len(trajectories["ep_lengths"]) for trajectories in files.values())
    return ExportResult(tuple(paths), episodes, steps, left_out=tuple(left_out))


def _name_trajectories(layout_name: str, rules: str) -> str:
    """Return a file name without suffix: the layout's name, with "_2019" if ``rules`` is "2019"."""
    name = "".join(letter if letter.isalnum() else "_" for letter in layout_name)
    if rules == "2019":
        return f"{name}_2019"
    return name


ORIENTATIONS = ((0, -1), (0, 1), (1, 0), (-1, 0))  # Overcooked-AI's vectors, by our direction: up, down, right, left
ACTIONS = (*ORIENTATIONS, (0, 0), "interact")  # by our action
_THINGS = ("", "onion", "tomato", "dish", "soup")
_INGREDIENTS = {"o": "onion", "t": "tomato"}
_LETTERS = " PXOTDS"  # of Overcooked-AI's layouts, by our terrain
_COOK_SIZE = 4  # numbers of a cook in a kitchen's row: column, line, direction, held thing
_KIND_MASK = 7  # a thing's lowest three bits; of a soup, onions, tomatoes and clock follow
_INGREDIENT_MASK = 3
_TOMATO_STRIDE = 4  # of a recipe's index: onions + 4 * tomatoes
_ONIONS_SHIFT = 3
_TOMATOES_SHIFT = 5
_CLOCK_SHIFT = 7


def _describe_trajectory(
    included: IncludedEpisode, team: TeamRecord, kitchen: "Kitchen", layout_name: str, states: list[dict[str, Any]]
) -> dict[str, Any]:
    """Describe an episode as an Overcooked-AI trajectory.

    Args:
        included: the episode.
        team: its joint actions and rewards.
        kitchen: the kitchen, whose layout and rules are stated.
        layout_name: the name of the layout.
        states: the states of the kitchen from `describe_state`, that after the reset first.
    """
    rewards = team.rewards[:, 0].astype(int).tolist()  # every seat has the same
    n_steps = len(rewards)
    dones = [step == n_steps for step in range(1, n_steps + 1)]
    actions = []
    for joint_action in team.actions.tolist():
        actions.append([ACTIONS[action] for action in joint_action])
    params = {
        "layout_name": layout_name,
        "terrain": _list_terrain(kitchen),
        "start_player_positions": [player["position"] for player in states[0]["players"]],
    }
    params |= {f"start_{kind}": recipes for kind, recipes in _describe_orders(kitchen).items()}
    return {
        "ep_states": states[:n_steps],
        "ep_actions": actions,
        "ep_rewards": rewards,
        "ep_dones": dones,
        "ep_returns": sum(rewards),
        "ep_lengths": n_steps,
        "mdp_params": params,
        "env_params": {"horizon": included.episode.plan.max_steps},
        "rules": kitchen.rules,
    }


def describe_state(kitchen: "Kitchen", step: int) -> dict[str, Any]:
    """Describe a kitchen's present state, that after ``step`` steps, as Overcooked-AI's ``OvercookedState.to_dict``."""
    from minihuman.worlds.grid.core import kitchen_rules as rules

    row = kitchen.row
    width, height, n_cooks = row[:3].tolist()  # with which a kitchen's row begins
    end_of_cooks = rules.COOK + _COOK_SIZE * n_cooks
    cooks = row[rules.COOK : end_of_cooks].reshape(n_cooks, _COOK_SIZE)
    contents = row[end_of_cooks + width * height :].reshape(width, height)  # of the cells, after their kinds
    times = row[rules.TIMES : rules.COOK].tolist()
    players = []
    for x, y, direction, held_number in cooks.tolist():
        held_object = _describe_object(held_number, [x, y], times)
        players.append({"position": [x, y], "orientation": list(ORIENTATIONS[direction]), "held_object": held_object})
    objects = [_describe_object(int(contents[x, y]), [x, y], times) for x, y in np.argwhere(contents).tolist()]
    return {"players": players, "objects": objects, "timestep": step, **_describe_orders(kitchen)}


def _describe_object(number: int, position: list[int], times: list[int]) -> dict[str, Any] | None:
    """Describe an object as Overcooked-AI does; return None if the number stands for no object.

    Args:
        number: the object in a kitchen's row: its kind in the lowest three bits, then a soup's contents and clock.
        position: its column and line.
        times: the steps that each recipe cooks, by the recipe's index.
    """
    from minihuman.worlds.grid.core import kitchen_rules as rules

    kind = number & _KIND_MASK
    if not kind:
        return None
    description = {"name": _THINGS[kind], "position": position}
    if kind != rules.SOUP:
        return description
    n_onions = number >> _ONIONS_SHIFT & _INGREDIENT_MASK
    n_tomatoes = number >> _TOMATOES_SHIFT & _INGREDIENT_MASK
    clock = (number >> _CLOCK_SHIFT) - 1
    ingredients = ["onion"] * n_onions + ["tomato"] * n_tomatoes
    cook_time = times[n_onions + _TOMATO_STRIDE * n_tomatoes]
    return description | {
        "_ingredients": [{"name": name, "position": position} for name in ingredients],
        "cooking_tick": clock,
        "_cooking_tick": clock,
        "is_cooking": 0 <= clock < cook_time,
        "is_ready": clock >= cook_time,
        "is_idle": clock < 0,
        "cook_time": -1 if clock < 0 else cook_time,
    }


def _describe_orders(kitchen: "Kitchen") -> dict[str, list[dict[str, list[str]]]]:
    """Describe a kitchen's recipes that earn a bonus and all that can be ordered, as Overcooked-AI does."""
    from minihuman.worlds.grid.kitchen import RECIPES

    return {
        "bonus_orders": [_describe_recipe(recipe) for recipe in kitchen.layout.bonus],
        "all_orders": [_describe_recipe(recipe) for recipe in kitchen.layout.orders or RECIPES],
    }


def _describe_recipe(recipe: str) -> dict[str, list[str]]:
    return {"ingredients": [_INGREDIENTS[letter] for letter in recipe]}


def _list_terrain(kitchen: "Kitchen") -> list[list[str]]:
    """Return the letters of a kitchen's cells in Overcooked-AI's layouts, row by row."""
    from minihuman.worlds.grid.core import kitchen_rules as rules

    width, height, n_cooks = kitchen.row[:3].tolist()
    first = rules.COOK + _COOK_SIZE * n_cooks  # the cells follow the cooks
    n_cells = width * height
    cells = kitchen.row[first : first + n_cells].reshape(width, height)
    letters = []
    for y in range(height):
        letters.append([_LETTERS[cell] for cell in cells[:, y]])
    return letters


People = dict[str, dict[str, Any]]  # by seat ("body_0"): the participant's code, and the laboratory's columns


def _list_team_episodes(
    chosen: IncludedEpisodes, left_out: list[str]
) -> Iterator[tuple[IncludedEpisode, TeamRecord, People]]:
    """Yield every team's episode that has a step, once; add a line to ``left_out`` for each episode of a single body.

    The people of an episode are complete when all episodes have been read, as each member has a log.
    """
    people_by_key: dict[tuple[object, ...], People] = {}
    for included in chosen:
        team = included.episode.team
        plan = included.episode.plan
        if team is None:
            left_out.append(f"{describe_episode(included)} {NO_TEAM}")
            continue
        key = (team.team, plan.block_name, included.log.plan.session, plan.episode_in_block, included.episode.attempt)
        if not len(team.actions):
            continue
        is_known = key in people_by_key
        people = people_by_key.setdefault(key, {})
        people[f"body_{team.seat}"] = {"participant": included.log.plan.participant.id, "person": dict(included.person)}
        if not is_known:
            yield included, team, people


def _replay_states(included: IncludedEpisode) -> Iterator[World]:
    """Replay an episode, yielding the world at each state, beginning with the reset.

    Raises:
        ExportError: if the world cannot be created here, or the last state differs from the log.
    """
    episode = included.episode
    try:
        with closing(World(episode.plan.world, episode.world_options)) as world:
            world.reset(episode.plan.seed)
            yield world
            for action in episode.actions:
                world.step(int(action))
                yield world
            if world.state_hash() != int(episode.state_hashes[-1]):
                raise ExportError(
                    f"{included.log.path}: {episode.name} ends in a different state than in the log; "
                    "run: minihuman verify"
                )
    except WorldError as error:
        raise ExportError(f"{included.log.path}: {episode.name}: {error}") from error
