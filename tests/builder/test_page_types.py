"""The builder's page: its types are those of the messages, and its library is the one that was released."""

import hashlib

from minihuman.builder.message_types import PATH, format_builder_types


def test_the_types_of_the_page_are_generated_from_the_messages() -> None:
    assert PATH.read_text(encoding="utf-8") == format_builder_types(), "run `python -m minihuman.builder.message_types`"


def test_the_vendored_library_is_unchanged_and_has_its_licences() -> None:
    vendor = PATH.parent / "vendor"
    licences = (vendor / "LICENSES.txt").read_text(encoding="utf-8")
    assert hashlib.sha256((vendor / "preact.js").read_bytes()).hexdigest() in licences
    assert "MIT License" in licences
    assert "Apache License" in licences
