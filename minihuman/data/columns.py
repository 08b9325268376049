"""The columns of every table: the computed ones, and the list of all. The data dictionary is written from here."""

from minihuman.data.column import BLOCK, LEFT_OUT, WHERE, WHO, Column
from minihuman.data.columns_logged import (
    ADVICE,
    ANSWER_CHANGES,
    ANSWERS,
    CLAUSES,
    CONTROLS,
    CORRECTIONS,
    FRAMES,
    LINKS,
    MARKS,
    NOTES,
    OTHER_INPUTS,
    OTHER_PRESSES,
    PAGES,
    PARTS,
    PLAN,
    POINTS,
    POLICIES,
    PREFERENCES,
    PRESSES,
    RATINGS,
    SAMPLES,
    SEGMENTS,
    STARTS,
    STEPS,
)

KEYS = (
    *WHO,
    *BLOCK,
    Column("first_episode", "whole", "", "The episode from which this key map held, 1 for the session's first."),
    Column("key", "key", "", "The physical key."),
    Column("action", "text", "", "Its action; empty where it has none."),
    Column("presses", "whole", "", "How often it went down while an episode ran, auto-repeats left out."),
    Column("steps", "whole", "", "Steps it caused."),
    Column("in_vain", "whole", "", "Steps it caused that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("found_s", "number", "s", "Playing time in episodes until its action first showed; empty if it never did."),
    Column("found_steps", "whole", "", "Steps up to and with the press by which its action first showed."),
)
EPISODES = (
    *WHO,
    *BLOCK,
    *WHERE,
    Column("episode_in_block", "whole", "", "1 for the block's first."),
    Column("world", "text", "", "The world's id."),
    Column("seed", "whole", "", "The seed of the layout."),
    Column("t_ns", "whole", "ns", "When the episode was reset: session time, since the first segment began."),
    Column("outcome", "text", "", "goal, timeout, failure, abandoned or cut_off."),
    Column("success", "yes_no", "", "Whether the outcome is goal."),
    Column("reward", "number", "", "Sum of the episode's rewards."),
    Column("steps", "whole", "", "Steps done."),
    Column("max_steps", "whole", "", "Steps allowed."),
    Column(
        "shortest_steps", "whole", "", "Fewest steps that can reach the goal; in 3D no fewer can. Empty if unknown."
    ),
    Column(
        "feasible_steps", "whole", "", "Steps of a way to the goal that was found and is possible. Empty if unknown."
    ),
    Column("excess_steps", "number", "", "Steps over feasible_steps; of episodes that reached the goal."),
    Column("log_excess_steps", "number", "", "ln(1 + steps over feasible_steps); who never got there is at max_steps."),
    Column("log_steps_ratio", "number", "", "ln(steps / feasible_steps); who never got there is at max_steps."),
    Column("spl", "number", "", "Success weighted by path length: feasible_steps / steps, 0 without the goal."),
    Column("playing_s", "number", "s", "From the reset to the last step, pauses left out."),
    Column("reaction_mean_ms", "number", "ms", "Mean reaction time."),
    Column("reaction_median_ms", "number", "ms", "Median reaction time."),
    Column("path_length", "number", "cell or m", "Ground covered."),
    Column("path_efficiency", "number", "", "Straight distance from start to end over ground covered."),
    Column("turns_in_place", "whole", "", "Runs of turning on the spot; empty where the world tells no pose."),
    Column("in_vain", "whole", "", "Steps that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("tags", "text", "", "The reviewers' tags in force, separated by spaces."),
    LEFT_OUT,
)
_OVER_EPISODES = (
    Column("episodes", "whole", "", "Episodes that count."),
    Column("success", "number", "", "Share of them that reached the goal."),
    Column("reward_mean", "number", "", "Mean reward."),
    Column("reward_sd", "number", "", "Standard deviation of the reward over episodes (n - 1)."),
    Column("reward_first", "number", "", "Reward of the first episode that counts."),
    Column(
        "reward_slope", "number", "1/episode", "Change of the reward over the block's first five episodes, an episode."
    ),
    Column("steps_mean", "number", "", "Mean steps."),
    Column(
        "steps_at_limit_mean", "number", "", "Mean steps; an episode that never reached the goal counts its max_steps."
    ),
    Column("excess_steps_mean", "number", "", "Mean steps over feasible_steps, of episodes that reached the goal."),
    Column("log_excess_steps_mean", "number", "", "Mean of log_excess_steps."),
    Column("log_steps_ratio_mean", "number", "", "Mean of log_steps_ratio."),
    Column("spl_mean", "number", "", "Mean of spl."),
    Column("playing_s_mean", "number", "s", "Mean playing time of an episode."),
    Column("reaction_median_ms", "number", "ms", "Median over all steps' reaction times."),
    Column("path_efficiency_mean", "number", "", "Mean path efficiency."),
    Column("in_vain_share", "number", "", "Share of steps that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("keys_found", "whole", "", "Keys with an action whose action showed."),
    Column("keys_to_find", "whole", "", "Keys with an action."),
    Column(
        "found_all_s",
        "number",
        "s",
        "Playing time until every key's action had shown, whatever episodes count; empty if one never did.",
    ),
)
BLOCKS = (*WHO, *BLOCK, *_OVER_EPISODES, LEFT_OUT)
PARTICIPANTS = (
    *WHO,
    Column("player", "text", "", "Whoever pressed the keys: human, or the simulated player's name."),
    Column("window", "text", "", "What the participant sat at: pygame, pyglet, web, simulated; empty if unsaid."),
    Column("started_at", "text", "UTC", "When the session began, ISO 8601."),
    Column("end_reason", "text", "", "Why the session ended."),
    Column("clean", "yes_no", "", "Whether the log was finished in the ordinary way."),
    Column("segments", "whole", "", "How many stretches the session was played in: 1, and one for each resume."),
    Column(
        "completed_share",
        "number",
        "",
        "Share of the planned episodes, skipped ones apart, played to an end; empty where none was planned.",
    ),
    *_OVER_EPISODES,
    LEFT_OUT,
)
TABLES: dict[str, tuple[Column, ...]] = {
    "steps": STEPS,
    "presses": PRESSES,
    "keys": KEYS,
    "episodes": EPISODES,
    "blocks": BLOCKS,
    "participants": PARTICIPANTS,
    "segments": SEGMENTS,
    "plan": PLAN,
    "starts": STARTS,
    "frames": FRAMES,
    "other_presses": OTHER_PRESSES,
    "notes": NOTES,
    "samples": SAMPLES,
    "marks": MARKS,
    "answers": ANSWERS,
    "answer_changes": ANSWER_CHANGES,
    "parts": PARTS,
    "pages": PAGES,
    "points": POINTS,
    "clauses": CLAUSES,
    "other_inputs": OTHER_INPUTS,
    "links": LINKS,
    "policies": POLICIES,
    "advice": ADVICE,
    "controls": CONTROLS,
    "ratings": RATINGS,
    "corrections": CORRECTIONS,
    "preferences": PREFERENCES,
}

NEED_WORLD = frozenset(
    {"shortest_steps", "feasible_steps", "excess_steps", "log_excess_steps", "log_steps_ratio", "spl"}
    | {"excess_steps_mean", "log_excess_steps_mean", "log_steps_ratio_mean", "spl_mean"}
)
"""The columns that a log alone cannot tell: the world itself is asked how few steps an episode could have taken."""


def dictionary(*, without: frozenset[str] = frozenset()) -> dict[str, dict[str, dict[str, str]]]:
    """The data dictionary, some columns left out: table, column, then its type, unit and meaning."""
    return {
        table: {
            column.name: {"type": column.kind, "unit": column.unit, "meaning": column.meaning}
            for column in columns
            if column.name not in without
        }
        for table, columns in TABLES.items()
    }
