"""Stimuli: worlds for trials, whose options say what a trial shows and what each response earns.

A trial is an episode of a single step (two in the two-step task): the response, or ``none`` at the deadline.
Probabilistic rewards are drawn from the seed of the reset, so a trial replays like any other episode.
"""

import base64
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw

from minihuman.display.shaping import is_rtl
from minihuman.display.text import draw_line
from minihuman.display.typefaces import select_typefaces
from minihuman.errors import WorldError
from minihuman.experiment.trial_responses import NO_RESPONSE as NO_RESPONSE

SIDES = {"left": 0.25, "centre": 0.5, "right": 0.75}  # of the width
_CARDS = {"left": 0.27, "right": 0.73}  # of the width
_CARD_SCALE = 0.75  # half of a card's side, as a multiple of the height of its text
_MAX_IMAGE_WIDTH = 0.45  # of the picture's width
_DIAMOND_SCALE = 1.2  # of the diamond's radius to the circle's, so that their areas look alike
SHAPES = ("circle", "square", "diamond")
BACKGROUND = "#16191e"
_TWO_STEP_NAMES = (("A", "B"), ("C", "D"), ("E", "F"))
_TWO_STEP_COLOURS = ("#e8e6e1", "#f0b048", "#56b4e9")


class Stimulus(gymnasium.Env[NDArray[np.int64], int]):
    """A world that shows one stimulus and takes one response.

    The observation is int64[2]: the number of responses so far, and 0. The stimulus is in the episode's options.

    Args:
        render_mode: the render mode, ``rgb_array``.
        responses: the names of the actions in addition to ``none``.
        text: the text shown at ``side``.
        left: the text on the left card, for a choice between two cards.
        right: the text on the right card.
        image: the image shown at ``side``, a PNG in URL-safe Base64.
        shape: the filled shape shown at ``side``: "circle", "square" or "diamond".
        colour: the colour of text and shape, a CSS name or "#rrggbb".
        side: the position of text, image and shape: "left", "centre" or "right".
        size: the size of the stimulus as a fraction of the picture's height.
        correct: the response that earns 1; ``none`` for no response, "" if the reward is probabilistic.
        language: the language of the text, which selects its typefaces.
        delay_ms: a time in the trial's timeline that a design chooses, such as a stop signal's delay; not shown here.
        **chances: options ``chance_RESPONSE``, the probability that a response earns 1.

    Raises:
        WorldError: if an option has an invalid value.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's
    option_prefix = "chance_"  # the prefix of options that are named after responses
    picture_size_px = (640, 480)  # set by the caller of ``render``
    last_reward = 0.0  # of the last response
    choice = 0  # the number of the choice on the screen, in a trial of several choices
    stop_delay_ms: float | None = None  # of a trial's stop signal, for simulated participants; None without one
    go_response = ""  # the response that would be correct without the stop signal

    def __init__(
        self,
        render_mode: str | None = None,
        *,
        responses: tuple[str, ...] = ("left", "right"),
        text: str | float = "",
        left: str | float = "",
        right: str | float = "",
        image: str = "",
        shape: str = "",
        colour: str = "#e8e6e1",
        side: str = "centre",
        size: float = 0.2,
        correct: str = "",
        language: str = "en",
        delay_ms: float = 0.0,
        **chances: float,
    ) -> None:
        self.render_mode = render_mode
        self.action_names = (*(str(response) for response in responses), NO_RESPONSE)
        self.action_space = gymnasium.spaces.Discrete(len(self.action_names))  # type: ignore[assignment]
        self.observation_space = gymnasium.spaces.Box(0, 2, (2,), np.int64)
        self._chances = _read_chances(chances, self.action_names)
        self.correct_response = str(correct)  # a table's cell may be a number, such as 1
        if self.correct_response:
            self._chances = {self.correct_response: 1.0}
        _require_choice("side", side, tuple(SIDES))
        _require_choice("shape", shape, ("", *SHAPES))
        _require_choices("correct", self._chances, self.action_names)
        self._language = _require_language(language)
        self._ink = read_colour(colour)
        self._text = str(text)
        cards = ((left, _CARDS["left"]), (right, _CARDS["right"]))
        self._cards = tuple((str(label), card_x) for label, card_x in cards if label != "")
        self._shape = shape
        self._side = SIDES[side]
        self._size = _read_number("size", size, low=0.0, high=10.0)
        _read_number("delay_ms", delay_ms, low=0.0, high=3_600_000.0)
        self._image = _read_image(image)
        self.prompted_responses = self._find_responses(str(text), side)

    def _find_responses(self, *words: str) -> tuple[str, ...]:
        """Return the responses whose names are among the words, whatever their case."""
        lower_words = {word.strip().lower() for word in words}
        return tuple(name for name in self.action_names if name.lower() in lower_words)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int64], dict[str, Any]]:
        """Reset the trial, show the stimulus, and return the observation and the info."""
        super().reset(seed=seed)
        self._n_steps = 0
        self.last_reward = 0.0
        return self._observe(), {"onset": True}

    def step(self, action: int) -> tuple[NDArray[np.int64], float, bool, bool, dict[str, Any]]:
        """Record the response, draw its reward and end the trial; return the results as Gymnasium defines them."""
        self._n_steps += 1
        chance = self._chances.get(self.action_names[int(action)], 0.0)
        self.last_reward = float(self.np_random.random() < chance)
        return self._observe(), self.last_reward, True, False, {}

    def _observe(self) -> NDArray[np.int64]:
        return np.array([self._n_steps, 0], np.int64)

    def render(self) -> Any:
        """Return the stimulus as a picture of ``picture_size_px``, uint8[height, width, 3].

        After the response the picture shows only the background.
        """
        width, height = self.picture_size_px
        picture = Image.new("RGB", (width, height), BACKGROUND)
        if not self._is_over:
            self._draw(picture)
        return np.array(picture)

    @property
    def _is_over(self) -> bool:
        return self._n_steps > 0

    def _draw(self, picture: Image.Image) -> None:
        """Draw the stimulus into a picture: its image, shape, text and cards."""
        width, height = picture.size
        draw = ImageDraw.Draw(picture)
        x = self._side * width
        y = height / 2
        if self._image is not None:
            self._draw_image(picture, self._image, x, y)
        radius = self._size * height / 2
        box = (x - radius, y - radius, x + radius, y + radius)
        match self._shape:
            case "circle":
                draw.ellipse(box, fill=self._ink)
            case "square":
                draw.rectangle(box, fill=self._ink)
            case "diamond":
                draw.regular_polygon((x, y, radius * _DIAMOND_SCALE), 4, rotation=45, fill=self._ink)
        self._draw_text(draw, self._text, x, y, self._ink)
        for label, card_x in self._cards:
            self._draw_card(draw, label, card_x * width, y, self._ink)

    def _draw_image(self, picture: Image.Image, image: Image.Image, x: float, y: float) -> None:
        """Draw an image centred at (x, y) in pixels, as high as the set size unless it is then wider than its limit."""
        width, height = picture.size
        scale = min(self._size * height / image.height, _MAX_IMAGE_WIDTH * width / image.width)
        scaled_image = image.resize((max(1, round(image.width * scale)), max(1, round(image.height * scale))))
        top_left = (round(x - scaled_image.width / 2), round(y - scaled_image.height / 2))
        picture.paste(scaled_image, top_left, scaled_image)

    def _draw_card(self, draw: ImageDraw.ImageDraw, text: str, x: float, y: float, ink: Any) -> None:
        """Draw a card, a square with rounded corners and a text, centred at (x, y) in pixels."""
        half_side = self._size * self.picture_size_px[1] * _CARD_SCALE
        box = (x - half_side, y - half_side, x + half_side, y + half_side)
        draw.rounded_rectangle(box, radius=half_side / 4, outline=ink, width=max(2, round(half_side / 24)))
        self._draw_text(draw, text, x, y, ink)

    def _draw_text(self, draw: ImageDraw.ImageDraw, text: str, x: float, y: float, ink: Any) -> None:
        """Draw a line of text centred at (x, y) in pixels."""
        size_px = max(8, round(self._size * self.picture_size_px[1]))
        faces = select_typefaces(self._language)
        draw_line(draw, (x, y), text, faces=faces, size_px=size_px, colour=ink, anchor="m", rtl=is_rtl(text))


class TwoStep(Stimulus):
    """The two-step task of Daw et al. (2011, Neuron 69): a choice that commonly leads to one of two further choices.

    The observation is int64[2]: the number of responses so far (2 after no response), and the pair of the second
    choice, 0 before it.

    Args:
        render_mode: the render mode, ``rgb_array``.
        common: the probability of the common transition; left commonly leads to the first pair.
        chance_1: the probability of a reward for the left choice of the first pair.
        chance_2: the probability of a reward for the right choice of the first pair.
        chance_3: the probability of a reward for the left choice of the second pair.
        chance_4: the probability of a reward for the right choice of the second pair.
    """

    def __init__(
        self,
        render_mode: str | None = None,
        *,
        common: float = 0.7,
        chance_1: float = 0.6,
        chance_2: float = 0.4,
        chance_3: float = 0.3,
        chance_4: float = 0.7,
    ) -> None:
        super().__init__(render_mode)
        self._common = _read_number("common", common)
        chances = {"chance_1": chance_1, "chance_2": chance_2, "chance_3": chance_3, "chance_4": chance_4}
        left_1, right_1, left_2, right_2 = (_read_number(name, chance) for name, chance in chances.items())
        self._reward_chances = ((left_1, right_1), (left_2, right_2))  # by pair and response

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int64], dict[str, Any]]:
        """Reset the trial, show the first choice, and return the observation and the info."""
        self._pair = 0  # 0 for the first choice, then the pair of the second choice
        self.choice = 0
        return super().reset(seed=seed, options=options)

    def step(self, action: int) -> tuple[NDArray[np.int64], float, bool, bool, dict[str, Any]]:
        """Make the first or second choice; ``none`` ends the trial without a reward. Return Gymnasium's results."""
        self._n_steps += 1
        response = self.action_names[int(action)]
        if response == NO_RESPONSE:
            self._n_steps = 2
            return self._observe(), 0.0, True, False, {}
        if not self._pair:
            is_common = self.np_random.random() < self._common
            self._pair = 1 if is_common == (response == "left") else 2  # left commonly leads to the first pair
            self.choice = self._pair
            return self._observe(), 0.0, False, False, {"onset": True}
        chance = self._reward_chances[self._pair - 1][int(response == "right")]
        self.last_reward = float(self.np_random.random() < chance)
        return self._observe(), self.last_reward, True, False, {}

    def _observe(self) -> NDArray[np.int64]:
        return np.array([self._n_steps, self._pair], np.int64)

    @property
    def _is_over(self) -> bool:
        return self._n_steps > 1

    def _draw(self, picture: Image.Image) -> None:
        """Draw the two cards of the present choice into a picture."""
        draw = ImageDraw.Draw(picture)
        width, height = picture.size
        ink = ImageColor.getrgb(_TWO_STEP_COLOURS[self._pair])[:3]
        for name, side in zip(_TWO_STEP_NAMES[self._pair], _CARDS.values(), strict=True):
            self._draw_card(draw, name, side * width, height / 2, ink)


def _require_choice(option: str, choice: str, allowed: Sequence[str]) -> None:
    if choice not in allowed:
        raise WorldError(f"{option} is {choice!r}; use one of {', '.join(filter(None, allowed))}")


def _require_choices(option: str, choices: Iterable[str], allowed: Sequence[str]) -> None:
    for choice in choices:
        _require_choice(option, choice, allowed)


def _require_language(language: object) -> str:
    if not isinstance(language, str):
        raise WorldError(f"language is {language!r}; use a code such as 'en'")
    return language


def read_colour(colour: str) -> Any:
    """Return a colour, a CSS name or "#rrggbb", as (red, green, blue), each 0 to 255.

    Raises:
        WorldError: if it is no CSS name and no "#rrggbb".
    """
    try:
        return ImageColor.getrgb(str(colour))[:3]
    except ValueError as error:
        raise WorldError(f"{colour!r} is not a colour; use a CSS colour name or #rrggbb") from error


def _read_number(name: str, number_or_text: str | float, *, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a number or its text, such as a table's "0.600", as a float; ``name`` is the option's name in errors.

    Raises:
        WorldError: if the value is not a finite number from ``low`` to ``high``.
    """
    try:
        number = math.nan if isinstance(number_or_text, bool) else float(number_or_text)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and low <= number <= high):
        if math.isinf(high):
            allowed = "a number"
        else:
            allowed = f"a number from {low:g} to {high:g}"
        raise WorldError(f"{name} is {number_or_text!r}; use {allowed}")
    return number


def _read_chances(chances: dict[str, float], responses: tuple[str, ...]) -> dict[str, float]:
    """Return the probability that each response earns 1, from the options named after responses.

    Raises:
        WorldError: if a value is not a number, or an option names no response.
    """
    chance_of_response: dict[str, float] = {}
    for option, chance in chances.items():
        response = option.removeprefix("chance_")
        if response == option or response not in responses:
            options = ", ".join(f"chance_{response}" for response in responses)
            raise WorldError(f"there is no option {option!r}; chances are called {options}")
        chance_of_response[response] = _read_number(option, chance)
    return chance_of_response


def _read_image(encoded: str) -> Image.Image | None:
    """Return a PNG in URL-safe Base64 as an RGBA image; None for "".

    Raises:
        WorldError: if the text is no PNG in Base64.
    """
    if not encoded:
        return None
    try:
        return Image.open(io.BytesIO(base64.urlsafe_b64decode(encoded)), formats=("PNG",)).convert("RGBA")
    except (ValueError, OSError) as error:
        raise WorldError(f"a stimulus image is not a PNG ({type(error).__name__}); save it as PNG") from error
