"""What is seen of a block: a screen for each phase, from its plan, its words and the episode that is played."""

from enum import StrEnum

from minihuman.study import texts
from minihuman.study.activities.pages import Reader
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.phases import Phase
from minihuman.study.play import NO_PICTURE, Play
from minihuman.study.screens import BlankScreen, PlayScreen, Screen, TextScreen
from minihuman.study.stage import Stage


class View:
    """A block's screens. Decides nothing.

    Args:
        plan: the block's.
        stage: the session around it, for its words and points.
    """

    def __init__(self, plan: PlayPlan, stage: Stage) -> None:
        self._plan = plan
        self._stage = stage

    def before(self, phase: StrEnum, reader: Reader) -> Screen | None:
        """A screen without an episode; None where the phase shows one."""
        words = self._stage.words
        match phase:
            case Phase.INSTRUCTIONS:
                return texts.page(
                    words,
                    title=self._plan.title or words["instructions.title"],
                    body=self._plan.instruction[reader.page],
                    page=reader.page,
                    pages=reader.pages,
                    last=words["go_on"],
                    button=words["button.go_on"],
                )
            case Phase.LEARNING:
                return texts.learning(words)
            case Phase.PREPARING:
                return texts.getting_ready(words)
            case Phase.INTERVAL | Phase.FIXATION:
                return BlankScreen(cross=phase is Phase.FIXATION)
        return None

    def rest(self, left_s: int) -> TextScreen:
        """The rest after the block."""
        return texts.rest(self._stage.words, texts.with_score(self._stage, self._plan.rest), left_s)

    def ready(self, play: Play) -> TextScreen:
        """The last screen before an episode."""
        return texts.ready(self._stage.words, self._mission(play), self._progress(play))

    def feedback(self, play: Play, scored: float) -> TextScreen:
        """What is said about an episode."""
        return texts.feedback(self._stage.words, self._plan, play, self._progress(play), scored, self._stage.points)

    def play(self, play: Play, *, held: bool, scored: float) -> PlayScreen:
        """An episode's picture; ``held``: its last one, with what it was worth."""
        words = self._stage.words
        legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
        return PlayScreen(
            picture=play.picture() if held or self._stage.draws_steps else NO_PICTURE,
            mission=self._mission(play),
            progress=self._progress(play),
            legend=tuple((key, words.action(action)) for key, action in legend),
            episode=play.plan.episode,
            step=play.steps,
            script=words.script,
            mark=texts.mark(play.outcome) if held and self._plan.marks else "",
            said=texts.score(words, scored) if held and self._plan.points is not None else "",
            labels=words.labels(tuple(key for key, _ in legend)),
        )

    def _mission(self, play: Play) -> str:
        return self._plan.mission or self._stage.words.mission(play.mission)

    def _progress(self, play: Play) -> str:
        total = self._stage.points if self._plan.show_points else None
        return texts.progress(self._stage, self._plan, play.plan, total)
