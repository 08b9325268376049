"""What the report says it asked and counted: by the plan, whoever is left; teams as teams."""

import pandas as pd
import pytest

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign, Factor
from minihuman.reporting.block_results import compute_block_results
from minihuman.reporting.results import Results, compute_results
from minihuman.reporting.statements import difference_statement
from minihuman.reporting.study_question import ask_question
from minihuman.statistics.comparison import compare_groups
from tests.report.test_results import played

TWO_GROUPS = ExperimentDesign((Factor("group", ("a", "b"), is_within=False),))
NOTHING = "nothing is compared between groups."


def results_without(excluded: tuple[str, ...]) -> Results:
    """The results of a study of two groups, some of whose people are all excluded."""
    rows, episodes = played(3)
    episodes = episodes.assign(block="grid")
    people = rows[["participant", "group"]]
    reasons = people["group"].map(lambda group: "asleep" if group in excluded else None)
    return compute_results(
        episodes.assign(exclusion_reason=episodes["group"].map(lambda group: "asleep" if group in excluded else None)),
        rows.assign(exclusion_reason=reasons),
        people.assign(exclusion_reason=reasons),
    )


@pytest.mark.parametrize("design", [TWO_GROUPS, ExperimentDesign(), None])  # none where versions have different ones
def test_a_study_of_two_groups_is_never_called_one_of_one(design: ExperimentDesign | None) -> None:
    analysis = AnalysisSpec()
    assert ask_question(analysis, results_without(("a", "b")), design) == "Nobody is included: nothing is compared."
    only_b = ask_question(analysis, results_without(("a",)), design)
    assert only_b == f"Of groups a and b only b has included participants: {NOTHING}"
    assert "groups a and b in block grid" in ask_question(analysis, results_without(()), design)


def test_a_study_of_one_group_says_so() -> None:
    rows, episodes = played(3)
    frames = (episodes.assign(block="grid"), rows, rows)
    alone = [frame[frame["group"] == "a"].assign(exclusion_reason=None) for frame in frames]
    assert ask_question(AnalysisSpec(), compute_results(*alone), ExperimentDesign()) == f"One group: {NOTHING}"


@pytest.mark.parametrize(
    ("pairs", "sizes"),
    [
        (("a",), "3 teams and 6 participants)"),
        (("a", "b"), "3 and 3 teams)"),
        ((), "6 and 6 participants)"),
    ],
)
def test_teams_are_called_teams_in_the_sentence_on_their_difference(pairs: tuple[str, ...], sizes: str) -> None:
    rows, episodes = played(6)
    units = {f"{group}-{number}": f"team-{group}-{number // 2}" for group in pairs for number in range(6)}
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec(), units)
    assert sizes in difference_statement(block.headline[0], block.block, block.team_units)


def test_a_group_of_teams_and_of_people_without_a_partner_is_called_both() -> None:
    rows, episodes = played(6)
    units = {"a-0": "team", "a-1": "team"}
    block = compute_block_results("grid", rows, episodes, ["a", "b"], AnalysisSpec(), units)
    sentence = difference_statement(block.headline[0], block.block, block.team_units)
    assert "5 teams and participants and 6 participants)" in sentence


def test_where_nobody_differs_the_answer_says_so_instead_of_a_p() -> None:
    rows = pd.DataFrame({"group": [*"aaaaabbbbb"], "success": 1.0})
    (comparison,) = compare_groups(rows, ["success"])
    assert difference_statement(comparison, "room") == (
        "Success rate, block room: a minus b is 0, and was not tested (nobody in either group differs from the others; "
        "5 and 5 participants)."
    )
