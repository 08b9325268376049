"""Lines of Minigrid's and Miniworld's own code that touch an environment, run on upstream's worlds and on ours.

    xvfb-run -a python -m tests.worlds.upstream_lines [FOLDER ...] [--count 150] [--seed 0] [--all]

Attribute accesses, assignments and calls on environments are taken from the sources of the installed packages, and from
the Python files and the Python in Markdown below each FOLDER (an unpacked source release has the tests). Names that
begin with an underscore are not taken, nor what a class of environments assigns to itself: they are a class's own. Of
Miniworld's pictures, which OpenGL draws, shapes are compared. Arguments that are no literals are samples by their
names. Of all different lines so many are drawn by seed; each is run on both worlds, freshly reset, and followed by some
steps. Printed are the lines that ours refuses, and those whose answer or whose steps differ without an error.
"""

import argparse
import ast
import importlib.util
import re
import signal
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from enum import EnumMeta
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import minihuman  # noqa: F401
from minihuman.errors import MinihumanError

ROOTS = frozenset({"env", "self.env", "self.unwrapped", "self.mission", "self.bot.mission", "mission"})
INSIDE = (
    "minigrid/envs/",
    "minigrid/minigrid_env",
    "minigrid/core/roomgrid",
    "miniworld/envs/",
    "miniworld/miniworld.py",
)
PASSED_THROUGH = frozenset({"unwrapped", "env"})
GYMNASIUMS_OWN = frozenset(
    {"reset", "step", "close", "spec", "metadata", "observation", "action", "np_random", "unwrapped"}
)
SAMPLES = {
    **dict.fromkeys(("i", "j", "x", "y", "room_i", "room_j", "abs_i", "abs_j", "vis_i", "vis_j"), "1"),
    **dict.fromkeys(("pos", "fwd_pos", "position_to_try", "obj_pos", "door_pos", "new_pos"), "(1, 1)"),
    **dict.fromkeys(("width", "height", "size", "agent_view_size"), "7"),
    **dict.fromkeys(("tile_size", "TILE_PIXELS"), "8"),
    **dict.fromkeys(("color", "key_color", "door_color"), "'red'"),
    **dict.fromkeys(("obj", "ball", "key"), "Ball('red')"),
    **dict.fromkeys(("max_tries",), "100"),
    **dict.fromkeys(("highlight", "rand_dir", "True"), "True"),
    **dict.fromkeys(("seed",), "3"),
    **dict.fromkeys(("fwd_dist", "fwd_step"), "0.1"),
    **dict.fromkeys(("fwd_drift",), "0.0"),
    **dict.fromkeys(("turn_angle", "turn_step"), "15"),
    **dict.fromkeys(("ent", "ent0", "entity"), "u.entities[0]"),
    **dict.fromkeys(("radius",), "0.4"),
    **dict.fromkeys(("frame_buffer",), "None"),
}
GRID, ROOM = "MiniGrid-DoorKey-8x8-v0", "MiniWorld-PickupObjects-v0"
MOST_CPU_S = 2.0  # of a line and the steps after it
STEPS = (0, 2, 1, 2, 2)


@dataclass(frozen=True, order=True, slots=True)
class Line:
    """A line of upstream's, about an environment ``u``, and the world it is run on."""

    text: str
    world_id: str


class _Rewriter(ast.NodeTransformer):
    """Rewrites an expression about an environment to one about ``u``."""

    def __init__(self, *, inside: bool) -> None:
        self.roots = ROOTS | ({"self"} if inside else set())
        self.is_complete = True

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if ast.unparse(node) in self.roots:
            return ast.Name("u")
        inner = self.visit(node.value)
        if isinstance(inner, ast.Name) and inner.id == "u" and node.attr in PASSED_THROUGH:
            return inner
        return ast.Attribute(inner, node.attr)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.roots:
            return ast.Name("u")
        if node.id in SAMPLES:
            return ast.parse(SAMPLES[node.id], mode="eval").body
        self.is_complete = False
        return node


def python_in(path: Path) -> Iterator[str]:
    """Give the Python of a source, or of each block of a Markdown file."""
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".py":
        yield text
    else:
        yield from re.findall(r"```py(?:thon)?\n(.*?)```", text, re.S)


def expressions_in(text: str, *, inside: bool) -> Iterator[str]:
    """Give the expressions and assignments of a source that touch an environment, about ``u``."""
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) and _is_environment(node)]
    own_nodes = {id(node) for definition in classes if inside for node in ast.walk(definition)}
    for node in ast.walk(tree):
        is_own = id(node) in own_nodes
        is_assignment = isinstance(node, ast.Assign) and len(node.targets) == 1
        if is_assignment and isinstance(node.targets[0], ast.Attribute) and not is_own:
            yield from _assignment(node)
        if isinstance(node, ast.Attribute | ast.Call):
            yield from _touching(node, inside=is_own)


def _is_environment(definition: ast.ClassDef) -> bool:
    return any(re.search(r"Env$|Grid$|Level$|LevelGen$", ast.unparse(base)) for base in definition.bases)


def _touching(node: ast.expr, *, inside: bool) -> Iterator[str]:
    rewriter = _Rewriter(inside=inside)
    text = ast.unparse(ast.fix_missing_locations(rewriter.visit(ast.parse(ast.unparse(node), mode="eval").body)))
    if rewriter.is_complete and _is_public(text):
        yield text


def _assignment(node: ast.Assign) -> Iterator[str]:
    for target in _touching(node.targets[0], inside=False):
        if target.count(".") == 1:
            values = list(_touching_or_literal(node.value))
            yield f"{target} = {values[0] if values else target}"


def _touching_or_literal(node: ast.expr) -> Iterator[str]:
    if isinstance(node, ast.Constant):
        yield ast.unparse(node)
    else:
        yield from _touching(node, inside=False)


def _is_public(text: str) -> bool:
    """Whether a text begins at an environment, and touches a name of upstream's that is not a class's own."""
    names = re.findall(r"u\.(\w+)", text)
    return (
        text.startswith("u.")
        and bool(names)
        and not any(name.startswith("_") or name in GYMNASIUMS_OWN for name in names)
    )


def world_of(path: Path) -> str:
    """Return the id of the world that a source's lines are run on: of its own class where it defines one."""
    parts = path.as_posix()
    if "miniworld" in parts.lower():
        package, default = "miniworld", ROOM
    else:
        package, default = "minigrid", "BabyAI-GoToLocal-v0" if "baby" in parts else GRID
    module = parts.partition(f"{package}/envs/")[2].removesuffix(".py").replace("/", ".")
    for spec in gymnasium.registry.values():
        entry = str(spec.entry_point)
        is_of_module = module and entry.startswith(f"{package}.envs") and module.split(".")[-1] in _module_of(entry)
        if is_of_module and f"minihuman/{spec.id}" in gymnasium.registry and "WFC" not in spec.id:
            return spec.id
    return default


def _module_of(entry: str) -> str:
    """The module in which an entry point's class is defined."""
    module, _, name = entry.partition(":")
    return str(getattr(getattr(sys.modules.get(module), name, None), "__module__", module)).rpartition(".")[2]


def extract_lines(folders: list[Path]) -> list[Line]:
    """Return the different lines below some folders, in order."""
    lines = set()
    for folder in folders:
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.md")]):
            inside = any(part in path.as_posix() for part in INSIDE)
            for text in python_in(path):
                lines |= {Line(line, world_of(path)) for line in expressions_in(text, inside=inside)}
    return sorted(lines)


def comparable(answer: Any) -> Any:
    """Return an answer as plain Python that is equal where both worlds mean the same."""
    if isinstance(answer, np.ndarray) and answer.ndim == 3 and answer.dtype != bool and max(answer.shape) >= 60:
        return list(answer.shape)  # a picture
    if isinstance(answer, np.ndarray | np.generic):
        return comparable(answer.tolist())
    if isinstance(answer, bool | str | type(None)):
        return answer
    if isinstance(answer, int | float):
        return round(float(answer), 9)
    if isinstance(answer, EnumMeta):
        return "actions"
    if isinstance(answer, dict):
        return {str(key): comparable(part) for key, part in answer.items()}
    if isinstance(answer, tuple | list | set | frozenset):
        return [comparable(part) for part in answer]
    if callable(answer):
        return "function"
    if hasattr(answer, "encode"):
        return comparable(answer.encode())
    if hasattr(answer, "pos"):
        return comparable([*answer.pos, answer.dir])
    for names in (("top", "size"), ("min_x", "max_x", "min_z", "max_z"), ("n",), ("shape",)):
        if all(hasattr(answer, name) for name in names):
            return comparable([getattr(answer, name) for name in names])
    return "object"


def answer_of(world_id: str, text: str) -> tuple[str, Any]:
    """Return how a line ends on a world and what it and some steps after it give: "value", or "error"."""
    from minigrid.core import world_object

    env = gymnasium.make(world_id, disable_env_checker=True)
    env.reset(seed=3)
    names = {"u": env.unwrapped, "np": np} | vars(world_object)
    earlier = signal.signal(signal.SIGVTALRM, _give_up)
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_CPU_S)
    try:
        if re.match(r"u\.\w+ = ", text):
            exec(text, names)
            answer = None
        else:
            answer = eval(text, names)
        answer = comparable(answer)
        return "value", [answer, *_after(env)]
    except MinihumanError as error:
        return "refused", str(error)
    except Exception as error:  # of any kind: upstream's own lines fail in their own ways
        return "error", f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, earlier)
        env.close()


def _give_up(*_: object) -> None:
    raise TimeoutError(f"more than {MOST_CPU_S} s of CPU time")  # Minigrid looks for a free wall for ever


def _after(env: gymnasium.Env[Any, Any]) -> Iterator[Any]:
    for action in STEPS:
        observed, reward, terminated, truncated, _ = env.step(action)
        agent = getattr(env.unwrapped, "agent", None)
        seen = comparable(observed["image"]) if agent is None else comparable([*agent.pos, agent.dir])
        yield [seen, round(float(reward), 9), terminated, truncated]
        if terminated or truncated:
            return


def compare(line: Line) -> tuple[str, str]:
    """Return what became of a line: "same", "refused", "differs" or "upstream fails", and in what words."""
    upstream = answer_of(line.world_id, line.text)
    if upstream[0] == "error":
        return "upstream fails", upstream[1]
    ours = answer_of(f"minihuman/{line.world_id}", line.text)
    if ours[0] != "value":
        return "refused" if ours[0] == "refused" else "raises without advice", ours[1]
    return ("same", "") if ours == upstream else ("differs", f"{upstream[1][0]} there, {ours[1][0]} here")


def installed_folders() -> list[Path]:
    """Return the folders of the installed packages."""
    specs = (importlib.util.find_spec(name) for name in ("minigrid", "miniworld"))
    return [Path(spec.origin).parent for spec in specs if spec is not None and spec.origin is not None]


def main() -> None:
    """Draw lines, run them, print what differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--all", action="store_true", help="Run every line, not a sample.")
    arguments = parser.parse_args()
    import minigrid  # noqa: F401
    import miniworld  # noqa: F401

    warnings.filterwarnings("ignore")
    lines = extract_lines([*installed_folders(), *arguments.folders])
    order = np.random.default_rng(arguments.seed).permutation(len(lines)).tolist()
    outcomes: Counter[str] = Counter()
    for number in order:
        outcome, words = compare(lines[number])
        if outcome != "upstream fails":
            outcomes[outcome] += 1
            if outcome != "same":
                print(f"{outcome}: {lines[number].text} ({lines[number].world_id}): {words[:300]}")
        if outcomes.total() == arguments.count and not arguments.all:
            break
    print(f"{len(lines)} different lines; of {outcomes.total()} that run on upstream's: {dict(outcomes)}")


if __name__ == "__main__":
    main()
