"""The paragraphs of a mission: its first stands above a world's picture, the others beside it.

Most missions are one sentence, hence one paragraph. A world of rules has a goal and several rules in one text; they are
broken for screens alone, since logs, observations and models have the text as it is.
"""

import re

_BREAK = re.compile(r"(?<=[.!?]) (?=\w+: )|(?<=[.!?:]) (?=\(\d+\) )")


def split_mission(mission: str) -> list[str]:
    """Return the paragraphs of a mission, at least one.

    A paragraph begins with a word and a colon ("Rules:") or with a number in brackets ("(2)"), after a sentence's end.
    """
    return _BREAK.split(mission)
