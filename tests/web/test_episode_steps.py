"""Which scene each step of an episode led to, and what its page showed of them."""

from minihuman.activities.correction.events import CorrectionBegun, CorrectionStepped
from minihuman.experiment.machine.events import Noted
from minihuman.web.episode_steps import EpisodeSteps
from minihuman.web.messages import DisplayedMessage


def shown(step: int, node: int, episode: int = 3) -> DisplayedMessage:
    return DisplayedMessage(1, 2, episode=episode, step=step, node=node)


def steps_of_episode_3() -> EpisodeSteps:
    """Scenes 10, 11 and one that is unknown."""
    steps = EpisodeSteps(())
    steps.episode = 3
    for scene in (10, 11, -1):
        steps.append(scene)
    return steps


def test_a_picture_is_known_once_its_step_was_made() -> None:
    steps = steps_of_episode_3()
    assert steps.knows(shown(2, 10))
    assert not steps.knows(shown(3, 10))
    assert not steps.knows(shown(1, 10, episode=2))
    assert [steps.find_scene(step) for step in (-1, 0, 1, 2, 3)] == [-1, 10, 11, -1, -1]


def test_only_a_picture_of_another_scene_differs() -> None:
    steps = steps_of_episode_3()
    assert steps.describe_difference(shown(1, 12)) == "step 1 of episode 4 was shown as scene 12, it is 11"
    assert steps.describe_difference(shown(1, 11)) == ""
    assert steps.describe_difference(shown(1, -1)) == ""
    assert steps.describe_difference(shown(2, 12)) == "", "the scene is unknown"


def test_a_session_that_is_resumed_within_a_correction_counts_the_steps_before_it() -> None:
    begun = CorrectionBegun(1, 0, 0, 3, 1, step=4, state_hash=0, pressed_ns=0)
    stepped = CorrectionStepped(2, 0, 0, 3, 5, 1, "left", 2, 0.0, False, False, 0)
    steps = EpisodeSteps([begun, stepped, Noted(3, "phase", "play")])
    assert steps.knows(shown(5, -1))
    assert not steps.knows(shown(6, -1))


def test_outside_joint_episodes_no_picture_is_early_or_corrected() -> None:
    steps = steps_of_episode_3()
    steps.keep_early(shown(3, 12))
    steps.append(12)
    assert steps.take_early() is None
    assert steps.find_corrected(shown(1, 12), {11: 1, 12: 2}) is None
