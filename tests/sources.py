"""The package's sources, each parsed once a process: parsing all of them takes three seconds."""

import ast
from functools import cache
from pathlib import Path


@cache
def parse_source(path: Path) -> ast.Module:
    """Parse a module of the package. It is shared: read it, and change nothing in it."""
    return ast.parse(path.read_text(encoding="utf-8"))
