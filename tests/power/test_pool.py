import csv
import math

import numpy as np
import pytest
from click.testing import CliRunner

from minihuman.cli.command_line import make_command_line
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.tables import select
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.planning.power import play_headless
from minihuman.planning.reaction_time_fit import fit_participants
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.human_like import HumanLikeParticipant
from tests.builders import session, write_log

PROTOCOL = """
[study]
name = "looking"
version = "1"
seed = 5
participants = 40
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
[[groups]]
name = "everyone"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = EPISODES
actions = ["left", "right", "forward"]
max_steps = 100
"""


def study(episodes):
    return decode_protocol(PROTOCOL.replace("EPISODES", str(episodes)).encode())


def participant(seed, index):
    """The very participant whom ``simulate`` seats there."""
    return HumanLikeParticipant("", np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,))))


@pytest.mark.program
def test_without_a_session_a_participant_plays_the_same_episodes(tmp_path):
    list(simulate(study(2), tmp_path, participants=2, seed=3, player="human-like"))
    for index, logged in enumerate(StudySessions(tmp_path, processes=1)):
        played = play_headless(logged.session.plan, participant(3, index), {})
        assert len(played) == 2
        assert [(one.outcome, one.reward, one.steps, one.limit) for one in played] == [
            (one.outcome_word, one.return_, len(one.actions), one.plan.max_steps) for one in logged.episodes
        ]
        assert all(one.shortest is not None and 0 < one.shortest <= one.limit for one in played)


@pytest.mark.program
def test_reaction_times_are_fitted_from_the_command_line(tmp_path):
    list(simulate(study(8), tmp_path, participants=2, seed=3, player="human-like"))
    out = tmp_path / "people.csv"
    command = ["fit", str(tmp_path / "looking"), "--out", str(out)]
    done = CliRunner().invoke(make_command_line(), command, catch_exceptions=False)
    assert done.exit_code == 0
    assert "human-like:mu_ms=" in done.output
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert {row["participant"] for row in rows} == {"sub-01", "sub-02"}
    bounds = {(row["participant"], row["parameter"]): (float(row["low"]), float(row["high"])) for row in rows}
    for row in rows:  # what so few presses cannot tell has no interval
        low, high = bounds[row["participant"], row["parameter"]]
        assert (math.isnan(low) and math.isnan(high)) or low <= float(row["value"]) <= high
    told = {parameter for (_, parameter), (low, _) in bounds.items() if not math.isnan(low)}
    assert {"mu_ms", "sigma_ms", "repeat_factor"} <= told


def test_an_excluded_participant_is_not_fitted(tmp_path):
    path = write_log(session(episodes=4, blocks=("grid",)), tmp_path)  # some 150 presses
    add_annotation(read_log(path), Annotation("exclude", "2026-11-23T09:00:00Z", note="the wrong person"))
    with (
        select(tmp_path, processes=1) as tables,
        pytest.raises(ReportError, match="no participant has enough key presses"),
    ):
        list(fit_participants(tables))
