"""Refusals: what a page shows when its participant may not take part, sometimes with a completion code.

No I/O.
"""

from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.web.arrivals import Rejection
from minihuman.web.eligibility import (
    Completion,
    build_completion,
    classify_ending,
    get_page_texts,
    get_session_code,
)
from minihuman.web.messages import Refusal

_FOR_GOOD = (
    "browser",
    "keyboard",
    "latency",
)  # ineligible for good, so the page gives a code; a window can be made larger
WAIT = Refusal("wait", "")  # the page tries again by itself


class RefusalTexts:
    """Builds a study's refusals, in the study's language.

    Args:
        protocol: the study.
    """

    def __init__(self, protocol: Protocol) -> None:
        self._protocol = protocol
        self._web = protocol.web
        self._texts = get_page_texts(protocol.study.language)

    def ask_to_reload(self) -> Refusal:
        """Return the refusal of a page of another release, which makes the page reload itself."""
        return Refusal("old", self._texts["busy"])

    def turn_away(self, reason: str, *, person: str = "") -> Refusal:
        """Return the refusal of a page for a reason, with a completion code if the reason is final.

        Args:
            reason: the key of the text that the page shows.
            person: the participant's id on the recruiting platform; "" if no platform sent them.
        """
        width, height = self._web.min_window_size_px
        fields = {
            "browsers": ", ".join(self._web.allowed_browsers),
            "width": width,
            "height": height,
            "minutes": max(1, int(self._web.reconnect_timeout_s // 60)),
        }
        words = self._texts[reason].format(**fields)
        if reason not in _FOR_GOOD:
            return Refusal(reason, words)
        return self._refuse_with_code(reason, words, build_completion(self._web, "screened_out", person=person))

    def answer_rejection(self, rejection: Rejection) -> Refusal:
        """Return the refusal of a rejected visitor; one who has taken part before gets the completion code again."""
        if rejection.reason == "wait":
            return WAIT
        if not rejection.ended:
            return self.turn_away(rejection.reason)
        end = classify_ending("complete", agreed=True)  # also if the log names no final reason
        if rejection.ended in FINAL_END_REASONS:
            end = classify_ending(rejection.ended, agreed=True)  # type: ignore[arg-type]
        code = get_session_code(self._protocol, rejection.session)
        completion = build_completion(self._web, end, session_code=code, person=rejection.person)
        if rejection.reason == "finished":
            return self._refuse_with_code(end, self._texts[end], completion)
        return self._refuse_with_code(rejection.reason, self._texts["not_today"], completion)

    def _refuse_with_code(self, reason: str, words: str, completion: Completion) -> Refusal:
        """Return a refusal whose text ends with the completion code, if there is one, and which has the return link."""
        if completion.code:
            words = f"{words} {self._texts['code']}: {completion.code}"
        return Refusal(reason, words, self._texts["leave"], completion.url)
