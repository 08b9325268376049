"""Checks whether a protocol can run without a server, with functions that yield obstacles of different kinds."""

from collections.abc import Iterator
from itertools import chain

from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.web.site.site_error import SiteError

_INSTEAD = "serve the study with: minihuman serve"


def require_site_support(protocol: Protocol, plan: SessionPlan) -> None:
    """Check that a static folder can run a participant's session.

    Raises:
        SiteError: if it cannot; the message names the first obstacle.
    """
    obstacles = chain(_list_study_obstacles(protocol), _list_part_obstacles(plan), _list_episode_obstacles(plan))
    obstacle = next(obstacles, None)
    if obstacle is not None:
        raise SiteError(f"{protocol.study.name}: {obstacle}; {_INSTEAD}")


def _list_study_obstacles(protocol: Protocol) -> Iterator[str]:
    """Yield a sentence for each setting of a study that needs a server."""
    if build_strata(protocol) is not None:
        yield "groups are drawn by strata, for which pages would have to know of each other"
    if len(protocol.sessions) > 1:
        yield f"the study has {len(protocol.sessions)} sessions, and a site runs one"
    if protocol.bonus is not None:
        yield "a bonus is paid, which a page could invent"


def _list_part_obstacles(plan: SessionPlan) -> Iterator[str]:
    """Yield a sentence for each part of a session that needs a server."""
    for part in plan.parts:
        find_server_needs = find_kind(part.kind).find_server_needs
        if find_server_needs is None:
            yield f"part {part.name!r} is of kind {part.kind!r}, which no page runs alone"
        else:
            for need in find_server_needs(part):
                yield f"part {part.name!r} {need}"


def _list_episode_obstacles(plan: SessionPlan) -> Iterator[str]:
    """Yield a sentence for each setting of an episode that needs a server."""
    trial_parts = {part.name for part in plan.parts if find_kind(part.kind).has_trials}
    for episode in plan.episodes:
        if episode.pace != "on_key":
            yield f"block {episode.block_name!r} has pace {episode.pace!r}, and a site's blocks are played on_key"
        if episode.options.get("control", "discrete") != "discrete":
            yield f"block {episode.block_name!r} has free motion, and a site's worlds have the eight actions"
        if episode.response_deadline_ms and episode.block_name not in trial_parts:
            yield f"block {episode.block_name!r} has a response deadline"
