"""Digests of the sources that compiled functions, or all worlds together, were made of.

What a function computes is decided by its own module, by the modules that this one imports, and so on. Does not import
Numba, so that a log can be verified without it.
"""

import hashlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec, resolve_name

_OURS = "minihuman"
# wherever in a line; a string that reads like an import only adds a module
_IMPORT = re.compile(r"(?:^|[;:])[ \t]*(?:from\s+([\w.]+)\s+import\s*(\([^)]*\)|[^\n;]+)|import\s+([^\n;]+))", re.M)


@cache
def rules_digest() -> str:
    """Of every source of the worlds that minihuman brings, 16 hexadecimal digits: the same on every machine."""
    return _digest(sorted(_below(files(f"{_OURS}.worlds"), "")))


@cache
def kernels_digest() -> str:
    """Of all sources that the page's modules are built from: a page with modules of others does not compute."""
    names = _reached(f"{_OURS}.worlds.build.exports", f"{_OURS}.worlds.build.compilation")
    return _digest([(name, _source(name) or "") for name in sorted(names)])


def import_closure(*modules: str) -> list[str]:
    """The files of modules of ours and of all they import from us, by their paths in the package, in order."""
    paths = [name.replace(".", "/") + ("/__init__.py" if _is_package(name) else ".py") for name in _reached(*modules)]
    return sorted(path.removeprefix(f"{_OURS}/") for path in paths)


def _reached(*modules: str) -> set[str]:
    """Modules and all they import from us, but for what only loads what was compiled.

    Each source is read once a process, when it first counts: an edit made later is not part of what runs now.
    """
    seen, new = set(modules), list(modules)
    while new:
        found = _imports(new.pop()) - seen - {f"{_OURS}.worlds.kernels"}
        seen |= found
        new += found
    return seen


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
    loader = getattr(sys.modules.get(module), "__loader__", None)
    if loader is None and (spec := _spec(module)) is not None:
        loader = spec.loader
    text: str | None = getattr(loader, "get_source", lambda _: None)(module)
    return text


@cache
def _imports(module: str) -> frozenset[str]:
    """The modules of its own package and of ours that a module's source imports; those it only seems to do no harm."""
    package = module if _is_package(module) else module.rpartition(".")[0]
    found: set[str] = set()
    for source, names, plain in _IMPORT.findall((_source(module) or "").replace("\\\n", " ")):
        bases = [source] if source else plain.split(",")
        for base in (resolve_name(each.split()[0], package) for each in bases if each.strip()):
            if base.partition(".")[0] in (_OURS, module.partition(".")[0]):
                inside = re.findall(r"\w+", names) if _is_package(base) else ()
                found |= {base, *(f"{base}.{name}" for name in inside)}
    return frozenset(name for name in found if _source(name) is not None)


def _is_package(module: str) -> bool:
    known = sys.modules.get(module) or _spec(module)
    return hasattr(known, "__path__") or getattr(known, "submodule_search_locations", None) is not None


def _spec(module: str) -> ModuleSpec | None:
    try:
        return find_spec(module)
    except (ImportError, ValueError):
        return None
