"""replay(fixture, session): every tick through the engine, every number from the ticks."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vfplan.errors import SessionError, SettingError
from vfplan.fixture import Fixture
from vfplan.rendering import ProxyParameters
from vfplan.replay.engines import RULES
from vfplan.replay.findings import findings
from vfplan.replay.run import RuleRun
from vfplan.replay.watch import SessionWatch
from vfplan.session import Source, TickBlock, open_session

Sink = Callable[[str, TickBlock], None]


@dataclass(frozen=True, eq=False)
class Replay:
    """What a replay found.

    Parameters
    ----------
    rule, engine
        What ran: "robust" or "paper"; "native" or "reference".
    ticks
        One row a tick; every `stride`-th stretch's deepest tick where a bound was set.
    metrics
        The report: the contract's keys and more, defined in docs/replay.md.
    fixture
        What was replayed against.
    stride
        Ticks of the session each row of `ticks` stands for.
    other
        With rule "both": the run of the paper's rule; this one is then the robust one.
    """

    rule: str
    engine: str
    ticks: TickBlock
    metrics: dict[str, Any]
    fixture: Fixture
    stride: int = 1
    other: Replay | None = field(default=None, repr=False)

    @property
    def record(self) -> dict[str, Any]:
        """What a result file keeps beside the ticks."""
        return result_record(self.metrics)


def result_record(metrics: dict[str, Any]) -> dict[str, Any]:
    """The part of a report that belongs in a result file: what was replayed, how, on what."""
    names = ("rule", "engine", "scene", "session", "fixture", "settings")
    return {name: metrics[name] for name in names if name in metrics}


def replay(
    fixture: Fixture | str | Path,
    session: Source | str | Path,
    *,
    rule: str = "robust",
    engine: str = "native",
    keep: int | None = None,
    sinks: Sequence[Sink] = (),
) -> Replay:
    """Replay a session against a fixture.

    Parameters
    ----------
    fixture
        A registered fixture, or the path of a bundle.
    session
        A `Session`, a `SessionStream`, or the path of a session file.
    rule
        "robust", "paper", or "both": side by side.
    engine
        "native", or "reference": the paper's algorithms in NumPy (rule "paper" only).
    keep
        At most this many ticks in the result's `ticks`; `None`: all of them.
    sinks
        Called with (rule, block of ticks) as the replay goes.

    Raises
    ------
    SessionError
        A session that cannot be read, or one in another frame than the fixture.
    InputError, SettingError, BundleError
        A fixture that cannot be replayed, an unknown rule or engine, a bad bundle.
    """
    fixture, record = _loaded(fixture)
    source = open_session(session) if isinstance(session, (str, Path)) else session
    _same_frame(fixture, source)
    rules = _rules(rule)
    runs = [RuleRun(fixture, name, engine, keep) for name in rules]
    watch = SessionWatch()
    for time, hip in source.blocks():
        watch.update(time, hip)
        for run in runs:
            block = run.feed(time, hip)
            for sink in sinks:
                sink(run.rule, block)
    return _results(fixture, record | _seen(source, watch), runs, engine, watch)


def _loaded(fixture: Fixture | str | Path) -> tuple[Fixture, dict[str, Any]]:
    """The fixture and what is known of its file."""
    if isinstance(fixture, Fixture):
        return fixture, {}
    from vfplan.bundle import read_fixture

    loaded = read_fixture(fixture)
    digest = hashlib.sha256(Path(fixture).read_bytes()).hexdigest()
    return loaded, {"fixture": {"sha256": digest}}


def _same_frame(fixture: Fixture, source: Source) -> None:
    if source.frame != fixture.frame:
        raise SessionError(
            f"positions in frame {source.frame!r}, the fixture in {fixture.frame!r}; "
            "they must be the same",
            where=source.name,
        )


def _rules(rule: str) -> tuple[str, ...]:
    if rule not in RULES:
        raise SettingError(f"rule {rule!r}; {', '.join(RULES)} wanted")
    return ("robust", "paper") if rule == "both" else (rule,)


def _seen(source: Source, watch: SessionWatch) -> dict[str, Any]:
    session = {"name": source.name, "frame": source.frame, **source.notes, **watch.report()}
    if source.sha256 is not None:
        session["sha256"] = source.sha256
    return {"session": session}


def _scene(fixture: Fixture, parameters: ProxyParameters) -> dict[str, Any]:
    return {
        "planar": fixture.ignore_axis is not None,
        "points": len(fixture.points),
        "contact_radius_m": parameters.contact_radius,
        "band_m": parameters.band,
        "point_radius_m": parameters.point_radius,
        "stiffness_n_per_m": parameters.stiffness.tolist(),
        "frame": fixture.frame,
    }


def _results(
    fixture: Fixture,
    record: dict[str, Any],
    runs: list[RuleRun],
    engine: str,
    watch: SessionWatch,
) -> Replay:
    done: Replay | None = None
    for run in reversed(runs):  # the first rule is the one that is reported, the second its other
        found = run.finish()
        metrics = {
            "rule": run.rule,
            "engine": engine,
            **found,
            "scene": _scene(fixture, run.engine.parameters),
            "left_out": dict(run.engine.left_out),
            **record,
            "findings": watch.findings() + findings(found, run.engine.parameters),
        }
        done = Replay(
            run.rule, engine, run.overview.ticks, metrics, fixture, run.overview.stride, done
        )
    assert done is not None
    return done
