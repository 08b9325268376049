"""Bindings of the axes of gamepads and mice and of clicks to the components of vector actions."""

import msgspec


class AxisBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An axis that moves a component of the action."""

    component: int  # of the action's vector, from 0
    scale: float = 1.0  # sensitivity, of the mouse's per pixel; below 0 the axis is inverted


class SpotBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The action of a click in the world's picture, and the components that its position sets."""

    x: int  # the component that gets the place from left to right
    y: int  # and from top to bottom
    action: str = ""  # an element that is done with it: "choice_0_6"


class Bindings(msgspec.Struct, frozen=True):
    """The axes and clicks that set an action's components in addition to keys."""

    axes: dict[str, AxisBinding] = {}  # by the axis's name
    spot: SpotBinding | None = None
