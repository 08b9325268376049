"""Which screen belongs to which phase. The words are in texts.py; nothing is decided here."""

from dataclasses import dataclass

from minihuman.study import texts
from minihuman.study.phases import Phase
from minihuman.study.plan import SessionPlan
from minihuman.study.play import Play
from minihuman.study.screens import PlayScreen, Screen


@dataclass(frozen=True, slots=True)
class Scene:
    """What a screen can depend on, beside phase and plan."""

    next_episode: int  # index of the episode that is played or comes next
    play: Play | None  # that episode, or after its end the last one
    checked: frozenset[str]  # keyboard check: the keys that have arrived
    rest_left_s: int


def screen_of(phase: Phase, plan: SessionPlan, scene: Scene) -> Screen:
    """The screen of a phase that is neither start nor over."""
    match phase:
        case Phase.CONSENT:
            return texts.consent(plan)
        case Phase.KEYBOARD_CHECK:
            return texts.keyboard_check(plan, scene.checked)
        case Phase.INSTRUCTIONS:
            return texts.instructions(plan, plan.episodes[scene.next_episode])
        case Phase.CLOSING:
            return texts.closing(plan)
        case Phase.QUIT_QUESTION:
            return texts.quit_question()
        case Phase.ABORT_QUESTION:
            return texts.abort_question()
    assert scene.play is not None, f"{phase} without an episode"
    match phase:
        case Phase.READY:
            return texts.ready(plan, scene.play.plan, scene.play.mission)
        case Phase.PAUSED:
            return texts.paused(plan, scene.play.plan)
        case Phase.FEEDBACK:
            return texts.feedback(plan, scene.play)
        case Phase.REST:
            return texts.rest(plan, scene.play.plan.block, scene.rest_left_s)
    return _play_screen(plan, scene.play)


def _play_screen(plan: SessionPlan, play: Play) -> PlayScreen:
    legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
    return PlayScreen(
        picture=play.picture(),
        mission=play.mission,
        progress=texts.progress(plan, play.plan),
        legend=tuple(legend),
        episode=play.plan.episode,
        step=play.steps,
    )
