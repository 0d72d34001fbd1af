"""`Session`: the state of a review. It needs no browser; the page shows it and sends it steps.

A session is immutable. `apply` returns a new one, and the old one stays what it was, so that undo
is the old session. All that a person does is a step: a small dict, such as
`{"do": "move_knot", "stroke": 0, "knot": 7, "to": [312.0, 205.5]}`. The list of steps is the draft:
applied to the same slice and markers, it gives the same session again, to the bit.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.errors import CheckFailed, SettingError, VfplanError
from vfplan.findings import Finding
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage
from vfplan.planning import register
from vfplan.review.geometry import Geometry, describe_way
from vfplan.review.markers import Fit
from vfplan.review.source import Source, open_source

MAX_STEPS = 20_000
"""Steps of a review at most: a person makes some hundreds."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The plan as it would be written now: a fixture with its findings, or why there is none."""

    fixture: Fixture | None
    findings: tuple[Finding, ...]
    why_not: str = ""
    code: str = ""


@dataclass(frozen=True, eq=False)
class State:
    """What the steps made of the source."""

    geometry: Geometry
    fit: Fit
    boxes: tuple[tuple[int, int, int, int], ...] = ()
    # A finding's key -> who accepted it, and when.
    answers: dict[str, tuple[str | None, str]] = field(default_factory=dict)
    # The plan of this state, once it is made; steps that do not touch the plan hand it on.
    made: dict[str, Outcome] = field(default_factory=dict)

    def changed(self, **changes: Any) -> State:
        """The state with another curve, or other markers; its plan is to be made anew."""
        return replace(self, made={}, **changes)


@dataclass(frozen=True, eq=False)
class Session:
    """A review in progress; see the module. Make one with `Session.open`."""

    source: Source
    steps: tuple[dict[str, Any], ...] = ()
    undone: tuple[dict[str, Any], ...] = ()
    _states: tuple[State, ...] = ()  # the source's own, then one a step

    @classmethod
    def open(
        cls,
        image: str | Path,
        markers: str | Path | None = None,
        markers2: str | Path | None = None,
        *,
        slice: str | Path | None = None,  # noqa: A002 - the option's name
        **settings: Any,
    ) -> Session:
        """Begin a review.

        Parameters
        ----------
        image
            A slice, a curve bundle or a fixture bundle.
        markers, markers2
            One file with both positions of each marker, or two joined by label.
        slice
            The slice that a bundle's curve was drawn on; its SHA-256 must be the bundle's.
        **settings
            Fields of `ExtractSettings` and `FixtureSettings`, such as `pixel_spacing_mm`.

        Raises
        ------
        ImageError, MarkerError, BundleError
            A file that cannot be used. A curve that cannot be extracted is no error: the state
            then names the refusal and what can be chosen.
        SettingError
            An unknown setting, or one outside its range.
        """
        source = open_source(image, markers, markers2, slice, settings)
        return cls(source, _states=(State(source.geometry, source.fit, source.boxes),))

    # Steps, and the way back.

    def apply(self, step: dict[str, Any]) -> Session:
        """The session after a step.

        Raises
        ------
        SettingError
            The step is not understood or does not fit the present state. Nothing has changed.
        """
        if len(self.steps) >= MAX_STEPS:
            raise SettingError(
                f"the review has {MAX_STEPS} steps, the most allowed; approve it or start anew",
                code="too-many-steps",
                numbers={"steps": MAX_STEPS},
            )
        from vfplan.review.steps import STEPS, named

        name = named(step)
        state = STEPS[name](self, step)
        kept = dict(step)
        if name == "answer":
            # The time belongs to the step: the draft shall give the same answer again.
            kept.setdefault("utc", next(reversed(state.answers.values()))[1])
        return replace(
            self,
            steps=(*self.steps, kept),
            # To look at the line takes nothing back, so what was undone can still be done again.
            undone=self.undone if name == "viewed" else (),
            _states=(*self._states, state),
        )

    def undo(self) -> Session:
        """The session before the last step; what was merely looked at since is undone with it."""
        if not self.steps:
            raise SettingError("there is no step to undo", code="nothing-to-undo")
        count = len(self.steps) - 1
        while count > 0 and self.steps[count]["do"] == "viewed":
            count -= 1
        return replace(
            self,
            steps=self.steps[:count],
            undone=(*self.steps[count:], *self.undone),
            _states=self._states[: count + 1],
        )

    def redo(self) -> Session:
        """The session with the step that was undone last."""
        if not self.undone:
            raise SettingError("there is no step to do again", code="nothing-to-redo")
        count = 1
        while count < len(self.undone) and self.undone[count]["do"] == "viewed":
            count += 1
        session = self
        for step in self.undone[:count]:
            session = session.apply(step)
        return replace(session, undone=self.undone[count:])

    def with_undone(self, steps: list[dict[str, Any]]) -> Session:
        """The session with steps that `redo` gives, as a draft holds them."""
        return replace(self, undone=tuple(steps))

    @property
    def current(self) -> State:
        """The state after the last step."""
        return self._states[-1]

    # What the state says.

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a person should look at, with the answers that were given."""
        return tuple(self._answered(finding) for finding in self.outcome.findings)

    @property
    def why_not(self) -> list[str]:
        """What stands against an approval, one sentence each; empty where nothing does."""
        state = self.current
        reasons = []
        if not state.geometry.strokes:
            reasons.append("There is no curve yet. Choose a candidate, or draw the curve.")
        elif self.outcome.why_not:
            reasons.append(self.outcome.why_not)
        for number, stroke in enumerate(state.geometry.strokes):
            if not stroke.seen.all():
                share = 1.0 - stroke.seen.mean()
                reasons.append(
                    f"{max(share, 0.01):.0%} of stroke {number + 1} was not in view yet at one "
                    "screen pixel a pixel or more."
                )
        open_doubts = sum(finding.is_open for finding in self.findings)
        if open_doubts == 1:
            reasons.append("One finding wants an answer.")
        elif open_doubts:
            reasons.append(f"{open_doubts} findings want an answer.")
        return reasons

    @property
    def approvable(self) -> bool:
        """Whether the plan may be approved as it stands."""
        return not self.why_not

    @property
    def outcome(self) -> Outcome:
        """The plan as it stands, made once a state."""
        made = self.current.made
        if "plan" not in made:
            made["plan"] = self._plan()
        return made["plan"]

    def state(self) -> dict[str, Any]:
        """All that the page shows, as JSON holds it."""
        refusal = self.current.geometry.refusal
        shown = self.quick_state()
        shown["findings"] = [finding.as_dict() for finding in self.findings]
        shown["warnings"] = [finding.text for finding in self.findings]
        if self.outcome.why_not and self.current.geometry.strokes:
            shown["refusal"] = {
                "code": self.outcome.code,
                "text": self.outcome.why_not,
                "place_px": None,
                "stage": "register",
            }
        elif refusal is not None:
            shown["refusal"] = {
                "code": refusal.code,
                "text": refusal.text,
                "place_px": refusal.place_px and list(refusal.place_px),
                "stage": "extract",
            }
        shown["why_not"] = self.why_not
        shown["approvable"] = not shown["why_not"]
        return shown

    def quick_state(self) -> dict[str, Any]:
        """`state` without what takes the whole plan: findings, and whether it is approvable."""
        geometry, fit = self.current.geometry, self.current.fit
        account = []
        for ink in geometry.account:
            u, v = ink.place
            account.append(
                {
                    "number": ink.number,
                    "u": u,
                    "v": v,
                    "pixels": ink.pixels,
                    "share": ink.share,
                    "box": list(ink.box),
                    "outline": ink.outline,
                    "left_out": ink.place in geometry.left,
                }
            )
        numbered = enumerate(geometry.candidates, 1)
        return {
            "image": self.source.describe(),
            "curve_px": [stroke.points.round(4).tolist() for stroke in geometry.strokes],
            "knots_px": [stroke.knots_px.round(4).tolist() for stroke in geometry.strokes],
            "closed": [stroke.closed for stroke in geometry.strokes],
            "sigma_px": [float(np.max(stroke.sigma)) for stroke in geometry.strokes],
            "edited": [_runs(stroke.edited) for stroke in geometry.strokes],
            "bridged": [_runs(stroke.bridged) for stroke in geometry.strokes],
            "unseen": [_runs(~stroke.seen) for stroke in geometry.strokes],
            "candidates": [describe_way(number, way) for number, way in numbered],
            "account": account,
            "boxes": [list(box) for box in self.current.boxes],
            "refusal": None,
            "steps": [_title(step) for step in self.steps if step["do"] != "viewed"],
            "can_undo": any(step["do"] != "viewed" for step in self.steps),
            "can_redo": bool(self.undone),
            "approved": None if self.steps else self.source.approved,
            **self.marker_state(fit),
        }

    def marker_state(self, fit: Fit | None = None) -> dict[str, Any]:
        """The markers, their residuals and the bound; also of markers that are being dragged."""
        fit = self.current.fit if fit is None else fit
        strokes = self.current.geometry.strokes
        points = np.vstack([stroke.points for stroke in strokes]) if strokes else np.zeros((0, 2))
        fitted = fit.registration
        bound_m = fit.tre95_m(points)
        margin_m = None
        if isinstance(fit.settings.margin, float):
            margin_m = fit.settings.margin
        elif fit.settings.margin == "tre95":
            margin_m = bound_m
        contact_m = fit.settings.contact_radius + fit.settings.point_radius
        return {
            "markers": fit.describe(),
            "mm_per_px": fit.mm_per_px,
            "fre_rms_m": None if fitted is None else _finite(fitted.fre_rms_m),
            "loo_rms_m": None if fitted is None else _finite(fitted.loo_rms_m),
            "tre95_m": bound_m,
            "margin_m": margin_m,
            "contact_m": contact_m,
            "markers_why_not": fit.why_not if fit.markers else "",
        }

    def approve(self, by: str) -> Fixture:
        """The fixture (or, without markers, the curve), approved by a person.

        Parameters
        ----------
        by
            The person's name. It also signs the answers that were given without one.

        Raises
        ------
        CheckFailed
            The plan is not approvable; the message is the first of `why_not`.
        SettingError
            The name is empty.
        """
        from vfplan.review.approval import approved

        if not str(by).strip():
            raise SettingError(
                "no name was given; an approval names the person who gives it", code="no-name"
            )
        reasons = self.why_not
        if reasons:
            raise CheckFailed(
                f"The plan cannot be approved. {' '.join(reasons)}",
                code="not-approvable",
                numbers={"reasons": len(reasons)},
            )
        findings = tuple(
            replace(finding, answered_by=by) if finding.answered_by == "" else finding
            for finding in self.findings
        )
        return approved(
            self.outcome.fixture,
            findings,
            str(by).strip(),
            self.steps_sha256,
            slice_shown=self.source.slice_path is not None,
        )

    @property
    def steps_sha256(self) -> str:
        """SHA-256 of the steps, as the draft holds them."""
        text = json.dumps(self.steps, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def _answered(self, finding: Finding) -> Finding:
        answer = self.current.answers.get(key_of(finding))
        if answer is None:
            return finding
        return replace(finding, answered_by=answer[0] or "", answered_utc=answer[1])

    # The plan as it would be written.

    def _plan(self) -> Outcome:
        state = self.current
        drawn = state.geometry.all_findings
        if not state.geometry.strokes:
            return Outcome(None, drawn)
        if self.source.fixture is not None and not self._is_changed():
            return Outcome(self.source.fixture, self.source.fixture_findings)
        curve = self.curve()
        if not state.fit.markers:
            return Outcome(curve, drawn)
        if state.fit.why_not:
            text = f"{state.fit.why_not[:1].upper()}{state.fit.why_not[1:]}."
            return Outcome(None, drawn, text, "markers")
        files = self.source.marker_files
        with state.fit.as_file() as table:
            if state.fit is not self.source.fit or not files:
                files = (table, None)
            try:
                planned = register(
                    curve, *files, state.fit.settings, image=self.source.image_of_markers
                )
            except VfplanError as error:
                return Outcome(None, drawn, _sentence(error.message), error.code)
        return Outcome(planned.fixture, (*drawn, *planned.findings))

    def _is_changed(self) -> bool:
        """Whether any step changed the curve or the markers of the source."""
        state, first = self.current, self._states[0]
        moved = state.fit is not first.fit
        before, after = first.geometry.strokes, state.geometry.strokes
        if len(before) != len(after):
            return True
        pairs = zip(before, after, strict=True)
        return moved or any(one.points is not other.points for one, other in pairs)

    def curve(self) -> Fixture:
        """The curve in the image's pixels, as `vfplan extract` would write it."""
        strokes = self.current.geometry.strokes
        points = np.vstack([stroke.points for stroke in strokes])
        counts = [len(stroke.points) for stroke in strokes]
        bridged = np.concatenate([stroke.bridged for stroke in strokes])
        edited = np.concatenate([stroke.edited for stroke in strokes])
        curve = Curve(
            stroke=np.repeat(np.arange(len(strokes), dtype=np.int32), counts),
            closed=np.array([stroke.closed for stroke in strokes]),
            bridged=bridged if bridged.any() else None,
            edited=edited if edited.any() else None,
        )
        image = self.source.image
        size = SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm)
        return Fixture(
            frame="image",
            points=np.c_[points, np.zeros(len(points))],
            provenance=Provenance.now(self.source.inputs, self.source.settings_in_force),
            sigma=np.concatenate([stroke.sigma for stroke in strokes]),
            curve=curve,
            image=size,
        )


def key_of(finding: Finding) -> str:
    """What an answer belongs to: a finding with other words or at another place is another one."""
    place = finding.place_px or finding.place_m or ()
    return json.dumps([finding.code, finding.stage, finding.text, [round(x, 3) for x in place]])


def _runs(flags: np.ndarray) -> list[list[int]]:
    """[first, last] of each run of flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flags, False].astype(int)))
    return [[int(start), int(stop) - 1] for start, stop in edges.reshape(-1, 2)]


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _sentence(text: str) -> str:
    """A message as a sentence of its own."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else f"{text}."


def _title(step: dict[str, Any]) -> str:
    """A step in the list of steps."""
    words = step["do"].replace("_", " ")
    for name in ("stroke", "knot", "candidate", "ink", "marker", "finding", "label"):
        if name in step:
            number = step[name]
            counted = name in ("stroke", "knot", "finding") and isinstance(number, int)
            words += f", {name} {number + 1 if counted else number}"
    return words
