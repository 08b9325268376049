"""A served study under faults: nothing acknowledged is lost or doubled, nothing is believed that nobody did.

Every tenth seed has two servers, which lease sessions from one database, and pages that come to either. Every other of
these has servers that die at commits, too, and a store of finished logs that cannot always be reached.
"""

import pytest

from tests.counts import count
from tests.fault_simulation.planted import (
    FOUND_BY,
    FOUND_BY_AT_COMMITS,
    FOUND_BY_TWO,
    PLANTED,
    PLANTED_AT_COMMITS,
    PLANTED_IN_LEASES,
)
from tests.fault_simulation.simulation import Parts, simulate

pytestmark = pytest.mark.program

FAILED_ONCE = (  # a hole that an fsync left, a blank live file, a line taken back after an fsync failed
    *(14, 61, 75),
    *(415, 2044),  # a line, and a live file, that could be read and were not on the disk
    *(3200, 3632, 3718),  # a last write, of a register or a live file, of which a power cut left the size alone
)
FAILED_ONCE_WITH_TWO = (
    94,  # the end of a session was said, and the answer lost: its log was not kept
    298,  # a server that never reached the database finished a segment, and the next went on without it
    301,  # a live file was to be put aside on a disk that had failed
    425,  # a segment was finished on one server, resumed from its copy, and then thrown away beside the finished one
)
FAILED_ONCE_AT_COMMITS = (
    *(4, 73),  # a segment was finished and could not be stored: another server finished it, too
    *(21, 162, 172),  # the enrolment log had the head of a log that no other server could have
    93,  # the copy of an ended session was replaced before its live file was finished: its own server put it aside
    1234,  # `recover` brought what another server had left, and left it, too
)


@pytest.mark.nightly(sample=True)
def test_no_seed_loses_doubles_or_believes_anything() -> None:
    runs, acknowledged, steps = count(20, 10_000), 0, 0
    failed = {}
    for seed in range(runs):
        outcome = simulate(seed, machines=2 if seed % 10 == 4 else 1, at_commits=seed % 20 == 14)
        acknowledged += outcome.acknowledged
        steps += outcome.steps
        if outcome.failures:
            failed[seed] = outcome.failures
    print(f"\n{runs} runs: {acknowledged} keys acknowledged, {steps} steps logged, {len(failed)} runs failed")
    assert failed == {}
    assert acknowledged > 10 * runs
    assert steps > 4 * runs


@pytest.mark.parametrize("seed", FAILED_ONCE)
def test_what_failed_once_does_not_fail_again(seed: int) -> None:
    assert simulate(seed).failures == []


@pytest.mark.parametrize("seed", FAILED_ONCE_WITH_TWO)
def test_what_failed_once_with_two_servers_does_not_fail_again(seed: int) -> None:
    assert simulate(seed, machines=2).failures == []


@pytest.mark.parametrize("seed", FAILED_ONCE_AT_COMMITS)
def test_what_failed_once_where_servers_die_at_commits_does_not_fail_again(seed: int) -> None:
    assert simulate(seed, machines=2, at_commits=True).failures == []


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_found(name: str) -> None:
    assert simulate(FOUND_BY[name], PLANTED[name]).failures
    assert simulate(FOUND_BY[name], Parts()).failures == []


@pytest.mark.parametrize("name", PLANTED_IN_LEASES)
def test_a_fault_planted_in_leases_is_found(name: str) -> None:
    assert simulate(FOUND_BY_TWO[name], PLANTED_IN_LEASES[name], machines=2).failures
    assert simulate(FOUND_BY_TWO[name], machines=2).failures == []


@pytest.mark.parametrize("name", PLANTED_AT_COMMITS)
def test_a_fault_planted_between_store_and_word_is_found(name: str) -> None:
    assert simulate(FOUND_BY_AT_COMMITS[name], PLANTED_AT_COMMITS[name], machines=2, at_commits=True).failures
    assert simulate(FOUND_BY_AT_COMMITS[name], machines=2, at_commits=True).failures == []


def test_one_number_repeats_a_run() -> None:
    assert simulate(29).trace == simulate(29).trace
    assert simulate(14, machines=2).trace == simulate(14, machines=2).trace
    assert simulate(4, machines=2, at_commits=True).trace == simulate(4, machines=2, at_commits=True).trace
