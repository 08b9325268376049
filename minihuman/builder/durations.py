"""An estimate of how long a session takes, from the protocol: reading, key presses, and the times that it states.

The estimate is for planning; the report of simulated or real sessions has measured times. Silent reading is 180 to 260
words a minute (Brysbaert, 2019, has 238 for English non-fiction), a key press in a world takes 0.3 to 1.2 s, a question
4 to 20 s. An episode in a world needs between a tenth and all of its steps.
"""

from collections.abc import Mapping
from typing import NamedTuple

import msgspec

from minihuman.builder.messages import Duration
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import find_installed_kind
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.part_names import CLOSING, CONSENT, KEYBOARD, list_part_names
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import SHIPPED_FORMS, PageSpec, QuestionnaireSpec, apply_overrides, load_form

_WORDS_PER_MIN = (260.0, 180.0)
_CHARACTERS_PER_WORD = 6.0  # with the space
_IDEOGRAPHS_PER_WORD = 1.5
_SCREEN_S = (1.0, 4.0)  # to go on from a screen
_QUESTION_S = (4.0, 20.0)
_PRESS_S = (0.3, 1.2)
_RESPONSE_S = (0.4, 1.5)  # of a trial without a deadline
_STEPS_NEEDED = (0.1, 1.0)  # of an episode's longest
_KEY_CHECK_S = (1.0, 3.0)  # for each key
_LONGEST_REST_S = 60.0  # of a rest that the participant ends
_FIRST_IDEOGRAPH = "\u2e80"


class Seconds(NamedTuple):
    """The lower and the upper estimate of a duration, in seconds."""

    least: float
    most: float

    def plus(self, other: tuple[float, float]) -> "Seconds":
        """Return the sum with another pair of estimates, the lower and the upper one."""
        return Seconds(self.least + other[0], self.most + other[1])

    def times(self, count: float) -> "Seconds":
        """Return the estimates of a duration that occurs ``count`` times."""
        return Seconds(self.least * count, self.most * count)


_NOTHING = Seconds(0.0, 0.0)


def estimate_durations(protocol: Protocol) -> list[Duration]:
    """Estimate the duration of each session of each group, for the first participant's order of the parts.

    Return an empty list if the protocol has no valid allocation list.
    """
    study = msgspec.structs.replace(protocol.study, participants=1)
    try:
        slot = build_allocation_list(msgspec.structs.replace(protocol, study=study))[0]
    except MinihumanError:
        return []
    sessions = [session.name for session in protocol.sessions] or [""]
    durations = []
    for group in protocol.groups:
        for number, session in enumerate(sessions, 1):
            parts = {
                name: _estimate_part(protocol, name, group.name)
                for name in list_part_names(protocol, slot, group.name, number)
            }
            total = _NOTHING
            for seconds in parts.values():
                total = total.plus(seconds)
            minutes = {name: (_to_minutes(part.least), _to_minutes(part.most)) for name, part in parts.items()}
            least, most = _to_minutes(total.least), _to_minutes(total.most)
            durations.append(Duration(group.name, session, least, most, minutes))
    return durations


def _estimate_part(protocol: Protocol, name: str, group: str) -> Seconds:
    """Estimate the duration of the part ``name`` as ``group`` has it; 0 s for a kind of part that is not known here."""
    page = protocol.page_for(name, group)
    if page is not None:
        return _estimate_page(page)
    for questionnaire in protocol.questions:
        if questionnaire.name == name:
            return _estimate_questions(apply_overrides(questionnaire, group), protocol.study.language)
    for block in protocol.blocks:
        if block.name == name:
            return _estimate_block(protocol.block_for(name, group), protocol.study.min_rest_s)
    if name == KEYBOARD:
        return Seconds(*_KEY_CHECK_S).times(len(protocol.keys.pool))
    if name == CONSENT:
        return _estimate_reading(protocol.study.consent)
    if name == CLOSING:
        return _estimate_reading(protocol.study.closing or "")
    return _NOTHING  # of a plug-in's own kind, or found during the session


def _estimate_page(page: PageSpec) -> Seconds:
    return _estimate_reading(f"{page.title} {page.text}")


def _estimate_reading(text: str) -> Seconds:
    """Estimate the time to read a text and press the key that leads on; 0 s for an empty text."""
    if not text.strip():
        return _NOTHING
    n_ideographs = sum(letter >= _FIRST_IDEOGRAPH for letter in text)
    words = (len(text) - n_ideographs) / _CHARACTERS_PER_WORD + n_ideographs / _IDEOGRAPHS_PER_WORD
    fast, slow = _WORDS_PER_MIN
    return Seconds(60 * words / fast, 60 * words / slow).plus(_SCREEN_S)


def _estimate_questions(questionnaire: QuestionnaireSpec, language: str) -> Seconds:
    items = questionnaire.items
    if questionnaire.form in SHIPPED_FORMS:
        items = load_form(questionnaire.form, language).items
    total = _NOTHING
    for question in items:
        n_answers = len(question.asked)
        total = total.plus(_estimate_reading(question.ask)).plus(Seconds(*_QUESTION_S).times(n_answers))
    return total


def _estimate_block(block: BlockSpec, rest_s: float) -> Seconds:
    """Estimate a block with its instructions and its rest, given its stop criterion and its time limit.

    Args:
        block: the block.
        rest_s: the shortest rest after a block, in seconds.
    """
    total = _estimate_reading(f"{block.title} {block.instructions}").plus(_estimate_rest(block, rest_s))
    episodes = _estimate_episode(block).times(block.episodes)
    if block.stop_criterion is not None:
        least_share = block.stop_criterion.successes / max(block.episodes, 1)  # of the episodes, all of them successes
        episodes = Seconds(episodes.least * min(least_share, 1.0), episodes.most)
    if block.max_block_s:
        episodes = Seconds(min(episodes.least, block.max_block_s), min(episodes.most, block.max_block_s))
    return total.plus(episodes)


def _estimate_rest(block: BlockSpec, rest_s: float) -> Seconds:
    """Estimate the rest after a block: ``rest_s`` seconds, or more with a rest text, until the participant goes on."""
    if not block.rest_text:
        return Seconds(rest_s, rest_s)
    return Seconds(max(rest_s, _SCREEN_S[0]), max(rest_s, _LONGEST_REST_S))


def _estimate_episode(block: BlockSpec) -> Seconds:
    """Estimate one episode, or one trial, with the screens around it."""
    around_s = (block.fixation_ms + block.final_frame_ms + block.feedback_ms) / 1000
    interval = block.inter_trial_interval_ms
    least_interval, most_interval = interval if isinstance(interval, tuple) else (interval, interval)
    total = _estimate_steps(block).plus((around_s + least_interval / 1000, around_s + most_interval / 1000))
    if block.ready == "each":
        total = total.plus(_SCREEN_S)
    feedback = block.feedback
    if isinstance(feedback, Mapping):  # a text for each outcome
        feedback = next(iter(feedback.values()), "")
    if feedback and not block.feedback_ms:
        total = total.plus(_SCREEN_S)
    return total


def _estimate_steps(block: BlockSpec) -> Seconds:
    """Estimate how long a block's episode is played, or how long its trials take, within the episode's time limit."""
    kind = find_installed_kind(block.kind)
    steps = [share * block.max_steps for share in _STEPS_NEEDED]
    if block.max_steps == 1 or (kind is not None and kind.has_trials):
        seconds = _estimate_trial(block)
    elif block.agent is not None:
        seconds = Seconds(*(block.agent.step_ms / 1000 * count for count in steps))
    elif block.pace == "real_time":
        seconds = Seconds(*(block.step_period_ms / 1000 * count for count in steps))
    else:
        seconds = Seconds(steps[0] * _PRESS_S[0], steps[1] * _PRESS_S[1])
    if block.max_episode_s:
        seconds = Seconds(min(seconds.least, block.max_episode_s), min(seconds.most, block.max_episode_s))
    return seconds


def _estimate_trial(block: BlockSpec) -> Seconds:
    """Estimate an episode's trials, one per step: the stimuli shown before each response, and the response."""
    before_s = 0.0
    if block.timeline is not None:
        durations_ms = [stimulus.duration_ms for stimulus in block.timeline.stimuli]
        before_s = sum(duration_ms for duration_ms in durations_ms if isinstance(duration_ms, int | float)) / 1000
    least, most = _RESPONSE_S
    if block.response_deadline_ms:
        most = block.response_deadline_ms / 1000
        least = min(least, most)
    return Seconds(before_s + least, before_s + most).times(block.max_steps)


def _to_minutes(seconds: float) -> float:
    return round(seconds / 60, 1)
