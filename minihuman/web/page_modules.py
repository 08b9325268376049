"""JavaScript modules that activity kinds provide for their own screens: their files and their addresses."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import GROUP, find_kind
from minihuman.plugins import list_plugin_names

_ROOT = "/static"


def find_module_address(module: str) -> str:
    """Return the address from which the page loads a JavaScript module that an activity kind names "package:file"."""
    package, _, file = module.partition(":")
    return f"{_ROOT}/{package.replace('.', '/')}/{file}"


def list_page_modules() -> Iterator[tuple[str, Path]]:
    """Yield the address and the file of each JavaScript module in the packages that have activity kinds' modules.

    This includes the packages' other modules, because a kind's module may import them.

    Raises:
        ProtocolError: if a kind names a module that does not exist.
    """
    packages = {module.partition(":")[0] for name in list_plugin_names(GROUP) for module in _list_modules_of_kind(name)}
    for package in sorted(packages):
        folder = _find_folder(package)
        for path in sorted(folder.glob("*.js")):
            yield find_module_address(f"{package}:{path.name}"), path


def _list_modules_of_kind(name: str) -> list[str]:
    """Return the page modules of an activity kind's screens, after checking that their files exist.

    Raises:
        ProtocolError: if a module does not exist.
    """
    try:
        screens = find_kind(name).screens
    except ProtocolError:  # a kind that cannot be loaded here has no screens here
        return []
    modules = [screen.page_view.module for screen in screens if screen.page_view is not None]
    for module in modules:
        package, _, file = module.partition(":")
        path = _find_folder(package) / file
        if not path.is_file():
            raise ProtocolError(f"activity {name!r} names the page module {module!r}, but {path} does not exist")
    return modules


def _find_folder(package: str) -> Path:
    """Return the folder of a Python package; raise ProtocolError if the package is not installed."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ProtocolError(f"package {package!r}, which has an activity's page module, does not exist; install it")
    return Path(spec.origin).parent
