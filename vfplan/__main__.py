"""`python -m vfplan` is the `vfplan` command."""

from vfplan.cli.main import cli

if __name__ == "__main__":
    cli(prog_name="vfplan")
