"""Export datasets for robomimic, one HDF5 file per world, `OUT/<world>.hdf5`, with a group per episode below `data`.

`obs/image` is a picture. `obs/state` holds the observed numbers, or the pose if the observation is a picture.
robomimic's policies have continuous actions, so an action is a one-hot vector, and `discrete_action` is what the
environment's `step` takes. Source: https://robomimic.github.io/docs/datasets/overview.html.
"""

import json
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np

from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    PICTURE_PX,
    ReplayedEpisode,
    ReplayedStudy,
    build_actions,
    build_state,
    build_steering_columns,
    name_actions,
    name_state,
)
from minihuman.exporters.study_metadata import get_plain_facts
from minihuman.worlds.hashing import resolve_files

_GYMNASIUM = 2  # robomimic's EnvType.GYM_TYPE


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write a robomimic data set for each world, ``NAME.hdf5``, of its episodes that have a step.

    Raises:
        ExportError: if an episode does not replay.
    """
    replayed = ReplayedStudy(chosen, "has no step, and robomimic keeps none without", picture_px=PICTURE_PX)
    files: dict[str, h5py.File] = {}
    with ExitStack() as stack:
        for name, included, demonstration in replayed:
            if name not in files:
                files[name] = stack.enter_context(h5py.File(out / f"{name}.hdf5", "w"))
                _write_environment(files[name].create_group("data"), included, demonstration)
            _write_demonstration(files[name]["data"], included, demonstration)
    return replayed.result(out / f"{name}.hdf5" for name in files)


def _write_environment(data: h5py.Group, included: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
    """Write the attributes of the group ``data``: the environment, and the names of the actions and the states."""
    plan = included.episode.plan
    environment = {"env_name": plan.world, "type": _GYMNASIUM, "env_kwargs": resolve_files(plan.options)}
    data.attrs["env_args"] = json.dumps(environment, default=str)
    data.attrs["action_names"] = json.dumps(name_actions(included))
    data.attrs["state_names"] = json.dumps(name_state(demonstration))
    data.attrs["total"] = 0


def _write_demonstration(data: h5py.Group, included: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
    """Write an episode as the next demonstration in the group ``data``; a step has its observation and the next one."""
    episode = included.episode
    n_steps = len(episode.actions)
    group = data.create_group(f"demo_{len(data)}")
    group.attrs["num_samples"] = n_steps
    group.attrs.update(get_plain_facts(included))
    observations = {"state": build_state(demonstration)}
    if demonstration.pictures:
        observations["image"] = np.stack(demonstration.pictures)
    dones = np.zeros(n_steps, np.int64)
    dones[-1] = 1
    actions = build_actions(included, demonstration)
    columns = {"actions": actions.pop("action")}
    columns |= actions
    columns |= {"rewards": episode.rewards, "dones": dones, "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9}
    columns |= build_steering_columns(episode)
    columns |= {f"obs/{name}": states[:-1] for name, states in observations.items()}
    columns |= {f"next_obs/{name}": states[1:] for name, states in observations.items()}
    for name, column in columns.items():
        group.create_dataset(name, data=column, compression="lzf")
    data.attrs["total"] += n_steps
