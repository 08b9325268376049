"""Registration of the worlds with Gymnasium, at once if Gymnasium is loaded, otherwise as soon as it is.

Importing minihuman therefore stays cheap for commands that make no world, and `gymnasium.make` still knows our worlds.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from importlib.abc import Loader  # it brings temporary files and archives, and no method that is needed here


def register_with_gymnasium() -> None:
    """Register every world with Gymnasium now, or have it registered when Gymnasium is imported."""
    if "gymnasium" in sys.modules:
        _register_worlds()
    elif not any(isinstance(finder, _GymnasiumFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumFinder())


def _register_worlds() -> None:
    """Register every world with Gymnasium."""
    from minihuman.worlds.catalogue import register  # a page for every world: not needed where none is made

    register()


class _GymnasiumFinder:
    """An import finder that finds Gymnasium through the other finders, and then has our worlds registered."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        other_finders = (finder for finder in sys.meta_path if finder is not self)
        specs = (finder.find_spec(fullname, path, target) for finder in other_finders)
        spec = next((candidate for candidate in specs if candidate is not None), None)
        if spec is not None and spec.loader is not None:
            spec.loader = cast("Loader", _RegisteringLoader(spec.loader, self))
        return spec


class _RegisteringLoader:
    """An import loader that loads Gymnasium with its own loader, registers our worlds, and then removes itself."""

    def __init__(self, loader: "Loader", finder: _GymnasiumFinder) -> None:
        self._loader = loader
        self._finder = finder

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        spec.loader = self._loader
        try:
            return self._loader.create_module(spec)
        finally:
            spec.loader = cast("Loader", self)

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__.loader = module.__loader__ = self._loader
        self._loader.exec_module(module)
        if self._finder in sys.meta_path:
            sys.meta_path.remove(self._finder)
        _register_worlds()
