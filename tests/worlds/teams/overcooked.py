"""Overcooked-AI 1.1.0 as an oracle: its dynamics, its recorded human play, and our kitchens in its words.

It is installed by itself (``pip install --no-deps overcooked-ai==1.1.0``): it requires the package pygame, whose files
would overwrite those of pygame-ce, and gym, which is given up. Of both it needs nothing for its dynamics.
"""

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np

from minihuman.worlds.grid.core import kitchen_rules as fields
from tests.machine import needs

needs_overcooked = needs("kitchens")
LAYOUTS = {  # what the recordings call them, and what they are called since
    "cramped_room": "cramped_room",
    "asymmetric_advantages": "asymmetric_advantages",
    "coordination_ring": "coordination_ring",
    "random0": "forced_coordination",
    "random3": "counter_circuit_o_1order",
}
DIRECTIONS = ((0, -1), (0, 1), (1, 0), (-1, 0))
ACTIONS = (*DIRECTIONS, (0, 0), "interact")
NAMES = ("", "onion", "tomato", "dish", "soup")


def action_number(action):
    """Our number of an action as the recordings write it."""
    return ACTIONS.index(action.lower() if isinstance(action, str) else tuple(action))


def action_of(number):
    """The oracle's action of our number."""
    return ACTIONS[number]


def dynamics():
    """The oracle's module of dynamics."""
    if not hasattr(np, "Inf"):
        np.Inf = np.inf  # which it asks for, and NumPy 2 calls inf
    if "gym" not in sys.modules:  # it registers an environment with it as it is imported
        gym, envs, registration = (ModuleType(name) for name in ("gym", "gym.envs", "gym.envs.registration"))
        registration.register = lambda **_: None
        gym.Env = object
        sys.modules |= {"gym": gym, "gym.envs": envs, "gym.envs.registration": registration}
    from overcooked_ai_py.mdp import overcooked_mdp

    return overcooked_mdp


def recordings():
    """Each recorded step: layout, state, joint action, next state, reward."""
    import pandas as pd

    dynamics()
    import overcooked_ai_py

    path = Path(overcooked_ai_py.__file__).parent / "data/human_data/clean_train_trials.pickle"
    table = pd.read_pickle(path)
    columns = ("layout_name", "state", "joint_action", "next_state", "reward")
    for layout, *texts, reward in zip(*(table[name] for name in columns), strict=True):
        yield layout, *(map(read_text, texts)), reward


def read_text(text):
    """A value that was written down as Python writes it, in a third of the time that Python takes."""
    for python, other in (("'", '"'), ("None", "null"), ("True", "true"), ("False", "false")):
        text = text.replace(python, other)
    return json.loads(text)


def thing_of(recorded):
    """What the kitchen calls a thing of a recorded state (2019's words), or of the oracle's."""
    if recorded is None:
        return fields.NOTHING
    kind = NAMES.index(recorded["name"])
    if kind != fields.SOUP:
        return kind
    if "state" in recorded:
        ingredient, count, clock = recorded["state"]
        counts = (count, 0) if ingredient == "onion" else (0, count)
        clock = clock if clock or count == 3 else -1
    else:
        inside = [each["name"] for each in recorded["_ingredients"]]
        counts, clock = (inside.count("onion"), inside.count("tomato")), recorded["cooking_tick"]
    return int(fields.soup(*counts, clock))


def write_state(kitchen, state):
    """Put the kitchen into a state in the oracle's words."""
    row = kitchen.row
    width, height, cooks = row[:3].tolist()
    at = fields.COOK + 4 * cooks + width * height
    row[at:] = fields.NOTHING
    for cook, player in enumerate(state["players"]):
        held = thing_of(player.get("held_object"))
        direction = DIRECTIONS.index(tuple(player["orientation"]))
        row[fields.COOK + 4 * cook :][:4] = *player["position"], direction, held
    objects = state["objects"]
    for each in objects.values() if isinstance(objects, dict) else objects:
        x, y = each["position"]
        row[at + x * height + y] = thing_of(each)
    row[fields.PHASE], row[fields.STEP] = fields.PLAYING, 0


def numbers_of(kitchen, state):
    """The state's numbers (cooks and things) as the kitchen would hold them."""
    before = kitchen.save()
    write_state(kitchen, state)
    numbers = kitchen.row[fields.COOK :].copy()
    kitchen.restore(before)
    return numbers
