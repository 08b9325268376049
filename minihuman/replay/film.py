"""Films of episodes, and contact sheets of sessions. Every picture is redrawn and checked against the log.

Beside the participant's view, a film shows the keys with their actions, the map with the path so far, and each step's
key and reaction time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw

from minihuman.dataset.measures import response_ms
from minihuman.display.shaping import is_rtl, measure_width_px
from minihuman.display.text import draw_line
from minihuman.display.typefaces import Typeface, TypefaceSet, select_typefaces
from minihuman.display.video import VideoWriter
from minihuman.errors import LogError
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.replay.frames import BACKGROUND, fit_picture, render_frames

SIZE_PX = (840, 420)
VIEW_PX = (420, 420)
STEPS_PER_S = 8
FORMATS = ("mp4", "webm", "gif", "png")
PAPER = "#ffffff"
PANEL = "#f4f5f7"
INK = "#1f2328"
FAINT = "#6e747c"
BLUE = "#0969da"
# GIF compresses pictures of rooms badly
_GIF_COLOURS = 32
_GIF_PX = (560, 280)
_LINES = 7  # the largest number of listed steps
_MOST_KEYS = 6  # the largest number of drawn keys
_SHEET = 6  # pictures per episode on a contact sheet
_THUMB_PX = (200, 150)
# a film's panel beside the view; positions from the picture's upper edge
_MARGIN_PX = 20
_WORLD_TOP_PX = 14
_PLAYER_TOP_PX = 40
_KEYS_TOP_PX = 74
_MAP_TOP_PX = 70
_MAP_PX = 160
_PROGRESS_TOP_PX = 250
_STEPS_TOP_PX = 278
_STEP_LINE_PX = 19
_MOST_TITLE_CHARACTERS = 32
_MOST_CAPTION_CHARACTERS = 48
_KEYS_PER_ROW = 3
_KEY_PX = 44
_KEY_RADIUS_PX = 7
_KEY_PITCH_PX = (62, 78)  # from one key to the next, across and down
_CAPTION_OFFSET_PX = 55
_MOST_KEY_CHARACTERS = 5
_MOST_ACTION_CHARACTERS = 8
_ACTION_COLUMN_CHARACTERS = 10  # of the list of steps
_LEAST_SMALL = 3  # names of keys with at least so many characters are set small
_LEAST_THING_PX = 4
_AGENT_PX = 5
# a contact sheet
_DESCRIPTION_PX = 190  # width of the descriptions on the left
_HEADING_PX = 40
_TEXT_MARGIN_PX = 10
_LINE_HEIGHT_PX = 22
_MOST_BLOCK_CHARACTERS = 20
_COLUMN_GAP_PX = 6
_ROW_GAP_PX = 8
_MAP_MARGIN_PX = (20, 4)
_LABEL_MARGIN_PX = (5, 4)
_LABEL_HEIGHT_PX = 20


@dataclass(frozen=True, slots=True)
class Lettering:
    """The typefaces and size in which a film's text is set."""

    faces: TypefaceSet
    size_px: int


REGULAR = select_typefaces("en")
BOLD = select_typefaces("en", bold=True)
MONOSPACED = TypefaceSet(first=Typeface(str(Path(get_data_path(), "fonts", "ttf", "DejaVuSansMono.ttf"))))
TITLE = Lettering(BOLD, 19)
TEXT = Lettering(REGULAR, 14)
MONO = Lettering(MONOSPACED, 12)
KEY = Lettering(BOLD, 22)
_MIDDLE = 0.58  # the middle of a line, from its top, as a share of the type size


def draw_label(
    draw: ImageDraw.ImageDraw,
    position: tuple[float, float],
    text: str,
    colour: str,
    lettering: Lettering,
    *,
    centred: bool = False,
) -> None:
    """Draw a line of text; ``position`` (x, y) in pixels is its upper left corner or, if ``centred``, its middle."""
    faces = lettering.faces
    size_px = lettering.size_px
    x, y = position
    ink = ImageColor.getrgb(colour)[:3]
    anchor = "m"
    if not centred:
        anchor = "l"
        y += _MIDDLE * size_px
    draw_line(draw, (x, y), text, faces=faces, size_px=size_px, colour=ink, anchor=anchor, rtl=is_rtl(text))


def write_film(log: SessionLog, out: Path, *, episode: int | None = None) -> Path:
    """Write a film of one or all episodes, or a contact sheet if the file is a ``.png``; return the file's path.

    Args:
        log: the session.
        out: the file's path; its extension selects the format, one of ``FORMATS``.
        episode: the episode's number, counted from 1; None for all. Only the last of several attempts is filmed.

    Raises:
        LogError: if the format is unknown, there is no such episode or no step, or a world no longer shows what the
            participant saw and the log has no pictures.
        WorldError: if a world cannot be run here, and the log has no pictures.
        OSError: if the file cannot be written.
    """
    kind = out.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise LogError(
            f"{out} does not have a video file extension; use one of {', '.join('.' + name for name in FORMATS)}"
        )
    episodes = _select_episodes(log, episode)
    out.parent.mkdir(parents=True, exist_ok=True)
    if kind == "png":
        draw_contact_sheet(log, episodes).save(out)
        return out
    unfinished = out.with_name(f"{out.name}.unfinished")
    try:
        images = (image for recorded in episodes for image in compose_frames(log, recorded))
        if kind == "gif":
            _save_gif(images, unfinished)
        else:
            with VideoWriter(unfinished, kind, fps=STEPS_PER_S) as video:
                video.write(np.asarray(image) for image in images)
        unfinished.replace(out)
    finally:
        unfinished.unlink(missing_ok=True)
    return out


def _select_episodes(log: SessionLog, number: int | None) -> list[EpisodeLog]:
    """Return a list with the last attempt at the episode of a number; if that is None, all episodes with a step.

    Raises:
        LogError: if there is no such episode, or no step to film.
    """
    episodes: Sequence[EpisodeLog] = log.episodes
    if number is not None:
        attempts = [episode for episode in log.episodes if episode.number == number]
        if not attempts:
            numbers = sorted({episode.number for episode in log.episodes})
            numbers_text = ", ".join(map(str, numbers)) or "none"
            raise LogError(f"{log.path} has no episode {number}; its episodes are {numbers_text}")
        episodes = attempts[-1:]
    with_steps = [episode for episode in episodes if len(episode.actions)]
    if not with_steps:
        raise LogError(f"{log.path}: there is no step to film; choose another episode")
    return with_steps


def _save_gif(images: Iterator[Image.Image], path: Path) -> None:
    """Save a film's pictures, reduced in size and colours, as an animated GIF."""
    first, *other_images = (
        image.resize(_GIF_PX, Image.Resampling.LANCZOS).quantize(_GIF_COLOURS, dither=Image.Dither.NONE)
        for image in images
    )
    duration_ms = 1000 // STEPS_PER_S
    first.save(path, "gif", save_all=True, append_images=other_images, duration=duration_ms, loop=0)


def compose_frames(log: SessionLog, episode: EpisodeLog, *, stride: int = 1) -> Iterator[Image.Image]:
    """Yield a film's pictures of an episode: the reset, every ``stride``-th step, and the last step.

    In a film of all steps the last picture is repeated for one second.

    Raises:
        LogError: as `render_frames`.
        WorldError: as `render_frames`.
    """
    times_ms = response_ms(episode)
    views = render_frames(episode, VIEW_PX)
    last = len(views) - 1
    for step, view in enumerate(views):
        if step % stride == 0 or step == last:
            image = _compose_frame(log, episode, step, Image.fromarray(fit_picture(view, VIEW_PX)), times_ms)
            n_repeats = 1
            if step == last and stride == 1:
                n_repeats = STEPS_PER_S
            yield from [image] * n_repeats


def _compose_frame(
    log: SessionLog, episode: EpisodeLog, step: int, view: Image.Image, times_ms: NDArray[np.float64]
) -> Image.Image:
    """Return a film's frame after a step (0 for the reset): the view, the keys, the map and the latest steps.

    ``view`` is the participant's picture; ``times_ms`` has the reaction time of each step, NaN without one.
    """
    image = Image.new("RGB", SIZE_PX, PAPER)
    draw = ImageDraw.Draw(image)
    image.paste(view, (0, 0))
    left = VIEW_PX[0] + _MARGIN_PX
    right = SIZE_PX[0] - _MARGIN_PX
    world_name = episode.plan.world.rpartition("/")[2].rpartition(":")[2]
    draw_label(draw, (left, _WORLD_TOP_PX), world_name[:_MOST_TITLE_CHARACTERS], INK, TITLE)
    caption = f"{log.plan.participant.id}, episode {episode.number}, {episode.plan.block_name}"
    draw_label(draw, (left, _PLAYER_TOP_PX), caption[:_MOST_CAPTION_CHARACTERS], FAINT, TEXT)
    _draw_keys(draw, episode, step, left)
    _draw_map(draw, episode, step, (right - _MAP_PX, _MAP_TOP_PX, right, _MAP_TOP_PX + _MAP_PX))
    seconds = (episode.t_ns[step] - episode.t_ns[0]) / 1e9
    progress = f"step {step} of {len(episode.actions)}, {seconds:.1f} s"
    if step == len(episode.actions):
        progress += f": {episode.outcome_word}"
    draw_label(draw, (left, _PROGRESS_TOP_PX), progress, INK, TEXT)
    for line, index in enumerate(range(max(0, step - _LINES), step)):
        ink = FAINT
        if index == step - 1:
            ink = INK
        y = _STEPS_TOP_PX + line * _STEP_LINE_PX
        draw_label(draw, (left, y), _describe_step(episode, index, times_ms[index]), ink, MONO)
    return image


def _draw_keys(draw: ImageDraw.ImageDraw, episode: EpisodeLog, step: int, left: int) -> None:
    """Draw an episode's keys and actions from pixel ``left`` on, and highlight the key that made step ``step``."""
    pressed = episode.step_keys[step - 1] if step else ""
    key_actions = sorted(episode.plan.key_map.keys.items())
    for number, (key, action) in enumerate(key_actions[:_MOST_KEYS]):
        row, column = divmod(number, _KEYS_PER_ROW)
        x = left + column * _KEY_PITCH_PX[0]
        y = _KEYS_TOP_PX + row * _KEY_PITCH_PX[1]
        middle = x + _KEY_PX // 2
        fill = PANEL
        ink = INK
        if pressed == key:
            fill = BLUE
            ink = PAPER
        draw.rounded_rectangle((x, y, x + _KEY_PX, y + _KEY_PX), _KEY_RADIUS_PX, fill=fill, outline=FAINT)
        lettering = KEY if len(key) < _LEAST_SMALL else MONO
        draw_label(draw, (middle, y + _KEY_PX // 2), key[:_MOST_KEY_CHARACTERS], ink, lettering, centred=True)
        caption = _shorten_action(action, _MOST_ACTION_CHARACTERS)
        draw_label(draw, (middle, y + _CAPTION_OFFSET_PX), caption, INK, MONO, centred=True)


def _describe_step(episode: EpisodeLog, index: int, reaction_ms: float) -> str:
    """Return a line about the step of index ``index``, from 0: time, key, action, and the reaction time unless NaN."""
    seconds = (episode.t_ns[index + 1] - episode.t_ns[0]) / 1e9
    key = episode.step_keys[index] or "-"
    action = _shorten_action(episode.start.action_names[episode.actions[index]], _ACTION_COLUMN_CHARACTERS)
    text = f"{seconds:7.2f} s  {key:>5}  {action:<{_ACTION_COLUMN_CHARACTERS}}"
    if np.isnan(reaction_ms):
        return text
    return f"{text}{reaction_ms:6.0f} ms"


def _shorten_action(name: str, length: int) -> str:
    """Return the last word of an action's name, cut to ``length`` characters."""
    return name.rpartition("_")[2][:length]


def _draw_map(draw: ImageDraw.ImageDraw, episode: EpisodeLog, step: int, box: tuple[int, int, int, int]) -> None:
    """Draw an episode's floor plan and its path up to a step into a box; draw nothing if the world has no map.

    ``box`` is the left, upper, right and lower edge in pixels.
    """
    plan = episode.start.map
    if plan is None:
        return
    x_min, z_min, x_max, z_max = plan.bounds
    left, top, right, bottom = box
    width = max(x_max - x_min, 1e-9)  # never 0, so that a flat map has a scale
    depth = max(z_max - z_min, 1e-9)
    scale = min((right - left) / width, (bottom - top) / depth)  # pixels per unit of the map

    def locate(x: float, z: float) -> tuple[float, float]:
        return left + (x - x_min) * scale, top + (z - z_min) * scale

    draw.rectangle((*locate(x_min, z_min), *locate(x_max, z_max)), fill=PANEL)
    for x_begin, z_begin, x_end, z_end in plan.walls:
        draw.line((*locate(x_begin, z_begin), *locate(x_end, z_end)), fill=INK, width=2)
    for thing in plan.things:
        x, z = locate(thing.x, thing.z)
        radius = max(thing.radius * scale, _LEAST_THING_PX)
        draw.rectangle((x - radius, z - radius, x + radius, z + radius), fill=thing.colour, outline=INK)
    path = episode.poses[: step + 1, [0, 2]]  # x and z
    has_pose = ~np.isnan(path[:, 0])
    points = [locate(x, z) for x, z in path[has_pose].tolist()]
    if len(points) > 1:
        draw.line(points, fill=BLUE, width=3, joint="curve")
    if points:
        x, z = points[-1]
        draw.ellipse((x - _AGENT_PX, z - _AGENT_PX, x + _AGENT_PX, z + _AGENT_PX), fill=BLUE, outline=PAPER)


def draw_contact_sheet(log: SessionLog, episodes: Sequence[EpisodeLog]) -> Image.Image:
    """Return a sheet with a row for each episode that has a step: description, map with the path, and six pictures."""
    column_px = _THUMB_PX[0] + _COLUMN_GAP_PX
    row_px = _THUMB_PX[1] + _ROW_GAP_PX
    rows = [episode for episode in episodes if len(episode.actions)]
    size_px = (_DESCRIPTION_PX + (_SHEET + 1) * column_px, _HEADING_PX + len(rows) * row_px)
    sheet = Image.new("RGB", size_px, PAPER)
    draw = ImageDraw.Draw(sheet)
    heading = f"{log.plan.study}: {log.plan.participant.id}, session {log.plan.session}"
    draw_label(draw, (_TEXT_MARGIN_PX, _TEXT_MARGIN_PX), heading, INK, TITLE)
    for row, episode in enumerate(rows):
        y = _HEADING_PX + row * row_px
        _draw_description(draw, episode, y)
        _draw_sheet_map(draw, episode, y)
        views = render_frames(episode, _THUMB_PX)
        steps = np.linspace(0, len(views) - 1, _SHEET).round().astype(int).tolist()
        for column, step in enumerate(steps, 1):
            corner = (_DESCRIPTION_PX + column * column_px, y)
            sheet.paste(Image.fromarray(fit_picture(views[step], _THUMB_PX)), corner)
            _draw_step_label(draw, step, corner)
    return sheet


def _draw_description(draw: ImageDraw.ImageDraw, episode: EpisodeLog, top: int) -> None:
    """Draw the lines that describe an episode on a contact sheet; the episode's row begins at pixel ``top``."""
    lines = [
        f"episode {episode.number}",
        episode.plan.block_name[:_MOST_BLOCK_CHARACTERS],
        f"{len(episode.actions)} steps",
        f"{episode.outcome_word}, {episode.return_:.2f}",
    ]
    ink = INK
    for number, text in enumerate(lines):
        y = top + _TEXT_MARGIN_PX + number * _LINE_HEIGHT_PX
        draw_label(draw, (_TEXT_MARGIN_PX, y), text, ink, TEXT)
        ink = FAINT


def _draw_sheet_map(draw: ImageDraw.ImageDraw, episode: EpisodeLog, top: int) -> None:
    """Draw an episode's map and path into the contact sheet's second column; the row begins at pixel ``top``."""
    width, height = _THUMB_PX
    left = _DESCRIPTION_PX + _MAP_MARGIN_PX[0]
    right = _DESCRIPTION_PX + width - _MAP_MARGIN_PX[0]
    box = (left, top + _MAP_MARGIN_PX[1], right, top + height - _MAP_MARGIN_PX[1])
    _draw_map(draw, episode, len(episode.actions), box)


def _draw_step_label(draw: ImageDraw.ImageDraw, step: int, corner: tuple[int, int]) -> None:
    """Draw the number of a picture's step on a dark box at ``corner``, the picture's upper left corner (x, y)."""
    x, y = corner
    margin_x, margin_y = _LABEL_MARGIN_PX
    text = f"step {step}"
    right = x + 2 * margin_x + measure_width_px(text, MONO.faces, MONO.size_px)
    draw.rectangle((x, y, right, y + _LABEL_HEIGHT_PX), fill=BACKGROUND)
    draw_label(draw, (x + margin_x, y + margin_y), text, PAPER, MONO)
