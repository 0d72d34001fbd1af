"""The steps of a review, each a function from a plan and the step's fields to the next plan.

Strokes, knots and findings count from 0, as in the lists of the plan. Candidates have the names,
and ink the numbers, that the state gives them, from 1. Places are (u, v) in pixels.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.bundle.content import max_number
from vfplan.errors import CurveError, SettingError, VfplanError
from vfplan.geometry.lines import arc_lengths
from vfplan.markers import find_marks
from vfplan.planning.extraction import MIN_SPACING_MM
from vfplan.registration.models import MODELS
from vfplan.review.geometry import Geometry, candidate_at, route_over, with_chosen, with_route
from vfplan.review.markers import Marker
from vfplan.review.plan import Plan, made_flat_plan
from vfplan.review.rendered import visible_name
from vfplan.review.strokes import MendedStroke, SliceInk, measured, path_through

Step = dict[str, Any]

# How far a click may be from the mark that is meant [px]: a screen shows large slices small.
MAX_SNAP_PX = 60
# Points of a drawn line at most; a hand clicks some tens.
MAX_CLICKS = 500

# Characters of a label at most, as a bundle holds them.
MAX_LABEL = 64


# The fields of a step.


def malformed(step: Step, name: str, wanted: str) -> SettingError:
    """The error that says of a field of a step what is wanted there instead."""
    value = json.dumps(step.get(name), default=str)[:60]
    return SettingError(
        f"In step {step['do']}, {name} is {value}. Give {wanted}.", code="step-malformed"
    )


def whole_number(step: Step, name: str, default: int | None = None) -> int:
    """The whole number in a field of a step."""
    value = step.get(name, default)
    if type(value) is not int:
        raise malformed(step, name, "a whole number")
    return value


def flag_of(step: Step, name: str, default: bool = False) -> bool:
    """True or false in a field of a step."""
    value = step.get(name, default)
    if not isinstance(value, bool):
        raise malformed(step, name, "true or false")
    return value


def is_number(value: Any) -> bool:
    """Whether a value of a step is a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def number_within(step: Step, name: str, default: float, largest: float) -> float:
    """The number in a field of a step, from 0 to the largest that is allowed."""
    value = step.get(name, default)
    if not is_number(value) or not 0 <= value <= largest:
        raise malformed(step, name, f"a number from 0 to {largest}")
    return float(value)


def numbers_of(step: Step, name: str, count: int) -> tuple[float, ...]:
    """The list of `count` finite numbers in a field of a step."""
    value = step.get(name)
    is_list = isinstance(value, (list, tuple)) and len(value) == count
    if not is_list or not all(is_number(number) and abs(number) <= 1e9 for number in value):
        raise malformed(step, name, f"a list of finite numbers, {count} in all")
    return tuple(float(number) for number in value)


def place_of(plan: Plan, step: Step, name: str) -> np.ndarray:
    """The place on the slice in a field of a step; up to half a pixel beyond the slice's border."""
    image, place = plan.source.image, np.array(numbers_of(step, name, 2))
    if (place < -0.5).any() or (place > far_corner(plan)).any():
        raise SettingError(
            f"({place[0]:z.1f}, {place[1]:z.1f}) lies outside the slice. Choose a place on its "
            f"{image.width_px} x {image.height_px} px.",
            code="outside-slice",
        )
    return place


def far_corner(plan: Plan) -> np.ndarray:
    """The lower right corner of the slice, half a pixel beyond its last one."""
    return np.array([plan.source.image.width_px, plan.source.image.height_px]) - 0.5


def label_of(step: Step, name: str) -> str:
    """The label in a field of a step, of printable characters."""
    value = step.get(name)
    is_label = isinstance(value, str) and value.strip() and value.isprintable()
    if not is_label or len(value) > MAX_LABEL:
        raise malformed(step, name, f"a label of at most {MAX_LABEL} printable characters")
    return value.strip()


def stroke_of(plan: Plan, step: Step) -> tuple[int, MendedStroke]:
    """The number of the stroke that a step names, and the stroke."""
    number = whole_number(step, "stroke", 0)
    return number, plan.geometry.stroke(number)


def knot_of(stroke: MendedStroke, step: Step) -> int:
    """The number of the knot that a step names."""
    knot = whole_number(step, "knot")
    if not 0 <= knot < len(stroke.knots):
        text = f"There is no knot {knot}. The stroke has {len(stroke.knots)}, from 0."
        raise SettingError(text, code="no-such-knot")
    return knot


@contextmanager
def as_step_refused(what: str) -> Iterator[None]:
    """Refuse the step where the block raises an error, and say what that means."""
    try:
        yield
    except VfplanError as error:
        text = f"{what}: {error.message.removesuffix('.')}."
        raise SettingError(text, code=error.code) from None


def require_slice(plan: Plan) -> None:
    """Raise `SettingError` where the slice is not at hand."""
    if plan.source.slice_path is None:
        text = "This step needs the slice. Open the bundle with it: --slice IMAGE."
        raise SettingError(text, code="no-slice")


def required_ink(plan: Plan) -> SliceInk:
    """The ink of the pen; raises `SettingError` where there is none."""
    require_slice(plan)
    if plan.geometry.ink is None:
        raise SettingError(
            "This step needs a pen's ink, and the curve was drawn as vectors. Draw the stretch by "
            "clicks, or open the slice without --curve.",
            code="no-ink",
        )
    return plan.geometry.ink


# The curve.


def with_stroke(plan: Plan, number: int, stroke: MendedStroke) -> Plan:
    """The plan with a stroke in the place of another."""
    return replace(plan, geometry=plan.geometry.with_stroke(number, stroke))


def with_strokes(plan: Plan, strokes: tuple[MendedStroke, ...]) -> Plan:
    """The plan with another curve."""
    return replace(plan, geometry=plan.geometry.with_strokes(strokes))


def move_knot(plan: Plan, step: Step) -> Plan:
    """Move a knot; its stretch is measured again where there is ink."""
    number, stroke = stroke_of(plan, step)
    moved = stroke.move_knot(knot_of(stroke, step), place_of(plan, step, "to"), plan.geometry.ink)
    return with_stroke(plan, number, moved)


def insert_knot(plan: Plan, step: Step) -> Plan:
    """A further knot on the curve, nearest to a place."""
    number, stroke = stroke_of(plan, step)
    return with_stroke(plan, number, stroke.insert_knot(place_of(plan, step, "at")))


def delete_knot(plan: Plan, step: Step) -> Plan:
    """Draw the stretch around a knot without it; without an end's knot, cut back to the next."""
    number, stroke = stroke_of(plan, step)
    return with_stroke(plan, number, stroke.delete_knot(knot_of(stroke, step), plan.geometry.ink))


def draw(plan: Plan, step: Step) -> Plan:
    """Draw a stretch, or a whole curve, by clicks or in one go.

    A line that begins or ends on the curve, or runs along it, takes the place of that stretch. Of
    any other the step says whether it takes the place of all, `"replace": true`, or becomes a
    further stroke, `"add": true`.
    """
    closed, adds, replaces = (flag_of(step, name) for name in ("closed", "add", "replace"))
    if adds and replaces:
        raise malformed(step, "replace", "add or replace, not both")
    clicks = clicks_of(plan, step, closed)
    geometry = plan.geometry
    path = np.clip(path_through(np.array(clicks), closed), -0.5, far_corner(plan))
    if adds or replaces or not geometry.strokes:
        stroke = MendedStroke.of(measured(path, closed, geometry.ink, (True, True)))
        kept = geometry.strokes if adds else ()
        return with_strokes(plan, (*kept, stroke))
    number = stroke_met(geometry, path)
    if closed:
        stroke = MendedStroke.of(measured(path, True, geometry.ink, (True, True)))
    else:
        stroke = geometry.strokes[number].redraw(path, geometry.ink)
    return with_stroke(plan, number, stroke)


def clicks_of(plan: Plan, step: Step, closed: bool) -> list[np.ndarray]:
    """The places of a drawn line, of which neighbours are a pixel or more apart."""
    points = step.get("points")
    if not isinstance(points, (list, tuple)) or not 2 <= len(points) <= MAX_CLICKS:
        raise malformed(step, "points", f"a list of 2 to {MAX_CLICKS} places")
    clicks = []
    for point in points:
        place = place_of(plan, {"do": "draw", "points": point}, "points")
        if not clicks or np.hypot(*(place - clicks[-1])) >= 1.0:
            clicks.append(place)
    if closed and len(clicks) > 1 and np.hypot(*(clicks[0] - clicks[-1])) < 1.0:
        clicks.pop()
    if len(clicks) < 2 + closed:
        raise SettingError(
            f"{len(clicks)} places a pixel or more apart draw no line. Click {2 + closed} places.",
            code="too-few-clicks",
        )
    return clicks


def stroke_met(geometry: Geometry, path: np.ndarray) -> int:
    """The stroke that a drawn line meets; raises `SettingError` where it meets none."""
    for number, stroke in enumerate(geometry.strokes):
        if stroke.meets(path):
            return number
    raise SettingError(
        "The line lies apart from the curve. Say what becomes of it: replace all, or add a stroke.",
        code="replace-or-add",
    )


def cut(plan: Plan, step: Step) -> Plan:
    """Cut off what lies before `start` or behind `end`, places near the curve."""
    number, stroke = stroke_of(plan, step)
    if "start" not in step and "end" not in step:
        raise malformed(step, "start", "a place, as start or as end")
    ends = [place_of(plan, step, end) if end in step else None for end in ("start", "end")]
    return with_stroke(plan, number, stroke.cut(*ends))


def join(plan: Plan, step: Step) -> Plan:
    """Join two strokes where two of their ends lie nearest."""
    number, stroke = stroke_of(plan, step)
    other = whole_number(step, "other", 1)
    second = plan.geometry.stroke(other)
    if other == number or stroke.closed or second.closed:
        text = "Two different open strokes can be joined. Choose another one."
        raise SettingError(text, code="cannot-join")
    strokes = list(plan.geometry.strokes)
    strokes[min(number, other)] = stroke.join(second, plan.geometry.ink)
    del strokes[max(number, other)]
    return with_strokes(plan, tuple(strokes))


def delete_stroke(plan: Plan, step: Step) -> Plan:
    """Take a stroke out of the curve."""
    number, _ = stroke_of(plan, step)
    strokes = plan.geometry.strokes
    return with_strokes(plan, strokes[:number] + strokes[number + 1 :])


def reverse(plan: Plan, step: Step) -> Plan:
    """Let a stroke run the other way round."""
    number, stroke = stroke_of(plan, step)
    return with_stroke(plan, number, stroke.reversed())


def choose(plan: Plan, step: Step) -> Plan:
    """Take a candidate as the curve: by its name, or the longest `at` a place.

    Earlier drafts give its number instead.
    """
    required_ink(plan)
    if "at" in step:
        return with_candidate(plan, *candidate_at(plan.geometry, place_of(plan, step, "at")))
    field_of = label_of if isinstance(step.get("candidate"), str) else whole_number
    return with_candidate(plan, plan.geometry, field_of(step, "candidate"))


def with_candidate(plan: Plan, geometry: Geometry, name: str | int) -> Plan:
    """The plan with a candidate of this geometry as its curve."""
    settings = plan.source.extraction_with(geometry.ink)
    return replace(plan, geometry=with_chosen(plan.source.image, settings, geometry, name))


def choose_pen(plan: Plan, step: Step) -> Plan:
    """Take another pen than the settings name; the slice is extracted anew."""
    ink = replace(required_ink(plan), colour=label_of(step, "colour"))
    return replace(plan, geometry=plan.source.geometry_with(ink))


def exclude(plan: Plan, step: Step) -> Plan:
    """Let ink in a box not count.

    The slice is extracted anew. A curve that a hand has shaped stays, and counts as drawn by hand
    in the box.
    """
    ink = required_ink(plan)
    # The whole pixels of the box that lie on the slice.
    u, v, width, height = numbers_of(step, "box", 4)
    image = plan.source.image
    low = np.maximum(np.floor((u, v)), 0).astype(int)
    high = np.minimum(np.ceil((u + width, v + height)), (image.width_px, image.height_px))
    size = high.astype(int) - low
    if (size <= 0).any():
        raise SettingError(
            f"The box at ({u:z.0f}, {v:z.0f}), {width:.0f} x {height:.0f} px, holds no pixel of "
            "the slice. Draw it over the slice.",
            code="box-empty",
        )
    box = (*low.tolist(), *size.tolist())
    ink, geometry = replace(ink, exclude=(*ink.exclude, box)), plan.geometry
    if not plan.is_shaped and not any(stroke.edited.any() for stroke in geometry.strokes):
        extracted = plan.source.geometry_with(ink)
        # A line that was chosen among several stays, if extraction alone still finds no curve.
        if extracted.strokes or not geometry.strokes:
            return replace(plan, geometry=replace(extracted, excluded_ink=geometry.excluded_ink))
    strokes = tuple(stroke.without_ink_in(box) for stroke in geometry.strokes)
    return replace(plan, geometry=replace(geometry, strokes=strokes, ink=ink, is_as_found=False))


def take(plan: Plan, step: Step) -> Plan:
    """Take ink of the account as the curve, or as a part of it."""
    ink, geometry = required_ink(plan), plan.geometry
    route = route_over(geometry.entry(whole_number(step, "ink")))
    meaning = step.get("as", "curve")
    if meaning not in ("curve", "part"):
        raise malformed(step, "as", '"curve" or "part"')
    if meaning == "part":
        stroke = MendedStroke.of(ink.trace(route.points, route.closed))
        return with_strokes(plan, (*geometry.strokes, stroke))
    return with_candidate(plan, *with_route(geometry, route))


def leave(plan: Plan, step: Step) -> Plan:
    """Leave ink of the account out of the curve; it is not asked about any more."""
    geometry, number = plan.geometry, whole_number(step, "ink")
    excluded = geometry.excluded_ink | {geometry.entry(number).middle}
    return replace(plan, geometry=replace(geometry, excluded_ink=excluded))


# The markers.


def positions_of(plan: Plan, step: Step, name: str) -> dict[str, Any]:
    """The positions of a marker that a step gives: on the slice, and in front of the robot.

    On the slice it is that of the mark drawn within `snap` [px] of the click, else of the click.
    """
    positions = {}
    if step.get(name) is not None:
        reach_px = number_within(step, "snap", 0, MAX_SNAP_PX)
        place, mark = tuple(place_of(plan, step, name).tolist()), None
        if reach_px and plan.source.slice_path is not None:
            mark = find_marks.find_mark(plan.source.image.rgb, "", place, reach_px)
        positions["place"] = place if mark is None else mark.position_px
    if step.get("target_m") is not None:
        positions["target_m"] = numbers_of(step, "target_m", 3)
    return positions


def with_marker(plan: Plan, step: Step, **changes: Any) -> Plan:
    """The plan with the step's marker changed."""
    return replace(plan, fit=plan.fit.with_marker(step.get("marker"), **changes))


def move_marker(plan: Plan, step: Step) -> Plan:
    """Move a marker on the slice, or give it another place in front of the robot."""
    positions = positions_of(plan, step, "to")
    if not positions:
        raise malformed(step, "to", "a place, or target_m")
    return with_marker(plan, step, **positions)


def add_marker(plan: Plan, step: Step) -> Plan:
    """Add a marker; the registration uses it once both of its positions are known."""
    marker = Marker(label_of(step, "label"), **positions_of(plan, step, "at"))
    return replace(plan, fit=plan.fit.with_markers((*plan.fit.markers, marker)))


def delete_marker(plan: Plan, step: Step) -> Plan:
    """Take a marker out of the list; the plan tells of it as of one that is left out."""
    return with_marker(plan, step, is_used=False, is_deleted=True)


def rename_marker(plan: Plan, step: Step) -> Plan:
    """Give a marker another label."""
    return with_marker(plan, step, label=label_of(step, "label"))


def leave_out_marker(plan: Plan, step: Step) -> Plan:
    """Leave a marker out of the registration, or use it again."""
    marker = plan.fit.markers[plan.fit.index(step.get("marker"))]
    return with_marker(plan, step, is_used=not flag_of(step, "out", marker.is_used))


def find_markers(plan: Plan, step: Step) -> Plan:
    """Move every marker in use to the cross or dot that is drawn next to it."""
    require_slice(plan)
    fit = plan.fit
    labels, places = [m.label for m in fit.used], [m.place for m in fit.used]
    with as_step_refused("The marks were not found"):
        found = find_marks.find_markers(plan.source.image.rgb, labels, places)
    for marker in found:
        fit = fit.with_marker(marker.label, place=marker.position_px)
    return replace(plan, fit=fit)


def choose_slice(plan: Plan, step: Step) -> Plan:
    """Turn to another slice of the stack, by its number from 0, before a curve is drawn."""
    source, number = plan.source, whole_number(step, "slice")
    if not 0 <= number < len(source.stack):
        text = f"There is no slice {number}. The stack has {len(source.stack)}, from 0."
        raise SettingError(text, code="no-such-slice")
    if plan.is_shaped or plan.exclude:
        text = "The curve belongs to this slice. Undo what was drawn before you choose another."
        raise SettingError(text, code="slice-drawn-on")
    with as_step_refused("The slice stays"):
        chosen = source.turned_to(number, plan.fit)
    return replace(plan, source=chosen, geometry=chosen.geometry, fit=chosen.fit)


def rectify(plan: Plan, step: Step) -> Plan:
    """Make a photograph flat by the homography of its markers; the slice is extracted anew."""
    ink, source = required_ink(plan), plan.source
    settings = source.extraction
    if plan.exclude or settings.roi or settings.start or settings.end or source.is_flat:
        text = "Boxes and ends are places on the photograph. Make it flat before they are chosen."
        raise SettingError(text, code="rectify-first")
    with as_step_refused("The picture stays"):
        return made_flat_plan(plan, ink)


def set_plan(plan: Plan, step: Step) -> Plan:
    """Plan with another model, distance, side from which the slice is seen, or pixel size."""
    source, fit, changes = plan.source, plan.fit, {}
    choices = {"model": MODELS, "seen_from": (None, "above", "below"), "arcs_m": (None,)}
    for name, allowed in choices.items():
        if name in step:
            if step[name] not in allowed:
                raise malformed(step, name, " or ".join(map(json.dumps, allowed)))
            changes[name] = step[name]
    for name in ("contact_radius", "guide_m"):
        if name in step:
            changes[name] = numbers_of(step, name, 1)[0]
    # A bundle that was opened is planned anew.
    changed = replace(source, planning=replace(source.planning, **changes), as_opened=None)
    new = replace(fit, settings=replace(fit.settings, **changes))
    if "pixel_spacing_mm" in step:
        spacing = numbers_of(step, "pixel_spacing_mm", 2)
        largest = max_number("/image/pixel_spacing")
        if not all(MIN_SPACING_MM <= size <= largest for size in spacing):
            raise malformed(step, "pixel_spacing_mm", f"sizes of {MIN_SPACING_MM:g} to {largest:g}")
        changed = replace(
            changed, image=replace(source.image, pixel_spacing_mm=spacing),
            extraction=replace(source.extraction, pixel_spacing_mm=spacing),
        )  # fmt: skip
        new = replace(new, pixel_spacing_mm=spacing)
    if fit is source.fit:
        changed = replace(changed, fit=new)
    return replace(plan, source=changed, fit=new)


# Answers, and what was looked at.


def answer(plan: Plan, step: Step) -> Plan:
    """Accept a finding by its number in the state's list, or all of one code."""
    findings = plan.outcome.findings
    which = step.get("finding")
    accepted = [
        finding
        for number, finding in enumerate(findings)
        if finding.code == which or (number == which and type(which) is int)
    ]
    if not accepted:
        text = f"There is no finding {which!r}. There are {len(findings)}, from 0."
        raise SettingError(text, code="no-such-finding")
    by = "" if step.get("by") is None else visible_name(label_of(step, "by"))
    utc = step.get("utc")
    if not isinstance(utc, str) or len(utc) != len("2026-01-31T12:00:00Z"):
        raise malformed(step, "utc", "a time such as 2026-01-31T12:00:00Z")
    answers = {found: replace(found, answered_by=by, answered_utc=utc) for found in accepted}
    answered = replace(plan, answers=plan.answers | answers)
    answered.__dict__["outcome"] = plan.outcome  # Answers do not change it.
    return answered


def points_in_view(plan: Plan, step: Step) -> np.ndarray:
    """(M, 2) the points of a stroke that were in view: from one share of its length to another."""
    _, stroke = stroke_of(plan, step)
    arc = arc_lengths(stroke.points, False)
    first, last = number_within(step, "from", 0.0, 1), number_within(step, "to", 1.0, 1)
    is_in = (arc >= (first - 1e-9) * arc[-1]) & (arc <= (last + 1e-9) * arc[-1])
    return stroke.points[is_in]


STEPS = {
    step.__name__: step
    for step in (
        move_knot, insert_knot, delete_knot, draw, cut, join, delete_stroke, reverse, choose,
        choose_pen, exclude, take, leave, move_marker, add_marker, delete_marker, rename_marker,
        leave_out_marker, find_markers, choose_slice, rectify, set_plan,
        answer,
    )
}  # fmt: skip

# Steps by which a hand shapes the curve; extraction anew would undo them.
BY_HAND = ("move_knot", "delete_knot", "draw", "cut", "join", "delete_stroke", "reverse", "take")


def apply(plan: Plan, step: Any) -> Plan:
    """The plan after a step; raises `SettingError` for one that does not fit."""
    if not isinstance(step, dict) or not isinstance(step.get("do"), str):
        text = 'The step has no key "do". Send an object such as {"do": "leave", "ink": 1}.'
        raise SettingError(text, code="step-malformed")
    name = step["do"]
    if name not in STEPS:
        text = f"There is no step {name[:40]!r}. The steps are: {', '.join(STEPS)}, viewed."
        raise SettingError(text, code="no-such-step")
    try:
        after = STEPS[name](plan, step)
    except CurveError as error:
        raise SettingError(error.message, code=error.code) from None
    return replace(after, is_shaped=True) if name in BY_HAND else after
