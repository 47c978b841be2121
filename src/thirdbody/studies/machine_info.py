"""Description of the machine and software of a measurement."""

import os
import platform
from pathlib import Path
from typing import Any

from thirdbody.system.cpu_count import cores

REGISTERS = {"%zmm": 512, "%ymm": 256, "%xmm": 128, ".4s": 128}
"""Widths of vector registers [bits] by how they are named in assembly, the widest first."""

SUM = "define <16 x float> @add(<16 x float> %a, <16 x float> %b) { %c = fadd <16 x float> %a, %b\n ret <16 x float> %c }"
"""A vector sum as LLVM source: its assembly contains the widest registers of a kind of core."""

CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
"""Folder in which Linux describes the caches of a core."""


def machine() -> dict[str, Any]:
    """Return processor, kind of core, cores usable by this process, current load of the last minute, system and versions.

    `core`: microarchitecture by LLVM's name, such as znver5; `code_for`: the one that kernels are compiled for, another if
    NUMBA_CPU_NAME names it; `vector_bits` of that code; `caches`: KiB by level, and by how many cores each is shared.
    """
    import numba
    import numpy as np

    from thirdbody.version import __version__

    return {
        "cpu": processor(),
        **core(),
        "caches": caches(),
        "cores": cores(),
        "threads": 1,
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "versions": {
            "thirdbody": __version__, "python": platform.python_version(),
            "numba": numba.__version__, "numpy": np.__version__,
        },
    }  # fmt: skip


def processor() -> str:
    """Return the model name of the processor, `unknown` if the system does not give it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def core() -> dict[str, Any]:
    """Return `core`, `code_for` and `vector_bits` of `machine`."""
    import llvmlite.binding as llvm
    import numba

    own = llvm.get_host_cpu_name()
    target, features = numba.config.CPU_NAME or own, numba.config.CPU_FEATURES or ""  # type: ignore[attr-defined]
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    compiler = llvm.Target.from_default_triple().create_target_machine(cpu=target, features=features)
    assembly = compiler.emit_assembly(llvm.parse_assembly(SUM))
    return {"core": own, "code_for": target, "vector_bits": next((REGISTERS[n] for n in REGISTERS if n in assembly), 64)}


def caches() -> dict[str, dict[str, int]]:
    """Return level -> KiB and number of cores that share it, of the data caches of a core; empty if the system hides them."""
    sizes: dict[str, dict[str, int]] = {}
    for folder in sorted(CACHES.glob("index*")):
        try:
            level, kind, size, shared = (
                (folder / name).read_text().strip() for name in ("level", "type", "size", "shared_cpu_list")
            )
        except OSError:
            continue
        if kind != "Instruction":
            sizes[f"L{level}"] = {"KiB": int(size.removesuffix("K")), "cores": _number_of(shared)}
    return sizes


def _number_of(listed: str) -> int:
    """Return how many numbers a list such as 0-3,8 names."""
    ends = [part.split("-") for part in listed.split(",") if part]
    return sum(int(pair[-1]) - int(pair[0]) + 1 for pair in ends)


def described(report: dict[str, Any]) -> str:
    """Return the processor of a report of `machine` in one line, with its kind of core, vectors and caches."""
    core = report["core"] if report["code_for"] == report["core"] else f"{report['core']}, code for {report['code_for']}"
    vectors = f"{report['vector_bits']}-bit vectors"
    sizes = [f"{level} {cache['KiB']} KiB" for level, cache in report["caches"].items()]
    return f"{report['cpu']} ({', '.join([core, vectors, *sizes])})"
