"""Grid worlds that a page lays out from seeds: row, random numbers, first image and mission are Python's."""

import functools
import hashlib
import json
import shutil
import subprocess
import threading
import warnings
from collections.abc import Iterator, Sequence
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import minihuman
from minihuman.web.world_pack import PackSummary, _ArrayPool, pack_worlds
from minihuman.worlds.catalogue import BABYAI_WORLDS, GRID_WORLDS
from tests.counts import PATIENCE_S, count
from tests.machine import need, needs
from tests.web.browser import browsing
from tests.web.firefox import firefox_at

HERE = Path(__file__).parent
PAGE = Path(minihuman.__file__).parent / "web" / "page"
FOREIGN = "MiniGrid-GoToObj-Transfer-v0"  # its rules are Python
WORLDS = [entry.name for entry in (*GRID_WORLDS, *BABYAI_WORLDS) if entry.name != FOREIGN]
SEEDS = [*range(count(3, 1_000)), 2**32, 2**53 - 1]
IN_BROWSERS = range(100)
PAGE_OF_PLAN = """<!DOCTYPE html><title>drawing</title>
<script>window.minihuman = { state: { drawn: "" } };</script><script type="module">
import { drawWorlds } from "./draw.mjs";
const plan = await (await fetch("plan.json")).json();
minihuman.state.drawn = JSON.stringify(await drawWorlds(new URL("./", location.href), plan));
</script>"""


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PackSummary]:
    folder = tmp_path_factory.mktemp("pack")
    (folder / "package.json").write_text('{"type": "module"}')
    return folder, pack_worlds(folder, range(1), WORLDS)


def _run_node(*arguments: str, text: str = "") -> str:
    ended = subprocess.run([need("node"), *arguments], input=text, capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def _draw(name: str, seeds: Sequence[int] = SEEDS) -> list[str]:
    """Digests of a world's first states in Python."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        env: Any = gymnasium.make(f"minihuman/{name}", disable_env_checker=True).unwrapped
    digests = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        state = env.save()
        parts = state.row, state.rng_state, observation["image"], observation["mission"].encode()
        digests.append(hashlib.sha256(b"".join(map(bytes, parts))).hexdigest()[:16])
    return digests


@pytest.mark.nightly(sample=True)
def test_every_world_is_laid_out_in_the_page_as_in_python(pack: tuple[Path, PackSummary]) -> None:
    folder, packed = pack
    names = [name for name in WORLDS if name not in packed.packed_states]
    plan = json.dumps({"worlds": names, "seeds": SEEDS})
    drawn = json.loads(_run_node(str(HERE / "draw.mjs"), str(folder), text=plan))
    assert [name for name in names if drawn[name] != _draw(name)] == []


def test_few_worlds_have_only_the_seeds_that_were_packed(pack: tuple[Path, PackSummary]) -> None:
    _, packed = pack
    assert set(packed.worlds) == set(WORLDS)
    assert packed.packed_states == tuple(name for name in WORLDS if name.startswith("MiniGrid-WFC-"))
    assert len(packed.packed_states) == 6


def test_a_pack_has_only_the_modules_that_its_worlds_need(tmp_path: Path) -> None:
    sizes = {}
    for name, modules in (("MiniGrid-FourRooms-v0", ["grid", "layouts"]), ("BabyAI-GoToLocal-v0", ["grid", "levels"])):
        size_bytes = pack_worlds(tmp_path / name, range(1), [name]).size_bytes
        assert sorted(path.name for path in (tmp_path / name / "worlds").iterdir()) == [f"{m}.wasm.z" for m in modules]
        sizes[name] = size_bytes
    assert max(sizes.values()) <= 160_000, sizes


def test_a_level_can_be_laid_out_as_often_as_one_likes(pack: tuple[Path, PackSummary]) -> None:
    folder, _ = pack
    script = f"""
        const {{ World }} = await import({json.dumps((folder / "packed_world.js").as_uri())});
        const world = await World.make("BabyAI-MiniBossLevel-v0");
        for (let seed = 0; seed < 600; seed++) world.reset({{ seed }}); // of arrays 3 MB, in memory of 1 MiB
        console.log(world.mission);
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        env = gymnasium.make("minihuman/BabyAI-MiniBossLevel-v0")
    assert _run_node("--input-type=module", "--eval", script).strip() == env.reset(seed=599)[0]["mission"]


def test_the_page_seeds_numpys_generator_as_numpy_does() -> None:
    seeds = [*range(100), 2**32 - 1, 2**32, 2**64 + 5, 2**127 - 1, 3**120, 2**200 - 1]
    script = f"""
        const {{ seedGenerator }} = await import({json.dumps((PAGE / "layouts.js").as_uri())});
        const seeds = {json.dumps([str(seed) for seed in seeds])};
        console.log(JSON.stringify(seeds.map((seed) => [...seedGenerator(BigInt(seed))].map(String))));
    """
    states = json.loads(_run_node("--input-type=module", "--eval", script))
    for seed, words in zip(seeds, states, strict=True):
        high, low, increment_high, increment_low, has_half, half = map(int, words)
        state = np.random.default_rng(seed).bit_generator.state
        assert state["state"] == {"state": high << 64 | low, "inc": increment_high << 64 | increment_low}
        assert (has_half, half) == (state["has_uint32"], state["uinteger"])


def test_layouts_of_other_sources_are_not_packed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("minihuman.web.page_layouts.layouts_digest", lambda: "another")
    with pytest.raises(ValueError, match="python -m kernel_build"):
        pack_worlds(tmp_path, range(1), ["MiniGrid-FourRooms-v0"])


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def address(pack: tuple[Path, PackSummary]) -> Iterator[str]:
    """Of a static server of a page that draws every world from a hundred seeds."""
    folder, packed = pack
    names = [name for name in WORLDS if name not in packed.packed_states]
    (folder / "index.html").write_text(PAGE_OF_PLAN)
    (folder / "plan.json").write_text(json.dumps({"worlds": names, "seeds": [*IN_BROWSERS]}))
    shutil.copy(HERE / "draw.mjs", folder)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()


def _differing(drawn: str) -> list[str]:
    return [name for name, digests in json.loads(drawn).items() if digests != _draw(name, IN_BROWSERS)]


@pytest.mark.nightly
@pytest.mark.program
@needs("chromium")
def test_chromium_lays_worlds_out_as_python_does(address: str) -> None:
    with browsing() as sit_down:
        somebody = sit_down(address)
        somebody.page.wait_for_function("minihuman.state.drawn", timeout=PATIENCE_S * 1000)
        assert _differing(somebody.page.evaluate("minihuman.state.drawn")) == []
        assert somebody.errors == []


@pytest.mark.nightly
@pytest.mark.program
@needs("firefox")
def test_firefox_lays_worlds_out_as_python_does(address: str, tmp_path: Path) -> None:
    with firefox_at(address, tmp_path / "profile") as page:
        page.until("s.drawn")
        assert _differing(page.find("minihuman.state.drawn")) == []


def test_arrays_of_equal_bytes_and_other_types_are_two() -> None:
    pool = _ArrayPool()
    numbers = [pool.number(np.zeros(2, kind)) for kind in (np.int64, np.float64, np.int64)]
    assert numbers == [0, 1, 0]
    assert list(pool.extents()) == [("int64", 16), ("float64", 16)]
    assert pool.join() == bytes(32)
