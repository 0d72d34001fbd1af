"""What all tests share: the data folder, the optional programs, the command line runner."""

from __future__ import annotations

import json
import math
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import codes
import pytest

ROOT = Path(__file__).resolve().parents[1]
ENDS = (".png", "_markers_image.csv", "_markers_robot.csv")
# The sample: a drawn slice, and its markers' places in the image and before the robot.
ELBOW = tuple(ROOT / "samples" / f"elbow{end}" for end in ENDS)

# What a child runs first: whoever runs the tests may ignore signals, as `nohup` and a shell's
# background do.
AWAKE = (
    "import signal\n"
    "for n in (signal.SIGTERM, signal.SIGHUP): signal.signal(n, signal.SIG_DFL)\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
)


def dimple_depth(spacing: float, radius: float, *, planar: bool) -> float:
    """How deep a ball sinks in the middle of a square of samples, or between two of a line [m]."""
    quarter = spacing * spacing / (4 if planar else 2)
    return quarter / (radius + math.sqrt(radius * radius - quarter))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="run the slow tests as well, as CI does")
    parser.addoption("--full", action="store_true", help="run the long studies as well")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what the call leaves out: `make test` the slow tests, `make test-all` long studies."""
    full = config.getoption("--full")
    slow = full or config.getoption("--all")
    for item in items:
        if "full" in item.keywords and not full:
            item.add_marker(pytest.mark.skip(reason="long study: run with --full"))
        elif "slow" in item.keywords and not slow:
            item.add_marker(pytest.mark.skip(reason="slow: run with --all"))


def pytest_configure(config: pytest.Config) -> None:
    """Watch the codes that are raised, in this process and in those below it."""
    if codes.RAISED not in os.environ:
        os.environ[codes.RAISED] = tempfile.mkstemp(prefix="vfplan-codes-")[1]
        config.add_cleanup(Path(os.environ[codes.RAISED]).unlink)
    codes.watch()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """After all tests: collect the codes of the sources that none of them named or raised."""
    codes.tell()
    config = session.config
    if hasattr(config, "workerinput"):
        return
    chosen = config.option.keyword or config.option.markexpr or config.option.collectonly
    is_whole = config.args_source is config.ArgsSource.TESTPATHS and not chosen
    if is_whole and (config.getoption("--all") or config.getoption("--full")):
        _codes_left.extend(codes.left())


_codes_left: list[str] = []


def pytest_terminal_summary(terminalreporter) -> None:
    """Print the codes that no test raised."""
    if _codes_left:
        terminalreporter.section("codes that no test names or raises", red=True)
        terminalreporter.write_line(" ".join(_codes_left))


@pytest.fixture(scope="session")
def root() -> Path:
    """The source tree the tests belong to."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data with known truth; skips the test where it is not there."""
    folder = Path(os.environ.get("VFPLAN_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no test data: set VFPLAN_TEST_DATA (looked in {folder})")
    return folder


def names_in(folder: Path) -> list[str]:
    """The names of the files in a folder, sorted."""
    return sorted(path.name for path in folder.iterdir())


def file_with(path: Path, content: str | bytes) -> Path:
    """The path of a file, once this is written there."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def missing(reason: str) -> NoReturn:
    """Skip the test for want of something; fail it where everything must be there (CI)."""
    if os.environ.get("VFPLAN_REQUIRE_PACKAGES"):
        pytest.fail(reason)
    pytest.skip(reason)


def missing_package(package: str, what: str) -> NoReturn:
    """As `missing`, naming the apt package."""
    missing(f"needs apt package {package} ({what} not found)")


@contextmanager
def memory_below(most: float) -> Iterator[None]:
    """The block takes fewer bytes than that at a time."""
    tracemalloc.start()
    yield
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < most


def free_port(kind=socket.SOCK_DGRAM):
    """A port of this machine that nobody uses yet."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def need_program(program: str, package: str) -> str:
    """The program's path; skips the test, naming the apt package, where it is absent."""
    return shutil.which(program) or missing_package(package, program)


def output(*command: Any, code: int = 0, timeout: float = 300, **more: Any) -> str:
    """What a program printed that ended with this code; `more` is for `subprocess.run`."""
    words = [str(word) for word in command]
    done = subprocess.run(
        words, capture_output=True, text=True, check=False, timeout=timeout, **more
    )
    assert done.returncode == code, (words, done.stdout, done.stderr)
    return done.stdout


def quick_compiler() -> str:
    """What compiles soonest, for programs whose answers count and not their speed."""
    return shutil.which("clang++") or need_program("g++", "g++")


def need_header(header: str, package: str, *folders: str) -> None:
    """Skip the test, naming the apt package, where a C or C++ header is absent."""
    places = [f"/usr/include/{header}", *(f"{folder}/{header}" for folder in folders)]
    if not any(Path(place).exists() for place in places):
        missing_package(package, header)


@dataclass(frozen=True)
class Run:
    """What a command left: exit code, text, and JSON where stdout holds it."""

    code: int
    stdout: str
    stderr: str

    @property
    def json(self) -> Any:
        """Stdout as one JSON document, NaN and Infinity refused."""

        def refuse(constant: str) -> None:
            raise ValueError(f"JSON holds {constant}")

        return json.loads(self.stdout, parse_constant=refuse)

    @property
    def sound(self) -> Run:
        """Itself, where the command ended with exit code 0."""
        assert self.code == 0, self.stderr
        return self

    def fails(self, code: int, *says: str, error: str | None = None) -> Run:
        """Itself, where it ended with this exit code, its one line, and its error's code."""
        assert self.code == code, (self.stdout, self.stderr)
        assert [text for text in says if text not in self.error_line] == [], self.stderr
        assert error is None or self.json["error"]["code"] == error, self.stdout
        return self

    @property
    def error_line(self) -> str:
        """The one line on stderr of a failed command."""
        lines = [line for line in self.stderr.splitlines() if line.strip()]
        assert len(lines) == 1, self.stderr
        return lines[0]


class CommandServer:
    """Runs `vfplan` in forked copies of one process; see `support/command_server.py`."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            program = ROOT / "tests" / "support" / "command_server.py"
            self._process = subprocess.Popen(
                [sys.executable, "-P", program, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                cwd="/",
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            )
        self._link = ours
        self._link.settimeout(900)

    def run(self, words: list[str], cwd: Path | None) -> Run:
        """One command, in a process of its own."""
        with tempfile.TemporaryDirectory() as out:
            request = {"words": words, "cwd": str(cwd or Path.cwd()), "out": out}
            self._link.send(json.dumps(request).encode())
            code = int(self._link.recv(64))
            stdout, stderr = (Path(out, name).read_text() for name in ("stdout", "stderr"))
        return Run(code, stdout, stderr)

    def close(self) -> None:
        """End the process."""
        self._link.close()
        self._process.wait(60)


@pytest.fixture(scope="session")
def vfplan_cli():
    """Run the installed `vfplan` in a process of its own: `vfplan_cli("info", path, "--json")`.

    With an environment given, the process is begun anew, as by a shell.
    """
    server = CommandServer()

    def run(*args: Any, cwd: Path | None = None, env: dict[str, str] | None = None) -> Run:
        words = [str(word) for word in args]
        if env is None:
            return server.run(words, cwd)
        done = subprocess.run(
            [str(Path(sys.executable).with_name("vfplan")), *words],
            capture_output=True,
            text=True,
            cwd=cwd,
            env={**os.environ, **env},
            timeout=900,
            check=False,
        )
        return Run(done.returncode, done.stdout, done.stderr)

    yield run
    server.close()


@pytest.fixture(scope="session")
def nanoflann_peer(tmp_path_factory):
    """The shipped peer, built on apt's nanoflann."""
    need_header("nanoflann.hpp", "libnanoflann-dev")
    need_program("g++", "g++")
    from vfplan.bench.peers import build_nanoflann

    return build_nanoflann(tmp_path_factory.mktemp("peer"))
