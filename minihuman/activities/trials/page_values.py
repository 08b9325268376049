"""The screen of a trial as values for the page, which shows its pictures by itself."""

from typing import Any

from minihuman.activities.trials.drawing import draw_stimuli
from minihuman.activities.trials.screens import TrialScreen
from minihuman.experiment.sounds import compute_digest
from minihuman.web.screen_values import NumberPicture

_PICTURE_PX = (640, 480)


def build_page_values(screen: TrialScreen, number: NumberPicture) -> dict[str, Any]:
    """Return what a page needs to present a trial by itself: all pictures and sounds, their times in ns, and the keys.

    Args:
        screen: the trial's screen.
        number: returns a picture's number, by which the page gets the picture before the trial's first is shown.
    """
    language = screen.locale.language
    numbers = {
        contents: number(draw_stimuli(contents, _PICTURE_PX, screen.files, language))
        for contents in dict.fromkeys(screen.pictures)
    }
    return {
        "prompt": screen.legend,
        "pictures": [numbers[contents] for contents in screen.pictures],
        "step": screen.step,
        "dues": screen.dues_ns,
        "start": screen.start_ns,
        "first": screen.first_flip_ns,
        "keys": screen.response_keys,
        "target": screen.target_step,
        "foresees": screen.foresees_responses,
        "lead": screen.lead_ns,
        "digests": [compute_digest(content, screen.files) for content in screen.sound_contents],
        "sounds": [
            {
                "cue": cue,
                "digest": compute_digest(sound.content, screen.files),
                "onset": sound.onset_ns,
                "early": sound.is_early,
                "until_response": sound.until_response,
            }
            for cue, sound in screen.sounds
        ],
    }
