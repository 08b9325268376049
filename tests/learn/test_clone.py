import json
from dataclasses import replace

import numpy as np
import pytest
import torch

import fine_tuning
from cloning_curve import run_cloning_curve
from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.behaviour_cloning import (
    CloneStudy,
    CloningSettings,
    clone_policy,
    clone_study,
    evaluate_policy,
    held_out_seed,
    make_random_policy,
    make_sampling_policy,
    split_by_participant,
)
from minihuman.learn.demonstrations import read_demonstrations
from minihuman.learn.policy.file import load_policy, save_atomically, save_policy
from minihuman.learn.policy.observation import ObservationEncoder, encode_whole_grid
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from tests.disks import fill, small_disk

pytestmark = pytest.mark.program

FOUR_ROOMS = "minihuman/MiniGrid-FourRooms-v0"
PROTOCOL = f"""
[study]
name = "clones"
version = "1.0"
seed = 3
participants = 20

[keys]
pool = ["1", "2", "3"]

[[groups]]
name = "everyone"
blocks = ["grid"]

[[blocks]]
name = "grid"
world = "{FOUR_ROOMS}"
episodes = 4
actions = ["left", "right", "forward"]
max_steps = 100
key_map = "shown"
view = "full"
"""
WHOLE = ObservationEncoder(missions=False, sight="whole")
QUICK = CloningSettings(most_epochs=12, mirrored=True)
STUDY = CloneStudy(FOUR_ROOMS, sight="whole", evaluation_episodes=15, cloning=QUICK)


@pytest.fixture(scope="module")
def protocol(tmp_path_factory):
    path = tmp_path_factory.mktemp("protocol") / "clones.toml"
    path.write_text(PROTOCOL)
    return path


@pytest.fixture(scope="module")
def logs(protocol, tmp_path_factory):
    """Four participants of four episodes each, who take the shortest way."""
    data = tmp_path_factory.mktemp("data")
    list(simulate(read_protocol(protocol), data, participants=4, seed=1, player="optimal"))
    return data


@pytest.fixture(scope="module")
def demonstrations(logs):
    return read_demonstrations(logs, FOUR_ROOMS, WHOLE, Selection())


@pytest.fixture(scope="module")
def cloned(logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("clone") / "clone.pt"
    return out, clone_study(logs, out, STUDY, command="test")


def test_demonstrations_hold_what_was_done_and_seen(logs, demonstrations):
    played = [episode for log in sorted(logs.rglob("*.mcap")) for episode in read_log(log).episodes]
    assert len(demonstrations.episodes) == len(played) == 16
    assert sorted(map(len, (e.actions for e in played))) == sorted(len(d.observations) for d in demonstrations.episodes)
    assert demonstrations.action_names == ("left", "right", "forward")
    for demonstration in demonstrations.episodes:
        # the last step is onto the goal, which is straight ahead: above the middle
        assert demonstration.actions[-1] == 2
        assert demonstration.observations[-1]["image"][0, 18, 17] == 8 * 25


def test_nobody_is_in_both_halves_of_the_split(demonstrations):
    training, validation = split_by_participant(demonstrations, share=0.2, seed=1)
    assert not set(training.participants) & set(validation.participants)
    assert len(training.participants) == 3
    assert len(training.episodes) + len(validation.episodes) == 16


def test_the_first_demonstrations_take_turns_between_participants(demonstrations):
    assert [episode.participant for episode in demonstrations.first(5).episodes] == [
        *demonstrations.participants,
        demonstrations.participants[0],
    ]


def test_a_clone_agrees_with_people_it_has_not_seen_and_beats_chance(demonstrations):
    training, validation = split_by_participant(demonstrations, share=0.2, seed=1)
    policy, found = clone_policy(training, validation, eyes="map", settings=QUICK)
    assert found.validation_loss < np.log(3)
    plays = [
        evaluate_policy(choose, FOUR_ROOMS, {}, WHOLE, episodes=15, seed=1)
        for choose in (make_sampling_policy(policy, 1), make_random_policy(3, 1))
    ]
    assert plays[0].rate > plays[1].rate


def test_the_same_seed_gives_the_same_clone(demonstrations):
    training, validation = split_by_participant(demonstrations, share=0.2, seed=1)
    settings = CloningSettings(most_epochs=2)
    weights = [clone_policy(training, validation, eyes="map", settings=settings)[0].state_dict() for _ in range(2)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


def test_held_out_episodes_are_not_training_episodes():
    assert min(held_out_seed(1, episode) for episode in range(100)) >= 2**31


def test_a_policy_for_which_a_disk_has_no_room_is_named_and_not_there(tmp_path):
    with small_disk(tmp_path, 1 << 16):
        ballast = fill(tmp_path, but=0)
        with pytest.raises(OSError, match="No space left on device") as refused:
            save_atomically({"weights": torch.zeros(100_000)}, tmp_path / "policy.pt")
        assert refused.value.filename == str(tmp_path / "policy.pt")
        assert list(tmp_path.iterdir()) == [ballast]


def test_what_is_ahead_is_above_the_middle():
    import gymnasium

    from minihuman.worlds.grid.core.cells import kind_of
    from minihuman.worlds.grid.core.rewards import cell_in_front

    world = gymnasium.make(FOUR_ROOMS, disable_env_checker=True).unwrapped
    for seed in range(12):
        world.reset(seed=seed)
        x, y = cell_in_front(world.state.row)
        assert encode_whole_grid(world)[18, 17, 0] == kind_of(world.state.cells)[x, y]


def test_the_card_says_how_well_it_does_and_from_what(cloned):
    out, text = cloned
    assert out.with_name("clone.pt.md").read_text() == text
    assert "| chance |" in text
    numbers = json.loads(out.with_name("clone.pt.json").read_text())
    (row,) = numbers["rows"]
    assert row["demonstrations"] == row["cloned"]["training_episodes"]
    low, high = row["interval"]
    assert low <= row["success"] <= high


def test_a_clone_plays_a_session_and_its_log_says_so(cloned, protocol, tmp_path):
    out, _ = cloned
    (path,) = simulate(read_protocol(protocol), tmp_path, participants=1, seed=2, player=f"policy:{out}")
    log = read_log(path)
    assert log.player == f"policy:{out}"
    assert len(log.episodes) == 4
    assert all(len(episode.actions) for episode in log.episodes)


def test_fine_tuning_is_told_apart_from_nothing(cloned, tmp_path, monkeypatch):
    out = tmp_path / "tuned.pt"
    monkeypatch.setattr("sys.argv", ["fine_tuning.py", str(cloned[0]), str(out), "--steps", "2048"])
    fine_tuning.main()
    text = out.with_name("tuned.pt.md").read_text()
    assert "| clone |" in text
    assert "| nothing |" in text
    policy, card = load_policy(out)
    assert card.trained_by == "cloning, then ppo"
    before = load_policy(cloned[0])[0].state_dict()
    assert any(not torch.equal(before[name], value) for name, value in policy.state_dict().items())


def test_a_policy_for_another_world_is_refused_in_one_line(cloned, protocol, tmp_path):
    out, _ = cloned
    other = tmp_path / "other.toml"
    other.write_text(PROTOCOL.replace("FourRooms", "GoToObj-Transfer"))
    with pytest.raises(LearnError, match="was trained in minihuman/MiniGrid-FourRooms-v0, but block 'grid' plays"):
        list(simulate(read_protocol(other), tmp_path / "data", participants=1, seed=2, player=f"policy:{out}"))


def test_a_folder_of_policies_plays_each_world_with_the_file_that_was_trained_in_it(cloned, protocol, tmp_path):
    """One file names the world as another of its own; the first by name was trained elsewhere."""
    policy, card = load_policy(cloned[0])
    away = replace(card, world="minihuman/MiniGrid-Empty-8x8-v0")
    folder = tmp_path / "policies"
    folder.mkdir()
    save_policy(policy, away, folder / "a.pt")
    with pytest.raises(LearnError, match=r"a\.pt was trained in minihuman/MiniGrid-Empty-8x8-v0, but"):
        list(simulate(read_protocol(protocol), tmp_path / "one", participants=1, seed=2, player=f"policy:{folder}"))
    save_policy(policy, replace(away, other_worlds=(card.world,)), folder / "b.pt")
    (path,) = simulate(read_protocol(protocol), tmp_path, participants=1, seed=2, player=f"policy:{folder}")
    (alone,) = simulate(read_protocol(protocol), tmp_path / "two", participants=1, seed=2, player=f"policy:{cloned[0]}")
    played, expected = ([list(episode.actions) for episode in read_log(one).episodes] for one in (path, alone))
    assert played == expected


@pytest.mark.parametrize(
    ("name", "content"), [("missing.pt", None), ("text.pt", b"no policy"), ("empty.pt", b"")], ids=lambda v: str(v)
)
def test_a_file_that_is_no_policy_is_refused(tmp_path, name, content):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(LearnError, match=name):
        load_policy(tmp_path / name)


def test_a_dataset_without_matching_episodes_is_refused_and_writes_nothing(logs, tmp_path):
    out = tmp_path / "clone.pt"
    study = CloneStudy("minihuman/MiniWorld-FourRooms-v0")
    with pytest.raises(LearnError, match="has no included episode of minihuman/MiniWorld-FourRooms-v0"):
        clone_study(logs, out, study, command="test")
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_is_not_overwritten(cloned, logs):
    out, _ = cloned
    before = out.read_bytes()
    with pytest.raises(LearnError, match="already exists"):
        clone_study(logs, out, STUDY, command="test")
    assert out.read_bytes() == before


def test_one_participant_cannot_be_split(demonstrations):
    with pytest.raises(LearnError, match=r"only one participant or team, .*needs two or more"):
        split_by_participant(demonstrations.by(demonstrations.participants[:1]), share=0.2, seed=1)


@pytest.mark.parametrize("size", [0, -5])
def test_no_demonstrations_are_no_size_to_try(size, logs, tmp_path):
    study = replace(STUDY, sizes=(size, 5))
    with pytest.raises(LearnError, match=f"{size} is not a valid number of demonstrations; use 1 or more"):
        clone_study(logs, tmp_path / "clone.pt", study, command="test")


def test_a_fine_tuning_in_which_no_episode_ended_is_told_as_such():
    runs = [fine_tuning.TrainingStart(start, 3, []) for start in ("nothing", "clone")]
    assert "| clone | 3 | not reached | - |" in fine_tuning.describe(runs, steps=2048, success=0.9).splitlines()


def test_a_curve_that_goes_on_has_no_clone_twice(demonstrations, tmp_path):
    settings = {"seeds": [1], "eyes": "map", "episodes": 2, "settings": CloningSettings(most_epochs=1)}
    made = [
        run_cloning_curve({"people": demonstrations}, sizes=[4, 500, 900], kept=tmp_path / "points.json", **settings)
        for _ in range(2)
    ]
    assert made[0] == made[1]
    assert [point.demonstrations for point in made[0]] == [4, 12]  # of 16 those of the one who is held out are not
