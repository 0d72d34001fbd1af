"""Compile the engine for pages: vfplan/engine/engine.wasm, by the ziglang of the group `wasm`.

    python release/make_wasm.py [FILE.wasm]

That one version of the compiler gives the same bytes from the same sources, on every machine.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "vfplan" / "engine" / "engine.wasm"
# As the controller is compiled: C++20 without contraction. Without exceptions a refusal ends the
# module, and `-flto` makes it a fifteenth smaller.
FLAGS = (
    "-target", "wasm32-wasi", "-mcpu=generic+simd128", "-mexec-model=reactor", "-std=c++20", "-Os",
    "-flto", "-ffp-contract=off", "-fno-exceptions", "-fno-rtti", "-Wall", "-Wextra",
    "-Wl,--strip-all",
)  # fmt: skip


def compile_to(target: Path) -> None:
    """Write the module."""
    native = "vfplan/native"
    words = [sys.executable, "-m", "ziglang", "c++", *FLAGS, f"-I{native}/include"]
    words += [f"{native}/src/browser.cpp", "-o", str(target.resolve())]
    subprocess.run(words, cwd=ROOT, check=True)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET
    compile_to(target)
    print(f"wrote {target}: {target.stat().st_size / 1e3:.0f} kB")
