"""`minihuman learn ppo`: it learns, its sums are right, and what it wrote plays."""

import csv
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from msgspec.structs import replace as replace_field

from minihuman.errors import LearnError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.learn.batch_ppo import BatchPpo
from minihuman.learn.curriculum import make_curriculum
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.network import build_policy
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.policy.players import PolicyAgent, PolicyPlayer
from minihuman.learn.training import train
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice
from minihuman.learn.training_worlds import BatchEncoder, SeatWorlds, TrainingLevel, make_worlds
from minihuman.worlds.adapters.world import World
from minihuman.worlds.team import make_team

EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"
SMALL = TrainingSettings(steps=256, worlds=4, rollout=16, minibatches=2, evaluation=0)


def train_in(world, out, settings, **options):
    return train(TrainingJob((WorldChoice(world, options),), settings), out)


@pytest.mark.parametrize("memory", [False, True], ids=["", "memory"])
def test_it_learns_and_what_it_wrote_plays_by_its_card(tmp_path, memory):
    settings = TrainingSettings(steps=16_000, worlds=16, rollout=64, learning_rate=2e-3, memory=memory, seed=3)
    report = train_in(EMPTY, tmp_path / "policy.pt", settings)
    curve = report.points
    assert report.evaluations[0].rate > 0.95, "in episodes that it was not trained in"
    assert curve[4].success < 0.9
    assert curve[-1].success > 0.95
    assert [point.steps for point in curve] == list(range(1024, curve[-1].steps + 1, 1024))
    with (tmp_path / "policy.csv").open(newline="") as file:
        assert [int(row["steps"]) for row in csv.DictReader(file)] == [point.steps for point in curve]
    policy, card = load_policy(tmp_path / "policy.pt")
    assert (card.world, card.memory, card.steps, policy.memory is not None) == (EMPTY, memory, curve[-1].steps, memory)
    player = PolicyPlayer(str(tmp_path / "policy.pt"), np.random.default_rng(5))
    world, solved = World(EMPTY, {}), 0
    plan = expand_one()
    for seed in range(10):
        world.reset(seed)
        player.begin(plan, (), world)
        for _ in range(40):
            result = world.step(world.action_names.index(plan.key_map.keys[player.press(world).key]))
            if result.terminated:
                solved += 1
                break
    assert solved >= 9


def expand_one():
    protocol = decode_protocol(
        f"""
        [study]
        name = "empty"
        version = "1"
        seed = 1
        [[groups]]
        name = "all"
        blocks = ["empty"]
        [[blocks]]
        name = "empty"
        world = "{EMPTY}"
        episodes = 1
        max_steps = 40
        actions = ["left", "right", "forward"]
        """.encode()
    )
    return expand_protocol(protocol, enrol_participant(protocol, 0)).episodes[0]


def make_run(settings=SMALL, **options):
    torch.manual_seed(1)
    worlds = make_worlds([WorldChoice(EMPTY, options)], settings.worlds, 1)
    space = ObservationEncoder(False).space(World(EMPTY, options).unwrapped)
    policy = build_policy(space, 7, "codes", memory=settings.memory)
    policy.action_net.weight.data *= 100  # else all actions are as likely at first
    run = BatchPpo(policy, worlds, make_curriculum(1, settings, 7), BatchEncoder(False, True), settings)
    run.begin()
    return run, policy


def test_advantages_are_those_of_gae_and_a_step_limit_is_no_end():
    run, policy = make_run(max_steps=10)
    rewards, ends = [], []
    step = run._worlds.step

    def watched(actions):
        given = step(actions)
        rewards.append(given.rewards.copy())
        ends.append((given.truncated & ~given.terminated, given.terminated.copy(), run._encode()))
        return given

    run._worlds.step = watched
    rollout = run._collect()
    values = rollout["values"].double().numpy()
    with torch.no_grad():
        last = policy.compute_outputs(run._observations)[1].squeeze(1).double().numpy()
        beyond = np.zeros_like(values)
        for t, (limited, _, shown) in enumerate(ends):
            for i in np.flatnonzero(limited):
                beyond[t, i] = float(policy.compute_outputs({"image": shown["image"][[i]]})[1])
    assert (beyond != 0).sum() >= 4
    following = np.vstack((values[1:], last))
    for i in range(SMALL.worlds):
        for begin in range(SMALL.rollout):  # the sum written out: until the episode ends, or the rollout
            total, weight = 0.0, 1.0
            for t in range(begin, SMALL.rollout):
                over = ends[t][0][i] or ends[t][1][i]
                behind = beyond[t, i] if over else following[t, i]
                total += weight * (rewards[t][i] + SMALL.gamma * behind - values[t, i])
                weight *= SMALL.gamma * SMALL.gae_lambda
                if over:
                    break
            assert float(rollout["advantages"][begin, i]) == pytest.approx(total, abs=1e-4)


def test_a_memory_goes_through_a_rollout_as_it_went_step_by_step_and_forgets_where_an_episode_begins():
    settings = TrainingSettings(steps=256, worlds=4, rollout=30, memory=True)
    run, policy = make_run(settings=settings, max_steps=7)
    hidden = run._hidden.clone()
    rollout = run._collect()
    assert rollout["starts"][1:].sum() >= 12
    seen = {"image": rollout["seen image"]}
    log_probs, values = policy.compute_sequence_outputs(seen, hidden, rollout["starts"])
    chosen = log_probs.gather(1, rollout["actions"].flatten()[:, None]).squeeze(1)
    torch.testing.assert_close(chosen, rollout["log_probs"].flatten(), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(values.squeeze(1), rollout["values"].flatten(), atol=1e-5, rtol=1e-4)
    again, _ = policy.compute_sequence_outputs(seen, hidden, torch.zeros_like(rollout["starts"]))
    assert not torch.allclose(again, log_probs, atol=1e-4)  # it does remember


def test_the_command_trains_and_refuses_what_has_no_batch_and_a_file_that_is_there(tmp_path):
    out = tmp_path / "made.pt"
    command = [sys.executable, "-m", "minihuman", "learn", "ppo", EMPTY, "--out", str(out), "--steps", "512"]
    trained = subprocess.run([*command, "--worlds", "4", "--evaluation", "3"], capture_output=True, text=True)
    assert trained.stdout.startswith(f"{out}: 512 steps, "), trained.stderr
    assert f"in 3 fresh episodes of {EMPTY}: success" in trained.stdout
    again = subprocess.run(command, capture_output=True, text=True)
    assert again.returncode == 2
    assert f"{out} already exists" in again.stderr
    out.unlink()
    again = subprocess.run(command, capture_output=True, text=True)
    assert f"{out.with_suffix('.csv')} already exists" in again.stderr, "a curve is not written over either"
    with pytest.raises(LearnError, match="device 'gpu' is not here"):
        train_in(EMPTY, tmp_path / "other.pt", replace(SMALL, device="gpu"))
    with pytest.raises(LearnError, match="an image with"):
        train_in("FrozenLake-v1", tmp_path / "other.pt", SMALL)


@pytest.mark.parametrize("world", ["minihuman/Team-CrampedRoom-v0", "minihuman/Team-FourRooms-v0"])
def test_a_policy_that_played_with_itself_sees_in_a_seat_what_it_saw_in_training(tmp_path, world):
    settings = TrainingSettings(steps=512, worlds=8, rollout=32)
    assert train_in(world, tmp_path / "team.pt", settings).points[-1].steps == 512
    agent = PolicyAgent(str(tmp_path / "team.pt"))
    _, card = load_policy(tmp_path / "team.pt")
    seats = SeatWorlds(make_team(world), 8, 256)
    seats.begin(range(8), [TrainingLevel(0, 9)] * 8)
    at = World(world, {"seat": 1})
    at.reset(5)
    at.unwrapped.team.restore(seats._batch._worlds[2].save() if seats._batch._worlds else at.unwrapped.team.save())
    agent.begin(replace_field(expand_one(), world=world), at)
    assert agent.action_probabilities(at).sum() == pytest.approx(1, abs=1e-5)
    raw = at.unwrapped.team.observation(1)
    np.testing.assert_array_equal(raw, seats.images[5])  # the third world's second seat
    seen = card.eyesight.episode_encoder().encode(at.unwrapped, raw)
    np.testing.assert_array_equal(seen["image"], BatchEncoder(False, False).encode(seats)["image"][5].numpy())


def test_seats_share_their_worlds_rewards_and_the_pay_for_useful_steps_falls_to_nothing():
    seats = SeatWorlds(make_team("minihuman/Team-CrampedRoom-v0"), 16, 2_000)
    apart = make_team("minihuman/Team-CrampedRoom-v0").batch(8)
    seats.begin(range(16), [TrainingLevel(0, 1)] * 16)
    apart.reset(seed=1)
    rng, paid = np.random.default_rng(2), [0.0, 0.0]
    for step in range(250):
        actions = rng.integers(0, 6, 16)
        rewards, over, limited = seats.step(actions)
        observations, joint, ends = apart.step(actions.reshape(8, 2))
        left = max(0.0, 1 - 16 * step / 2_000)
        np.testing.assert_allclose(rewards.reshape(8, 2), joint + left * apart.shaping)
        np.testing.assert_array_equal(seats.images.reshape(observations.shape), observations)
        np.testing.assert_array_equal(over, np.repeat(ends, 2))
        assert not limited.any()
        paid[step >= 125] += float((rewards.reshape(8, 2) - joint).sum())
    assert paid[0] > 0
    assert paid[1] == 0


def test_a_level_is_scored_by_the_size_of_the_advantages_in_its_episode():
    run, _ = make_run(replace(SMALL, curriculum="plr"), max_steps=5)
    first = [episode.level for episode in run._playing]
    rollout = run._collect()
    ended = list(run._ended_levels)
    scores = []
    run._curriculum.score = lambda level, score: scores.append((level, score))
    run._score_levels(rollout)
    assert [level for level, _ in scores] == [level for _, level in ended]
    assert len(scores) == int(rollout["starts"][1:].sum() + run._starts.sum()) >= 3 * SMALL.worlds
    for number, level in enumerate(first):
        end = 1 + int(rollout["starts"][1:, number].argmax())  # the first episodes are five steps long or shorter
        mean = float(rollout["advantages"][:end, number].abs().mean())
        assert dict(reversed(scores))[level] == pytest.approx(mean, rel=1e-5)
    run._score_levels(run._collect())
    assert len(scores) >= 6 * SMALL.worlds, "and once more in the next rollout"
