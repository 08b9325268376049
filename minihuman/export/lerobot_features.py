"""A LeRobot dataset's features: what is seen, what is done about it, and what came of it, a row a frame."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.data.chosen import Chosen
from minihuman.export.asked import actions_of
from minihuman.export.observations import flat, flat_names, is_picture
from minihuman.export.resimulate import Demonstration
from minihuman.export.taught import taught_columns

PICTURE, STATE = "observation.image", "observation.state"


def features_of(item: Chosen, first: Demonstration) -> dict[str, dict[str, Any]]:
    """What a frame of the episode's dataset has: type, shape and names of each feature, as ``info.json`` says them."""
    if is_picture(first.observation_space):
        shape = list(np.asarray(first.observations[0]).shape)
        names = _place_names(item)
        seen = {PICTURE: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}}
    else:
        names, seen = flat_names(first.observations[0]), {}
    actions = list(actions_of(item))
    return {
        **seen,
        STATE: {"dtype": "float32", "shape": [len(names)], "names": names},
        "action": {"dtype": "float32", "shape": [len(actions)], "names": actions},
        "action_index": {"dtype": "int64", "shape": [1], "names": ["what the environment's step takes"]},
        **(
            {
                "intervention": {"dtype": "bool", "shape": [1], "names": None},
                "policy_action": {"dtype": "int64", "shape": [1], "names": ["what the policy would have done"]},
            }
            if item.episode.taught is not None
            else {}
        ),
        "next.reward": {"dtype": "float64", "shape": [1], "names": None},
        "next.done": {"dtype": "bool", "shape": [1], "names": None},
        "next.success": {"dtype": "bool", "shape": [1], "names": None},
        "time_s": {"dtype": "float64", "shape": [1], "names": None},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "frame_index": {"dtype": "int64", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
        "index": {"dtype": "int64", "shape": [1], "names": None},
        "task_index": {"dtype": "int64", "shape": [1], "names": None},
    }


def _place_names(item: Chosen) -> list[str]:
    """The state of a world of pictures: where the agent stands, or, where the world cannot tell, how much is over."""
    return ["elapsed"] if np.isnan(item.episode.poses).any() else ["x", "z", "cos_yaw", "sin_yaw"]


def _place(item: Chosen) -> NDArray[np.float32]:
    poses = item.episode.poses[:-1]
    if np.isnan(item.episode.poses).any():
        return (np.arange(len(poses)) / item.episode.plan.max_steps).astype(np.float32).reshape(-1, 1)
    x, _, z, yaw_rad = poses.T
    return np.stack([x, z, np.cos(yaw_rad), np.sin(yaw_rad)], axis=1).astype(np.float32)


def columns_of(item: Chosen, demonstration: Demonstration, features: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """The features that come from the episode, ``n`` rows each."""
    episode = item.episode
    before = demonstration.observations[:-1]
    seen: dict[str, NDArray[Any]]
    if PICTURE in features:
        seen = {PICTURE: np.stack(before), STATE: _place(item)}
    else:
        space = demonstration.observation_space
        seen = {STATE: np.stack([flat(observation, space).astype(np.float32) for observation in before])}
    done = np.zeros(len(episode.actions), bool)
    done[-1] = True
    taken = np.array(episode.start.action_names)[episode.actions]
    return {
        **seen,
        "action": (taken[:, None] == np.array(features["action"]["names"])).astype(np.float32),
        "action_index": demonstration.actions,
        **taught_columns(episode),
        "next.reward": episode.rewards,
        "next.done": done,
        "next.success": done & (episode.outcome == "goal"),
        "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9,
    }
