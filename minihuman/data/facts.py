"""What goes with an episode wherever it goes: who played it, by which protocol, with which keys, how it ended."""

from typing import Any

from minihuman.data.versions import version_name
from minihuman.recorded.episode import Episode, SessionLog


def episode_facts(log: SessionLog, episode: Episode) -> dict[str, Any]:
    """The facts of one episode; ``session``, ``segment``, ``episode`` and ``attempt`` count from 1."""
    plan = episode.plan
    return {
        "study": log.plan.study,
        "version": version_name(log.plan),
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
        "player": log.player,
        "block": plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
        "world": plan.world,
        "seed": plan.seed,
        "outcome": episode.outcome_word,
        "mission": episode.start.mission,
        "key_map": dict(plan.key_map.keys),
        "action_names": list(episode.start.action_names),
        "protocol_sha256": log.plan.protocol_sha256,
    }
