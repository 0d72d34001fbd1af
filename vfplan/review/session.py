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
from vfplan.findings import Finding, doubt
from vfplan.fixture import Curve, Fixture, Provenance, SourceImage
from vfplan.planning.plan import register
from vfplan.review.geometry import Geometry, describe_candidate
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
    exclude: tuple[tuple[int, int, int, int], ...] = ()
    # A finding's key -> who accepted it, and when.
    answers: dict[str, tuple[str | None, str]] = field(default_factory=dict)
    # Holds the plan of this state once there is one; steps that do not change it hand it on.
    plan: dict[str, Outcome] = field(default_factory=dict)

    def changed(self, **changes: Any) -> State:
        """The state with another curve, or other markers; it has no plan yet."""
        return replace(self, plan={}, **changes)


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
        curve: str | Path | None = None,
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
        curve
            A curve that was drawn on the slice as vectors; the pen is then not looked for.
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
        source = open_source(image, markers, markers2, slice, curve, settings)
        return cls(source, _states=(State(source.geometry, source.fit, source.exclude),))

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
                f"The review has {MAX_STEPS} steps and takes no more. Approve it or start anew.",
                code="too-many-steps",
                numbers={"steps": MAX_STEPS},
            )
        from vfplan.review.steps import STEPS, named

        name = named(step)
        state = STEPS[name](self, step)
        kept = dict(step)
        if name == "answer":
            # The time belongs to the step, so that a draft gives the same answer again. The newest
            # answer is the last of the dictionary.
            kept.setdefault("utc", next(reversed(state.answers.values()))[1])
        undone: tuple[dict[str, Any], ...] = ()
        if name == "viewed":
            # A look takes nothing back, so what was undone can still be done again.
            undone = self.undone
        return replace(
            self, steps=(*self.steps, kept), undone=undone, _states=(*self._states, state)
        )

    def undo(self) -> Session:
        """The session before the last step; what was merely looked at since is undone with it."""
        if not self.steps:
            raise SettingError(
                "There is no step to undo. Take a step first.", code="nothing-to-undo"
            )
        # Go back to the last step that is more than a look.
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
            raise SettingError(
                "There is no step to do again. Undo one first.", code="nothing-to-redo"
            )
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
        findings = []
        for finding in self.outcome.findings:
            if key_of(finding) in self.current.answers:
                by, at = self.current.answers[key_of(finding)]
                finding = replace(finding, answered_by=by or "", answered_utc=at)
            findings.append(finding)
        return tuple(findings)

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
            if not stroke.viewed.all():
                share = 1.0 - stroke.viewed.mean()
                reasons.append(
                    f"{max(share, 0.01):.0%} of stroke {number + 1} was not in view yet at full "
                    "size. Look along it."
                )
        unanswered = sum(finding.is_open for finding in self.findings)
        if unanswered == 1:
            reasons.append("One finding wants an answer.")
        elif unanswered:
            reasons.append(f"{unanswered} findings want an answer.")
        return reasons

    @property
    def approvable(self) -> bool:
        """Whether the plan may be approved as it stands."""
        return not self.why_not

    @property
    def outcome(self) -> Outcome:
        """The plan as it stands, made once a state."""
        plan = self.current.plan
        if "outcome" not in plan:
            outcome = self._plan()
            # Whether this review shows the slice; an earlier one may have.
            findings = [
                finding for finding in outcome.findings if finding.code != "slice-not-shown"
            ]
            if self.source.is_slice_missing:
                text = (
                    "The slice is not shown, so neither the line's ends nor other ink can be seen. "
                    "Open the bundle with its slice: --slice IMAGE."
                )
                findings.append(doubt("slice-not-shown", "extract", text))
            plan["outcome"] = replace(outcome, findings=tuple(findings))
        return plan["outcome"]

    def state(self) -> dict[str, Any]:
        """All that the page shows, as JSON holds it."""
        state = self.quick_state()
        state["findings"] = [finding.as_dict() for finding in self.findings]
        state["warnings"] = [finding.text for finding in self.findings]
        refusal = self.current.geometry.refusal
        if self.outcome.why_not and self.current.geometry.strokes:
            state["refusal"] = {
                "code": self.outcome.code,
                "text": self.outcome.why_not,
                "place_px": None,
                "stage": "register",
            }
        elif refusal is not None:
            state["refusal"] = {
                "code": refusal.code,
                "text": refusal.text,
                "place_px": refusal.place_px,
                "stage": "extract",
                "other_pen": refusal.other_pen,
            }
        state["why_not"] = self.why_not
        state["approvable"] = not state["why_not"]
        return state

    def quick_state(self) -> dict[str, Any]:
        """`state` without what takes the whole plan: findings, and whether it is approvable."""
        geometry = self.current.geometry
        state: dict[str, Any] = {
            "image": self.source.describe(),
            "curve_px": [],
            "knots_px": [],
            "closed": [],
            "sigma_px": [],
            "edited": [],
            "bridged": [],
            "unseen": [],
            "candidates": [],
            "account": [],
            "boxes": [list(box) for box in self.current.exclude],
            "refusal": None,
            "steps": [_title(step) for step in self.steps if step["do"] != "viewed"],
            "can_redo": bool(self.undone),
            "approved": None,
        }
        for stroke in geometry.strokes:
            state["curve_px"].append(stroke.points.round(4).tolist())
            state["knots_px"].append(stroke.knots_px.round(4).tolist())
            state["closed"].append(stroke.closed)
            state["sigma_px"].append(float(np.max(stroke.sigma)))
            state["edited"].append(_runs(stroke.edited))
            state["bridged"].append(_runs(stroke.bridged))
            state["unseen"].append(_runs(~stroke.viewed))
        for number, route in enumerate(geometry.candidates, 1):
            state["candidates"].append(describe_candidate(number, route))
        for entry in geometry.account:
            row = {
                "number": entry.number,
                "u": entry.middle[0],
                "v": entry.middle[1],
                "pixels": entry.pixels,
                "share": entry.share,
                "is_ink": entry.is_ink,
                "box": list(entry.box),
                "outline": entry.outline,
                "left_out": entry.middle in geometry.excluded_ink,
            }
            state["account"].append(row)
        state["can_undo"] = bool(state["steps"])
        if not self.steps:
            state["approved"] = self.source.approved
        return state | self.marker_state()

    def marker_state(self, fit: Fit | None = None) -> dict[str, Any]:
        """The markers, their residuals and the bound; also of markers that are being dragged."""
        if fit is None:
            fit = self.current.fit
        points = np.zeros((0, 2))
        if self.current.geometry.strokes:
            points = np.vstack([stroke.points for stroke in self.current.geometry.strokes])
        bound_m = fit.tre95_m(points)
        fre_rms_m = loo_rms_m = None
        if fit.registration is not None:
            fre_rms_m = _finite(fit.registration.fre_rms_m)
            loo_rms_m = _finite(fit.registration.loo_rms_m)
        why_not = fit.why_not if fit.markers else ""
        margin_m = None
        if isinstance(fit.settings.margin, float):
            margin_m = fit.settings.margin
        elif fit.settings.margin == "tre95":
            margin_m = bound_m
        contact_m = fit.settings.contact_radius + fit.settings.point_radius
        return {
            "markers": fit.describe(),
            "mm_per_px": fit.mm_per_px,
            "fre_rms_m": fre_rms_m,
            "loo_rms_m": loo_rms_m,
            "tre95_m": bound_m,
            "margin_m": margin_m,
            "contact_m": contact_m,
            "markers_why_not": why_not,
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
        from vfplan.review.acceptance import approved

        if not str(by).strip():
            raise SettingError(
                "No name was given. An approval names the person who gives it.", code="no-name"
            )
        reasons = self.why_not
        if reasons:
            raise CheckFailed(
                f"The plan cannot be approved. {' '.join(reasons)}",
                code="not-approvable",
                numbers={"reasons": len(reasons)},
            )
        by = str(by).strip()
        findings = []
        for finding in self.findings:
            if finding.answered_by == "":
                finding = replace(finding, answered_by=by)
            findings.append(finding)
        return approved(
            self.outcome.fixture,
            tuple(findings),
            by,
            self.steps_sha256,
            slice_shown=self.source.slice_path is not None,
        )

    @property
    def steps_sha256(self) -> str:
        """SHA-256 of the steps, as the draft holds them."""
        text = json.dumps(self.steps, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    # The plan as it would be written.

    def _plan(self) -> Outcome:
        state = self.current
        of_curve = state.geometry.all_findings
        if not state.geometry.strokes:
            return Outcome(None, of_curve)
        # What no step changed is approved as it is in the bundle.
        first = self._states[0]
        before, after = first.geometry.strokes, state.geometry.strokes
        is_changed = state.fit is not first.fit or len(before) != len(after)
        for stroke, other in zip(before, after, strict=False):
            if stroke.points is not other.points:
                is_changed = True
        if self.source.fixture is not None and not is_changed:
            return Outcome(self.source.fixture, self.source.fixture.findings)
        curve = self.curve()
        if not state.fit.markers:
            return Outcome(curve, of_curve)
        if state.fit.why_not:
            return Outcome(None, of_curve, _sentence(state.fit.why_not), "markers")
        with state.fit.as_files() as files:
            # The files themselves, as long as nobody changed a marker.
            if state.fit is self.source.fit and self.source.marker_files:
                files = self.source.marker_files
            try:
                planned = register(
                    curve, *files, state.fit.settings, image=self.source.image_of_markers
                )
            except VfplanError as error:
                # The page has no options; what is wrong with the markers is mended on it.
                message = error.message.replace(", or give --markers-as-given", "")
                return Outcome(None, of_curve, _sentence(message), error.code)
        return Outcome(planned.fixture, (*of_curve, *planned.findings))

    def curve(self) -> Fixture:
        """The curve in the image's pixels, as `vfplan extract` would write it."""
        strokes = self.current.geometry.strokes
        points = np.vstack([stroke.points for stroke in strokes])
        sigma = np.concatenate([stroke.sigma for stroke in strokes])
        if not sigma.any():
            # A curve that was drawn as vectors has no deviation.
            sigma = None
        settings = self.source.settings_in_force
        if self.current.exclude:
            settings["exclude"] = self.current.exclude
        ink = self.current.geometry.ink
        if ink is not None and ink.colour != self.source.extraction.colour:
            settings["colour"] = ink.colour
        image = self.source.image
        size = SourceImage(image.width_px, image.height_px, image.pixel_spacing_mm)
        return Fixture(
            frame="image",
            points=np.c_[points, np.zeros(len(points))],
            provenance=Provenance.now(self.source.inputs, settings),
            sigma=sigma,
            curve=Curve.of(strokes),
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
    return None if value is None or not math.isfinite(value) else float(value)


def _sentence(text: str) -> str:
    """A message as a sentence."""
    text = text[:1].upper() + text[1:]
    if not text.endswith("."):
        text += "."
    return text


def _title(step: dict[str, Any]) -> str:
    """A step in the list of steps."""
    words = step["do"].replace("_", " ")
    for name in ("stroke", "knot", "candidate", "ink", "marker", "finding", "label", "colour"):
        if name not in step:
            continue
        number = step[name]
        # The page counts these from 1.
        if name in ("stroke", "knot", "finding") and isinstance(number, int):
            number += 1
        words += f", {name} {number}"
    return words
