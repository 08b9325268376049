"""The floor plan of an episode as a small PNG, for viewers that show a log's images."""

import io
import math

from PIL import Image, ImageDraw

from minihuman.worlds.pose import Map, Pose

LONG_SIDE_PX = 384
MARGIN_PX = 12
ARROW_PX = 9  # its least radius
PAPER, FLOOR, WALL, AGENT = "#ffffff", "#f1efe9", "#33363b", "#0072b2"


def floor_plan_png(floor: Map, pose: Pose | None) -> bytes:
    """Draw a map seen from above, +x right and +z down, with its things and, if given, where the agent starts."""
    x0, z0, x1, z1 = floor.bounds
    scale = (LONG_SIDE_PX - 2 * MARGIN_PX) / max(x1 - x0, z1 - z0, 1e-9)  # px per cell or metre

    def at(x: float, z: float) -> tuple[float, float]:
        return (MARGIN_PX + (x - x0) * scale, MARGIN_PX + (z - z0) * scale)

    right, bottom = at(x1, z1)
    image = Image.new("RGB", (math.ceil(right) + MARGIN_PX, math.ceil(bottom) + MARGIN_PX), PAPER)
    draw = ImageDraw.Draw(image)
    draw.rectangle((*at(x0, z0), right, bottom), fill=FLOOR)
    for wall in floor.walls:
        draw.line((*at(wall[0], wall[1]), *at(wall[2], wall[3])), fill=WALL, width=3)
    for thing in floor.things:
        x, z = at(thing.x, thing.z)
        radius = max(thing.radius * scale, 2.0)
        draw.ellipse((x - radius, z - radius, x + radius, z + radius), fill=thing.colour, outline=WALL)
    if pose is not None:
        draw.polygon([at(*corner) for corner in _arrow(pose, max(0.4, ARROW_PX / scale))], fill=AGENT)
    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


def _arrow(pose: Pose, radius: float) -> list[tuple[float, float]]:
    """Corners (x, z) of an arrowhead at the pose, pointing where it looks."""
    angles = (pose.yaw_rad, pose.yaw_rad + 2.5, pose.yaw_rad - 2.5)
    return [(pose.x + radius * math.cos(angle), pose.z - radius * math.sin(angle)) for angle in angles]
