"""What a controller that includes vfplan/engine.hpp costs to compile, in processor seconds.

    python tests/native/compile_time.py [--runs 5] [include-folder ...]

Several folders are compiled in turn, so that a loaded machine slows all of them alike. Of each the
fastest run counts, and the ratio is to the first folder.
"""

import argparse
import resource
import subprocess
import tempfile
from pathlib import Path

CONTROLLER = """
#include <vfplan/engine.hpp>
int main() {
    const double xyz[6] = {0, 0, 0, 0.001, 0, 0};
    vfplan::Engine engine(xyz, 2, vfplan::Parameters{});
    return engine.step({{0, 0, 0.01}}).force[2] > 0;
}
"""
OURS = Path(__file__).parents[2] / "vfplan/native/include"


def compile_time(include: Path, folder: Path, flags: list[str]) -> float:
    """User time of one compilation [s]."""
    command = ["g++", "-std=c++20", "-O2", f"-I{include}", *flags, "-c", "controller.cpp"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(command, cwd=folder, check=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--flag", action="append", default=[], help="a further compiler flag")
    parser.add_argument(
        "include", nargs="*", type=lambda name: Path(name).resolve(), default=[OURS]
    )
    asked = parser.parse_args()
    times = [[] for _ in asked.include]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "controller.cpp").write_text(CONTROLLER)
        for _ in range(asked.runs):
            for include, seconds in zip(asked.include, times, strict=True):
                seconds.append(compile_time(include, Path(folder), asked.flag))
    fastest = [min(seconds) for seconds in times]
    for include, seconds in zip(asked.include, fastest, strict=True):
        print(f"{seconds:5.1f} s  {seconds / fastest[0]:4.2f}  {include}")


if __name__ == "__main__":
    main()
