"""What robomimic, TensorFlow Datasets, Hugging Face, SPSS and Stata read of an export equals the log."""

import functools
import json
import struct

import google_crc32c
import numpy as np
import pandas as pd
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.exporters.exporter import export_study
from minihuman.worlds.adapters.world import World
from tests.builders import session, write_log
from tests.export.played import chosen, played
from tests.export.study import recorded

WORLDS = ["minihuman/MiniGrid-FourRooms-v0", "minihuman/MiniWorld-FourRooms-v0"]


@pytest.fixture(scope="module", params=WORLDS)
def items(request):
    return chosen([played(request.param, number=number, seed=number + 3) for number in range(2)])


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    for index in range(2):
        write_log(session(participant=f"sub-0{index + 1}", index=index, seed=index, blocks=("grid",), episodes=2), data)
    return data / "transfer"


def seen(episode):
    """What the world shows and observes when the episode is played again, not through the code under test."""
    world = World(episode.plan.world)
    world.reset(episode.plan.seed)
    for action in [*episode.actions, None]:
        observed = world.observation
        is_picture = not isinstance(observed, dict)
        yield observed if is_picture else world.frame(episode.plan.view, (128, 128), episode.plan.palette)
        if action is not None:
            world.step(int(action))


def test_robomimic_has_pictures_before_and_after_every_action(items, tmp_path):
    import h5py

    from minihuman.exporters import robomimic

    (path,) = robomimic.export(iter(items), tmp_path).paths
    with h5py.File(path) as file:
        assert file["data"].attrs["total"] == sum(len(item.episode.actions) for item in items)
        assert json.loads(file["data"].attrs["env_args"])["env_name"] == items[0].episode.plan.world
        names = json.loads(file["data"].attrs["action_names"])
        for number, item in enumerate(items):
            demo, episode = file[f"data/demo_{number}"], item.episode
            pictures = np.array(list(seen(episode)))
            assert np.array_equal(demo["obs/image"], pictures[:-1])
            assert np.array_equal(demo["next_obs/image"], pictures[1:])
            assert demo["obs/state"].shape[0] == demo.attrs["num_samples"] == len(episode.actions)
            taken = [names[row.argmax()] for row in demo["actions"][()]]
            assert taken == [episode.start.action_names[action] for action in episode.actions]
            assert np.array_equal(demo["rewards"], episode.rewards)
            assert demo["dones"][()].tolist() == [0] * (len(episode.actions) - 1) + [1]


@functools.cache  # protobuf crashes where a message outlives its class
def tensorflows_example():
    """`tf.train.Example`, from its definition."""
    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="tf", syntax="proto3")
    kinds = {"BytesList": 12, "FloatList": 2, "Int64List": 3}
    for name, kind in kinds.items():
        file.message_type.add(name=name).field.add(name="value", number=1, type=kind, label=3)
    feature = file.message_type.add(name="Feature")
    for number, name in enumerate(kinds, 1):
        feature.field.add(name=name.lower(), number=number, type=11, type_name=f".tf.{name}", label=1)
    features = file.message_type.add(name="Features")
    entry = features.nested_type.add(name="FeatureEntry")
    entry.field.add(name="key", number=1, type=9, label=1)
    entry.field.add(name="value", number=2, type=11, type_name=".tf.Feature", label=1)
    entry.options.map_entry = True
    features.field.add(name="feature", number=1, type=11, type_name=".tf.Features.FeatureEntry", label=3)
    file.message_type.add(name="Example").field.add(
        name="features", number=1, type=11, type_name=".tf.Features", label=1
    )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tf.Example"))


def records(path):
    """The records of a TFRecord file, each checksum compared."""
    content, at = path.read_bytes(), 0
    while at < len(content):
        (length,) = struct.unpack_from("<Q", content, at)
        for begin, end in ((at, at + 8), (at + 12, at + 12 + length)):
            crc = google_crc32c.value(content[begin:end])
            (stored,) = struct.unpack_from("<I", content, end)
            assert stored == ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF
        yield content[at + 12 : at + 12 + length]
        at += 16 + length


def test_rlds_steps_hold_what_was_seen_after_the_last_action_too(items, tmp_path):
    from minihuman.exporters import rlds

    (root,) = rlds.export(iter(items), tmp_path).paths
    info = json.loads((root / "dataset_info.json").read_text())
    (shard,) = root.glob("*.tfrecord-00000-of-00001")
    found = [tensorflows_example().FromString(record).features.feature for record in records(shard)]
    assert info["splits"][0]["shardLengths"] == [str(len(found))]
    for item, features in zip(items, found, strict=True):
        episode, n = item.episode, len(item.episode.actions)
        assert len(features["steps/observation/image"].byteslist.value) == n + 1
        assert list(features["steps/discrete_action"].int64list.value) == [*episode.actions.tolist(), 0]
        assert list(features["steps/is_last"].int64list.value) == [0] * n + [1]
        assert list(features["steps/is_terminal"].int64list.value)[-1] == int(episode.terminated[-1])
        assert features["steps/reward"].floatlist.value[:n] == pytest.approx(episode.rewards.tolist())
        assert features["episode_metadata/participant"].byteslist.value[0] == b"sub-01"


def test_hugging_face_spss_and_stata_hold_the_rows_of_the_tables(study, tmp_path, monkeypatch):
    import datasets
    import pyreadstat

    monkeypatch.setenv("HF_DATASETS_CACHE", str(tmp_path / "cache"))
    for kind in ("parquet", "hugging-face", "spss", "stata"):
        export_study(kind, study, tmp_path / kind, Selection())
    for name in ("episodes", "participants", "plan"):
        expected = pd.read_parquet(tmp_path / f"parquet/{name}.parquet")
        loaded = datasets.load_dataset(str(tmp_path / "hugging-face"), name, cache_dir=str(tmp_path / "cache"))["train"]
        rows = loaded.to_pandas()
        for column in expected.select_dtypes("datetimetz"):  # which are texts there
            rows[column] = pd.to_datetime(rows[column])
        pd.testing.assert_frame_equal(rows, expected, check_dtype=False)
        for kind, read, ending in (("spss", pyreadstat.read_sav, "sav"), ("stata", pyreadstat.read_dta, "dta")):
            frame, meta = read(str(tmp_path / kind / f"{name}.{ending}"))
            assert list(frame.columns) == list(expected.columns)
            assert meta.column_names_to_labels["participant"] == "The participant's code."
            for column in expected.select_dtypes("number"):
                assert frame[column].to_numpy(float) == pytest.approx(expected[column].to_numpy(float), nan_ok=True)
            assert frame["participant"].tolist() == expected["participant"].tolist()
    folders = {path.name for path in (tmp_path / "hugging-face/steps/study=transfer").iterdir()}
    assert folders == {"participant=sub-01", "participant=sub-02"}


TWO_GROUPS = """
[study]
name = "two-groups"
version = "1.0"
seed = 7
[keys]
pool = ["1", "2", "3", "4", "5"]
keyboard_check = false
[[groups]]
name = "plain"
blocks = ["grid"]
[[groups]]
name = "hands"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 20
key_map = "shown"
[blocks.group_overrides.hands]
actions = ["left", "right", "forward", "pickup"]
"""


@pytest.fixture(scope="module")
def two_groups(tmp_path_factory):
    study = recorded(tmp_path_factory.mktemp("groups"), participants=2, player="random", toml=TWO_GROUPS.encode())
    assert {item.log.plan.participant.group for item in IncludedEpisodes(StudySessions(study))} == {"plain", "hands"}
    return study


def test_groups_with_other_actions_share_columns_of_one_meaning(two_groups, tmp_path):
    import h5py

    actions = ["left", "right", "forward", "pickup"]
    result, _ = export_study("robomimic", two_groups, tmp_path / "robomimic", Selection())
    with h5py.File(*result.paths) as file:
        assert json.loads(file["data"].attrs["action_names"]) == actions
        for demo in file["data"].values():
            names = json.loads(demo.attrs["action_names"])
            taken = [names[action] for action in demo["discrete_action"][()]]
            assert [actions[place] for place in np.argmax(demo["actions"], axis=1)] == taken
    result, _ = export_study("rlds", two_groups, tmp_path / "rlds", Selection())
    (shard,) = result.paths[0].glob("*.tfrecord-*")
    for record in records(shard):
        features = tensorflows_example().FromString(record).features.feature
        assert len(features["steps/action"].floatlist.value) == 4 * len(features["steps/reward"].floatlist.value)


STAIRCASE = """
[blocks.design]
name = "staircase"
settings = { option = "agent_view_size", values = [%s], down = 1, stop_reversals = 9 }
"""


@pytest.mark.parametrize(
    ("option", "values", "datasets"), [("max_steps", "30, 25, 20", 1), ("agent_view_size", "7, 5", 2)]
)
@pytest.mark.parametrize("kind", ["robomimic", "rlds", "minari", "imitation", "lerobot"])
def test_a_design_makes_one_dataset_and_one_more_where_the_observation_has_another_shape(
    option, values, datasets, kind, tmp_path
):
    import h5py

    design = (STAIRCASE % values).replace("agent_view_size", option)
    toml = TWO_GROUPS.replace("episodes = 1", "episodes = 4") + design
    study = recorded(tmp_path / "data", participants=1, toml=toml.encode())
    chosen_options = [item.episode.plan.options for item in IncludedEpisodes(StudySessions(study))]
    assert len({str(options) for options in chosen_options}) > 1
    result, _ = export_study(kind, study, tmp_path / kind, Selection())
    assert len(result.paths) == datasets
    assert result.episodes == len(chosen_options)
    assert all("grid" in path.stem.replace("_", "-").split("-") for path in result.paths if kind != "rlds")
    if kind == "robomimic":
        found = []
        for path in result.paths:
            with h5py.File(path) as file:
                found += [json.loads(demo.attrs["options"]) for demo in file["data"].values()]
        assert sorted(map(str, found)) == sorted(map(str, chosen_options))
