"""Facts about a study that are stated after it was recorded: an `about.toml` with fields of the table `[about]`.

A log holds the protocol as it was when the session was played. The licence, the DOI, the authors and the laboratory's
columns of participants are often settled later; each field of this file takes the place of the protocol's.
"""

import tomllib

import msgspec

from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.about_spec import AboutSpec, check_about, check_newer_person_columns
from minihuman.experiment.protocol.validation_errors import build_protocol_error, find_structural_errors


class _AboutFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file: nothing but the table."""

    about: AboutSpec = AboutSpec()


def replace_study_facts(logged: AboutSpec, text: str, source: str) -> AboutSpec:
    """Return the table [about] of a protocol, with each field that an `about.toml` has replaced by that file's.

    Args:
        logged: the table of the protocol.
        text: the content of the file.
        source: the name of the file in errors.

    Raises:
        ProtocolError: if the text is no valid TOML, or has a field or value that `[about]` does not allow.
    """
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"{source}: this is not valid TOML: {error}") from None
    errors = list(find_structural_errors(tree, _AboutFile))
    facts = logged
    if not errors:
        table = msgspec.convert(tree, _AboutFile).about
        errors = [*check_about(table), *check_newer_person_columns(table)]
        facts = msgspec.structs.replace(logged, **{field: getattr(table, field) for field in tree.get("about", {})})
    protocol_error = build_protocol_error(errors, source=source, text=text, tree=tree)
    if protocol_error:
        raise protocol_error
    return facts
