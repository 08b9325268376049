"""What the readers of others find in our exports equals the log, bit for bit; pictures in a video nearly so."""

import json
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from minihuman.dataset.included_episodes import IncludedEpisode
from minihuman.display.video import pad_to_even
from minihuman.errors import ExportError
from minihuman.exporters import lerobot
from minihuman.exporters.flat_observations import Resimulator
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.export.played import chosen, played

OLD = Path(__file__).parents[1] / "golden/v1/first-person/sub-01/ses-01/sub-01_ses-01.mcap"
WORLDS = ["minihuman/MiniGrid-FourRooms-v0", "minihuman/MiniWorld-FourRooms-v0", "minigrid:MiniGrid-DoorKey-5x5-v0"]


def observations(episode):
    """What the world shows when the episode is played again, not through the code under test."""
    world = World(episode.plan.world)
    world.reset(episode.plan.seed)
    seen = [world.observation]
    for action in episode.actions:
        world.step(int(action))
        seen.append(world.observation)
    return seen


def same(stored, shown) -> bool:
    if isinstance(shown, dict):
        return set(stored) == set(shown) and all(same(stored[key], shown[key]) for key in shown)
    return stored == shown if isinstance(shown, str) else np.array_equal(stored, shown)


def at(column, row):
    return {key: at(value, row) for key, value in column.items()} if isinstance(column, dict) else column[row]


@pytest.fixture(params=WORLDS)
def items(request):
    return chosen([played(request.param, number=number, seed=number + 3) for number in range(3)])


def test_minari_gives_back_every_observation_action_reward_and_flag(items, tmp_path, monkeypatch):
    import minari

    from minihuman.exporters import minari as minari_export

    written = minari_export.export(iter(items), tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    (dataset_id,) = minari.list_local_datasets()
    dataset = minari.load_dataset(dataset_id)
    assert (dataset.total_episodes, dataset.total_steps) == (3, written.steps)
    assert not json.loads((next(tmp_path.rglob("metadata.json"))).read_text())["jpeg_encoding"]
    for item, stored in zip(items, dataset, strict=True):
        episode = item.episode
        for row, shown in enumerate(observations(episode)):
            assert same(at(stored.observations, row), shown)
        assert np.array_equal(stored.actions, episode.actions)
        assert np.array_equal(stored.rewards, episode.rewards)
        assert np.array_equal(stored.terminations, episode.terminated)
        assert np.array_equal(stored.truncations[:-1], episode.truncated[:-1])
        assert stored.truncations[-1] == (not episode.terminated[-1])  # unfinished ones are cut off there
        assert dataset.observation_space.contains(at(stored.observations, 0))


def test_minari_episodes_know_subject_group_keys_seed_and_outcome(items, tmp_path, monkeypatch):
    import minari

    from minihuman.exporters import minari as minari_export

    minari_export.export(iter(items), tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset = minari.load_dataset(next(iter(minari.list_local_datasets())))
    for item, facts in zip(items, dataset.storage.get_episode_metadata(range(3)), strict=True):
        assert facts["participant"] == "sub-01"
        assert facts["seed"] == item.episode.plan.seed
        assert facts["outcome"] == item.episode.outcome
        assert json.loads(facts["key_map"]) == item.episode.plan.key_map.keys


def test_imitation_reads_flat_observations_and_rewards(items, tmp_path):
    import datasets

    from minihuman.exporters import imitation

    (path,) = imitation.export(iter(items), tmp_path).paths
    stored = datasets.load_from_disk(str(path))
    assert set(stored.features) == {"obs", "acts", "infos", "terminal", "rews"}
    for item, row in zip(items, stored, strict=True):
        episode = item.episode
        shown = observations(episode)
        assert np.array_equal(row["acts"], episode.actions)
        assert np.array_equal(row["rews"], episode.rewards)
        assert row["terminal"] == episode.terminated[-1]
        assert len(row["infos"]) == len(episode.actions)
        assert json.loads(row["infos"][0])["participant"] == "sub-01"
        for flat, seen in zip(row["obs"], shown, strict=True):
            if isinstance(seen, dict):
                assert flat == [int(seen["direction"]), *seen["image"].ravel().tolist()]
            else:
                assert np.array_equal(np.array(flat), seen.transpose(2, 0, 1))  # as a CnnPolicy takes it


def test_lerobot_files_have_the_structure_of_format_v3(items, tmp_path):
    (root,) = lerobot.export(iter(items), tmp_path).paths
    info = json.loads((root / "meta/info.json").read_text())
    frames = sum(len(item.episode.actions) for item in items)
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"]) == (3, frames)
    episodes = pd.read_parquet(root / "meta/episodes/chunk-000/file-000.parquet")
    tasks = pd.read_parquet(root / "meta/tasks.parquet")
    assert list(tasks.columns) == ["task_index"]
    for item, row in zip(items, episodes.to_dict("records"), strict=True):
        file = info["data_path"].format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
        data = pd.read_parquet(root / file)
        assert set(data.columns) == set(info["features"]) - {"observation.image"}  # which is in a video
        data = data.iloc[row["dataset_from_index"] : row["dataset_to_index"]]
        assert list(data["index"]) == list(range(row["dataset_from_index"], row["dataset_to_index"]))
        assert set(data["episode_index"]) == {row["episode_index"]}
        assert data["discrete_action"].tolist() == item.episode.actions.tolist()
        names = np.array(info["features"]["action"]["names"])
        assert [names[value.argmax()] for value in data["action"]] == [
            item.episode.start.action_names[action] for action in item.episode.actions
        ]
        assert all(value.sum() == 1 for value in data["action"])
        assert np.array_equal(data["next.reward"], item.episode.rewards)
        assert tasks.index[data["task_index"].iloc[0]] == row["tasks"][0]
        assert row["minihuman/participant"] == "sub-01"
    stats = json.loads((root / "meta/stats.json").read_text())
    assert set(stats) == set(info["features"])
    assert stats["index"]["max"] == [frames - 1]


def test_lerobot_files_are_those_of_the_golden_list(tmp_path):
    """Every file, key, column and type of format v3.0, written down once: a change shows in the list's own history."""
    items = chosen([played("minihuman/MiniWorld-FourRooms-v0", number=number) for number in range(2)])
    (root,) = lerobot.export(iter(items), tmp_path).paths
    golden = json.loads((Path(__file__).parent / "lerobot_v3.json").read_text())
    assert sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()) == golden["files"]
    info = json.loads((root / "meta/info.json").read_text())
    assert list(info) == golden["info"]
    assert info["features"] == golden["features"]
    for name in ("data", "episodes"):
        path = next(root.rglob(golden["examples"][name]))
        found = {field.name: str(field.type) for field in pq.read_schema(path)}
        assert found == golden["columns"][name]


def decoded(root, episodes):
    """Each episode's pictures, where its row of metadata says that they are in the video."""
    with av.open(str(root / "videos/observation.image/chunk-000/file-000.mp4")) as video:
        pictures = {round(frame.time, 6): frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)}
    for row in episodes:
        first, last = (row[f"videos/observation.image/{name}_timestamp"] for name in ("from", "to"))
        assert last - first == pytest.approx(row["length"] / 10)
        yield [pictures[round(first + frame / 10, 6)] for frame in range(row["length"])]


@pytest.mark.parametrize("world_id", WORLDS)
def test_lerobot_pictures_are_what_was_seen_in_the_order_of_the_steps(world_id, tmp_path):
    items = chosen([played(world_id, number=number, seed=number + 3) for number in range(3)])
    (root,) = lerobot.export(iter(items), tmp_path).paths
    episodes = pd.read_parquet(root / "meta/episodes/chunk-000/file-000.parquet").to_dict("records")
    info = json.loads((root / "meta/info.json").read_text())
    assert [name for name in info["features"] if name.startswith("action")] == ["action"]
    for item, pictures in zip(items, decoded(root, episodes), strict=True):
        seen = observations(item.episode)[:-1]
        if isinstance(seen[0], dict):
            seen = [pad_to_even(picture) for picture in views(item.episode)][:-1]
        assert info["features"]["observation.image"]["shape"] == list(seen[0].shape)
        differ = np.abs(np.array(seen, int)[:, None] - np.array(pictures, int)[None]).mean(axis=(2, 3, 4))
        own = np.diag(differ)
        assert own.max() < 6  # of 255: what the codec leaves out
        assert all(own[row] <= differ[row].min() + 1 for row in range(len(own)))


def views(episode):
    """What the participant saw, drawn again, not through the code under test."""
    world = World(episode.plan.world)
    world.reset(episode.plan.seed)
    yield world.frame(episode.plan.view, (128, 128), episode.plan.palette)
    for action in episode.actions:
        world.step(int(action))
        yield world.frame(episode.plan.view, (128, 128), episode.plan.palette)


def test_rerun_reads_the_lerobot_export(items, tmp_path):
    from rerun.experimental import LeRobotReader

    (root,) = lerobot.export(iter(items), tmp_path).paths
    reader = LeRobotReader(root)
    assert (reader.version, reader.episodes()) == ("v3", [0, 1, 2])
    for item, number in zip(items, reader.episodes(), strict=True):
        chunks = {chunk.entity_path: chunk for chunk in reader.stream(number).to_chunks()}
        assert chunks["/action"].num_rows == len(item.episode.actions)
        (values,) = (
            column
            for name, column in chunks["/action"].to_record_batch().to_pydict().items()
            if name.endswith("Scalars:scalars")
        )
        shown = np.array(list(values)).reshape(len(item.episode.actions), -1)
        assert shown.argmax(axis=1).tolist() == item.episode.actions.tolist()  # the world's first three were asked for
        assert any(path.startswith("/observation") for path in chunks)


def test_an_episode_that_does_not_replay_is_refused_by_name():
    (item,) = chosen([played(WORLDS[0], seed=1)])
    item.episode.observation_hashes[4] += 1
    with pytest.raises(ExportError, match=r"episode 1 step 4: the replayed observation differs .* minihuman 0\.1\.0"):
        Resimulator()(item)


def test_pictures_of_an_earlier_renderer_are_drawn_anew_and_it_is_said(caplog):
    log = read_log(OLD)
    first_person = IncludedEpisode(log, log.episodes[0])
    again = Resimulator()(first_person)
    assert len(again.observations) == len(first_person.episode.actions) + 1
    assert "its pictures are drawn by this version" in caplog.text
    first_person.episode.state_hashes[2] += 1
    with pytest.raises(ExportError, match=r"step 2: the replayed observation differs"):
        Resimulator()(first_person)


def test_each_world_has_its_own_dataset(tmp_path):
    from minihuman.exporters import imitation

    items = chosen([played(world, number=number) for number, world in enumerate(WORLDS)])
    names = {path.name for path in imitation.export(iter(items), tmp_path).paths}
    assert names == {"minigrid-fourrooms-v0", "miniworld-fourrooms-v0", "minigrid-doorkey-5x5-v0"}


def lerobots_features(info):
    """The types that LeRobot's own ``get_hf_features_from_features`` (0.4.4) makes of ``info.json`` and casts to."""
    import datasets

    made = {}
    for name, feature in info["features"].items():
        if feature["dtype"] == "video":
            continue
        if feature["shape"] == [1]:
            made[name] = datasets.Value(feature["dtype"])
        else:
            made[name] = datasets.Sequence(datasets.Value(feature["dtype"]), length=feature["shape"][0])
    return datasets.Features(made)


def test_lerobot_files_cast_to_the_types_that_lerobot_makes_of_their_description(items, tmp_path):
    import datasets

    (root,) = lerobot.export(iter(items), tmp_path / "out").paths
    info = json.loads((root / "meta/info.json").read_text())
    files = [str(path) for path in sorted(root.glob("data/*/*.parquet"))]
    frames = datasets.Dataset.from_parquet(files, features=lerobots_features(info), cache_dir=str(tmp_path / "cache"))
    assert frames.num_rows == info["total_frames"]
    assert isinstance(frames[0]["discrete_action"], int)
    assert len(frames[0]["action"]) == len(info["features"]["action"]["names"])
    info["features"]["action"]["shape"] = [1]  # what was written before: a list of one, described as a scalar
    with pytest.raises(Exception, match=r"cast|convert|generating"):
        datasets.Dataset.from_parquet(files, features=lerobots_features(info), cache_dir=str(tmp_path / "other"))


def test_lerobot_statistics_are_those_of_the_frames(tmp_path):
    items = chosen([played(WORLDS[0], number=number, steps=40) for number in range(3)])
    (root,) = lerobot.export(iter(items), tmp_path).paths
    stats = json.loads((root / "meta/stats.json").read_text())
    frames = np.concatenate([(item.episode.t_ns[1:] - item.episode.t_ns[0]) / 1e9 for item in items])
    said = stats["time_s"]
    assert (said["min"], said["max"], said["count"]) == ([frames.min()], [frames.max()], [len(frames)])
    assert said["mean"] == pytest.approx([frames.mean()])
    assert said["std"] == pytest.approx([frames.std()])
    assert said["min"] < said["q01"] < said["q10"] < said["q50"] < said["q90"] < said["q99"] < said["max"]


def test_lerobot_card_has_front_matter(items, tmp_path):
    (root,) = lerobot.export(iter(items), tmp_path).paths
    front = (root / "README.md").read_text().split("---\n")[1]
    said = dict(line.split(": ", 1) for line in front.splitlines())
    assert json.loads(said["task_categories"]) == ["robotics"]
    assert json.loads(said["configs"])[0]["data_files"] == "data/*/*.parquet"
