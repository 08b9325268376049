"""The facts of a session as one readable page (Markdown)."""

from minihuman.recorded.episode import Episode, SessionLog


def facts_page(log: SessionLog) -> str:
    """Who, what, when, how it ended, and one row an episode."""
    plan, participant = log.plan, log.plan.participant
    clean = "finished" if log.clean else "cut off"
    lines = [
        f"# {participant.id}, session {plan.session}",
        "",
        f"**{plan.study}** {plan.study_version}, group *{participant.group}*, played by *{log.player}*.",
        f"Started {log.started_at} ({_segments(log)}); the log is {clean}, the session ended: {log.end_reason}.",
        "",
        "| episode | attempt | block | world | keys | outcome | steps | return |",
        "|--:|--:|---|---|---|---|--:|--:|",
        *(_row(episode) for episode in log.episodes),
        "",
        "| fact | value |",
        "|---|---|",
        f"| protocol SHA-256 | `{plan.protocol_sha256}` |",
        f"| study seed | {plan.study_seed} |",
        *(f"| {name} | {value} |" for name, value in sorted(log.facts.items())),
    ]
    return "\n".join(lines) + "\n"


def _segments(log: SessionLog) -> str:
    """Where each segment begins, on the session's clock."""
    if len(log.segments) == 1:
        return "one segment"
    begins = ", ".join(f"{segment.start_ns / 1e9:.1f} s" for segment in log.segments)
    return f"{len(log.segments)} segments, beginning at session time {begins}"


def _row(episode: Episode) -> str:
    plan = episode.plan
    keys = ", ".join(f"{key}: {action}" for key, action in sorted(plan.key_map.keys.items()))
    return (
        f"| {episode.number} | {episode.attempt} | {plan.block_name} | {plan.world} (seed {plan.seed}) | {keys} "
        f"| {episode.outcome_word} | {len(episode.actions)} | {episode.return_:.3f} |"
    )
