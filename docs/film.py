"""Make the README's film: a recorded session's keys, worlds and log, and its verification.

python docs/film.py docs/images/film.webp

A simulated participant plays the demo protocol; the film shows two of its episodes. Every picture is rendered again
from the log's seed and actions, and the state's hash of each step is compared with the log.
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw

import minihuman
from minihuman.log.read.session_reader import read_log
from minihuman.replay.film import MONOSPACED, PAPER, Lettering, compose_frames, draw_label

ROOT = Path(__file__).parents[1]
FRAME_MS = 75
STEPS_SHOWN = 26  # per episode; of a longer one every second or third


def film(out: Path) -> None:
    """Record a session, verify it and write the film."""
    with tempfile.TemporaryDirectory() as folder:
        protocol = ROOT / "protocols/demo.toml"
        [log] = minihuman.simulate(protocol, participants=1, data=folder, player="human-like", seed=3)
        verified = list(minihuman.verify(log))
        assert all(line.ok for line in verified)
        session = minihuman.open_session(log)
        goals = {one.block: one for one in reversed(session.episodes) if one.outcome == "goal"}  # the first per block
        log_read = read_log(log)
        frames = [
            frame
            for episode in reversed(goals.values())
            for frame in compose_frames(log_read, episode.recorded, stride=max(1, -(-episode.steps // STEPS_SHOWN)))
        ]
        last = frames[-1]
        frames += [_verification(last, log.name, verified[-1].text, shown) for shown in (1, 2, 3)]
    durations = [FRAME_MS] * (len(frames) - 3) + [500, 500, 1800]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=75, method=6)


def _verification(behind: Image.Image, log: str, text: str, shown: int) -> Image.Image:
    """The terminal in which the log is verified, over the last picture; ``shown`` lines of it."""
    image = Image.blend(behind, Image.new("RGB", behind.size, PAPER), 0.72)
    draw = ImageDraw.Draw(image)
    draw.rounded_rectangle((110, 130, 730, 290), 10, fill="#0d1117")
    lines = [
        (f"$ minihuman verify {log}", "#e6edf3"),
        (f"{log}: {text}", "#e6edf3"),
        ("replayed from seeds and keys, bit for bit", "#3fb950"),
    ]
    for place, (line, colour) in enumerate(lines[:shown]):
        draw_label(draw, (134, 156 + 40 * place), line, colour, Lettering(MONOSPACED, 15))
    return image


if __name__ == "__main__":
    film(Path(sys.argv[1]))
