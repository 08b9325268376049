"""Make the README's film: a recorded session's keys, worlds and log, and its verification.

python docs/film.py docs/images/film.webp

A simulated participant plays the demo protocol; the film shows two of its episodes. Every picture is rendered again
from the log's seed and actions, and the state's hash of each step is compared with the log.
"""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

import minihuman
from minihuman.worlds.adapters.world import World

ROOT = Path(__file__).parents[1]
SIZE_PX = (840, 420)
VIEW_PX = (420, 420)
FRAME_MS = 75
STEPS_SHOWN = 26  # per episode; of a longer one every second or third
PAPER, PANEL, INK, FAINT, BLUE, GREEN = "#ffffff", "#f4f5f7", "#1f2328", "#8a9099", "#0969da", "#1a7f37"


def _font(size_px: int, *, mono: bool = False, bold: bool = False) -> ImageFont.FreeTypeFont:
    family = "DejaVu Sans Mono" if mono else "DejaVu Sans"
    found = font_manager.findfont(font_manager.FontProperties(family=family, weight="bold" if bold else "normal"))
    return ImageFont.truetype(found, size_px)


TITLE, TEXT, MONO, KEY = _font(19, bold=True), _font(14), _font(12, mono=True), _font(22, bold=True)


def film(out: Path) -> None:
    """Record a session, verify it and write the film."""
    with tempfile.TemporaryDirectory() as folder:
        protocol = ROOT / "protocols/demo.toml"
        [log] = minihuman.simulate(protocol, participants=1, data=folder, player="human-like", seed=3)
        verified = list(minihuman.verify(log))
        assert all(line.ok for line in verified)
        session = minihuman.open_session(log)
        goals = {one.block: one for one in reversed(session.episodes) if one.outcome == "goal"}  # the first per block
        frames = [frame for episode in reversed(goals.values()) for frame in _episode(episode)]
        last = frames[-1]
        frames += [_verification(last, log.name, verified[-1].text, shown) for shown in (1, 2, 3)]
    durations = [FRAME_MS] * (len(frames) - 3) + [500, 500, 1800]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=75, method=6)


def _episode(episode: minihuman.Episode) -> Iterator[Image.Image]:
    recorded = episode.recorded
    stride = max(1, -(-episode.steps // STEPS_SHOWN))
    keys = sorted({key: action for key, action in zip(episode.keys, episode.actions, strict=True) if key}.items())
    with closing(World(episode.world, recorded.plan.options)) as world:
        world.reset(episode.seed)
        for step, action in enumerate(recorded.actions, 1):
            world.step(int(action))
            found = world.state_hash()
            assert found == int(recorded.state_hashes[step]), f"{recorded.name} step {step}: another state"
            if step % stride == 0 or step == episode.steps:
                view = Image.fromarray(world.frame(size_px=VIEW_PX))
                yield _frame(episode, step, keys, view, f"{found & 0xFFFFFFFFFFFFFFFF:016x}")


def _frame(
    episode: minihuman.Episode, step: int, keys: list[tuple[str, str]], view: Image.Image, state: str
) -> Image.Image:
    image = Image.new("RGB", SIZE_PX, PAPER)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, *VIEW_PX), fill="#24272c")
    image.paste(view, ((VIEW_PX[0] - view.width) // 2, (VIEW_PX[1] - view.height) // 2))
    left, right = VIEW_PX[0] + 20, SIZE_PX[0] - 20
    name = "FourRooms in the grid" if "MiniGrid" in episode.world else "FourRooms in first person"
    draw.text((left, 14), name, INK, TITLE)
    draw.text((left, 40), f"participant {episode.participant}, episode {episode.number}", FAINT, TEXT)
    for place, (key, action) in enumerate(keys):
        x = left + place * 62
        pressed = episode.keys[step - 1] == key
        draw.rounded_rectangle((x, 74, x + 44, 118), 7, fill=BLUE if pressed else PANEL, outline=FAINT)
        draw.text((x + 22, 96), key, PAPER if pressed else INK, KEY, anchor="mm")
        draw.text((x + 22, 129), action.rpartition("_")[2], INK, MONO, anchor="mm")
    _map(draw, episode, step, (right - 170, 70, right, 240))
    draw.text((left, 262), "one log: every key, step and frame", FAINT, TEXT)
    for line, one in enumerate(range(max(0, step - 6), step)):
        shade = INK if one == step - 1 else FAINT
        text = (
            f"{episode.times_s[one + 1]:8.3f} s  key {episode.keys[one]}  {episode.actions[one].rpartition('_')[2]:<8}"
        )
        draw.text((left, 286 + 19 * line), f"{text}{episode.reaction_ms[one]:5.0f} ms", shade, MONO)
    draw.text((left, 402), f"state {state}", BLUE, MONO)
    return image


def _map(draw: ImageDraw.ImageDraw, episode: minihuman.Episode, step: int, box: tuple[int, int, int, int]) -> None:
    """The floor plan from above with the path so far."""
    plan = episode.map
    assert plan is not None
    x0, z0, x1, z1 = plan.bounds
    scale = min((box[2] - box[0]) / (x1 - x0), (box[3] - box[1]) / (z1 - z0))

    def at(x: float, z: float) -> tuple[float, float]:
        return box[0] + (x - x0) * scale, box[1] + (z - z0) * scale

    draw.rectangle((*at(x0, z0), *at(x1, z1)), fill=PANEL)
    for wall in plan.walls:
        draw.line((*at(wall[0], wall[1]), *at(wall[2], wall[3])), fill=INK, width=2)
    for thing in plan.things:
        x, z = at(thing.x, thing.z)
        radius = max(thing.radius * scale, 4)
        draw.rectangle((x - radius, z - radius, x + radius, z + radius), fill=thing.colour, outline=INK)
    points = [at(x, z) for x, z in episode.path[: step + 1, [0, 2]]]
    if len(points) > 1:
        draw.line(points, fill=BLUE, width=3, joint="curve")
    x, z = points[-1]
    draw.ellipse((x - 5, z - 5, x + 5, z + 5), fill=BLUE, outline=PAPER)


def _verification(behind: Image.Image, log: str, text: str, shown: int) -> Image.Image:
    """The terminal in which the log is verified, over the last picture; ``shown`` lines of it."""
    image = Image.blend(behind, Image.new("RGB", SIZE_PX, PAPER), 0.72)
    draw = ImageDraw.Draw(image)
    draw.rounded_rectangle((110, 130, 730, 290), 10, fill="#0d1117")
    lines = [
        (f"$ minihuman verify {log}", "#e6edf3"),
        (f"{log}: {text}", "#e6edf3"),
        ("replayed from seeds and keys, bit for bit", "#3fb950"),
    ]
    for place, (line, colour) in enumerate(lines[:shown]):
        draw.text((134, 156 + 40 * place), line, colour, _font(15, mono=True))
    return image


if __name__ == "__main__":
    film(Path(sys.argv[1]))
