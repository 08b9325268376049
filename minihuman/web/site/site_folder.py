"""Writes a site: the page's own modules and rules, and for each allocation slot the script of its session.

A script contains the graph of the session's screens, the first state of each episode, and the pictures, arrays and
texts that the page needs to show them. It is made by the real session machine; the page follows it as a served page
follows its server.
"""

import base64
import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec

from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.events import EndReason
from minihuman.experiment.machine.inputs import TRIAL_RULES, Tick
from minihuman.experiment.machine.part_sequence import asks_consent_before_play
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.session import CONSENT_RULES, KEY_RULES, SessionMachine
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.plan.trials import list_sound_digests, list_sounds
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.sounds import PAGE_RATE_HZ, SoundContent, compute_digest, encode_wav, render_sound
from minihuman.experiment.words import InterfaceWords
from minihuman.runtime.machine import collect_machine_facts
from minihuman.web import messages
from minihuman.web.computed import ComputedEpisode, PageWorld
from minihuman.web.eligibility import build_completion, classify_ending, get_page_texts, list_touch_keys
from minihuman.web.key_codes import KEY_CODES
from minihuman.web.outbox import PageSettings, build_rules
from minihuman.web.page_modules import list_page_modules
from minihuman.web.screen_values import ImageCache
from minihuman.web.site.screen_graph import ScreenGraph, ScreenNode
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.support import require_site_support
from minihuman.worlds.source_digest import kernels_digest

SITE_VERSION = 1
_PAGE = Path(__file__).parents[1] / "page"
_SITE_MODULES = Path(__file__).parent / "page"
_COLLECTORS = ("download", "datapipe", "jatos")
_JATOS_HEAD = Path(__file__).with_name("jatos_head.html")  # with the script that JATOS serves beside a component's page
_ENCODER = msgspec.json.Encoder()


@dataclass(frozen=True, slots=True)
class SiteSummary:
    """The contents of a site's folder."""

    slots: int
    screens: int  # of the first slot
    size_bytes: int
    build: str  # as ``digest_build`` returns it


def digest_build(protocol: Protocol) -> str:
    """Return a digest of the protocol and the rules, with which an import recognises records of another build."""
    parts: tuple[object, ...] = (
        SITE_VERSION,
        messages.MESSAGE_VERSION,
        protocol.sha256,
        kernels_digest(),
        CONSENT_RULES,
        KEY_RULES,
    )
    if any(find_kind(block.kind).has_trials for block in protocol.blocks):  # their tables are in separate files
        files = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(protocol.files.items())}
        parts = (*parts, TRIAL_RULES, files)
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


def require_collector(collector: str) -> None:
    """Check that a collector of records is known by its name, or is an address.

    Raises:
        SiteError: if it is neither.
    """
    name = collector.partition(":")[0]
    if name not in _COLLECTORS and urlsplit(collector).scheme not in ("https", "http"):
        raise SiteError(f"collector {collector!r} is none; use download, datapipe:EXPERIMENT_ID, jatos, or an address")


def write_site(protocol: Protocol, folder: Path, *, collector: str = "download", slots: int = 0) -> SiteSummary:
    """Write a site into a folder.

    Args:
        protocol: the study.
        folder: the folder, which is created if necessary; files of an earlier site in it are replaced.
        collector: where the page sends its record: download, jatos, datapipe:EXPERIMENT_ID or an address.
        slots: the number of allocation slots; 0 for the study's.

    Raises:
        SiteError: if a part of the protocol needs a server, the collector is unknown, or the study has fewer slots.
    """
    require_collector(collector)
    count = slots or protocol.study.participants
    if count > len(build_allocation_list(protocol)):
        raise SiteError(f"{count} slots are more than the study's {protocol.study.participants} participants")
    build = digest_build(protocol)
    head = ""
    if collector == "jatos":
        head = _JATOS_HEAD.read_text(encoding="utf-8")
    _copy_page(folder, head)
    (folder / "study" / "arrays").mkdir(parents=True, exist_ok=True)
    n_screens = 0  # of the first slot
    sounds: dict[str, SoundContent] = {}
    for index in range(count):
        script = SlotScript(protocol, index)
        if index == 0:
            n_screens = len(script.graph.nodes)
        sounds |= script.sounds
        content = script.build_content(build)
        _copy_modules(folder / "static", script.modules)
        _write_json(folder / "study" / f"slot-{index}.json", content)
        for arrays in script.arrays.values():
            _write_json(folder / "study" / "arrays" / f"{arrays.name}.json", arrays)
    for digest, sound in sounds.items():
        _write_sound(folder / "sounds" / digest, sound, protocol.files)
    _write_json(folder / "study" / "site.json", _describe_site(protocol, build, collector, count))
    size_bytes = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return SiteSummary(count, n_screens, size_bytes, build)


def _write_json(path: Path, content: Any) -> None:
    path.write_bytes(_ENCODER.encode(content))


def _write_sound(path: Path, sound: SoundContent, files: Mapping[str, bytes]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(encode_wav(render_sound(sound, files, PAGE_RATE_HZ), PAGE_RATE_HZ))


def _copy_modules(static: Path, addresses: Iterable[str]) -> None:
    """Copy activity kinds' modules, given by their addresses at a server, into the folder of the static files."""
    files = dict(list_page_modules())
    for address in addresses:
        path = static / _find_relative_address(address)
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(files[address], path)


def _find_relative_address(address: str) -> str:
    """Return the address of a module relative to the page's own modules, as a site may be in any folder of a host."""
    return f"./{address.removeprefix('/static/')}"


def _describe_site(protocol: Protocol, build: str, collector: str, slots: int) -> dict[str, Any]:
    return {
        "version": SITE_VERSION,
        "study": protocol.study.name,
        "build": build,
        "collector": collector,
        "slots": slots,
        "sources": kernels_digest(),
        "words": get_page_texts(protocol.study.language),
    }


def _copy_page(folder: Path, head: str) -> None:
    """Copy the page's files, with the site's own modules in place of those that communicate with a server.

    Args:
        folder: the site's folder.
        head: lines of HTML for the end of the page's head, of which the last is the head's end tag; "" for none.
    """
    static = folder / "static"
    shutil.rmtree(static, ignore_errors=True)
    shutil.copytree(_PAGE, static, ignore=shutil.ignore_patterns("*.html", "*.d.ts", "polling.js"))
    for module in sorted(_SITE_MODULES.glob("*.js")):
        shutil.copy(module, static / module.name)
    page = (_PAGE / "page.html").read_text(encoding="utf-8").replace('"/static/', '"static/')
    page = page.replace('<link rel="modulepreload" href="static/polling.js">\n', "")
    if head:
        end_tag = head.splitlines()[-1]
        page = page.replace(end_tag, head.strip())
    (folder / "index.html").write_text(page, encoding="utf-8", newline="\n")


class SlotScript:
    """The script of the session of one allocation slot.

    Args:
        protocol: the study.
        index: the slot's index in the allocation list, from 0.

    Raises:
        SiteError: if a part of the session needs a server.
    """

    def __init__(self, protocol: Protocol, index: int) -> None:
        self.arrays: dict[str, messages.ArraysMessage] = {}  # by name, which is their digest
        self._protocol = protocol
        self._plan = plan_site_session(protocol, index)
        self.sounds = {compute_digest(sound, self._plan.files): sound for sound in list_sounds(self._plan)}
        self._settings = get_page_settings(protocol)
        self._images = ImageCache(self._settings.encoding)
        self.modules: set[str] = set()  # of kinds of activity: addresses at a server
        self._episodes: dict[int, dict[str, Any]] = {}
        require_site_support(protocol, self._plan)
        session = build_session(
            self._plan, PageWorld, collect_machine_facts(), picture_px=self._settings.picture_px, renders_steps=False
        )
        session.receive(Tick(1))  # begins the session, as the first message of a served page does
        self.graph = ScreenGraph(session, self._images.number, self._describe_episode)
        self._pictures = self._images.take_new()
        self.graph.close()
        session.close()

    def build_content(self, build: str) -> dict[str, Any]:
        """Build the script as JSON values, with the digest of the build."""
        plan = self._plan
        words = get_page_texts(plan.language)
        quit_title = InterfaceWords(plan.language, plan.words)["quit.title"]
        nodes = [self._describe_node(node) for node in self.graph.nodes]
        return {
            "build": build,
            "slot": plan.participant.index,
            "start": self.graph.start,
            "agreed": not asks_consent_before_play(plan),
            "nodes": nodes,
            "episodes": self._episodes,
            "pictures": [_describe_picture(picture) for picture in self._pictures],
            "keys": dict(KEY_CODES),
            "touch": list_touch_keys(plan),
            "sounds": list_sound_digests(plan),
            "words": words | {"quit_title": quit_title},
        }

    def _describe_episode(self, session: SessionMachine, play: RunningEpisode) -> None:
        """Add an episode's rules and first state to the script, and its arrays."""
        computed = ComputedEpisode(play, self._settings.picture_px)
        self.arrays |= {arrays.name: arrays for arrays in computed.arrays}
        part_plan = session.part.part.plan
        rules = build_rules(play, part_plan, computed=computed.state(), keep=0)
        names = [arrays.name for arrays in computed.arrays]
        self._episodes[play.plan.episode] = {"rules": rules, "arrays": names}

    def _describe_node(self, node: ScreenNode) -> dict[str, Any]:
        """Return a node as JSON values, and record the modules that it needs."""
        description = asdict(node)
        for values in (description["screen"], description["run"]):
            if values and "module" in values:
                self.modules.add(values["module"])
                values["module"] = _find_relative_address(values["module"])
        if node.reason:
            description["over"] = self._build_session_over(node)
        return description

    def _build_session_over(self, node: ScreenNode) -> messages.SessionOver:
        """Build the message that ends a session at a node."""
        reason: EndReason = node.reason  # type: ignore[assignment]
        end = classify_ending(reason, agreed=reason != "declined")
        completion = build_completion(self._protocol.web, end)
        words = get_page_texts(self._plan.language)
        return messages.SessionOver(end, words[end], words["code"], completion.code, words["leave"], completion.url)


def _describe_picture(picture: messages.PictureMessage) -> dict[str, Any]:
    return {
        "number": picture.number,
        "encoding": picture.encoding,
        "width": picture.width,
        "height": picture.height,
        "data": base64.b64encode(picture.data).decode(),
    }


def plan_site_session(protocol: Protocol, index: int, code: str = "") -> SessionPlan:
    """Plan the session of a slot, for the site and for the import, which runs the session again.

    Args:
        protocol: the study.
        index: the slot's index in the allocation list, from 0.
        code: the participant's code; "" for the slot's first participant.
    """
    participant = enrol_participant(protocol, index)
    if code:
        participant = msgspec.structs.replace(participant, id=code)
    return expand_protocol(protocol, participant)


def get_page_settings(protocol: Protocol) -> PageSettings:
    """Return the protocol's settings for the site's page."""
    return PageSettings(protocol.web.image_size_px, protocol.web.image_encoding)
