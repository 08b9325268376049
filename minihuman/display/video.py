"""Video encoding of pictures: H.264 for datasets and films, AV1 for the replay viewer, WebM for web pages.

Decoded pictures differ slightly from the encoded ones.
"""

import logging
import os
from collections.abc import Iterable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple

import av
import numpy as np
from av.video.frame import PictureType
from numpy.typing import NDArray

from minihuman.operating_system import keep_scheduling

logging.getLogger("libav").setLevel(logging.ERROR)  # encoders report their settings as warnings
os.environ.setdefault("SVT_LOG", "1")  # else the encoder of AV1 prints its settings to the terminal


class VideoEncoding(NamedTuple):
    """The settings of a video encoder, in FFmpeg's terms."""

    codec: str
    container: str
    options: dict[str, str]
    pixel_format: str = "yuv420p"


ENCODINGS = {
    # a key frame every second picture, as LeRobot's own: samples are read in any order. No picture depends on a later
    # one: the replay viewer takes such a stream as it is
    "dataset": VideoEncoding(
        "libx264", "mp4", {"preset": "veryfast", "crf": "23", "g": "2", "bf": "0", "forced-idr": "1"}
    ),
    "mp4": VideoEncoding("libx264", "mp4", {"preset": "veryfast", "crf": "20"}),
    "webm": VideoEncoding("libvpx-vp9", "webm", {"deadline": "realtime", "cpu-used": "8", "crf": "34", "b": "0"}),
    # the viewer decodes AV1 by itself; a key frame every 20 pictures, so that it can jump
    "replay": VideoEncoding("libsvtav1", "mp4", {"preset": "12", "crf": "35", "g": "20", "svtav1-params": "lp=1"}),
}


class VideoWriter:
    """A video file that is being written, used in a ``with`` statement; all pictures have the same size.

    Args:
        file: the path, or an open binary file, to write to
        encoding: a name in ``ENCODINGS``
        fps: the number of pictures per second

    Raises:
        OSError: if the file cannot be written.
    """

    def __init__(self, file: Path | IO[bytes], encoding: str, *, fps: int) -> None:
        settings = ENCODINGS[encoding]
        self.frames = 0
        target: str | IO[bytes] = file if not isinstance(file, Path) else str(file)
        self._container: Any = av.open(target, "w", format=settings.container)
        stream: Any = self._container.add_stream(settings.codec, rate=Fraction(fps), options=settings.options)
        self._stream = stream
        self._stream.pix_fmt = settings.pixel_format
        self._stream.thread_count = 1  # the same pictures make the same bytes

    def write(self, pictures: Iterable[NDArray[np.uint8]]) -> None:
        """Append pictures uint8[H, W, 3] with even height and width; the first one becomes a key frame."""
        for index, picture in enumerate(pictures):
            if not self.frames:
                self._stream.height, self._stream.width = picture.shape[:2]
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            if index == 0:
                frame.pict_type = PictureType.I
            if self.frames:
                self._container.mux(self._stream.encode(frame))
            else:
                with keep_scheduling():  # the first picture starts the encoder's threads
                    self._container.mux(self._stream.encode(frame))
            self.frames += 1

    def close(self) -> None:
        """Encode the remaining pictures and close the file."""
        if self.frames:
            self._container.mux(self._stream.encode())
        self._container.close()

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with suppress(OSError, ValueError):  # an error of closing must not replace the first error
            self.close()


def pad_to_even(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with an even number of rows and columns, as codecs require, by repeating the last ones."""
    extra_rows, extra_columns = (size % 2 for size in picture.shape[:2])
    if extra_rows or extra_columns:
        return np.pad(picture, ((0, extra_rows), (0, extra_columns), (0, 0)), "edge")
    return picture
