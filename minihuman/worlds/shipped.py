"""Machine code that came with the package, as a platform's wheel brings it: where it is, and what runs it.

It is made for the instructions that nearly every processor since 2013 has, x86-64-v3. What finds it by name is the
same as for code compiled here (`kernels.Kept`), so other sources or versions find nothing, and compile.
"""

from collections.abc import Mapping
from pathlib import Path

LEVEL = "x86-64-v3"  # LLVM's name of it
FOLDER = Path(__file__).parent / "compiled"
_INSTRUCTIONS = (
    *("cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2", "avx", "avx2"),
    *("bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)


def made_for(triple: str, features: Mapping[str, bool]) -> tuple[str, str, str] | None:
    """What shipped code for a machine was compiled for, in Numba's words; None where the processor lacks something.

    Args:
        triple: the machine, its system and its ABI.
        features: LLVM's names of instructions, and whether this processor has them.
    """
    if not triple.startswith("x86_64") or not all(features.get(name) for name in _INSTRUCTIONS):
        return None
    return triple, LEVEL, ""
