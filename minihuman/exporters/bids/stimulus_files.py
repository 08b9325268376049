"""The stimuli of a BIDS dataset: events of pictures and sounds that activities presented, and the files in them.

Files lie below ``stimuli/`` by the names that the protocol has for them; a file of another version of the protocol with
the same name and another content has its digest in its name.
"""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from minihuman.dataset.presented_stimuli import Presentation, list_presentations
from minihuman.log.model.session_log import SessionLog
from minihuman.storage.outside_names import join_inside
from minihuman.worlds.hashing import refer_to_file

STIMULI_FOLDER = "stimuli"
STIM_FILE = "stim_file"
STIM_FILE_COLUMN = {
    STIM_FILE: {
        "Description": (
            "The image that begins to be shown with a flip, of several the front one, or the file of a sound; below "
            "the folder stimuli."
        )
    }
}
_DIGITS = 8  # of a digest in a name


class StimulusFiles:
    """The files of a dataset's stimuli, which are written once each."""

    def __init__(self, out: Path) -> None:
        self._folder = out / STIMULI_FOLDER
        self._digests: dict[str, str] = {}  # by name below the folder

    @property
    def is_empty(self) -> bool:
        """Return whether no stimulus of the dataset has a file."""
        return not self._digests

    def add(self, name: str, files: Mapping[str, bytes]) -> str:
        """Write a protocol's file unless it is written; return its name below the folder, "" if ``files`` lacks it.

        Raises:
            OutsideNameError: if the name would lead out of the folder.
        """
        if name not in files:
            return ""
        content = files[name]
        digest = hashlib.sha256(content).hexdigest()
        unique = name
        if self._digests.get(name, digest) != digest:
            path = PurePosixPath(name)
            unique = str(path.with_name(f"{path.stem}-{digest[:_DIGITS]}{path.suffix}"))
        if unique not in self._digests:
            target = join_inside(self._folder, unique)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
            self._digests[unique] = digest
        return unique


class SessionStimuli:
    """The stimuli that a session presented, and their files in the dataset."""

    def __init__(self, log: SessionLog, stimulus_files: StimulusFiles) -> None:
        self._files = log.plan.files
        self._stimulus_files = stimulus_files
        self._names = {refer_to_file(content): name for name, content in log.plan.files.items()}
        self._presentations: dict[tuple[int, int], list[Presentation]] = {}
        for presentation in list_presentations(log):
            episode = presentation.episode
            self._presentations.setdefault((episode.number, episode.attempt), []).append(presentation)

    def list_presented(self, number: int, attempt: int) -> Iterator[tuple[Presentation, dict[str, Any]]]:
        """Yield each presentation in an attempt at an episode, with further cells of its event; write its file."""
        for presentation in self._presentations.get((number, attempt), ()):
            columns: dict[str, Any] = {"detail": ", ".join(presentation.stimuli)}
            if presentation.file:
                columns[STIM_FILE] = self._stimulus_files.add(presentation.file, self._files)
            if presentation.kind == "sound":
                duration_ms = presentation.duration_ms
                columns["duration"] = None if duration_ms is None else duration_ms / 1e3
            yield presentation, columns

    def find_image(self, options: Mapping[str, Any]) -> str:
        """Write the first image that a world's options name; return its path below the stimuli, "" for none."""
        for option in options.values():
            if isinstance(option, str) and option in self._names:
                return self._stimulus_files.add(self._names[option], self._files)
        return ""
