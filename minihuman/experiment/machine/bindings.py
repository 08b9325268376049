"""Bindings of the axes of gamepads and mice and of clicks to the components of vector actions."""

import msgspec


class AxisBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An axis that moves a component of the action."""

    component: int  # of the action's vector, from 0
    scale: float = 1.0  # sensitivity, of the mouse's per pixel; below 0 the axis is inverted


class SpotBinding(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The action of a click in the world's picture, and the components that its position sets."""

    x: int  # the component that is set by the click's position from left to right
    y: int  # the component that is set by its position from top to bottom
    action: str = ""  # an action that the click also makes, such as "choice_0_6"; "" for none


class Bindings(msgspec.Struct, frozen=True):
    """The axes and clicks that set an action's components in addition to keys."""

    axes: dict[str, AxisBinding] = {}  # by the axis's name
    spot: SpotBinding | None = None
