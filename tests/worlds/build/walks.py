"""A random walk in every world of one body, as digests: the same on every machine.

    python -m tests.worlds.build.walks > HERE; on another machine, or in QEMU: > THERE; diff HERE THERE

Needs minihuman, NumPy and Gymnasium alone. A line is a world and the digest of what it showed, earned and ended.
"""

import hashlib
import platform
import sys
import warnings

import gymnasium
import numpy as np

import minihuman  # noqa: F401

STEPS = 60


def walk(name: str) -> str:
    """The digest of a walk."""
    env, found, rng = gymnasium.make(name), hashlib.sha256(), np.random.default_rng(7)
    seen, _ = env.reset(seed=11)
    for _ in range(STEPS):
        take(found, seen)
        seen, reward, terminated, truncated, _ = env.step(int(rng.integers(env.action_space.n)))
        found.update(np.float64(reward).tobytes() + bytes([terminated, truncated]))
        if terminated or truncated:
            take(found, seen)
            seen, _ = env.reset()
    take(found, seen)
    return found.hexdigest()[:16]


def take(found, seen) -> None:
    """Add an observation to a digest."""
    if isinstance(seen, dict):
        for name in sorted(seen):
            take(found, seen[name])
    else:
        found.update(seen.encode() if isinstance(seen, str) else np.ascontiguousarray(seen).tobytes())


def main() -> None:
    """Walk everywhere."""
    warnings.simplefilter("ignore")
    for name in sorted(one for one in gymnasium.registry if one.startswith("minihuman/")):
        if "/Team-" not in name and name != "minihuman/Level-v0":
            print(name, walk(name), flush=True)
    print(f"{platform.machine()}; compiled here by Numba: {'numba' in sys.modules}", file=sys.stderr)


if __name__ == "__main__":
    main()
