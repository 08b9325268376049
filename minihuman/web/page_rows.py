"""The offsets in a grid world's row and a first-person world's arrays, generated for the page from the worlds' rules.

python -m minihuman.web.page_rows     # writes page/row.js, which is committed
"""

from pathlib import Path

from minihuman.worlds.first_person import rules
from minihuman.worlds.grid.core import state

PATH = Path(__file__).with_name("page") / "row.js"
_HEAD = """\
// Where in a world's first state what is. Generated: edit minihuman/worlds/grid/core/state.py or
// minihuman/worlds/first_person/rules.py, then run `python -m minihuman.web.page_rows`.
"""
_OF_ROW = (
    *("WIDTH", "HEIGHT", "DIRECTION", "CARRYING", "STEP", "MAX_STEPS", "PHASE", "ACTIONS", "MISSION", "FAILED"),
    *("HEADER", "PLAYING"),
)
_OF_NUMBERS = ("REWARD",)


def format_page_rows() -> str:
    """Return the text of `page/row.js`, a JavaScript module of constants."""
    rows = [f"export const {name} = {getattr(state, name)};" for name in _OF_ROW]
    numbers = [f"export const NUMBERS_{name} = {getattr(rules, name)};" for name in _OF_NUMBERS]
    return _HEAD + "\n".join([*rows, *numbers]) + "\n"


if __name__ == "__main__":
    PATH.write_text(format_page_rows(), encoding="utf-8", newline="\n")
    print(PATH)
