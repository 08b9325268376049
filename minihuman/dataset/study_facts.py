"""The facts about a study, as its tables and exports state them: the logged protocol's, and those of `about.toml`."""

from functools import lru_cache
from pathlib import Path

from minihuman.dataset.log_files import find_containing_folder
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.about_file import replace_study_facts
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import AboutSpec

ABOUT_FILE_NAME = "about.toml"


@lru_cache(maxsize=8)
def decode_plan_protocol(toml: bytes) -> Protocol | None:
    """Decode the protocol in a log; None if this version cannot read it."""
    try:
        return decode_logged_protocol(toml)
    except ProtocolError:
        return None


def find_study_folder(source: Path) -> Path:
    """Return the folder of a study, given the folder or a log in it."""
    folder = find_containing_folder(source)
    if folder.name.startswith("ses-"):  # a log lies in STUDY/sub-07/ses-01
        return folder.resolve().parent.parent
    return folder


def read_study_facts(source: Path, protocol_toml: bytes) -> AboutSpec:
    """Return the facts about a study, from the protocol in a log and from `about.toml` in the study's folder.

    Facts in `about.toml` replace those of the protocol. A protocol that this version cannot read states none.

    Raises:
        ProtocolError: if `about.toml` is not valid.
    """
    protocol = decode_plan_protocol(protocol_toml)
    logged = AboutSpec()
    if protocol is not None:
        logged = protocol.about
    path = find_study_folder(source) / ABOUT_FILE_NAME
    if not path.is_file():
        return logged
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ProtocolError(f"{path}: byte {error.start} is not valid UTF-8; save the file as UTF-8") from None
    return replace_study_facts(logged, text, str(path))
