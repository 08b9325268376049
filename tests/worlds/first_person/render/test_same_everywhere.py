"""The same picture in every process, thread and kind of machine code, compiled or not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.counts import count
from tests.worlds.first_person.render.stages import apart, digest, display_digest, threaded_digests, together

pytestmark = pytest.mark.program


def elsewhere(width: int, height: int, *how: str, **settings: str) -> str:
    run = subprocess.run(
        [sys.executable, "-m", "tests.worlds.first_person.render.stages", str(width), str(height), *how],
        env={**os.environ, **settings},
        capture_output=True,
        check=True,
        text=True,
    )
    return run.stdout.strip()


def test_another_process_draws_the_same_pictures() -> None:
    assert elsewhere(80, 60) == digest(80, 60)


def test_two_threads_draw_what_one_draws() -> None:
    assert threaded_digests(80, 60) == {digest(80, 60)}


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process cannot be kept to one core here")
def test_a_large_picture_in_bands_on_all_cores_is_that_of_one_core() -> None:
    assert elsewhere(640, 500, "alone") == digest(640, 500)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_pictures_drawn_together_are_what_each_is_alone(threads: int) -> None:
    assert together(80, 60, threads=threads) == apart(80, 60)


@pytest.fixture(scope="module")
def in_plain_python() -> list[str]:
    """What a process draws whose kernels are not compiled, 12 x 8: alone, together, and in the look of a display."""
    return elsewhere(12, 8, "everything", NUMBA_DISABLE_JIT="1").split()


@pytest.mark.nightly
def test_the_kernels_run_as_plain_python_draw_the_same_pictures_alone_and_together(in_plain_python: list[str]) -> None:
    assert in_plain_python[:2] == [digest(12, 8), apart(12, 8, pictures=2)]


@pytest.mark.nightly
def test_the_kernels_run_as_plain_python_draw_the_same_display(in_plain_python: list[str]) -> None:
    assert in_plain_python[2:] == [display_digest(12, 8)]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "features"),
    [("generic", ""), ("haswell", "+avx2,+fma"), ("skylake-avx512", "+avx512f,+fma")][: count(1, 3)],
)
def test_other_machine_code_draws_the_same_pictures(name: str, features: str) -> None:
    if "avx512" in features and "avx512f" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("AVX-512 is missing: run this on a processor that has it")
    settings = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features, "MINIHUMAN_KERNELS": "jit"}
    assert elsewhere(80, 60, **settings) == digest(80, 60)
