"""The session that comes with the software, recorded by its first version: it stays readable, and provable."""

from pathlib import Path

from minihuman.admin.verify.episodes import EpisodeVerification, verify_episodes
from minihuman.log.read.session_reader import read_log

EXAMPLE = Path(__file__).parents[2] / "sessions/example/demo/sub-01/ses-01/sub-01_ses-01.mcap"


def test_the_first_versions_log_is_read_and_plays_again_to_the_bit() -> None:
    session = read_log(EXAMPLE)
    assert session.facts["version_minihuman"] == "0.1.0"
    assert [episode.outcome_word for episode in session.episodes] == ["goal"] * 4
    # the two first-person episodes were drawn by an earlier renderer: their pictures are not compared
    assert verify_episodes(session) == EpisodeVerification(episodes=4, steps=231, difference="", n_other_renderer=2)
