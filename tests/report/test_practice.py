"""Practice: recorded and shown as all blocks are, and in no comparison, count or value of a participant."""

import re
from pathlib import Path

import pandas as pd
import pytest

from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.tables import select
from minihuman.errors import ProtocolError, ReportError
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.reporting.analysed_rows import find_practice
from minihuman.runtime.simulated_session import simulate
from tests.report.reports import write_report

PROTOCOL = """
[study]
name = "trained"
version = "{version}"
seed = 3
participants = 8
[keys]
check = false
[[groups]]
name = "a"
blocks = ["warm-up", "walk"]
[[groups]]
name = "b"
blocks = ["warm-up", "walk"]
[[blocks]]
name = "warm-up"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 3
actions = ["left", "right", "forward"]
max_steps = 20
analysed = {analysed}
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
[[exclusions]]
reason = "too few episodes"
level = "participant"
measure = "episodes"
below = 3
{more}
"""


def protocol(*, analysed: str = "false", version: str = "1", more: str = "") -> Protocol:
    return decode_protocol(PROTOCOL.format(analysed=analysed, version=version, more=more).encode())


@pytest.fixture(scope="module", params=["false", "true"])
def study(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[bool, Path]:
    data = tmp_path_factory.mktemp("data")
    for _ in simulate(protocol(analysed=request.param), data, participants=4, seed=1, player="random"):
        pass
    return request.param == "true", data / "trained"


@pytest.mark.program
def test_practice_counts_for_no_participant_and_its_rows_are_kept(study: tuple[bool, Path]) -> None:
    analysed, folder = study
    with StudyStore(StudySessions(folder, processes=1), with_shortest=False) as store:
        tables = {name: store.tables.table(name).to_pandas() for name in ("participants", "episodes", "blocks")}
    expected = (5, "") if analysed else (2, "too few episodes")
    participants: pd.DataFrame = tables["participants"].fillna({"exclusion_reason": ""})
    assert [tuple(row) for row in participants[["episodes", "exclusion_reason"]].to_numpy()] == [expected] * 4
    assert tables["episodes"]["block"].value_counts().to_dict() == {"warm-up": 12, "walk": 8}
    assert set(tables["blocks"]["block"]) == {"warm-up", "walk"}


@pytest.mark.program
def test_the_report_names_practice_and_compares_it_nowhere(tmp_path: Path) -> None:
    toml = PROTOCOL.format(analysed="false", version="1", more="").replace("below = 3", "below = 1")
    for _ in simulate(decode_protocol(toml.encode()), tmp_path, participants=4, seed=1, player="random"):
        pass
    page, *others = write_report(select(tmp_path / "trained", processes=1), tmp_path / "out")
    text = re.sub(r"\s+", " ", page.read_text())
    assert "block warm-up (12 episodes)." in text
    assert "4 participants and 8 episodes are included" in text
    assert "Block walk</h2>" in text
    assert "Block warm-up</h2>" not in text
    assert "Block warm-up: practice, not analysed: 3 episodes in" in text
    assert not [path.name for path in others if path.name.startswith("warm-up")]


def test_practice_is_not_what_groups_are_compared_on() -> None:
    with pytest.raises(ProtocolError, match=r"\$\.analysis\.block is 'warm-up', which has analysed = false"):
        protocol(more='[analysis]\nblock = "warm-up"')


def test_versions_that_do_not_agree_on_practice_are_not_pooled() -> None:
    one, other = protocol(), protocol(analysed="true", version="2")
    assert find_practice([one], ["a", "b"]) == {("a", "warm-up"), ("b", "warm-up")}
    assert find_practice([other], ["a", "b"]) == frozenset()
    with pytest.raises(ReportError, match=r"analyse different blocks \(warm-up\); choose one version with --version"):
        find_practice([one, other], ["a"])
