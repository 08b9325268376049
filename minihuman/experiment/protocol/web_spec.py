"""The `[web]` table of a protocol: how the study runs in a browser, and who can take part there."""

import re
from collections.abc import Iterator
from typing import Literal

import msgspec

from minihuman.experiment.protocol.validation_errors import Bound, FieldError, check_bounds

Browser = Literal["chrome", "edge", "firefox", "safari"]
RecruitmentPlatform = Literal["prolific", "sona", "mturk"]
ImageEncoding = Literal["auto", "lossless", "jpeg"]

# A host name of two or more labels, or localhost, with an optional port; "*." before a name means all hosts below it.
_EMBEDDING_HOST = re.compile(
    r"((\*\.)?([a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?\.)+[a-z][a-z0-9-]{1,62}|localhost)(:\d{1,5})?"
)
MAX_EMBEDDING_HOSTS = 20
_CODE = re.compile(r"[A-Za-z0-9_-]{0,64}")
CODE_RULE = "use letters, digits, '-' and '_', at most 64"


def is_completion_code(code: str) -> bool:
    """Return whether a text may be a completion code: "", or letters, digits, "-" and "_", which a URL can contain."""
    return _CODE.fullmatch(code) is not None


class CompletionCodesSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The codes by which participants confirm to the recruiting platform how their session ended; "" shows none."""

    complete: str = ""
    declined: str = ""  # the participant refused consent
    screened_out: str = ""  # by browser, window, latency or keyboard, or by a criterion that was not reached
    failed_check: str = ""  # by wrong answers to questions with on_failure = "end"
    timed_out: str = ""  # the participant was inactive or away for longer than the study waits
    quit: str = ""  # the participant ended the session


class WebSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of the study in a browser; the table is optional."""

    image_size_px: tuple[int, int] = (
        640,
        480,
    )  # of the world's picture, width and height; shown enlarged, never stretched
    image_encoding: ImageEncoding = "auto"  # auto: grid worlds lossless, first-person ones as JPEG
    reconnect_timeout_s: float = 600.0  # without a connection, after which the session ends
    idle_timeout_s: float = 1800.0  # without an input, after which the session ends; 0 for never
    allowed_browsers: tuple[Browser, ...] = ()  # browsers that may take part; () for any
    max_rtt_ms: float = 0.0  # the longest round-trip time of a page that may take part; 0 for any
    min_window_size_px: tuple[int, int] = (0, 0)  # the smallest window that may take part, width and height
    require_keyboard: bool = True  # whether devices with only a touch screen are refused
    open_access: bool = False  # whether visitors without a link and from no platform may take part
    recruitment_platforms: tuple[RecruitmentPlatform, ...] = ()  # platforms that send visitors; () to require links
    max_concurrent_sessions: int = 200
    max_unconsented_per_address: int = 20  # visitors without a link who have not taken part yet; raise it for a lab
    require_signed_arrival: bool = False  # whether platforms' visitors need a signature; see web/arrival_signature.py
    embed_in: tuple[str, ...] = ()  # hosts whose pages may show the study in a frame; () for none
    completion_codes: CompletionCodesSpec = CompletionCodesSpec()
    redirect: str = ""  # where the page leads at the end; {code} and {id}, the platform's id, are filled in


_BOUNDS: tuple[Bound, ...] = (
    *(("reconnect_timeout_s", 0, 86_400), ("idle_timeout_s", 0, 86_400), ("max_rtt_ms", 0, 60_000)),
    *(("max_concurrent_sessions", 1, 10_000), ("max_unconsented_per_address", 1, 10_000)),
)
_SIZE_BOUNDS: tuple[Bound, ...] = (("image_size_px", 16, 4096), ("min_window_size_px", 0, 8192))


def check_web(web: WebSpec) -> Iterator[FieldError]:
    """Yield an error for each value of the table [web] that has the right type but is not valid."""
    for field, least, most in _SIZE_BOUNDS:
        size_px = getattr(web, field)
        if not all(least <= side <= most for side in size_px):
            yield f"$.web.{field}", f"is {list(size_px)}; use {least} to {most} px a side"
    yield from check_bounds("$.web", web, _BOUNDS)
    yield from _check_embedding_hosts(web.embed_in)
    yield from _check_completion_codes(web.completion_codes)
    if web.redirect and not web.redirect.startswith("https://"):
        yield "$.web.redirect", f"is {web.redirect!r}; it starts with https://"
    if set(re.findall(r"\{([^}]*)\}", web.redirect)) - {"code", "id"}:
        yield "$.web.redirect", "has a bad placeholder; use {code} and {id}"


def _check_embedding_hosts(hosts: tuple[str, ...]) -> Iterator[FieldError]:
    if len(hosts) > MAX_EMBEDDING_HOSTS:
        yield "$.web.embed_in", f"has {len(hosts)} hosts; list at most {MAX_EMBEDDING_HOSTS}"
    for number, host in enumerate(hosts):
        if not _EMBEDDING_HOST.fullmatch(host):
            yield (
                f"$.web.embed_in[{number}]",
                f'is {host!r}; write a host in lower case, without https:// or a path, such as "survey.example.org"',
            )


def _check_completion_codes(codes: CompletionCodesSpec) -> Iterator[FieldError]:
    code_of_end = msgspec.structs.asdict(codes)
    for end, code in code_of_end.items():
        if not is_completion_code(code):
            yield f"$.web.completion_codes.{end}", f"is {code!r}; {CODE_RULE}"
    if codes.complete and list(code_of_end.values()).count(codes.complete) > 1:
        yield "$.web.completion_codes.complete", "is another end's code, too; give completion one of its own"
