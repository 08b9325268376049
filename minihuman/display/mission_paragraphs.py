"""The paragraphs of a mission: the first stands above a world's picture, and the others stand beside it.

Most missions are one sentence, hence one paragraph. A world of rules has a goal and several rules in one text. Only
screens divide it; logs, observations and models have the text as it is.
"""

import re

_BREAK = re.compile(r"(?<=[.!?]) (?=\w+: )|(?<=[.!?:]) (?=\(\d+\) )")


def split_mission(mission: str) -> list[str]:
    """Return the paragraphs of a mission, at least one.

    A paragraph begins at a word with a colon ("Rules:") or at a number in brackets ("(2)") that follows the end of a
    sentence; a number also begins one after a colon.
    """
    return _BREAK.split(mission)
