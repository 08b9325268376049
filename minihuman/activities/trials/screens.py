"""The screen of a trial with a time course: the stimuli that are visible now, and those that follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.activities.trials.plan import Corner
from minihuman.activities.trials.schedule import SOUND_LEAD_NS, ScheduledSound, StimulusContent
from minihuman.activities.trials.trial_run import TrialRun
from minihuman.experiment.machine.activity import SessionContext
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import FilmsScreen, PageView
from minihuman.experiment.sounds import SoundContent
from minihuman.experiment.words import InterfaceWords

_PHOTODIODE_SIZE = 0.2  # of the picture's height; the square's middle is the corner, so that a quarter is seen


@dataclass(frozen=True, slots=True, eq=False)
class TrialScreen(FilmsScreen):
    """A screen of a trial's stimuli.

    The page has every picture of the trial, the empty one first: those before the response, then those after it.
    """

    drawing: ClassVar[str] = "minihuman.activities.trials.drawing:draw_trial"
    page_view: ClassVar[PageView | None] = PageView(
        "trial", "minihuman.activities.trials.page_values:build_page_values", "minihuman.activities.trials:page.js"
    )
    contents: tuple[StimulusContent, ...]  # what is visible, the front one last
    body: str  # the names of the visible stimuli, by which screenshots tell screens apart
    files: Mapping[str, bytes]  # of images, by name
    legend: str  # keys and what they do; "" where it is not shown
    flip_ns: int | None  # when it is to be on the display, in session time; None: at once
    pictures: tuple[tuple[StimulusContent, ...], ...]  # of the trial: the empty one, before and after the response
    dues_ns: tuple[int, ...]  # of the pictures before the response, since the first; the empty one's is 0
    step: int  # the index of the present picture in ``pictures``
    episode: tuple[int, int]  # the part and the episode
    start_ns: int | None  # when the first picture is due; None: at once
    first_flip_ns: int | None  # when the first picture reached the display; None: not yet
    response_keys: tuple[str, ...]
    target_step: int  # the index of the picture from which on responses are taken
    sounds: tuple[tuple[int, ScheduledSound], ...]  # each with its number in the session
    sound_contents: tuple[SoundContent, ...]  # of these sounds, and of those that may follow the trial
    lead_ns: int | None  # from the empty picture to the first one, if the first waits for sounds
    foresees_responses: bool  # whether every press from the target on is a response, so that the page need not ask

    @property
    def due_ns(self) -> int | None:
        """Return when the screen is to be on the display, in session time; None means at once."""
        return self.flip_ns

    @property
    def films(self) -> tuple[Sequence[NDArray[np.uint8]], ...]:
        """Return no films, because a page has all pictures before the first one is shown."""
        return ()

    @property
    def shown_step(self) -> int:
        """Return the index of the present picture among the trial's pictures."""
        return self.step

    @property
    def identity(self) -> tuple[object, ...]:
        """Return the episode and the time at which its first picture is due; screens of the same trial share them."""
        return (self.episode, self.start_ns)


def build_trial_screen(
    context: SessionContext,
    play: RunningEpisode,
    run: TrialRun,
    *,
    first_cue: int,
    photodiode: Corner | msgspec.UnsetType,
) -> TrialScreen:
    """Build the screen of a running trial, whose sounds are numbered from ``first_cue`` on.

    ``photodiode`` is the corner in which a square changes with each picture; unset for none.
    """
    words = context.words
    schedule = run.schedule
    frames = range(len(run.changes_ns))
    shown = [_list_contents(run, frame, photodiode, has_response=after) for after in (False, True) for frame in frames]
    target_step = 1
    if schedule.target_ns in run.changes_ns:
        target_step += run.changes_ns.index(schedule.target_ns)
    return TrialScreen(
        contents=_list_contents(run, run.frame, photodiode, has_response=run.has_response),
        body=", ".join(stimulus.name for stimulus in run.visible),
        files=context.plan.files,
        legend=_format_legend(words, play.plan.key_map.keys) if play.plan.show_keys else "",
        flip_ns=None if run.is_seen else run.find_due_ns(run.frame),
        pictures=((), *shown),
        dues_ns=(0, *run.changes_ns),
        step=run.frame + 1 + (len(frames) if run.has_response else 0),  # the index in `pictures`
        episode=(play.plan.block, play.plan.episode),
        start_ns=run.rhythm_start_ns,
        first_flip_ns=run.first_flip_ns,
        target_step=target_step,
        sounds=tuple(enumerate(schedule.sound_list, first_cue)),
        sound_contents=schedule.sound_contents,
        lead_ns=SOUND_LEAD_NS if run.has_lead else None,
        foresees_responses=run.foresees_responses,
        response_keys=tuple(play.plan.key_map.keys),
        locale=words.locale,
    )


def _list_contents(
    run: TrialRun, frame: int, photodiode: Corner | msgspec.UnsetType, *, has_response: bool
) -> tuple[StimulusContent, ...]:
    """Return what a picture shows, the front one last; a square for a photodiode is in front of all."""
    contents = tuple(stimulus.content for stimulus in run.find_visible(frame, has_response=has_response))
    if not photodiode or frame < 0:
        return contents
    square = StimulusContent(
        text="",
        shape="square",
        image="",
        colour="#000000" if frame % 2 else "#ffffff",
        size=_PHOTODIODE_SIZE,
        x=float(photodiode.endswith("right")),
        y=float(photodiode.startswith("bottom")),
        layout="line",
    )
    return (*contents, square)


def _format_legend(words: InterfaceWords, actions_by_key: Mapping[str, str]) -> str:
    """Return a line of the keys' labels and what each key does, in the order of the keys."""
    actions = sorted(actions_by_key.items())
    labels = words.labels(tuple(key for key, _ in actions))
    entries = [f"{label}: {words.action(action)}" for (_, action), (_, label, _) in zip(actions, labels, strict=True)]
    return "     ".join(entries)
