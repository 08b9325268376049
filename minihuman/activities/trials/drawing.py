"""Drawing of a trial's stimuli: texts, shapes and images at their places."""

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from minihuman.activities.trials.plan import IMAGE_FORMATS
from minihuman.activities.trials.schedule import StimulusContent
from minihuman.activities.trials.screens import TrialScreen
from minihuman.display.drawing import sheet as theme
from minihuman.display.drawing.sheet import Sheet, Size
from minihuman.display.shaping import is_rtl
from minihuman.display.text import draw_line
from minihuman.display.typefaces import select_typefaces
from minihuman.errors import WorldError
from minihuman.experiment.machine.screens import TextLocale
from minihuman.experiment.stimuli import BACKGROUND, SHAPES, read_colour

_MOST_KEPT = 64  # drawn pictures in the cache, some megabytes each
_RING_RADIUS = 0.34  # of the picture's height
_WIDEST = 0.9  # the greatest width of an image, as a share of the picture's width
_MOST_IMAGES = 64  # decoded image files in the cache
_LEAST_TEXT_PX = 4
_DIAMOND_REACH = 1.2  # from a diamond's centre to its corners, in half sizes; its area is then close to a circle's
_LEGEND_AT = 0.95  # of the screen's height
_LEGENDS_HIGH = 32  # how many times the legend's size goes into the screen's height
_LEGEND_WIDTH = 0.95  # of the screen's width


@dataclass(frozen=True, slots=True)
class DrawnSheet:
    """A sheet that has been drawn before, uint8[H, W, 3]; showing it takes only a copy."""

    page: NDArray[np.uint8]


def draw_trial(screen: TrialScreen, size_px: Size) -> DrawnSheet:
    """Draw what is visible in a window, with the keys below if the trial shows them.

    The trial's other pictures are drawn, too, and cached, because there is time for that before the first picture.
    """
    files = _Files(screen.files)
    for contents in screen.pictures[: _MOST_KEPT // 2]:  # half of the cache, so that these do not displace each other
        _draw_sheet(contents, size_px, files, screen.legend, screen.locale)
    return _draw_sheet(screen.contents, size_px, files, screen.legend, screen.locale)


@lru_cache(maxsize=_MOST_KEPT)
def _draw_sheet(
    contents: tuple[StimulusContent, ...], size_px: Size, files: "_Files", legend: str, locale: TextLocale
) -> DrawnSheet:
    """Draw stimuli on a sheet of a window's size, with a line of keys at the bottom unless the legend is empty."""
    sheet = Sheet(size_px, locale)
    sheet.page.paste(_draw(contents, size_px, files, locale.language), (0, 0))
    if legend:
        width, height = size_px
        centre = (width / 2, height * _LEGEND_AT)
        sheet.put_line(centre, legend, round(height / _LEGENDS_HIGH), width * _LEGEND_WIDTH, theme.MUTED_INK)
    return DrawnSheet(np.array(sheet.page))


def draw_stimuli(
    contents: Sequence[StimulusContent], size_px: Size, files: Mapping[str, bytes], language: str
) -> NDArray[np.uint8]:
    """Draw stimuli as uint8[H, W, 3]; the last one is in front.

    Args:
        contents: what each stimulus shows, and where.
        size_px: the picture's width and height in pixels.
        files: the image files, by name.
        language: the language of the texts, by which their typefaces are chosen.

    Raises:
        WorldError: if a shape or colour is unknown, or an image is missing or cannot be decoded.
    """
    return np.asarray(_draw(tuple(contents), size_px, _Files(files), language))


class _Files:
    """A protocol's files as part of a cache's key; two are equal if they wrap the same object."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self.files = files

    def __hash__(self) -> int:
        return id(self.files)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Files) and other.files is self.files


def _draw(contents: tuple[StimulusContent, ...], size_px: Size, files: _Files, language: str) -> Image.Image:
    picture = Image.new("RGB", size_px, BACKGROUND)
    for content in contents:
        _draw_content(picture, content, files, language)
    return picture


def _draw_content(picture: Image.Image, content: StimulusContent, files: _Files, language: str) -> None:
    """Draw a stimulus: its image, then its shape, then its text on one line or word by word around a ring."""
    width, height = picture.size
    draw = ImageDraw.Draw(picture)
    ink = read_colour(content.colour)
    centre = (content.x * width, content.y * height)
    if content.image:
        _paste_image(picture, content, files)
    if content.shape:
        _draw_shape(draw, content, centre, content.size * height / 2, ink)
    if not content.text:
        return
    size_px = max(_LEAST_TEXT_PX, round(content.size * height))
    lines = [content.text]
    points = [centre]
    if content.layout == "ring":
        lines = content.text.split()
        points = _find_ring_points(centre, len(lines), _RING_RADIUS * height)
    for line, point in zip(lines, points, strict=True):
        draw_line(
            draw,
            point,
            line,
            faces=select_typefaces(language),
            size_px=size_px,
            colour=ink,
            anchor="m",
            rtl=is_rtl(line),
        )


def _find_ring_points(centre: tuple[float, float], count: int, radius: float) -> list[tuple[float, float]]:
    """Return points at equal distances on a circle around a centre, clockwise from the top."""
    angles = [2 * math.pi * index / count for index in range(count)]
    return [(centre[0] + radius * math.sin(angle), centre[1] - radius * math.cos(angle)) for angle in angles]


def _draw_shape(
    draw: ImageDraw.ImageDraw, content: StimulusContent, centre: tuple[float, float], reach: float, ink: Any
) -> None:
    """Draw a stimulus's shape around a centre in pixels; ``reach`` is half its size in pixels.

    Raises:
        WorldError: if the shape is unknown.
    """
    x, y = centre
    box = (x - reach, y - reach, x + reach, y + reach)
    match content.shape:
        case "circle":
            draw.ellipse(box, fill=ink)
        case "square":
            draw.rectangle(box, fill=ink)
        case "diamond":
            draw.regular_polygon((x, y, reach * _DIAMOND_REACH), 4, rotation=45, fill=ink)
        case shape:
            raise WorldError(f"shape is {shape!r}; use one of {', '.join(SHAPES)}")


def _paste_image(picture: Image.Image, content: StimulusContent, files: _Files) -> None:
    """Paste a stimulus's image, scaled to the stimulus's height unless that makes it too wide."""
    width, height = picture.size
    image = _read_image(content.image, files)
    scale = min(content.size * height / image.height, _WIDEST * width / image.width)
    scaled = image.resize((max(1, round(image.width * scale)), max(1, round(image.height * scale))))
    left_px = round(content.x * width - scaled.width / 2)
    top_px = round(content.y * height - scaled.height / 2)
    picture.paste(scaled, (left_px, top_px), scaled)


@lru_cache(maxsize=_MOST_IMAGES)
def _read_image(name: str, files: _Files) -> Image.Image:
    """Decode an image file of the protocol; raise `WorldError` if it is missing or of another format."""
    content = files.files.get(name)
    if content is None:
        raise WorldError(f"image {name!r} is not in the protocol's folder; copy it there")
    try:
        return Image.open(io.BytesIO(content), formats=IMAGE_FORMATS).convert("RGBA")
    except (ValueError, OSError, SyntaxError) as error:
        raise WorldError(
            f"image {name!r} is no PNG, JPEG or WebP ({type(error).__name__}); save it as one of these"
        ) from error
