import numpy as np
import pandas as pd

from minihuman.reporting.instruction_clauses import clauses_table, count_clauses
from tests.report.pages import page


def tables():
    """One does both clauses of an episode, the other one of two, in a second attempt: the first was broken off."""
    episodes = pd.DataFrame(
        [
            ("s1", 1, 1, 1, "several", "a", None),
            ("s2", 1, 1, 1, "several", "a", "abandoned"),
            ("s2", 1, 2, 1, "several", "a", None),
            ("s1", 1, 1, 2, "rooms", "a", None),
        ],
        columns=["participant", "session", "segment", "episode", "block", "group", "exclusion_reason"],
    )
    said = "open the red door, then put a ball next to the box"
    starts = episodes.drop(columns=["block", "group", "exclusion_reason"]).assign(
        mission=[said, said, said, "reach the goal"]
    )
    done = pd.DataFrame(
        [("s1", 1, 1, 1, 1, 4), ("s1", 1, 1, 1, 2, 20), ("s2", 1, 1, 1, 1, 90), ("s2", 1, 2, 1, 1, 8)],
        columns=["participant", "session", "segment", "episode", "clause", "step"],
    )
    return episodes, starts, done


def test_every_clause_that_was_asked_for_counts_and_only_in_episodes_that_do():
    rows = count_clauses(*tables()).set_index("verb")
    assert rows.loc["open", ["asked", "done", "median_step"]].tolist() == [2, 2, 6]
    assert rows.loc["put next to", ["asked", "done", "median_step"]].tolist() == [2, 1, 20]
    assert set(rows["block"]) == {"several"}


def test_the_section_says_shares_with_their_intervals():
    text = page(clauses=clauses_table(count_clauses(*tables())))
    assert "<h2>Instructions</h2>" in text
    assert "0.50 (0.09 to 0.91)" in text
    assert "1.0 (0.34 to 1.0)" in text


def test_without_instructions_there_is_no_section():
    episodes, starts, done = tables()
    rows = count_clauses(episodes, starts, done.iloc[:0])
    assert rows.empty
    assert clauses_table(rows) is None


def test_a_clause_that_nobody_did_has_no_step():
    episodes, starts, done = tables()
    rows = count_clauses(episodes, starts, done[done["clause"] == 1])
    undone = rows[rows["verb"] == "put next to"]
    assert undone["done"].tolist() == [0]
    assert np.isnan(undone["median_step"]).all()
    assert "\N{EN DASH}" in page(clauses=clauses_table(rows))
