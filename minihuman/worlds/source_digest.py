"""Digests of the sources that compiled functions, or all worlds together, were made of.

What a function computes is decided by its own module, by the modules that this one imports, and so on. Does not import
Numba, so that a log can be verified without it.
"""

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import resolve_name

_OURS = "minihuman"
# wherever in a line; a string that reads like an import only adds a module
_IMPORT = re.compile(r"(?:^|[;:])[ \t]*(?:from\s+([\w.]+)\s+import\s*(\([^)]*\)|[^\n;]+)|import\s+([^\n;]+))", re.M)


@cache
def rules_digest() -> str:
    """Digest every source of the worlds that minihuman brings: 16 hexadecimal digits, the same on every machine."""
    return _digest(sorted(_below(files(f"{_OURS}.worlds"), "")))


@cache
def kernels_digest() -> str:
    """Digest all sources that the page's modules are built from: a page with modules of others does not compute."""
    names = _reached(f"{_OURS}.worlds.build.exports", f"{_OURS}.worlds.build.compilation")
    return _digest([(name, _source(name) or "") for name in sorted(names)])


def import_closure(*modules: str) -> list[str]:
    """Return the files of our modules and of all they import from us, by their paths in the package, in order."""
    named = [name.removeprefix(f"{_OURS}.").replace(".", "/") for name in _reached(*modules) - {_OURS}]
    packages = {way for way in named if files(_OURS).joinpath(way).is_dir()}
    return sorted(f"{way}/__init__.py" if way in packages else f"{way}.py" for way in named)


def _reached(*modules: str) -> set[str]:
    """Return modules and all they import from us, except what only loads compiled code.

    Each source is read once a process, when it first counts: an edit made later is not part of what runs now.
    """
    reached = set(modules)
    new = list(modules)
    while new:
        imported = _imports(new.pop()) - reached - {f"{_OURS}.worlds.kernels"}
        reached |= imported
        new += imported
    return reached


def _digest(sources: list[tuple[str, str]]) -> str:
    digest = hashlib.sha256()
    for name, text in sources:
        digest.update(f"{name} {len(text)}\n{text}".encode())
    return digest.hexdigest()[:16]


def _below(folder: Traversable, path: str) -> Iterator[tuple[str, str]]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _below(entry, f"{path}{entry.name}/")
        elif entry.name.endswith(".py"):
            yield f"{path}{entry.name}", entry.read_text(encoding="utf-8")


@cache
def _source(module: str) -> str | None:
    """Read the source of a module of ours; None where there is none of that name."""
    for path in (_path(module, "/__init__.py"), _path(module)):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def _path(module: str, suffix: str = ".py") -> Traversable:
    return files(_OURS).joinpath(f"{module.removeprefix(_OURS).replace('.', '/').lstrip('/')}{suffix}".lstrip("/"))


@cache
def _imports(module: str) -> frozenset[str]:
    """Return the modules of ours that a module's source imports; one too many does no harm."""
    if _path(module, "/__init__.py").is_file():
        package = module
    else:
        package = module.rpartition(".")[0]
    imported: set[str] = set()
    for source, names, plain in _IMPORT.findall((_source(module) or "").replace("\\\n", " ")):
        bases = [source] if source else plain.split(",")
        for base in (resolve_name(clause.split()[0], package) for clause in bases if clause.strip()):
            imported |= {base, *(f"{base}.{name}" for name in re.findall(r"\w+", names))}
    return frozenset(name for name in imported if name.partition(".")[0] == _OURS and _source(name) is not None)
