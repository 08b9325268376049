import hashlib
import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

from minihuman.worlds.catalogue import WORLDS, is_compiled_grid
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.source_digest import kernels_digest, layouts_digest
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.worlds.build.page_cases import Files, differing, page_case
from tests.worlds.build.player import PAGE_FOLDER, page_player

MODULES = PAGE_FOLDER / "worlds"
MANIFEST, LAYOUTS_MANIFEST = "manifest.json", "layouts.json"  # as kernel_build.page_modules names them
MOST_BYTES = 400_000
MOST_LAYOUT_BYTES = 140_000
LOOKS = ("classic", False), ("classic", True), ("display", False)  # and whether light, camera and shadows vary
ROOT = Path(__file__).parents[3]
FOREIGN = ["minihuman/MiniGrid-GoToObj-Transfer-v0", "minihuman/Rules-v0"]  # grid worlds that no page computes


def _manifest(name: str = MANIFEST, folder: Path = MODULES) -> dict:
    return json.loads((folder / name).read_text(encoding="utf-8"))


def test_the_committed_modules_are_those_of_the_manifest_and_small():
    modules = _manifest()["modules"] | _manifest(LAYOUTS_MANIFEST)["modules"]
    files = [file for module in modules.values() for file in module["files"]]
    found = {file["file"]: hashlib.sha256((MODULES / file["file"]).read_bytes()).hexdigest() for file in files}
    assert found == {file["file"]: file["sha256"] for file in files}
    assert {path.name for path in MODULES.iterdir()} == {MANIFEST, LAYOUTS_MANIFEST, *found}
    layouts = [file["bytes"] for module in _manifest(LAYOUTS_MANIFEST)["modules"].values() for file in module["files"]]
    assert sum(layouts) <= MOST_LAYOUT_BYTES
    assert sum(file["bytes"] for file in files) - sum(layouts) <= MOST_BYTES


def test_the_participants_page_loads_no_layouts():
    assert set(_manifest()["modules"]) == {"grid", "first_person"}
    assert "layouts" not in (PAGE_FOLDER / "world.js").read_text(encoding="utf-8")


def test_the_committed_modules_name_no_folder_of_the_machine_that_built_them():
    for path in MODULES.glob("*.wasm"):
        assert b"site-packages" not in path.read_bytes(), path


def test_the_committed_modules_are_built_from_the_kernels_beside_them():
    assert _manifest()["sources"] == kernels_digest(), "run `python -m kernel_build`"
    assert _manifest(LAYOUTS_MANIFEST)["sources"] == layouts_digest(), "run `python -m kernel_build`"


def test_a_structure_on_the_stack_has_room_for_fields_where_pointers_took_eight_bytes():
    from kernel_build.page_modules import keep_structure_sizes

    code = "  %.1 = alloca { ptr, i64, [2 x ptr] }, align 8\n  %.2 = alloca ptr, align 8\n  store ptr %.2, ptr %.1\n"
    kept = "  %.1 = alloca { i64, i64, [2 x i64] }, align 8\n  %.2 = alloca ptr, align 8\n  store ptr %.2, ptr %.1\n"
    assert keep_structure_sizes(code) == kept


@pytest.mark.nightly
def test_building_again_gives_the_committed_modules(tmp_path):
    from kernel_build.page_modules import PAGE, linker_version

    if linker_version(PAGE) is None:
        pytest.skip("wasm-ld is missing: apt-get install lld, or pip install ziglang")
    subprocess.run([sys.executable, "-m", "kernel_build", str(tmp_path)], check=True)
    for name in (MANIFEST, LAYOUTS_MANIFEST):
        new, kept = _manifest(name, tmp_path), _manifest(name)
        tools = "numba", "llvmlite", "linker"
        if any(new[tool] != kept[tool] for tool in tools):
            pinned, here = (", ".join(f"{tool} {made[tool]}" for tool in tools) for made in (kept, new))
            pytest.skip(f"the modules were built by {pinned}; here are {here}: install those to compare")
        assert new == kept


def _played(folder: Path, cases: list[dict], *, simd: bool = False) -> dict[str, str]:
    with page_player("node", folder, simd=simd) as player:
        player.submit(cases)
        return player.digests()


@needs("node")
@pytest.mark.program
def test_every_grid_world_plays_in_the_page_as_in_python(tmp_path):
    files, cases, expected, foreign = Files(tmp_path), [], {}, []
    for entry in WORLDS:
        env = gymnasium.make(entry.id).unwrapped
        if isinstance(env, FirstPersonEnv):
            continue
        assert env.is_compiled == is_compiled_grid(entry.id, {})
        if not env.is_compiled:
            foreign.append(entry.id)
            continue
        case, expected[entry.id] = page_case(env, 0, files, entry.id)
        cases.append(case)
    upstream = gymnasium.make("minihuman/MiniGrid-KeyCorridorS3R3-v0", palette="minigrid").unwrapped
    case, expected["palette"] = page_case(upstream, 0, files, "palette")
    assert differing(expected, _played(tmp_path, [*cases, case])) == []
    assert foreign == FOREIGN
    assert len(expected) == 194 + 1


@needs("node")
@pytest.mark.program
@pytest.mark.parametrize("simd", [False, True], ids=["plain", "simd"])
def test_every_first_person_world_plays_in_the_page_as_in_python(tmp_path, simd):
    files, cases, expected = Files(tmp_path), [], {}
    for number, entry in enumerate(WORLDS):
        if not isinstance(gymnasium.make(entry.id).unwrapped, FirstPersonEnv):
            continue
        for look, varied in LOOKS if simd and number % 4 == 0 else LOOKS[:1]:
            env = gymnasium.make(
                entry.id, trig=1, domain_rand=varied, contact_shadows=varied and look == "classic", look=look
            ).unwrapped
            assert env.is_compiled
            name = f"{entry.id} {look} {'varied' if varied else ''}"
            case, expected[name] = page_case(env, 3, files, name)
            cases.append(case)
    assert differing(expected, _played(tmp_path, cases, simd=simd)) == []
    assert len(expected) >= 24


@pytest.mark.nightly(sample=True)
@pytest.mark.program
@needs("chromium")
def test_chromium_plays_as_python_does_for_three_minutes():
    """Two worlds of each kind, a few seeds; every world for three minutes under MINIHUMAN_NIGHTLY=1."""
    extent = count(("--only", "FourRooms", "--seeds", "2"), ("--seeds", "200", "--minutes", "3"))
    command = [sys.executable, "-m", "tests.worlds.build.compare", "--engine", "chromium", *extent]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 differ" in done.stdout
