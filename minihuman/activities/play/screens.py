"""The screens of a block."""

from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING

import msgspec

from minihuman.activities.pages.page_reader import PageReader
from minihuman.activities.pages.screens import build_page_screen
from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import SessionContext
from minihuman.experiment.machine.events import Outcome
from minihuman.experiment.machine.points import (
    PointsNumber,
    fill_score_fields,
    format_score,
    format_total,
    isolate_signs,
)
from minihuman.experiment.machine.running_episode import EMPTY_IMAGE, NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screen_texts import capitalise
from minihuman.experiment.machine.screens import BlankScreen, Motion, OutcomeMark, PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.words import InterfaceWords
from minihuman.worlds.pose import Pose

if TYPE_CHECKING:
    from minihuman.experiment.machine.activity import SessionContext

OUTCOME_MARKS: dict[Outcome | None, OutcomeMark] = {"goal": "good", "timeout": "neutral", "failure": "bad"}


def format_progress(context: "SessionContext", block: PlayPlan, episode: EpisodePlan, points: float | None) -> str:
    """Format an episode's position in the session, such as "Part 1 of 2, episode 3 of 10", and the points so far.

    ``points`` is None in a block that does not show them.
    """
    words = context.words
    fields = {
        "part": block.block + 1,
        "parts": block.blocks,
        "episode": episode.episode_in_block + 1,
        "episodes": episode.episodes_in_block,
    }
    key = "progress.of_one" if block.blocks < 2 else "progress.of_many"
    if block.until is not None:
        key += "_open"  # the number of episodes is open
    line = words.fill(key, **fields)
    if points is None:
        return line
    return f"{line}    {format_total(words, points)}"


def build_feedback_screen(
    words: InterfaceWords, block: PlayPlan, played: RunningEpisode, progress_line: str, points: float, total: float
) -> TextScreen:
    """Build the block's feedback screen for an episode's outcome, with the fields of its text filled in.

    Args:
        words: the interface's texts.
        block: the block's plan, which has a feedback text for the outcome.
        played: the finished episode.
        progress_line: the line that shows the episode's position in the session.
        points: the points that the episode earned.
        total: the session's points so far.
    """
    outcome = played.outcome or "abandoned"
    body = block.feedback[outcome].format(
        outcome=words[f"outcome.{outcome}"],
        reward=played.return_,
        steps=played.steps,
        episode=played.plan.episode_in_block + 1,
        episodes=played.plan.episodes_in_block,
        points=PointsNumber(points),
        total=PointsNumber(total),
    )
    body = isolate_signs(words, capitalise(body.strip()))
    prompt = "" if block.trial and block.trial.feedback_ms else words["go_on"]
    return TextScreen("", body, prompt, progress_line, locale=words.locale)


def build_rest_screen(words: InterfaceWords, text: str, remaining_s: int) -> TextScreen:
    """Build the screen of the rest after a block, with the seconds that remain; Enter continues when none do.

    ``text`` is what the screen says; if it is empty, the interface's standard text is shown.
    """
    prompt = words["go_on"] if remaining_s <= 0 else words.fill("rest.wait", seconds=remaining_s)
    return TextScreen(words["rest.title"], text.strip() or words["rest.body"], prompt, locale=words.locale)


class BlockScreens:
    """A builder of a block's screens.

    Args:
        plan: the block's plan.
        context: the session around the block, for its texts and points.
        shows_progress: whether a line shows the episode's position in the session.
    """

    def __init__(self, plan: PlayPlan, context: SessionContext, *, shows_progress: bool = True) -> None:
        self._plan = plan
        self._context = context
        self._shows_progress = shows_progress
        self._last_view: tuple[int, int, Pose | None] | None = None  # the latest step's episode, number and pose

    def build_without_episode(self, phase: StrEnum, reader: PageReader) -> Screen | None:
        """Build the screen of a phase that shows no episode; return None for other phases."""
        words = self._context.words
        match phase:
            case Phase.INSTRUCTIONS:
                return build_page_screen(
                    words,
                    title=self._plan.title or words["instructions.title"],
                    body=self._plan.instruction[reader.page],
                    page=reader.page,
                    pages=reader.pages,
                    last_prompt=words["go_on"],
                    last_button=words["button.go_on"],
                )
            case Phase.LEARNING:
                return screen_texts.build_notice_screen(words, words["learning.title"], words["learning.body"])
            case Phase.PREPARING:
                return screen_texts.build_wait_screen(words)
            case Phase.INTERVAL | Phase.FIXATION:
                return BlankScreen(cross=phase is Phase.FIXATION)
        return None

    def build_rest(self, remaining_s: int) -> TextScreen:
        """Build the screen of the rest after the block, with the seconds that remain of it."""
        return build_rest_screen(self._context.words, fill_score_fields(self._context, self._plan.rest), remaining_s)

    def build_ready(self, play: RunningEpisode) -> TextScreen:
        """Build the screen that waits for Enter before an episode."""
        words = self._context.words
        mission = screen_texts.capitalise(self._mission(play))
        return TextScreen(
            words["ready.title"], mission, words["ready.prompt"], self._format_progress_line(play), locale=words.locale
        )

    def build_feedback(self, play: RunningEpisode, points: float) -> TextScreen:
        """Build the feedback screen of an episode that earned the given points."""
        return build_feedback_screen(
            self._context.words, self._plan, play, self._format_progress_line(play), points, self._context.points
        )

    def build_play(self, play: RunningEpisode, *, is_last: bool, points: float) -> PlayScreen:
        """Build the screen of a running episode.

        Args:
            play: the episode.
            is_last: whether its last picture stays on; the screen then also has the outcome's mark and the points, each
                only if the block shows them.
            points: the points that the episode earned.
        """
        words = self._context.words
        legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
        mark: OutcomeMark = ""
        score_text = ""
        if is_last and self._plan.marks:
            mark = OUTCOME_MARKS.get(play.outcome, "")
        if is_last and self._plan.points is not None:
            score_text = format_score(words, points)
        picture = EMPTY_IMAGE
        if is_last or self._context.renders_steps:
            picture = play.picture()
        has_motion = self._plan.motion_ms and self._context.renders_steps
        return PlayScreen(
            picture=picture,
            mission=self._mission(play),
            progress=self._format_progress_line(play),
            legend=tuple((key, words.action(action)) for key, action in legend),
            episode=play.plan.episode,
            step=play.steps,
            locale=words.locale,
            mark=mark,
            score_text=score_text,
            labels=words.labels(tuple(key for key, _ in legend)),
            accepts_pointer=play.takes_clicks,
            axes=play.window_axes,
            motion=self._track_motion(play) if has_motion else None,
        )

    def _track_motion(self, play: RunningEpisode) -> Motion | None:
        """Return the motion of the view from the previous step's picture to this one, and remember this step's view.

        None means that the previous picture was not of the step before, or the world had no pose there.
        """
        last_view = self._last_view
        self._last_view = (play.plan.episode, play.steps, play.world.pose())
        if last_view is None:
            return None
        last_episode, last_step, last_pose = last_view
        is_next_step = last_episode == play.plan.episode and last_step == play.steps - 1
        if last_pose is None or not is_next_step:
            return None
        assert self._plan.motion_ms is not msgspec.UNSET
        return Motion(round(self._plan.motion_ms * NS_PER_MS), partial(play.picture_between, last_pose))

    def _mission(self, play: RunningEpisode) -> str:
        return self._plan.mission or self._context.words.mission(play.mission)

    def _format_progress_line(self, play: RunningEpisode) -> str:
        """Format the episode's position and the points so far, each only if the block shows it."""
        total = self._context.points if self._plan.show_points else None
        if not self._shows_progress:
            if total is None:
                return ""
            return format_total(self._context.words, total)
        return format_progress(self._context, self._plan, play.plan, total)
