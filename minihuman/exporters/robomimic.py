"""Export datasets for robomimic, one HDF5 file per world, `OUT/<world>.hdf5`: a group per episode below `data`.

`obs/image` is a picture, `obs/state` the numbers that were observed, or the pose where a picture was. robomimic's
policies have continuous actions: an action is a one-hot vector, and `discrete_action` what the environment's `step`
takes. Source: https://robomimic.github.io/docs/datasets/overview.html.
"""

import json
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np

from minihuman.dataset.sessions import IncludedEpisode, IncludedEpisodes
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    PICTURE_PX,
    ReplayedEpisode,
    Resimulator,
    build_actions,
    build_state,
    build_steering_columns,
    dataset_name,
    name_actions,
    name_state,
)
from minihuman.exporters.study_metadata import describe_episode

_GYMNASIUM = 2  # robomimic's EnvType.GYM_TYPE


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every episode that has a step.

    Raises:
        ExportError: if an episode does not replay.
    """
    resimulate = Resimulator(picture_px=PICTURE_PX)
    paths: list[Path] = []
    left_out: list[str] = []
    episodes = steps = 0
    with ExitStack() as stack:
        files: dict[str, h5py.File] = {}
        for item in chosen:
            if not len(item.episode.actions):
                left_out.append(f"{describe_episode(item)} has no step, and robomimic keeps none without")
                continue
            demonstration, name = resimulate(item), dataset_name(item)
            if name not in files:
                paths.append(out / f"{name}.hdf5")
                files[name] = stack.enter_context(h5py.File(paths[-1], "w"))
                _begin(files[name].create_group("data"), item, demonstration)
            _write(files[name]["data"], item, demonstration)
            episodes, steps = episodes + 1, steps + len(item.episode.actions)
    return ExportResult(tuple(paths), episodes, steps, tuple(left_out))


def _begin(data: h5py.Group, item: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
    plan = item.episode.plan
    made_by = {"env_name": plan.world, "type": _GYMNASIUM, "env_kwargs": plan.options}
    data.attrs["env_args"] = json.dumps(made_by, default=str)
    data.attrs["action_names"] = json.dumps(name_actions(item))
    data.attrs["state_names"] = json.dumps(name_state(demonstration))
    data.attrs["total"] = 0


def _write(data: h5py.Group, item: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
    episode = item.episode
    group = data.create_group(f"demo_{len(data)}")
    group.attrs["num_samples"] = len(episode.actions)
    for name, value in item.facts.items():
        group.attrs[name] = value if isinstance(value, str | int) else json.dumps(value)
    done = np.zeros(len(episode.actions), np.int64)
    done[-1] = 1
    seen = {"state": build_state(demonstration)}
    if demonstration.pictures:
        seen |= {"image": np.stack(demonstration.pictures)}
    actions = build_actions(item, demonstration)
    columns = {
        "actions": actions.pop("action"),
        **actions,
        "rewards": episode.rewards,
        "dones": done,
        "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9,
        **build_steering_columns(episode),
        **{f"obs/{name}": values[:-1] for name, values in seen.items()},
        **{f"next_obs/{name}": values[1:] for name, values in seen.items()},
    }
    for name, values in columns.items():
        group.create_dataset(name, data=values, compression="lzf")
    data.attrs["total"] += len(episode.actions)
