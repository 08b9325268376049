"""Digests of the sources from which compiled functions, or all worlds together, were made.

The result of a function depends on its own module, on the modules that this one imports, and so on. This module does
not import Numba, so that a log can be verified without it.
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
    """Return the digest of all sources of the built-in worlds: 16 hexadecimal digits, the same on every machine."""
    return _digest(sorted(_list_sources(files(f"{_OURS}.worlds"), "")))


@cache
def kernels_digest() -> str:
    """Return the digest of all sources from which the page's modules are built.

    A page whose modules were built from other sources does not compute worlds.
    """
    return _digest_exports("exports")


@cache
def layouts_digest() -> str:
    """Return the digest of all sources from which the page's layouts are built."""
    return _digest_exports("layout_exports")


def _digest_exports(module: str) -> str:
    names = _find_reached(f"{_OURS}.worlds.build.{module}", f"{_OURS}.worlds.build.compilation")
    return _digest([(name, _source(name) or "") for name in sorted(names)])


def import_closure(*modules: str) -> list[str]:
    """Return the files of some of our modules and of all of ours that they import, directly or indirectly.

    The files are sorted and given by their paths in the package.
    """
    paths = [name.removeprefix(f"{_OURS}.").replace(".", "/") for name in _find_reached(*modules) - {_OURS}]
    packages = {path for path in paths if files(_OURS).joinpath(path).is_dir()}
    return sorted(f"{path}/__init__.py" if path in packages else f"{path}.py" for path in paths)


def _find_reached(*modules: str) -> set[str]:
    """Return the given modules and all of ours that they import, except the module that loads compiled code.

    Each source is read once per process, when it is first needed: an edit made later is not part of the running code.
    """
    reached = set(modules)
    waiting = list(modules)
    while waiting:
        imported = _imports(waiting.pop()) - reached - {f"{_OURS}.worlds.kernels"}
        reached |= imported
        waiting += imported
    return reached


def _digest(sources: list[tuple[str, str]]) -> str:
    """Return the digest of named texts: 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for name, text in sources:
        digest.update(f"{name} {len(text)}\n{text}".encode())
    return digest.hexdigest()[:16]


def _list_sources(folder: Traversable, path: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of every Python file below a folder; ``path`` precedes each file's path in it."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _list_sources(entry, f"{path}{entry.name}/")
        elif entry.name.endswith(".py"):
            yield f"{path}{entry.name}", entry.read_text(encoding="utf-8")


@cache
def _source(module: str) -> str | None:
    """Return the source of one of our modules, or None if there is no module of that name."""
    for path in (_path(module, "/__init__.py"), _path(module)):
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def _path(module: str, suffix: str = ".py") -> Traversable:
    return files(_OURS).joinpath(f"{module.removeprefix(_OURS).replace('.', '/').lstrip('/')}{suffix}".lstrip("/"))


@cache
def _imports(module: str) -> frozenset[str]:
    """Return our modules that a module's source imports, perhaps with some more, which does no harm."""
    if _path(module, "/__init__.py").is_file():
        package = module
    else:
        package = module.rpartition(".")[0]
    imported: set[str] = set()
    # of "from source import names", or of "import clauses"
    for source, names, clauses in _IMPORT.findall((_source(module) or "").replace("\\\n", " ")):
        bases = [source] if source else clauses.split(",")
        for base in (resolve_name(clause.split()[0], package) for clause in bases if clause.strip()):
            imported |= {base, *(f"{base}.{name}" for name in re.findall(r"\w+", names))}
    return frozenset(name for name in imported if name.partition(".")[0] == _OURS and _source(name) is not None)
