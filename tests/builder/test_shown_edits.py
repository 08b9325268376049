"""What the page shows before an edit is answered is what the server makes of the file: random edits of protocols."""

import json
import random
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from minihuman.builder.document import NotEditableError, TomlDocument
from tests.builder.test_document import PROTOCOLS, walk
from tests.counts import count
from tests.machine import needs

PAGE = Path(__file__).parents[2] / "minihuman" / "builder" / "page"
N_EDITS = count(3, 30)  # of each protocol
SCRIPT = """
const { applyEdit } = await import(process.argv[1]);
const cases = JSON.parse(await new Response(process.stdin).text());
for (const { tree, edit } of cases) applyEdit(tree, edit);
console.log(JSON.stringify(cases.map(({ tree }) => tree)));
"""


def make_edits(document: TomlDocument, choose: random.Random) -> Iterator[tuple[dict[str, Any], TomlDocument]]:
    """Yield edits of a document with what each makes of it."""
    paths = [path for path, _ in walk(document.tree)]
    elements = [path for path in paths if isinstance(path[-1], int)]
    for path in choose.choices(paths, k=N_EDITS):
        with suppress(NotEditableError):
            yield {"op": "set", "path": path, "value": "other"}, document.set(path, "other")
        with suppress(NotEditableError):
            yield {"op": "remove", "path": path}, document.remove(path)
    for path in choose.choices(elements, k=N_EDITS):
        to = choose.randrange(len(document.find(path[:-1])))
        with suppress(NotEditableError):
            yield {"op": "move", "path": path, "to": to}, document.move(path, to)
        member = document.find(path)
        with suppress(NotEditableError):
            yield {"op": "insert", "path": path, "value": member}, document.insert(path, member)
        with suppress(NotEditableError):
            yield {"op": "duplicate", "path": path, "value": {}}, document.duplicate(path)


def prune(content: Any) -> Any:
    """Return values without empty tables and lists: the file has none whose last member had a header of its own."""
    if isinstance(content, dict):
        pruned = {key: prune(member) for key, member in content.items()}
        return {key: member for key, member in pruned.items() if member not in ({}, [])}
    if isinstance(content, list):
        return [prune(member) for member in content]
    return content


@needs("node")
@pytest.mark.nightly(sample=True)
def test_the_page_foresees_what_the_server_makes_of_the_file() -> None:
    choose = random.Random(3)
    cases = []
    expected = []
    for path in PROTOCOLS:
        document = TomlDocument.parse(path.read_text(encoding="utf-8"))
        for edit, edited in make_edits(document, choose):
            is_copy_of_scalar = edit["op"] == "duplicate" and not isinstance(document.find(edit["path"]), dict)
            if not is_copy_of_scalar:  # the page duplicates tables alone
                cases.append({"tree": document.tree, "edit": edit})
                expected.append(edited.tree)
    command = ["node", "--input-type=module", "-e", SCRIPT, str(PAGE / "edits.js")]
    answer = subprocess.run(command, input=json.dumps(cases), capture_output=True, text=True, check=True)
    assert len(cases) > len(PROTOCOLS)
    assert prune(json.loads(answer.stdout)) == prune(expected)
