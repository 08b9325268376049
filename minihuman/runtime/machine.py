"""Facts about the machine that a session runs on, and the session's clock. No fact names a person or a machine."""

import hashlib
import platform
import re
import subprocess
import time
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path

import minihuman
from minihuman.activities.agent_blocks.activity import AGENT_RULES
from minihuman.activities.questions.number.draft import NUMBER_RULES
from minihuman.activities.team.presence import PRESENCE_RULES
from minihuman.experiment.machine.inputs import MESSAGE_RULES, TEXT_RULES, TRIAL_RULES
from minihuman.experiment.machine.session import CONSENT_RULES, KEY_RULES
from minihuman.experiment.pending_session import is_allocation_pending
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.trust import SOURCE_FACT, list_world_sources
from minihuman.worlds.adapters.registered_module import find_registered_module
from minihuman.worlds.contract import CLAUSES_VERSION, PICTURES_VERSION, SHADOWS_VERSION
from minihuman.worlds.source_digest import rules_digest

_DRAWING_PACKAGES = {"gymnasium.envs.mujoco": "mujoco", "gymnasium.envs.box2d": "Box2D"}  # by a module's beginning
_GIT_TIMEOUT_S = 5.0
_PACKAGES = ("numpy", "gymnasium", "mcap", "pygame-ce", "pyglet", "minigrid", "miniworld")


class SessionClock:
    """The session's monotonic clock, 0 at its creation; ``started_unix_ns`` is the wall clock at that moment.

    It is the finest clock that the system has: CLOCK_MONOTONIC on Linux, mach_absolute_time on macOS, and on Windows
    QueryPerformanceCounter, since the clock of ``time.monotonic`` advances in steps of 16 ms there before Python 3.13.
    """

    def __init__(self) -> None:
        self.started_unix_ns = time.time_ns()
        self.started_monotonic_ns = time.perf_counter_ns()

    def __call__(self) -> int:
        """Return the nanoseconds since the clock was created."""
        return time.perf_counter_ns() - self.started_monotonic_ns

    def facts(self) -> dict[str, str]:
        """Return the monotonic clock's reading at the start, the name of that clock, and local time's offset from UTC.

        Any other recording on this machine that uses that clock can be aligned with the log to the nanosecond. The
        offset tells which calendar day it was. No time zone is named, as that would tell where the participant lives.
        """
        local = datetime.fromtimestamp(self.started_unix_ns / 1e9).astimezone()
        return {
            "utc_offset_min": str(round((local.utcoffset() or timedelta()) / timedelta(minutes=1))),
            "started_monotonic_ns": str(self.started_monotonic_ns),
            "monotonic_clock": time.get_clock_info("perf_counter").implementation,
        }


def collect_machine_facts() -> dict[str, str]:
    """Return facts about rules, versions, platform and processor, and the commit of a checkout, by name."""
    facts = {
        "rules": rules_digest(),
        "pictures": str(PICTURES_VERSION),
        "shadow_pictures": str(SHADOWS_VERSION),
        "clauses": str(CLAUSES_VERSION),
        "number_rules": NUMBER_RULES,
        "consent_rules": CONSENT_RULES,
        "key_rules": KEY_RULES,
        "text_rules": TEXT_RULES,
        "message_rules": MESSAGE_RULES,
        "agent_rules": AGENT_RULES,
        "trial_rules": TRIAL_RULES,
        "presence_rules": PRESENCE_RULES,
        "python": platform.python_version(),
        "system": f"{platform.system()} {_strip_builder_suffix(platform.release())}",
        "machine": platform.machine(),
        "version_minihuman": minihuman.__version__,
    }
    for package in _PACKAGES:
        try:
            facts[f"version_{package}"] = version(package)
        except PackageNotFoundError:
            continue
    if commit := _find_git_commit(Path(minihuman.__file__).parents[1]):
        facts["git_commit"] = commit
    return facts


def list_world_ids(plan: SessionPlan) -> set[str]:
    """Return the ids of the worlds that a session may play; those of all groups if the group is not drawn yet."""
    if is_allocation_pending(plan):
        return {block.world for block in decode_logged_protocol(plan.protocol_toml).blocks}
    return {episode.world for episode in plan.episodes}


def collect_world_facts(worlds: Iterable[str]) -> dict[str, str]:
    """Return the versions of the packages that worlds come from, and the SHA-256 of the modules that world ids name.

    An id such as "lab_worlds:lab/Corridor-v0" names a module; the modules that it imports are included.
    """
    ids = list(worlds)
    sources = {
        f"{SOURCE_FACT}{module}": hashlib.sha256(path.read_bytes()).hexdigest()
        for module, path in list_world_sources(ids).items()
    }
    return sources | _collect_package_versions(ids)


def _collect_package_versions(worlds: Iterable[str]) -> dict[str, str]:
    """Return the versions of the packages that worlds come from, by fact, without those of `_PACKAGES`."""
    modules = {_find_drawing_package(find_registered_module(world)) for world in worlds}
    modules -= {"", "minihuman", "gymnasium"}
    if not modules:
        return {}
    names = _list_distributions()
    distributions = set[str]()
    for module in modules:
        distributions.update(names.get(module, ()))
    return {f"version_{name}": version(name) for name in sorted(distributions - set(_PACKAGES))}


def _find_drawing_package(module: str) -> str:
    """Return the package that determines the pictures of a module's worlds: a simulator, or the module's own."""
    for prefix, package in _DRAWING_PACKAGES.items():
        if module.startswith(prefix):
            return package
    return module.partition(".")[0]


@cache
def _list_distributions() -> Mapping[str, list[str]]:
    """Return the installed distributions by the top-level packages that they provide."""
    return packages_distributions()


def _strip_builder_suffix(release: str) -> str:
    """Return a kernel's version without its builder's suffix, which may name a machine or a person."""
    match = re.match(r"[0-9.]*", release)
    assert match is not None
    return match[0]


@cache
def _find_git_commit(folder: Path) -> str:
    """Return a checkout's commit, with "+" if files were changed; "" if the folder is not a checkout.

    A folder inside another project's checkout does not count, since an environment is often inside the repository of a
    laboratory's study.
    """
    if not (folder / ".git").exists():
        return ""
    command = ("git", "-C", str(folder), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+")
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=_GIT_TIMEOUT_S
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
