"""A withdrawal, a manifest and a policy file on a failing disk: nothing is half done without a word."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from minihuman.admin import local_copies, withdrawal
from minihuman.admin.manifest import write_manifest
from minihuman.admin.policies import PolicyStore
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.storage.durable_files import write_durably
from minihuman.storage.erasure import erase
from minihuman.storage.remote_store import FolderStore
from tests.counts import count
from tests.fault_simulation.erasure import Commands, FailingDisk, simulate_erasure

FAILED_ONCE = (58,)  # an archive of an earlier try was taken for durable: a power cut took its name
SEEDS_UNTIL_FOUND = 200


@pytest.mark.nightly(sample=True)
def test_nothing_is_half_erased_or_half_written_without_a_word() -> None:
    outcomes = [simulate_erasure(seed) for seed in range(count(60, 2_000))]
    failed = {outcome.seed: outcome.failures for outcome in outcomes if outcome.failures}
    stopped = sum(number for outcome in outcomes for what, number in outcome.happened.items() if "stopped" in what)
    print(f"\n{len(outcomes)} runs, {stopped} attempts stopped, {len(failed)} runs failed")
    assert failed == {}
    assert stopped > len(outcomes) / 2


@pytest.mark.parametrize("seed", FAILED_ONCE)
def test_an_erasure_that_failed_once_does_not_fail_again(seed: int) -> None:
    assert simulate_erasure(seed).failures == []


class NamesNotDurable(FailingDisk):
    """What is taken out of a folder, or renamed in it, is never made durable."""

    def sync_folder(self, folder: Path) -> None:
        """Leave it as it is."""


def write_manifest_in_place(study: Path) -> None:
    """Write a manifest as a script would."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minihuman.admin.manifest.replace_durably", _write_in_place)
        write_manifest(study)


def keep_policy_if_it_has_a_name(study: Path, content: bytes) -> None:
    """Take a policy file that has its name for one that is durable."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minihuman.admin.policies.sync_folder", lambda folder: None)
        PolicyStore(study).keep(content)


@contextmanager
def _write_in_place(path: Path, unfinished: Path) -> Iterator[object]:
    with write_durably(path) as file:
        yield file


def withdraw_without_a_mark(study_dir: Path, code: str, *, seal: Path | None) -> None:
    """Leave nothing behind that says that an erasure has begun."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(withdrawal, "_mark_as_begun", lambda study_dir, code: nullcontext())
        withdraw_participant(study_dir, code, seal=seal)


def withdraw_and_swallow_errors(study_dir: Path, code: str, *, seal: Path | None) -> None:
    """Take what could not be erased for erased."""

    def erase_silently(path: Path) -> list[OSError]:
        erase(path)
        return []

    with pytest.MonkeyPatch.context() as patch:
        for module in (withdrawal, local_copies):
            patch.setattr(module, "erase", erase_silently)
        withdraw_participant(study_dir, code, seal=seal)


def withdraw_by_names_alone(study_dir: Path, code: str, *, seal: Path | None) -> None:
    """Take what has a participant's name out of a remote store, and not what a crash left of an upload."""

    def remove_each(store: FolderStore, owner: str, names: list[str]) -> None:
        for name in names:
            store.remove(name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FolderStore, "erase", remove_each)
        withdraw_participant(study_dir, code, seal=seal)


PLANTED = {
    "names not durable": Commands(disk=NamesNotDurable),
    "no mark": Commands(withdraw=withdraw_without_a_mark),
    "errors swallowed": Commands(withdraw=withdraw_and_swallow_errors),
    "an upload's remains left": Commands(withdraw=withdraw_by_names_alone),
    "a manifest written in place": Commands(write_manifest=write_manifest_in_place),
    "a policy's name taken for durable": Commands(keep_policy=keep_policy_if_it_has_a_name),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_fault_planted_in_an_erasure_is_found(name: str) -> None:
    assert any(simulate_erasure(seed, PLANTED[name]).failures for seed in range(SEEDS_UNTIL_FOUND))
