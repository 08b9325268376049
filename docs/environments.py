"""Play every environment that is installed here by its id alone, and write the table in environments.md.

    xvfb-run -a python docs/environments.py

Each id gets five seconds of session time in a process of its own: a study that `minihuman new` would write for it, a
simulated participant who holds keys, the log verified, a picture drawn, a copy tried, three replays compared. Ids that
`gymnasium.make(id, render_mode="rgb_array")` itself cannot make are not counted.
"""

import argparse
import json
import multiprocessing
import tempfile
from collections import Counter
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = {  # and the module that registers theirs
    "gymnasium": "",
    "ale-py": "ale_py",
    "highway-env": "highway_env",
    "gymnasium-robotics": "gymnasium_robotics",
    "crafter": "other_worlds",  # and MiniHack and arcengine, as far as they are installed
}
SECONDS = 5.0
PAGE = Path(__file__).with_name("environments.md")
FOUND = PAGE.with_suffix(".json")  # of each id, what was found when it was tried last
TABLE = "## Environments by their id"  # the page up to here is written by hand
KEPT = "## A minute in real time"  # the page from here on is other scripts': real_time_minutes, recorded_sessions


def register(module: str) -> None:
    """Import a package that registers its environments."""
    registers = import_module(module)
    if module in ("ale_py", "gymnasium_robotics"):
        import gymnasium

        gymnasium.register_envs(registers)


def list_ids() -> list[str]:
    """Each id once: of several versions the latest, of the arcade its own namespace."""
    import gymnasium

    newest: dict[str, tuple[int, str]] = {}
    for package, module in PACKAGES.items():
        before = set(gymnasium.registry)
        if module:
            try:
                register(module)
            except ImportError:
                continue
        for name, spec in gymnasium.registry.items():
            old = package == "ale-py" and not spec.namespace
            of_gymnasium = str(spec.entry_point).startswith("gymnasium.envs.") and spec.namespace is None
            theirs = module == "other_worlds" and spec.namespace != "other"  # what our module imports registers its own
            if old or theirs or name.startswith("GymV2") or (name in before if module else not of_gymnasium):
                continue
            known = newest.get(f"{spec.namespace}/{spec.name}", (-1, ""))
            mine = (spec.version or 0, f"{module}:{name}" if module else name)
            newest[f"{spec.namespace}/{spec.name}"] = max(known, mine)
    return [name for _, name in newest.values()]


def try_id(world_id: str, seconds: float) -> dict[str, str]:
    """Play one id and say what was found; "not_made" where Gymnasium itself cannot make it."""
    import gymnasium

    module, _, name = world_id.rpartition(":")
    if module:
        register(module)
    try:
        made = gymnasium.make(name, render_mode="rgb_array")
        made.reset(seed=0)
        made.render()
        made.close()
    except Exception as error:
        return {"not_made": f"{type(error).__name__}: {error}"[:120]}
    from minihuman.admin.protocol_file import ProtocolDraft
    from minihuman.admin.verify.episodes import verify_episodes
    from minihuman.experiment.keys import assign_usual_keys, find_period_ms, key_label
    from minihuman.experiment.plan.dry_run import check_worlds, list_world_notices
    from minihuman.experiment.protocol.protocol import decode_protocol
    from minihuman.log.read.session_reader import read_log
    from minihuman.runtime.simulated_session import simulate
    from minihuman.trust import Trust, list_foreign_modules
    from minihuman.worlds.adapters.world import World

    Trust(frozenset(), list_foreign_modules([world_id])).record()
    world = World(world_id)
    keys, period_ms = assign_usual_keys(world), find_period_ms(world)
    space, notices = str(world.action_space), list(list_world_notices(world))
    world.close()
    toml = ProtocolDraft(name="one", world=world_id, episodes=1, participants=1).toml()
    limit = next(line for line in toml.splitlines() if line.startswith("max_steps"))
    steps = min(round(seconds * 1000 / (period_ms or 250)), int(limit.split()[2]))
    protocol = decode_protocol(toml.replace(limit, f"max_steps = {steps}").encode())
    check_worlds(protocol)
    with tempfile.TemporaryDirectory() as folder:
        (path,) = simulate(protocol, Path(folder), participants=1, seed=1, player="random")
        difference = verify_episodes(read_log(path)).difference
    unsteady = any("nondeterministic" in notice for notice in notices)
    copied = not any("copied" in notice for notice in notices)
    return {
        "space": space if len(space) < 60 else f"{space[:57]}...",
        "keys": ", ".join(f"{key_label(key)} {action}" for key, action in keys.items()),
        "pace": "on key" if period_ms is None else f"{1000 / period_ms:.0f}/s",
        "replays": "no: nondeterministic" if unsteady else f"NO: {difference}"[:80] if difference else "yes",
        "browser": "ahead" if period_ms is None and copied else "round trip",
    }


def try_in_a_process(world_id: str, seconds: float) -> dict[str, str]:
    """Play one id where it can break nothing else: in a fork, which has imported everything already."""
    forking = multiprocessing.get_context("fork")
    receiver, sender = forking.Pipe(duplex=False)

    def report() -> None:
        try:
            sender.send(try_id(world_id, seconds))
        except Exception as error:
            sender.send({"error": f"{type(error).__name__}: {error}"[:120]})

    process = forking.Process(target=report)
    process.start()
    sender.close()
    try:
        return receiver.recv() if receiver.poll(240) else {"error": "took longer than 240 s"}
    except EOFError:
        process.join()
        return {"error": f"the process ended with {process.exitcode}"}
    finally:
        process.kill()
        process.join()


def describe(found: dict[str, dict[str, str]]) -> str:
    """The page."""
    made = {name: one for name, one in found.items() if "not_made" not in one}
    failed = {
        name: one.get("error", one.get("replays", "")).partition(";")[0]
        for name, one in made.items()
        if "error" in one or one["replays"].startswith("NO")
    }
    versions = []
    for package in (*PACKAGES, "minihack", "nle", "arcengine", "mujoco", "box2d"):
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    share = 100 * (len(made) - len(failed)) / max(1, len(made))
    browsers = Counter(one["browser"] for name, one in made.items() if name not in failed)
    lines = [
        TABLE,
        "",
        "Any Gymnasium environment with pictures and actions that are Discrete, MultiDiscrete, MultiBinary or Box,",
        "or Dict and Tuple of them, can be the `world` of a block. `minihuman new --world ID` writes a study with",
        "the keys below. `minihuman check` says what to know of it: parts of an action without a key (the first four",
        "axes of a Box have keys, the others stay at rest), worlds that do not replay, and worlds that cannot be",
        "copied in mid-episode. It plays the world as participants will;",
        "[what it refuses](extending.md#worlds-of-others) is said with what to change.",
        "",
        "*Pace*: steps per second while keys are held, or one step per key. *Replays*: whether the log of a session",
        "was proven by playing it again. *Browser*: whether the page shows the next pictures ahead of the network, or",
        "each step one round trip after its key.",
        "",
        f"Tried with {', '.join(versions)}.",
        f"Of {len(found)} ids Gymnasium itself made {len(made)}; {len(made) - len(failed)} of these ({share:.1f} %)",
        f"were played for {SECONDS:g} s",
        f"and their logs proven or marked; {browsers['ahead']} are shown ahead in a browser.",
        f"{sum('MiniHack' in name for name in made)} of them are MiniHack's, one is a game of arcengine, which needs",
        "Python 3.12 or later. A run of `python docs/environments.py` writes this section.",
        "",
        "| id | actions | keys | pace | replays | browser |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in made.items():
        if name not in failed:
            cells = (f"`{name}`", *(one[column] for column in ("space", "keys", "pace", "replays", "browser")))
            lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    lines += ["", "Not played:", "", *(f"- `{name}`: {why}" for name, why in failed.items())] if failed else []
    page, heading, recorded = PAGE.read_text(encoding="utf-8").partition(KEPT)
    by_hand = page.partition(TABLE)[0].rstrip()
    return "\n".join([by_hand, "", *lines, "", heading + recorded if heading else ""]).rstrip() + "\n"


def main() -> None:
    """Try one id, or all, and write the page as it grows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--one", default="", help="an id to try alone")
    parser.add_argument("--only", nargs="+", default=[""], help="try the ids with one of these in them; keep the rest")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    asked = parser.parse_args()
    if asked.one:
        print(try_id(asked.one, asked.seconds))
        return
    import minihuman.admin.protocol_file  # the slow part, once
    import minihuman.admin.verify.episodes
    import minihuman.runtime.simulated_session  # noqa: F401

    known = json.loads(FOUND.read_text(encoding="utf-8"))
    ids = list_ids()
    chosen = [name for name in ids if any(part in name for part in asked.only)]
    found = {name: one for name, one in known.items() if name not in chosen}
    for name in chosen:
        found[name] = try_in_a_process(name, asked.seconds)
        print(name, found[name], flush=True)
        FOUND.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
        PAGE.write_text(describe(found), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
