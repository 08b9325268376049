"""The protocols that come with the package: inside it when installed, beside it in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def shipped_protocol(name: str) -> Path:
    """Where a shipped protocol's TOML file is, by the file's name without its ending."""
    inside = _PACKAGE / "protocols" / f"{name}.toml"
    return inside if inside.exists() else _PACKAGE.parent / "protocols" / f"{name}.toml"
