"""Shadows of earlier versions: a picture that differs is an earlier renderer's; in a new log it is a difference."""

from dataclasses import replace

from minihuman.admin.verify.episodes import EpisodeVerification, verify_episodes
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.contract import SHADOWS_VERSION
from tests.golden.test_frozen import log_of


def take_shadowed() -> tuple[SessionLog, EpisodeLog]:
    """Return a frozen log, older than the fact, and its episode in a world with shadows."""
    log = log_of("every-option")
    (episode,) = [episode for episode in log.episodes if episode.plan.options.get("contact_shadows")]
    return log, episode


def test_a_shadow_that_was_drawn_otherwise_is_an_earlier_renderers() -> None:
    log, episode = take_shadowed()
    steps = len(episode.actions)
    assert verify_episodes(replace(log, episodes=(episode,))) == EpisodeVerification(1, steps, "")
    altered = replace(episode, observation_hashes=episode.observation_hashes + 1)
    assert verify_episodes(replace(log, episodes=(altered,))) == EpisodeVerification(1, steps, "", n_other_renderer=1)
    moved = replace(altered, state_hashes=altered.state_hashes + 1)
    assert " state hash " in verify_episodes(replace(log, episodes=(moved,))).difference


def test_a_shadow_of_this_version_must_be_the_same() -> None:
    log, episode = take_shadowed()
    facts = {"shadow_pictures": str(SHADOWS_VERSION)}
    segments = tuple(replace(segment, facts=segment.facts | facts) for segment in log.segments)
    altered = replace(episode, observation_hashes=episode.observation_hashes + 1)
    proof = verify_episodes(replace(log, episodes=(altered,), segments=segments))
    assert " observation hash " in proof.difference
