"""Bindings of gamepad axes and clicks to the components of vector actions."""

import msgspec


class AxisBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A gamepad axis that moves a component of the action."""

    component: int  # of the action's vector, from 0
    scale: float = 1.0  # sensitivity; below 0 the axis is inverted


class SpotBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The action of a click in the world's picture, and the components that its position sets."""

    x: int  # the component that gets the place from left to right
    y: int  # and from top to bottom
    action: str = ""  # an element that is done with it: "choice_0_6"


class Bindings(msgspec.Struct, frozen=True):
    """The axes and clicks that set an action's components in addition to keys."""

    axes: dict[str, AxisBinding] = {}  # of the gamepad
    spot: SpotBinding | None = None
