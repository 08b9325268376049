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
from minihuman.learn.batch_ppo import BatchPpoSettings, _make_batch, _Run, _Seats, train_batch
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.network import build_policy
from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.policy.players import PolicyAgent, PolicyPlayer
from minihuman.worlds.adapters.world import World
from minihuman.worlds.team import make_team

EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"
SMALL = BatchPpoSettings(steps=256, worlds=4, rollout=16, minibatches=2)


@pytest.mark.parametrize("memory", [False, True], ids=["", "memory"])
def test_it_learns_and_what_it_wrote_plays_by_its_card(tmp_path, memory):
    settings = BatchPpoSettings(steps=16_000, worlds=16, rollout=64, learning_rate=2e-3, memory=memory)
    curve = train_batch(EMPTY, tmp_path / "policy.pt", settings, seed=3)
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


def make_run(world=EMPTY, settings=SMALL, **options):
    torch.manual_seed(1)
    batch = _make_batch(world, settings.worlds, **options)
    space = ObservationEncoder(False).space(World(world, options).unwrapped)
    policy = build_policy(space, int(batch.single_action_space.n), "codes", memory=settings.memory)
    policy.action_net.weight.data *= 100  # else all actions are as likely at first
    return _Run(policy, batch, True, False, settings, 7), policy


def test_advantages_are_those_of_gae_and_a_step_limit_is_no_end():
    run, policy = make_run(max_steps=10)
    rewards, truncated = [], []
    step = run._worlds.step

    def watched(actions):
        given = step(actions)
        rewards.append(np.asarray(given[1], np.float64).copy())
        truncated.append((given[3] & ~given[2], given[2].copy(), given[4]))
        return given

    run._worlds.step = watched
    rollout = run._collect()
    values = rollout["values"].double().numpy()
    with torch.no_grad():
        last = policy.think(run._observations)[1].squeeze(1).double().numpy()
        beyond = np.zeros_like(values)
        for t, (limited, _, infos) in enumerate(truncated):
            for i in np.flatnonzero(limited):
                beyond[t, i] = float(policy.think(run._encode([infos["final_obs"][i]]))[1])
    assert (beyond != 0).sum() >= 4
    following = np.vstack((values[1:], last))
    for i in range(SMALL.worlds):
        for begin in range(SMALL.rollout):  # the sum written out: until the episode ends, or the rollout
            total, weight = 0.0, 1.0
            for t in range(begin, SMALL.rollout):
                over = truncated[t][0][i] or truncated[t][1][i]
                behind = beyond[t, i] if over else following[t, i]
                total += weight * (rewards[t][i] + SMALL.discount * behind - values[t, i])
                weight *= SMALL.discount * SMALL.trace
                if over:
                    break
            assert float(rollout["advantages"][begin, i]) == pytest.approx(total, abs=1e-4)


def test_a_memory_goes_through_a_rollout_as_it_went_step_by_step_and_forgets_where_an_episode_begins():
    settings = BatchPpoSettings(steps=256, worlds=4, rollout=30, memory=True)
    run, policy = make_run(settings=settings, max_steps=7)
    hidden = run._hidden.clone()
    rollout = run._collect()
    assert rollout["starts"][1:].sum() >= 12
    seen = {"image": rollout["seen image"]}
    log_probs, values = policy.think_through(seen, hidden, rollout["starts"])
    chosen = log_probs.gather(1, rollout["actions"].flatten()[:, None]).squeeze(1)
    torch.testing.assert_close(chosen, rollout["log_probs"].flatten(), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(values.squeeze(1), rollout["values"].flatten(), atol=1e-5, rtol=1e-4)
    again, _ = policy.think_through(seen, hidden, torch.zeros_like(rollout["starts"]))
    assert not torch.allclose(again, log_probs, atol=1e-4)  # it does remember


def test_the_command_trains_and_refuses_what_has_no_batch_and_a_file_that_is_there(tmp_path):
    out = tmp_path / "made.pt"
    command = [sys.executable, "-m", "minihuman", "learn", "ppo", EMPTY, "--out", str(out), "--steps", "512"]
    trained = subprocess.run([*command, "--worlds", "4"], capture_output=True, text=True)
    assert trained.stdout.startswith(f"{out}: 512 steps, "), trained.stderr
    again = subprocess.run(command, capture_output=True, text=True)
    assert again.returncode == 2
    assert f"{out} already exists" in again.stderr
    out.unlink()
    again = subprocess.run(command, capture_output=True, text=True)
    assert f"{out.with_suffix('.csv')} already exists" in again.stderr, "a curve is not written over either"
    with pytest.raises(LearnError, match="device 'gpu' is not here"):
        train_batch(EMPTY, tmp_path / "other.pt", replace(SMALL, device="gpu"))
    for world, said in (("minigrid:MiniGrid-Empty-5x5-v0", "has no batch of worlds"), ("CartPole-v1", "an image with")):
        with pytest.raises(LearnError, match=said):
            train_batch(world, tmp_path / "other.pt", SMALL)


@pytest.mark.parametrize("world", ["minihuman/Team-CrampedRoom-v0", "minihuman/Team-FourRooms-v0"])
def test_a_policy_that_played_with_itself_sees_in_a_seat_what_it_saw_in_training(tmp_path, world):
    settings = BatchPpoSettings(steps=512, worlds=8, rollout=32)
    curve = train_batch(world, tmp_path / "team.pt", settings)
    assert curve[-1].steps == 512
    agent = PolicyAgent(str(tmp_path / "team.pt"))
    policy, card = load_policy(tmp_path / "team.pt")
    seats = _Seats(make_team(world), settings)
    run = _Run(policy, seats, card.eyes == "codes", False, settings, 4)
    trained, _ = seats.reset(seed=9)
    at = World(world, {"seat": 1})
    at.reset(5)
    at.unwrapped.team.restore(seats._batch._worlds[2].save() if seats._batch._worlds else at.unwrapped.team.save())
    agent.begin(replace_field(expand_one(), world=world), at)
    assert agent.action_probabilities(at).sum() == pytest.approx(1, abs=1e-5)
    raw = at.unwrapped.team.observation(1)
    np.testing.assert_array_equal(raw, trained[5])  # the third world's second seat
    seen = card.eyesight.episode_encoder().encode(at.unwrapped, raw)
    np.testing.assert_array_equal(seen["image"], run._encode(trained)["image"][5].numpy())


def test_seats_share_their_worlds_rewards_and_the_pay_for_useful_steps_falls_to_nothing():
    settings = BatchPpoSettings(steps=4_000, worlds=16)
    seats = _Seats(make_team("minihuman/Team-CrampedRoom-v0"), settings)
    apart = make_team("minihuman/Team-CrampedRoom-v0").batch(8)
    seats.reset(seed=1)
    apart.reset(seed=1)
    rng, paid = np.random.default_rng(2), [0.0, 0.0]
    for step in range(250):
        actions = rng.integers(0, 6, 16)
        seen, rewards, over, limited, _ = seats.step(actions)
        observations, joint, ends = apart.step(actions.reshape(8, 2))
        left = max(0.0, 1 - 16 * step / 2_000)
        np.testing.assert_allclose(rewards.reshape(8, 2), joint + left * apart.shaping)
        np.testing.assert_array_equal(seen.reshape(observations.shape), observations)
        np.testing.assert_array_equal(over, np.repeat(ends, 2))
        assert not limited.any()
        paid[step >= 125] += float((rewards.reshape(8, 2) - joint).sum())
    assert paid[0] > 0
    assert paid[1] == 0
