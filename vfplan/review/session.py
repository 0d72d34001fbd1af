"""`Session`: the state of a review. It needs no browser; the page shows it and sends it steps.

A session is immutable. `apply` returns a new one, and the old one stays what it was, so that undo
is the old session. All that a person does is a step: a small dict, such as
`{"do": "move_knot", "stroke": 0, "knot": 7, "to": [312.0, 205.5]}`. The list of steps is the draft:
applied to the same slice and markers, it gives the same session again, to the bit.

A look at the line, `{"do": "viewed"}`, is no step: it belongs to who looked and to this session.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vfplan.bundle import review_digest
from vfplan.display import Report
from vfplan.errors import CheckFailed, SettingError, VfplanError
from vfplan.fixture import Fixture, Review
from vfplan.geometry.lines import runs
from vfplan.io.files import FilePath, now_utc
from vfplan.review import steps as steps_of_a_plan
from vfplan.review.geometry import describe_candidates
from vfplan.review.plan import Plan, Source, open_source
from vfplan.review.rendered import described, digest_of, rendered_in_json, visible_name
from vfplan.review.steps import Step

# No places.
NOTHING = np.zeros(0, complex)

SHOWN_OF_STEP = {"do", "stroke", "knot", "candidate", "ink", "marker", "finding", "label", "colour"}


@dataclass(frozen=True, eq=False)
class Session:
    """A review in progress; see the module. Make one with `Session.open`."""

    source: Source
    steps: tuple[Step, ...] = ()
    undone: tuple[Step, ...] = ()
    _plans: tuple[Plan, ...] = ()  # the source's own, then one a step
    # Who looked -> the points of the line that were in view at full size, as u + iv [px]. What was
    # looked at without a name ("") counts for everybody.
    seen: dict[Any, np.ndarray] = field(default_factory=dict)

    @classmethod
    def open(
        cls,
        image: FilePath,
        markers: FilePath | None = None,
        markers2: FilePath | None = None,
        *,
        slice: FilePath | None = None,  # noqa: A002 - the option's name
        curve: FilePath | None = None,
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
        return cls(source, _plans=(Plan(source, source.geometry, source.fit),))

    # Steps, and the way back.

    def apply(self, step: Step) -> Session:
        """The session after a step, or after a look, which the field `by` gives to a person.

        Raises
        ------
        SettingError
            The step is not understood or does not fit the present state. Nothing has changed.
        """
        name = step.get("do") if isinstance(step, dict) else None
        if name == "viewed":
            return self.looked_at(step, visible_name(str(step["by"])) if "by" in step else "")
        if name == "answer":
            # The time belongs to the step, so that a draft gives the same answer again.
            step = {"utc": now_utc(), **step}
        plan = steps_of_a_plan.apply(self.current, step)
        steps, plans = self.steps, self._plans
        if steps and name == steps[-1]["do"] == "choose_slice":
            # Of slices that are turned one after the other, the last is the one that is chosen.
            steps, plans = steps[:-1], plans[:-1]
        return replace(self, steps=(*steps, dict(step)), undone=(), _plans=(*plans, plan))

    def looked_at(self, step: Step, who: Any) -> Session:
        """The session after somebody had a part of a stroke in view at full size."""
        return self.with_seen(who, as_complex(steps_of_a_plan.points_in_view(self.current, step)))

    def with_seen(self, who: Any, places: np.ndarray) -> Session:
        """The session with further places seen by somebody."""
        seen = np.union1d(self.seen.get(who, NOTHING), places)
        return replace(self, seen=self.seen | {who: seen})

    def undo(self) -> Session:
        """The session before the last step; the slice that was chosen first stays."""
        if not self.steps_on_slice:
            raise SettingError("There is no step to undo. Take one first.", code="nothing-to-undo")
        undone = (self.steps[-1], *self.undone)
        return replace(self, steps=self.steps[:-1], undone=undone, _plans=self._plans[:-1])

    def redo(self) -> Session:
        """The session with the step that was undone last."""
        if not self.undone:
            raise SettingError("No step was undone. Undo one first.", code="nothing-to-redo")
        return replace(self.apply(self.undone[0]), undone=self.undone[1:])

    def anew(self) -> Session:
        """The session without its steps."""
        return replace(self, steps=(), undone=(), _plans=self._plans[:1])

    @property
    def steps_on_slice(self) -> tuple[Step, ...]:
        """The steps without the choice of the slice that they began with."""
        is_chosen = len(self.steps) > 0 and self.steps[0]["do"] == "choose_slice"
        return self.steps[is_chosen:]

    @property
    def current(self) -> Plan:
        """The plan after the last step."""
        return self._plans[-1]

    # What the page shows.

    def state(self, by: Any = "") -> Report:
        """All that the page shows to a person, as JSON holds it."""
        plan = self.current
        state = self.quick_state(by)
        state["refusal"] = plan.geometry.refusal
        if plan.outcome.why_not and plan.geometry.strokes:
            state["refusal"] = {"code": plan.outcome.code, "text": plan.outcome.why_not,
                                "place_px": None, "stage": "register"}  # fmt: skip
        why_not = self.why_not(by)
        state |= {"rendered": None, "described": [], "outline_px": [], "bound_px": []}
        if plan.fixture is not None:
            if plan.bound95_m is not None:
                state["tre95_m"] = plan.bound95_m
            state["rendered"] = rendered_in_json(plan.fixture)
            state["described"] = described(plan.fixture)
            lines = [line for outline in plan.outlines for line in outline.lines]
            state["outline_px"] = [line.round(2).tolist() for line in lines]
            state["bound_px"] = [
                (bound_m / plan.metres_per_px).round(3).tolist() for _, bound_m in plan.bounds
            ]
        return state | {
            "at_angle": plan.is_to_be_flat,
            "findings": [finding.as_dict() for finding in plan.findings],
            "why_not": why_not, "approvable": not why_not, "digest": self.digest,
        }  # fmt: skip

    def bodies(self) -> Report:
        """What renders the plan as it stands, for the page's own engine; else why nothing does."""
        if self.current.fixture is None:
            return {"why_not": self.current.why_not[0]}
        try:
            return {"digest": self.digest, **self.current.bodies()}
        except VfplanError as error:
            return {"why_not": error.message}

    def quick_state(self, by: Any = "") -> Report:
        """`state` without what takes the whole plan: findings, and whether it is approvable."""
        plan, geometry, strokes = self.current, self.current.geometry, self.current.geometry.strokes
        steps = self.steps_on_slice
        account = [
            {key: getattr(entry, key) for key in ("number", "u", "v", "size_px", "pixels", "what")}
            | {
                "outline": [] if entry.piece is None else entry.piece.outline,
                "left_out": entry.middle in geometry.excluded_ink,
            }
            for entry in geometry.account
        ]
        state = {
            "image": plan.source.describe(),
            "curve_px": [stroke.points.round(4).tolist() for stroke in strokes],
            "knots_px": [stroke.points[stroke.is_knot].round(4).tolist() for stroke in strokes],
            "closed": [stroke.closed for stroke in strokes],
            "edited": [first_and_last(stroke.edited) for stroke in strokes],
            "bridged": [first_and_last(stroke.bridged) for stroke in strokes],
            "unseen": [first_and_last(flags) for flags in self.unseen(by)],
            "candidates": describe_candidates(geometry),
            "account": account, "boxes": [list(box) for box in plan.exclude], "refusal": None,
            "steps": [{name: step[name] for name in SHOWN_OF_STEP & step.keys()} for step in steps],
            "can_undo": bool(steps), "can_redo": bool(self.undone),
            "approved": None,
        }  # fmt: skip
        fixture = self.source.as_opened
        if not self.steps and fixture is not None and fixture.reviewed is not None:
            state["approved"] = asdict(fixture.reviewed)
        return state | marker_state(plan)

    def approve(self, by: str) -> Fixture:
        """The fixture (or, without markers, the curve), approved by a person.

        Parameters
        ----------
        by
            The person's name. It also signs the answers that were given without one.

        Raises
        ------
        CheckFailed
            The plan is not approvable; the message says what `why_not` says.
        SettingError
            The name is empty, or cannot be read as it is.
        """
        by = visible_name(str(by))
        reasons = self.why_not(by)
        if reasons:
            text = f"The plan cannot be approved. {' '.join(reasons)}"
            raise CheckFailed(text, code="not-approvable")
        return self.with_review(by)

    def with_review(self, by: str = "") -> Fixture:
        """The fixture as it would be approved by a person, whether or not that is allowed yet."""
        findings = tuple(
            replace(finding, answered_by=by) if finding.answered_by == "" else finding
            for finding in self.current.findings
        )
        fixture = self.current.fixture
        # Of the steps, as the draft holds them.
        text = json.dumps(self.steps, sort_keys=True, separators=(",", ":"))
        sha256 = hashlib.sha256(text.encode()).hexdigest()
        opened = self.source.as_opened
        fixture = replace(
            fixture.with_settings({"review_steps_sha256": sha256}), findings=findings,
            reviewed=None, case=opened and opened.case,
        )  # fmt: skip
        return replace(fixture, reviewed=Review(by, now_utc(), review_digest(fixture)))

    @property
    def digest(self) -> str | None:
        """The digest of the plan as it stands, which an approval names; `None` without a plan."""
        if self.current.fixture is None:
            return None
        return digest_of(self.with_review(), slice_shown=self.current.image is not None)

    def unseen(self, by: Any = "") -> list[np.ndarray]:
        """For each stroke whether its points, (M,) bool, were never in view for a person."""
        seen = np.r_[self.seen.get(by, NOTHING), self.seen.get("", NOTHING)]
        return [~np.isin(as_complex(line.points), seen) for line in self.current.geometry.strokes]

    def why_not(self, by: Any = "") -> list[str]:
        """What stands against an approval by a person, one sentence each."""
        return self.current.why_not + [
            f"{100 * max(flags.mean(), 0.01):.0f} % of stroke {number} was not in view yet at full "
            "size. Look along it."
            for number, flags in enumerate(self.unseen(by), 1)
            if flags.any()
        ]


@lru_cache(maxsize=8)
def marker_state(plan: Plan) -> Report:
    """The markers, their residuals and the bound; also of markers that are being dragged."""
    fit, registration = plan.fit, plan.fit.registration
    return {
        "markers": fit.rows,
        "mm_per_px": fit.mm_per_px,
        "fre_rms_m": registration and registration.fre_rms_m,
        "markers_why_not": fit.why_not if fit.markers else "",
        "plan": {
            key: getattr(fit.settings, key)
            for key in ("model", "contact_radius", "guide_m", "guide_stroke", "seen_from", "arcs_m")
        }
        | {"pixel_spacing_mm": fit.pixel_spacing_mm},
        "tre95_m": fit.tre95_m(plan.geometry.strokes),
    }


def as_complex(points: np.ndarray) -> np.ndarray:
    """(M,) u + iv of points (M, 2)."""
    return points[:, 0] + 1j * points[:, 1]


def first_and_last(flags: np.ndarray) -> list[list[int]]:
    """[first, last] of each run of flags."""
    return [run[[0, -1]].tolist() for run in runs(flags, False)]
