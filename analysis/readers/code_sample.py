"""Draw functions and docstrings that new readers grade, by a seed.

python analysis/readers/code_sample.py FOLDER --seed 1

It writes `functions.txt` (40 functions of 4 to 40 lines) and `docstrings.txt` (40 docstrings, each under the line that
defines what it describes), numbered. Files that protobuf generates are left out. `--also PACKAGE` draws as many from
another package and mixes them in; `functions-key.tsv` and `docstrings-key.tsv` say which are whose.
"""

import argparse
import ast
import random
import textwrap
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "minihuman"
SAMPLE = 40
SHORTEST = 4
LONGEST = 40
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def read_definitions(package: Path) -> Iterator[tuple[str, Definition, str]]:
    """Yield the functions and classes of a package: where each stands, its node and its source."""
    for path in sorted(package.rglob("*.py")):
        if path.stem.endswith("_pb2") or "tests" in path.parts:
            continue
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, Definition):
                yield f"{path.relative_to(package.parent)}:{node.lineno}", node, _cut_out(text, node)


def _cut_out(text: str, node: Definition) -> str:
    return textwrap.dedent(ast.get_source_segment(text, node, padded=True) or "")


def list_functions(package: Path) -> list[tuple[str, str]]:
    """Return the functions of 4 to 40 lines, each with its place."""
    return [
        (place, source)
        for place, node, source in read_definitions(package)
        if not isinstance(node, ast.ClassDef) and SHORTEST <= len(source.splitlines()) <= LONGEST
    ]


def list_docstrings(package: Path) -> list[tuple[str, str]]:
    """Return the docstrings, each under the first line of what it describes."""
    docstrings = []
    for place, node, source in read_definitions(package):
        text = ast.get_docstring(node)
        if text is not None:
            docstrings.append((place, f'{source.splitlines()[0]}\n    """{text}"""'))
    return docstrings


def write_sample(folder: Path, name: str, drawn: list[tuple[str, str]]) -> None:
    """Write the numbered texts, and the key that says where each is from."""
    texts = [f"## {number}\n\n{source}\n" for number, (_, source) in enumerate(drawn, 1)]
    (folder / f"{name}.txt").write_text("\n".join(texts), encoding="utf-8")
    key = [f"{number}\t{place}\n" for number, (place, _) in enumerate(drawn, 1)]
    (folder / f"{name}-key.tsv").write_text("".join(key), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--also", type=Path, help="a package that readers cannot tell from ours")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    packages = [PACKAGE, arguments.also] if arguments.also else [PACKAGE]
    for name, list_all in (("functions", list_functions), ("docstrings", list_docstrings)):
        random_numbers = random.Random(f"{name} {arguments.seed}")
        drawn = [text for package in packages for text in random_numbers.sample(list_all(package), SAMPLE)]
        if arguments.also:
            random_numbers.shuffle(drawn)
        write_sample(arguments.folder, name, drawn)


if __name__ == "__main__":
    main()
