"""On which line of a TOML file a value is: Python's parser does not tell. For messages, so near enough is enough."""

import re
from collections import Counter

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"\s*((?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*'))*)\s*=")
_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}\n]', re.DOTALL
)
_STEP = re.compile(r"(\.[^.\[\]]+|\[\d+\])$")


class Lines:
    """The lines of a file's tables and keys, by path: "$.blocks[1].episodes" is on line 23."""

    def __init__(self, text: str) -> None:
        self._at = {"$": 1}
        table = "$"
        counts: Counter[str] = Counter()
        for number, line in _statements(text):
            if header := _HEADER.match(line):
                table = _table(header[2], counts, array=header[1] == "[[")
                self._at.setdefault(table, number)
                self._at.setdefault(_STEP.sub("", table) if table.endswith("]") else table, number)
            elif key := _KEY.match(line):
                self._at.setdefault(f"{table}.{_plain(key[1])}", number)

    def of(self, path: str) -> int:
        """The line of a path, or of the nearest thing around it."""
        while path not in self._at and _STEP.search(path):
            path = _STEP.sub("", path)
        return self._at.get(path, 1)


def _statements(text: str) -> list[tuple[int, str]]:
    """The first line of every statement, with its number: what goes on inside strings and brackets is passed over."""
    lines = text.split("\n")
    starts: list[tuple[int, str]] = [(1, lines[0])]
    number, depth = 1, 0
    for token in _TOKEN.finditer(text):
        word = token[0]
        if word == "\n":
            number += 1
            if depth == 0:
                starts.append((number, lines[number - 1]))
        elif word in "[{":
            depth += 1
        elif word in "]}":
            depth = max(0, depth - 1)
        else:
            number += word.count("\n")
    return starts


def _table(name: str, counts: "Counter[str]", *, array: bool) -> str:
    """The path of a header; tables inside arrays belong to the last one."""
    path = "$"
    parts = [part.strip().strip("\"'") for part in name.split(".")]
    for place, part in enumerate(parts):
        path = f"{path}.{part}"
        if place == len(parts) - 1 and array:
            counts[path] += 1
        if counts[path]:
            path = f"{path}[{counts[path] - 1}]"
    return path


def _plain(key: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in key.split("."))
