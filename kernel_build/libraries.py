"""The library of all kernels that Python calls: machine code made of their bitcode, and a manifest of its sources."""

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from kernel_build import bitcode, compiler_digest, library_manifest
from kernel_build.library_cache import CachedLibrary, LibraryCache
from kernel_build.linking import BuildError, Target, find_linker, link_objects, machine_for

LINKER_REQUIREMENT = "ziglang>=0.13"
LOWERING_REQUIREMENTS = "numba>=0.68", "numpy>=1.26", "gymnasium>=1.1"
# Whether a library is for this processor: which bits cpuid sets says what instructions there are, and xgetbv that the
# system keeps the wide registers. v2 is of 2009 (SSE3, SSSE3, CX16, SSE4.1, SSE4.2, POPCNT), v3 of 2013 (those, FMA,
# MOVBE, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT).
_CPUID = 'call { i32, i32, i32, i32 } asm "cpuid", "={ax},={bx},={cx},={dx},{ax},{cx},~{dirflag},~{fpsr},~{flags}"'
_RUNS_HERE = {
    "generic": """
define i32 @runs_here() {
  ret i32 1
}
""",
    "x86-64-v2": """
define i32 @runs_here() #0 {
  %basic = CPUID(i32 1, i32 0)
  %basic_said = extractvalue { i32, i32, i32, i32 } %basic, 2
  %basic_set = and i32 %basic_said, 9970177
  %basic_fits = icmp eq i32 %basic_set, 9970177
  br i1 %basic_fits, label %yes, label %no
yes:
  ret i32 1
no:
  ret i32 0
}
attributes #0 = { "target-cpu"="x86-64" "target-features"="" }
""",
    "x86-64-v3": """
define i32 @runs_here() #0 {
  %basic = CPUID(i32 1, i32 0)
  %basic_said = extractvalue { i32, i32, i32, i32 } %basic, 2
  %basic_set = and i32 %basic_said, 953692673
  %basic_fits = icmp eq i32 %basic_set, 953692673
  br i1 %basic_fits, label %newer, label %no
newer:
  %newer_set = CPUID(i32 7, i32 0)
  %newer_set_said = extractvalue { i32, i32, i32, i32 } %newer_set, 1
  %newer_set_set = and i32 %newer_set_said, 296
  %newer_set_fits = icmp eq i32 %newer_set_set, 296
  br i1 %newer_set_fits, label %more, label %no
more:
  %more_set = CPUID(i32 -2147483647, i32 0)
  %more_set_said = extractvalue { i32, i32, i32, i32 } %more_set, 2
  %more_set_set = and i32 %more_set_said, 32
  %more_set_fits = icmp eq i32 %more_set_set, 32
  br i1 %more_set_fits, label %kept, label %no
kept:
  %kept_set = call { i32, i32 } asm "xgetbv", "={ax},={dx},{cx},~{dirflag},~{fpsr},~{flags}"(i32 0)
  %kept_said = extractvalue { i32, i32 } %kept_set, 0
  %kept_wide = and i32 %kept_said, 6
  %kept_fits = icmp eq i32 %kept_wide, 6
  br i1 %kept_fits, label %yes, label %no
yes:
  ret i32 1
no:
  ret i32 0
}
attributes #0 = { "target-cpu"="x86-64" "target-features"="" }
""",
}

_ELF = "ld.lld", ("-shared", "-z", "noexecstack", "--strip-all", "--hash-style=gnu"), ".so"
_DLL = "lld-link", ("/dll", "/noentry", "/nodefaultlib", "/opt:ref"), ".dll"
_MACOS = "-dylib", "-arch", "arm64", "-platform_version", "macos", "11.0", "11.0", "-undefined", "dynamic_lookup"
_MACHO = "ld64.lld", _MACOS, ".dylib"


@dataclass(frozen=True, slots=True)
class Platform:
    """What a library is for.

    Args:
        system: Python's name of it.
        machine: LLVM's name of the kind of processor.
        target: what is emitted and linked.
    """

    system: str
    machine: str
    target: Target

    @property
    def is_here(self) -> bool:
        """Return whether it is this system and kind of processor."""
        return [self.system, self.machine] == library_manifest.HERE

    @property
    def file(self) -> str:
        """Name the library's file."""
        return f"kernels-{self.system}-{self.target.cpu}{self.target.suffix}"


PLATFORMS = (  # the newest processors first
    Platform("linux", "x86_64", Target("x86_64-unknown-linux-gnu", "x86-64-v3", "", *_ELF)),
    Platform("linux", "x86_64", Target("x86_64-unknown-linux-gnu", "x86-64-v2", "", *_ELF)),
    Platform("linux", "aarch64", Target("aarch64-unknown-linux-gnu", "generic", "", *_ELF)),
    Platform("win32", "x86_64", Target("x86_64-pc-windows-msvc", "x86-64-v3", "", *_DLL)),
    Platform("win32", "x86_64", Target("x86_64-pc-windows-msvc", "x86-64-v2", "", *_DLL)),
    Platform("darwin", "aarch64", Target("arm64-apple-macosx", "generic", "", *_MACHO)),
)


def find_platform() -> Platform | None:
    """Return this machine's platform, with the newest level that its processor has; None where none is known."""
    features = llvm.get_host_cpu_features()
    is_v3 = all(features.get(name) for name in ("avx2", "bmi2", "fma", "movbe"))
    levels = [platform for platform in PLATFORMS if platform.is_here and (is_v3 or platform.target.cpu != "x86-64-v3")]
    return levels[0] if levels else None


def emit_library(code: bytes, target: Target, kernel_count: int) -> bytes:
    """Make a library of bitcode of so many kernels.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    machine = machine_for(target)
    module = llvm.parse_bitcode(code)
    module.triple = target.triple
    module.data_layout = str(machine.target_data)
    module.link_in(llvm.parse_assembly(_RUNS_HERE[target.cpu].replace("CPUID", _CPUID)))
    # Numba optimised each kernel by itself, for any machine. All together, for this one, they are 3 to 7 % faster and a
    # quarter smaller, for 5 CPU-seconds of the build.
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = True
    tuning.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    module.verify()
    exported = ["api", "refusals", "runs_here", *(f"kernel_{number}" for number in range(kernel_count))]
    return link_objects([machine.emit_object(module)], exported, target)


def build_library(folder: Path, *, only_stale: bool = False) -> None:
    """Write this machine's library and its manifest into a folder, from the cache or anew.

    What was made of other kernels is not in the manifest: it would be loaded as if it were of these.

    Args:
        folder: where to.
        only_stale: not if the folder has a library of the kernels as they are, by the compiler as it is.

    Raises:
        BuildError: if there is no linker, or it refuses, or Numba is needed and missing.
    """
    platform = find_platform()
    if platform is None:
        print(f"no library is known for {' on '.join(library_manifest.HERE)}")
        return
    committed = bitcode.read_committed_manifest()
    if only_stale and is_fresh(folder, platform, committed):
        return
    cache = LibraryCache.of_user()
    key = _cache_key(platform, committed)
    library = cache.read(key)
    if library is None or not bitcode.has_every_kernel(library.manifest):
        bitcode_manifest, code = bitcode.read_or_lower(committed)
        emitted = emit_library(code, platform.target, len(bitcode_manifest["kernels"]))
        library = CachedLibrary(_describe(bitcode_manifest), emitted)
        cache.write(key, library)
    _write(folder, library.manifest, {platform: library.code})


def build_every_library(folder: Path) -> None:
    """Write the libraries of all platforms that can be linked here, and their manifest.

    Raises:
        BuildError: if this machine's own cannot be made.
    """
    manifest, code = bitcode.read_or_lower(bitcode.read_committed_manifest())
    libraries: dict[Platform, bytes] = {}
    for platform in PLATFORMS:
        try:
            libraries[platform] = emit_library(code, platform.target, len(manifest["kernels"]))
        except BuildError as error:
            if platform.is_here:
                raise
            (folder / platform.file).unlink(missing_ok=True)  # one of other kernels
            print(f"{folder / platform.file}: not made. {str(error).splitlines()[0]}")
    _write(folder, _describe(manifest), libraries)


def is_fresh(folder: Path, platform: Platform, committed: Mapping[str, Any] | None) -> bool:
    """Say whether a folder has a platform's library of all kernels as they are, by this version of what builds it."""
    manifest = library_manifest.read_manifest(folder)
    if manifest is None or manifest.get("compiler") != compiler_digest():
        return False
    if committed is not None and manifest["bitcode"] != committed["sha256"]:
        return False
    digests = {file["file"]: file["sha256"] for file in manifest["files"]}
    try:
        digest = hashlib.sha256((folder / platform.file).read_bytes()).hexdigest()
    except OSError:
        return False
    return digests.get(platform.file) == digest and bitcode.has_every_kernel(manifest)


def list_requirements(folder: Path) -> list[str]:
    """Return what a folder's library needs to be built, beside llvmlite.

    That is a linker where there is none, and Numba where neither the committed bitcode nor a library that was built
    before is of the kernels as they are.
    """
    platform = find_platform()
    committed = bitcode.read_committed_manifest()
    if platform is None or is_fresh(folder, platform, committed):
        return []
    cached = LibraryCache.of_user().read(_cache_key(platform, committed))
    if cached is not None and bitcode.has_every_kernel(cached.manifest):
        return []
    linker = [] if find_linker(platform.target) else [LINKER_REQUIREMENT]
    if committed is not None:
        return linker
    return [*linker, *LOWERING_REQUIREMENTS]


def _describe(bitcode_manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return a library's manifest, but for its files."""
    shared = {name: bitcode_manifest[name] for name in ("api", "kernels", "sources", "modules")}
    return {"compiler": compiler_digest(), "bitcode": bitcode_manifest["sha256"]} | shared


def _cache_key(platform: Platform, committed: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return all that a library is made of: sources, compiler, tools and platform."""
    package = library_manifest.PACKAGE
    paths = sorted(path.relative_to(package).as_posix() for path in (package / "worlds").rglob("*.py"))
    sources = "\n".join(f"{path} {library_manifest.source_digest(path)}" for path in paths)
    if find_spec("numba") is not None:
        lowered_by = f"numba {version('numba')}"
    else:
        lowered_by = ""
    return {
        "sources": hashlib.sha256(sources.encode()).hexdigest(),
        "compiler": compiler_digest(),
        "bitcode": lowered_by if committed is None else committed["sha256"],
        "llvmlite": llvmlite.__version__,
        "platform": [platform.system, platform.machine, platform.target.cpu],
    }


def _write(folder: Path, manifest: Mapping[str, Any], libraries: Mapping[Platform, bytes]) -> None:
    """Write libraries, and then the manifest that lists them; a running process keeps the file that it has loaded."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for platform, code in libraries.items():
        _replace(folder / platform.file, code)
        runs_on = [platform.system, platform.machine]
        files.append({"file": platform.file, "runs on": runs_on, "sha256": hashlib.sha256(code).hexdigest()})
        print(f"{folder / platform.file}: {len(code) / 1000:.0f} kB")
    text = json.dumps({**manifest, "files": files}) + "\n"
    _replace(folder / library_manifest.MANIFEST, text.encode())


def _replace(path: Path, content: bytes) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as scratch:
        new = Path(scratch, path.name)
        new.write_bytes(content)
        os.replace(new, path)
