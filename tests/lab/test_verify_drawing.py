"""A floor plan's drawing in a log may have its edges a pixel off, as Pillow's releases put them; nothing more."""

import numpy as np
from PIL import Image, ImageDraw

from minihuman.admin.verify.messages import _differ_by_a_pixel


def _drawn(x: float, radius: float, colour: str = "#0072b2"):
    image = Image.new("RGB", (120, 120), "#f1efe9")
    ImageDraw.Draw(image).ellipse((x - radius, 60 - radius, x + radius, 60 + radius), fill=colour, outline="#33363b")
    return np.asarray(image)


def test_a_disc_whose_outline_is_a_pixel_off_is_the_same_drawing():
    assert _differ_by_a_pixel(_drawn(60, 6), _drawn(60, 6))
    assert _differ_by_a_pixel(_drawn(60, 6), _drawn(60.6, 6))


def test_a_disc_that_is_elsewhere_of_another_colour_or_missing_is_another_drawing():
    for other in (_drawn(64, 6), _drawn(60, 6, "#d55e00"), _drawn(60, 2), _drawn(60, 6)[:100]):
        assert not _differ_by_a_pixel(_drawn(60, 6), other)
        assert not _differ_by_a_pixel(other, _drawn(60, 6))
