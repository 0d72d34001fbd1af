"""What every command's `--json` says of the shipped sample: its keys and its values.

`live` has none that ends by itself. Times, digests, keys, dates and sentences are left out.
"""

from __future__ import annotations

import json
import runpy
import shutil
import tempfile
from contextlib import chdir
from pathlib import Path

from click.testing import CliRunner
from oracle.replays import OURS, SAMPLES
from vfplan.cli.main import cli

# In the order in which they run, in one folder that holds the sample. `elbow.h5` is the bundle that
# 2dd7600 planned, so that what comes after the extraction does not depend on it.
COMMANDS = {
    "extract": "extract elbow.png --pixel-spacing 0.5 -o curve.h5",
    "register": "register curve.h5 elbow_markers_image.csv elbow_markers_robot.csv"
    " -o registered.h5",
    "plan": "plan elbow.png elbow_markers_image.csv elbow_markers_robot.csv --pixel-spacing 0.5"
    " --guide 1 -o planned.h5",
    "surface": "surface bone.mrk.json --tolerance 2 -o surface.h5",
    "import": "import cloud.csv --units mm -o cloud.h5",
    "info": "info elbow.h5",
    "validate": "validate elbow.h5",
    "export": "export elbow.h5 -o elbow.dxf",
    "view": "view elbow.h5 --screenshot view.png",
    "keygen": "keygen -o planner.key",
    "sign": "sign elbow.h5 --key planner.key --case case-17 --despite-findings -o signed.h5",
    "verify": "verify signed.h5 --keys planner.pub --case case-17",
    "diff": "diff elbow.h5 guided.h5",
    "replay": "replay elbow.h5 elbow_session.csv -o result.h5",
    "replay robot": "replay elbow.h5 elbow_session.csv --robot franka -o robot.h5",
    "rehearse": "rehearse elbow.h5 elbow_session.csv",
    "burr": "burr cloud.h5 press.csv --radius 3 -o burred.h5",
    "stability": "stability elbow.h5 --robot franka --part closed-loop",
    "campaign": "campaign elbow.h5 --trials 64 -o campaign",
    "bench": "bench register --quick -o bench",
    "demo": "demo -o demo",
}
# `make test` leaves these to `make test-full`: they take longer.
LONG = ("view", "stability", "campaign", "bench", "demo")
QUICK = tuple(name for name in COMMANDS if name not in LONG)
# A longer list is frozen as its length.
LONGEST = 16
LEFT_OUT = {
    "elapsed_s", "real_time_factor", "step_us", "trials_per_minute", "machine", "budget_us", "us",
    "key_id", "sha256", "digest", "warnings", "findings", "history", "message", "text", "verdict",
    "next", "format", "version", "/@id", "/@version", "/provenance@created_utc",
    "/provenance@software", "/provenance/history", "chosen", "pareto",
}  # fmt: skip
# Relative tolerance of numbers. The first line's commands draw or extract anew, the second's
# simulate an arm with a library whose versions differ; the others take a frozen bundle.
LOOSE = {
    "extract": 0.05, "register": 0.05, "plan": 0.05, "demo": 0.05, "campaign": 0.2, "bench": 0.2,
    "rehearse": 0.02, "surface": 0.01, "stability": 0.001,
}  # fmt: skip
TIGHT = 1e-6
# Numbers that differ by less are the same, whatever their unit: they are rounding errors of 0.
SMALLEST = 1e-9


def documents(names):
    """{name: {path of a value: value}} of the JSON documents of some commands."""
    answers = {}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        prepare()
        for name in names:
            words = [*COMMANDS[name].split(), "--json"]
            done = CliRunner(env={"SOURCE_DATE_EPOCH": "1767225600"}).invoke(cli, words)
            answers[name] = dict(leaves({"exit": done.exit_code, **json.loads(done.stdout)}))
    return answers


def prepare():
    """Put the sample, the frozen bundles and two small inputs into the current folder."""
    for path in [*SAMPLES.glob("elbow*"), OURS / "elbow.h5"]:
        shutil.copy(path, ".")
    shutil.copy(OURS / "elbow-guided.h5", "guided.h5")
    runpy.run_path(str(SAMPLES / "make_bone.py"), run_name="__main__")
    rows = [f"{x},{y},0" for x in range(-10, 11) for y in range(-10, 11)]
    Path("cloud.csv").write_text("x,y,z\n" + "\n".join(rows) + "\n")
    hips = [f"{k / 1000:.3f},{(k - 500) * 1e-5:.6f},0,{0.008 - k * 1e-5:.6f}" for k in range(1000)]
    Path("press.csv").write_text("t,x,y,z\n" + "\n".join(hips) + "\n")


def leaves(value, path=""):
    """(path, value) of every number, string, bool and null of a document."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in LEFT_OUT and not key.startswith("time_us"):
                yield from leaves(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and len(value) > LONGEST:
        yield f"{path}.length", len(value)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from leaves(inner, f"{path}[{k}]")
    else:
        yield path, value


def text(_tree, name):
    """What tests/data/oracle/documents.txt holds: a line a value."""
    lines = [
        "# What --json of every command holds on the shipped sample.",
        f"# Renew: python tests/oracle/renew.py {name}",
    ]
    for command, values in documents(COMMANDS).items():
        lines += [f"[{command}]", f"# vfplan {COMMANDS[command]} --json"]
        for path, value in values.items():
            shown = f"{value:.9g}" if isinstance(value, float) else json.dumps(value)
            lines.append(f"{path} = {shown}")
    return "\n".join(lines) + "\n"


def parsed(text):
    """{command: {path: value}}."""
    answers = {}
    for line in text.splitlines():
        if line.startswith("["):
            values = answers.setdefault(line[1:-1], {})
        elif not line.startswith("#"):
            path, value = line.split(" = ", 1)
            values[path] = json.loads(value)
    return answers


def different(frozen, new):
    """A line for each value that is gone, of another kind, or beyond its tolerance."""
    for command, values in new.items():
        for path, before in frozen[command].items():
            if path not in values:
                yield f"{command}: {path} is gone; it was {before!r}"
            elif not same(before, values[path], LOOSE.get(command, TIGHT)):
                yield f"{command}: {path} was {before!r}, is {values[path]!r}"


def same(before, now, tolerance):
    """Whether a value is what it was; of a sentence, whether there is one."""
    kinds = (int, float)
    if isinstance(before, str) and " " in before:
        return isinstance(now, str)
    if type(before) is bool or not (isinstance(before, kinds) and isinstance(now, kinds)):
        return before == now
    return abs(before - now) <= tolerance * max(abs(before), abs(now)) + SMALLEST
