"""`python -m vfplan` is the `vfplan` command; `--cmake-dir` prints the folder for find_package."""

import sys

from vfplan import cmake_dir


def main() -> None:
    """Run the command line, or print the CMake folder."""
    if sys.argv[1:] == ["--cmake-dir"]:
        print(cmake_dir())
        return
    from vfplan.cli.main import cli

    cli(prog_name="vfplan")


if __name__ == "__main__":
    main()
