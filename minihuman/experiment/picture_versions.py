"""Whether this version of the package draws first-person worlds as the version that recorded a session did."""

from collections.abc import Mapping
from typing import Any

from minihuman.worlds.contract import PICTURES_VERSION, SHADOWS_VERSION


def renders_same_images(facts: Mapping[str, str]) -> bool:
    """Return whether this version draws first-person worlds as the version that recorded a session with these facts."""
    return facts.get("pictures", "1") == str(PICTURES_VERSION)


def may_draw_other_shadows(facts: Mapping[str, str], options: Mapping[str, Any]) -> bool:
    """Return whether the shadows of a world with these options may differ from those in a session with these facts.

    Before version 2, a shadow that the edge of a picture cut off was drawn wrongly.
    """
    return bool(options.get("contact_shadows")) and facts.get("shadow_pictures", "1") != str(SHADOWS_VERSION)
