"""What `learn ppo` is asked for: job files and options, networks, and a researcher's own world."""

import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

from minihuman.cli.training_options import compose_job
from minihuman.errors import LearnError
from minihuman.learn.policy.file import load_policy
from minihuman.learn.training import train
from minihuman.learn.training_settings import TrainingJob, TrainingSettings, WorldChoice, read_job
from tests.worlds.grid.own_world_examples import Patrol

EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"
MAZE = """
import gymnasium
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import goal

class Maze(GridWorld):
    def __init__(self, **options):
        super().__init__(width=5, height=5, max_steps=20, mission="go", **options)

    def layout(self, grid):
        grid.wall_rect()
        grid.place(goal())
        grid.place_agent()

gymnasium.register("my/Maze-v0", entry_point=Maze, vector_entry_point=Maze.vector)
"""
JOBS = sorted(
    path for path in Path(__file__).parents[2].joinpath("analysis/ppo").glob("*.toml") if "people.toml" not in path.name
)


def test_options_win_over_the_file_and_an_option_of_worlds_is_of_all_of_them(tmp_path):
    path = tmp_path / "job.toml"
    path.write_text(
        f'gamma = 0.9\nclip = 0.1\nhidden = [32, 16]\n[[world]]\nid = "{EMPTY}"\noptions = {{ max_steps = 9 }}\n'
        f'[[world]]\nid = "minihuman/MiniGrid-Empty-6x6-v0"\n'
    )
    job = compose_job([], path, ["agent_view_size=5", "see_through_walls=true"], {"clip": 0.3})
    assert (job.settings.gamma, job.settings.clip, job.settings.hidden) == (0.9, 0.3, (32, 16))
    shared = {"agent_view_size": 5, "see_through_walls": True}
    assert [choice.options for choice in job.worlds] == [{"max_steps": 9, **shared}, shared]
    other = compose_job([EMPTY], path, [], {})
    assert other.worlds == (WorldChoice(EMPTY),)


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("gamma = 1.5", r"job\.toml: gamma is 1\.5; use 0 to 1"),
        ("discount = 0.9", r"job\.toml: 'discount' is not a setting; use world or one of steps, worlds, "),
        ("steps = 'many'", r"job\.toml: steps is 'many': Expected `int`, got `str`"),
        ("steps = ", r"job\.toml is not TOML"),
        ("steps = 5", r"job\.toml: no world to train in is named"),
        ("hidden = []", r"job\.toml: hidden is \[\]; name one or more sizes"),
        ("memory = true\nworlds = 2", r"minibatches is 4, but with a memory each needs a world of 2; use fewer"),
    ],
)
def test_what_a_job_gets_wrong_is_named(tmp_path, toml, message):
    (tmp_path / "job.toml").write_text(toml)
    with pytest.raises(LearnError, match=message):
        read_job(tmp_path / "job.toml")


@pytest.mark.parametrize("path", JOBS, ids=lambda path: path.stem)
def test_committed_jobs_can_be_read(path):
    assert read_job(path).worlds


@pytest.mark.parametrize(
    ("world", "network", "eyes"),
    [
        (EMPTY, "cnn", "near"),
        (EMPTY, "auto", "codes"),
        ("minihuman/MiniWorld-OneRoom-v0", "mlp", "flat"),
        ("minihuman/Team-FourRooms-v0", "cnn", "near cells"),
    ],
)
def test_each_network_is_trained_saved_and_loaded(tmp_path, world, network, eyes):
    settings = TrainingSettings(
        steps=16, worlds=2, rollout=8, minibatches=2, network=network, hidden=(24,), evaluation=0
    )
    train(TrainingJob((WorldChoice(world),), settings), tmp_path / "policy.pt")
    policy, card = load_policy(tmp_path / "policy.pt")
    assert (card.eyes, card.hidden) == (eyes, (24,))
    assert policy.action_net.in_features == 24


def test_an_own_world_is_trained_in_by_its_compiled_rules_with_options(tmp_path):
    gymnasium.register("minihuman-test/Job-Patrol-v0", entry_point=Patrol)
    choice = WorldChoice("minihuman-test/Job-Patrol-v0", {"coins_to_collect": 1})
    settings = TrainingSettings(steps=512, worlds=8, rollout=32, evaluation=4)
    report = train(TrainingJob((choice,), settings), tmp_path / "policy.pt")
    _, card = load_policy(tmp_path / "policy.pt")
    assert (card.world, card.world_options, card.eyes) == (choice.id, choice.options, "cells"), "own kinds are seen"
    assert report.evaluations[0].episodes == 4
    del gymnasium.registry["minihuman-test/Job-Patrol-v0"]


@pytest.mark.program
def test_a_module_beside_the_job_runs_only_if_it_is_trusted(tmp_path):
    (tmp_path / "my_maze.py").write_text(MAZE)
    job = tmp_path / "job.toml"
    job.write_text('steps = 64\nworlds = 4\nrollout = 16\nevaluation = 0\n[[world]]\nid = "my_maze:my/Maze-v0"\n')
    command = [sys.executable, "-m", "minihuman", "learn", "ppo", "--job", str(job), "--out", str(tmp_path / "p.pt")]
    refused = subprocess.run(command, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "which is not trusted; if you trust it, add --trust" in refused.stderr
    trained = subprocess.run([*command, "--trust"], capture_output=True, text=True)
    assert "p.pt: 64 steps" in trained.stdout, trained.stderr
