import csv

import pytest
from click.testing import CliRunner

from minihuman.cli.command_line import make_command_line

pytestmark = pytest.mark.program

PROTOCOL = """
[study]
name = "small"
version = "1"
seed = 5
participants = 4
[keys]
pool = ["1", "2", "3"]
[[groups]]
name = "one"
blocks = ["grid"]
[[groups]]
name = "other"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-Empty-6x6-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 60
"""


def test_a_protocols_power_is_told_written_and_drawn(tmp_path):
    app = make_command_line()
    protocol = tmp_path / "small.toml"
    protocol.write_text(PROTOCOL)
    options = ["--effect", "excess=0.5", "--groups", "3,6", "--studies", "20", "--people", "4"]
    done = CliRunner().invoke(
        app, ["power", str(protocol), *options, "--out", str(tmp_path / "out")], catch_exceptions=False
    )
    assert done.exit_code == 0
    assert "block grid" in done.output
    assert "group other, player human-like" in done.output
    with (tmp_path / "out" / "power.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["participants_a_group"] for row in rows] == ["3", "6"]
    assert all(0 <= float(row["low"]) <= float(row["power"]) <= float(row["high"]) <= 1 for row in rows)
    assert (tmp_path / "out" / "power.png").stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "small.toml"]
