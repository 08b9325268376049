"""Columns of what is measured: the tables of keys, episodes, blocks and participants."""

from minihuman.dataset.table_columns import (
    BLOCK_COLUMNS,
    EPISODE_KEY,
    EXCLUDED_COLUMN,
    SESSION_COLUMNS,
    UNIT_COLUMN,
    TableColumn,
)

KEYS = (
    *SESSION_COLUMNS,
    *BLOCK_COLUMNS,
    TableColumn("first_episode", "integer", "", "The episode from which this key map held, 1 for the session's first."),
    TableColumn("key", "key", "", "The physical key."),
    TableColumn("action", "text", "", "Its action; empty where it has none."),
    TableColumn("presses", "integer", "", "How often it went down while an episode ran, without auto-repeats."),
    TableColumn("steps", "integer", "", "Steps it caused."),
    TableColumn("ineffective_steps", "integer", "", "Steps it caused that changed nothing to be seen."),
    TableColumn("refused", "integer", "", "Presses with no action, or while no action was taken."),
    TableColumn(
        "discovered_s", "number", "s", "Playing time in episodes until its action first showed; empty if it never did."
    ),
    TableColumn("discovered_steps", "integer", "", "Steps up to and with the press by which its action first showed."),
)


EPISODES = (
    *EPISODE_KEY,
    TableColumn("episode_in_block", "integer", "", "1 for the block's first."),
    TableColumn("world", "text", "", "The world's id."),
    TableColumn("seed", "integer", "", "The seed of the layout."),
    TableColumn("t_ns", "integer", "ns", "When the episode was reset: session time, since the first segment began."),
    TableColumn(
        "outcome", "text", "", "goal, timeout, failure, abandoned, agent_failed, cut_off; ended: no rule says."
    ),
    TableColumn("success", "boolean", "", "Whether the outcome is goal; empty where no rule says."),
    TableColumn("reward", "number", "", "Sum of the episode's rewards."),
    TableColumn("steps", "integer", "", "Steps done."),
    TableColumn("max_steps", "integer", "", "Steps allowed."),
    TableColumn(
        "shortest_steps", "integer", "", "Fewest steps that can reach the goal; in 3D no fewer can. Empty if unknown."
    ),
    TableColumn("feasible_steps", "integer", "", "Steps of the shortest known path to the goal. Empty if unknown."),
    TableColumn("excess_steps", "number", "", "Steps over feasible_steps; of episodes that reached the goal."),
    TableColumn("log_excess_steps", "number", "", "ln(1 + steps over feasible_steps); max_steps without the goal."),
    TableColumn("log_steps_ratio", "number", "", "ln(steps / feasible_steps); max_steps without the goal."),
    TableColumn("spl", "number", "", "Success weighted by path length: feasible_steps / steps, 0 without the goal."),
    TableColumn("playing_s", "number", "s", "From the reset to the last step, without pauses."),
    TableColumn("reaction_mean_ms", "number", "ms", "Mean of reaction_ms over the episode's steps.", 1),
    TableColumn("reaction_median_ms", "number", "ms", "Median of reaction_ms over the episode's steps.", 1),
    TableColumn("response_mean_ms", "number", "ms", "Mean of response_ms.", 2),
    TableColumn("response_median_ms", "number", "ms", "Median of response_ms.", 2),
    TableColumn("path_length", "number", "cell or m", "Ground covered."),
    UNIT_COLUMN,
    TableColumn("path_efficiency", "number", "", "Straight distance from start to end over ground covered."),
    TableColumn("turns_in_place", "integer", "", "Runs of turning on the spot; empty where the world gives no pose."),
    TableColumn("ineffective_steps", "integer", "", "Steps that changed nothing to be seen."),
    TableColumn("refused", "integer", "", "Presses with no action, or while no action was taken."),
    TableColumn(
        "absent_share", "number", "", "Of a team: share of joint steps in which a seat idled or an agent had it."
    ),
    TableColumn("labels", "text", "JSON", "The labels of a trial's stimulus, by column of its table; empty without."),
    TableColumn("info_at_end", "text", "JSON", "What record_info keeps of the last step's info; empty without."),
    TableColumn("tags", "text", "", "The reviewers' tags in force, separated by spaces."),
    EXCLUDED_COLUMN,
)


_OVER_EPISODES = (
    TableColumn("episodes", "integer", "", "Included episodes."),
    TableColumn("success", "number", "", "Share of them that reached the goal."),
    TableColumn("reward_mean", "number", "", "Mean reward."),
    TableColumn("reward_sd", "number", "", "Standard deviation of the reward over episodes (n - 1)."),
    TableColumn("reward_first", "number", "", "Reward of the first included episode."),
    TableColumn(
        "reward_slope", "number", "1/episode", "Change of the reward per episode over the block's first five episodes."
    ),
    TableColumn("steps_mean", "number", "", "Mean steps."),
    TableColumn(
        "steps_at_limit_mean", "number", "", "Mean steps; an episode that never reached the goal counts its max_steps."
    ),
    TableColumn(
        "excess_steps_mean", "number", "", "Mean steps over feasible_steps, of episodes that reached the goal."
    ),
    TableColumn("log_excess_steps_mean", "number", "", "Mean of log_excess_steps."),
    TableColumn("log_steps_ratio_mean", "number", "", "Mean of log_steps_ratio."),
    TableColumn("spl_mean", "number", "", "Mean of spl."),
    TableColumn("playing_s_mean", "number", "s", "Mean playing time of an episode."),
    TableColumn("reaction_median_ms", "number", "ms", "Median of reaction_ms over all steps.", 1),
    TableColumn("response_median_ms", "number", "ms", "Median of response_ms over all steps.", 2),
    TableColumn("path_efficiency_mean", "number", "", "Mean path efficiency."),
    TableColumn("ineffective_share", "number", "", "Share of steps that changed nothing to be seen."),
    TableColumn("refused", "integer", "", "Presses with no action, or while no action was taken."),
    TableColumn("keys_discovered", "integer", "", "Keys with an action whose action showed."),
    TableColumn("keys_total", "integer", "", "Keys with an action."),
    TableColumn(
        "all_keys_discovered_s",
        "number",
        "s",
        "Playing time until every key's action had shown, over all episodes; empty if one never did.",
    ),
)


BLOCKS = (*SESSION_COLUMNS, *BLOCK_COLUMNS, *_OVER_EPISODES, EXCLUDED_COLUMN)


PARTICIPANTS = (
    *SESSION_COLUMNS,
    TableColumn("player", "text", "", "Who pressed the keys: human, or the simulated player's name."),
    TableColumn(
        "evidence", "text", "", "witnessed: recorded as it was played; consistent: imported from a page's own data."
    ),
    TableColumn("window", "text", "", "The participant's window: pygame, pyglet, web or simulated; empty if unknown."),
    TableColumn("started_at", "text", "UTC", "When the session began, ISO 8601."),
    TableColumn("utc_offset_min", "integer", "min", "The offset of the local time from UTC then; empty if unknown."),
    TableColumn("end_reason", "text", "", "Why the session ended."),
    TableColumn("clean", "boolean", "", "Whether the log was finished in the ordinary way."),
    TableColumn("segments", "integer", "", "How many segments the session has: 1, and one more for each resume."),
    TableColumn(
        "clock_notes",
        "integer",
        "",
        "Notes that the page's time was ahead of the server's or moved against it, a possible reason for exclusion.",
    ),
    TableColumn(
        "page_alterations",
        "text",
        "",
        "How the browser, an extension or a setting changed the page: translation, text, zoom and others; consent text "
        "if the consent text was other than the study's.",
    ),
    TableColumn(
        "completed_share",
        "number",
        "",
        "Share of the planned episodes, skipped ones apart, played to an end; empty where none was planned.",
    ),
    *_OVER_EPISODES,
    EXCLUDED_COLUMN,
)


COLUMNS_NEEDING_WORLD = frozenset(
    {"shortest_steps", "feasible_steps", "excess_steps", "log_excess_steps", "log_steps_ratio", "spl"}
    | {"excess_steps_mean", "log_excess_steps_mean", "log_steps_ratio_mean", "spl_mean"}
)
"""The columns that a log alone cannot tell: the world itself is asked how few steps an episode could have taken."""
