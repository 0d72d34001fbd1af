"""Run the readers on the conformance kit, and put the matrix into howto/reader.md:

python docs/make_conformance.py
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from vfplan.bundle.read import read_bundle
from vfplan.bundle.seal import Trust, read_keys
from vfplan.conformance import __main__ as runner
from vfplan.conformance.kit import write_kit
from vfplan.errors import BundleError, InputError
from vfplan.io.files import to_json_types

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "howto" / "reader.md"
BEGIN = "<!-- matrix: made by docs/make_conformance.py -->\n"
END = "<!-- end -->"


def main() -> None:
    """Write the matrix."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, remainder = text.partition(BEGIN)
    after = remainder.partition(END)[2]
    PAGE.write_text(before + BEGIN + matrix() + "\n" + END + after, encoding="utf-8")


def matrix() -> str:
    """A line for each rule, a column for each reader."""
    second = [sys.executable, str(ROOT / "samples" / "reader" / "vfplan_reader.py")]
    with tempfile.TemporaryDirectory() as folder:
        kit = Path(folder) / "kit"
        write_kit(kit)
        program = Path(folder) / "bundle_info"
        source = ROOT / "samples" / "bundle_info" / "main.cpp"
        include = ROOT / "vfplan" / "native" / "include"
        subprocess.run(["g++", "-std=c++20", f"-I{include}", source, "-o", program], check=True)
        by_header = runner.command_reader([str(program), "--values"], refused=(3, 4))
        results = {
            "package": runner.judge(kit, by_the_package, verified_by_the_package),
            "bundle_info": runner.judge(kit, by_header),
            "vfplan_reader.py": runner.judge(kit, runner.command_reader(second)),
        }
    return runner.matrix(results) + "\n" + sums(results)


def sums(results: dict[str, list[runner.Result]]) -> str:
    """The last line: how many of its files each reader judged as it must."""
    cells = []
    for judged in results.values():
        right = [result for result in judged if not result.problem]
        cells.append(f"{len(right)} of {len(judged)}")
    count = max(len(judged) for judged in results.values())
    return f"| all files | {count} | " + " | ".join(cells) + " |"


def by_the_package(path: Path) -> dict[str, object] | None:
    """The values that the installed package reads; `None` when it refuses the file."""
    try:
        return to_json_types(read_bundle(path)[0])
    except (BundleError, InputError):
        return None


def verified_by_the_package(path: Path) -> dict[str, object] | None:
    """The same where the keys beside the file are trusted alone."""
    try:
        trust = Trust(read_keys(path.with_name("keys.pub")))
        return to_json_types(read_bundle(path, trust=trust)[0])
    except (BundleError, InputError):
        return None


if __name__ == "__main__":
    main()
