"""The steps of a review, each a function from a session and the step's fields to the next state.

Strokes, knots and findings count from 0, as in the lists of the state. Candidates and ink have the
numbers that the state gives them, from 1. Places are (u, v) in pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.errors import MarkerError, SettingError, VfplanError
from vfplan.io.files import now_utc
from vfplan.planning.plan import register
from vfplan.review.geometry import Geometry, route_over, with_chosen
from vfplan.review.ink import REACH_PX, SliceInk, drawn_by_hand
from vfplan.review.markers import Marker, fit_of, pairs_of_table
from vfplan.review.session import Session, State, key_of
from vfplan.review.strokes import JOIN_PX, MendedStroke, nearest_point, spline_through

Step = dict[str, Any]
MAX_CLICKS = 500
"""Points of a drawn line at most; a hand clicks some tens."""

MAX_EXCLUDED = 100
"""Excluded boxes at most."""

MAX_MARKERS = 200
"""Markers at most; layouts have 4 to 40."""

MAX_LABEL = 64
"""Characters of a label at most, as a bundle holds them."""


# The fields of a step.


def named(step: Any) -> str:
    """What a step does; raises `SettingError` for none that is known."""
    if not isinstance(step, dict) or not isinstance(step.get("do"), str):
        raise SettingError(
            'The step has no key "do". Send an object such as {"do": "leave", "ink": 1}.',
            code="step-malformed",
        )
    name = step["do"]
    if name not in STEPS:
        raise SettingError(
            f"There is no step {name[:40]!r}. The steps are: {', '.join(STEPS)}.",
            code="no-such-step",
        )
    return name


def _malformed(step: Step, name: str, wanted: str) -> SettingError:
    value = repr(step.get(name))[:60]
    return SettingError(
        f"In step {step['do']}, {name} is {value}. Give {wanted}.", code="step-malformed"
    )


def _whole(step: Step, name: str, default: int | None = None) -> int:
    value = step.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int):
        raise _malformed(step, name, "a whole number")
    return value


def _share(step: Step, name: str, default: float) -> float:
    value = step.get(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 1:
        raise _malformed(step, name, "a number from 0 to 1")
    return float(value)


def _numbers(step: Step, name: str, count: int) -> tuple[float, ...]:
    value = step.get(name)
    if not isinstance(value, (list, tuple)) or len(value) != count:
        raise _malformed(step, name, f"a list of {count} numbers")
    for number in value:
        usable = isinstance(number, (int, float)) and not isinstance(number, bool)
        if not usable or not math.isfinite(number) or abs(number) > 1e9:
            raise _malformed(step, name, f"a list of {count} finite numbers")
    return tuple(float(number) for number in value)


def _place(session: Session, step: Step, name: str) -> np.ndarray:
    """A place on the slice; a hand may point half a pixel beyond its border."""
    return _on_slice(session, np.array(_numbers(step, name, 2)))


def _on_slice(session: Session, place: np.ndarray) -> np.ndarray:
    image = session.source.image
    limit = np.array([image.width_px, image.height_px]) - 0.5
    if (place < -0.5).any() or (place > limit).any():
        raise SettingError(
            f"({place[0]:.1f}, {place[1]:.1f}) lies outside the slice. Choose a place on its "
            f"{image.width_px} x {image.height_px} px.",
            code="outside-slice",
            numbers={"u": float(place[0]), "v": float(place[1])},
        )
    return place


def _label(step: Step, name: str) -> str:
    value = step.get(name)
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise _malformed(step, name, "a label of printable characters")
    if len(value) > MAX_LABEL:
        raise _malformed(step, name, f"a label of at most {MAX_LABEL} characters")
    return value.strip()


def _stroke_of(session: Session, step: Step) -> tuple[State, int, MendedStroke]:
    state = session.current
    number = _whole(step, "stroke", 0)
    return state, number, state.geometry.stroke(number)


def _knot_of(stroke: MendedStroke, step: Step) -> int:
    knot = _whole(step, "knot")
    if not 0 <= knot < len(stroke.knots):
        raise SettingError(
            f"There is no knot {knot}. The stroke has {len(stroke.knots)}, from 0.",
            code="no-such-knot",
            numbers={"knot": knot, "knots": len(stroke.knots)},
        )
    return knot


def _needs_ink(session: Session) -> SliceInk:
    ink = session.current.geometry.ink
    if ink is None:
        if session.source.slice_path is None:
            raise SettingError(
                "This step needs the slice. Open the bundle with it: --slice IMAGE.",
                code="no-slice",
            )
        raise SettingError(
            "This step needs a pen's ink, and the curve was drawn as vectors. Draw the stretch by "
            "clicks, or open the slice without --curve.",
            code="no-ink",
        )
    return ink


# The curve.


def move_knot(session: Session, step: Step) -> State:
    """Move a knot; its stretch is measured again where there is ink."""
    state, number, stroke = _stroke_of(session, step)
    knot = _knot_of(stroke, step)
    to = _place(session, step, "to")
    moved = stroke.move_knot(knot, to, state.geometry.ink)
    return state.changed(geometry=state.geometry.with_stroke(number, moved))


def insert_knot(session: Session, step: Step) -> State:
    """A further knot on the curve, nearest to a place."""
    state, number, stroke = _stroke_of(session, step)
    new = stroke.insert_knot(_place(session, step, "at"))
    return state.changed(geometry=state.geometry.with_stroke(number, new))


def delete_knot(session: Session, step: Step) -> State:
    """Draw the stretch without a knot; of an end, cut back to the next knot."""
    state, number, stroke = _stroke_of(session, step)
    new = stroke.delete_knot(_knot_of(stroke, step), state.geometry.ink)
    return state.changed(geometry=state.geometry.with_stroke(number, new))


def draw(session: Session, step: Step) -> State:
    """Draw a stretch, or a whole curve, by clicks.

    A line that begins or ends on the curve becomes a stretch of it. Any other becomes the curve,
    in place of what was there; with `"add": true` it becomes a further stroke.
    """
    state = session.current
    closed = step.get("closed", False)
    adds = step.get("add", False)
    if not isinstance(closed, bool) or not isinstance(adds, bool):
        raise _malformed(step, "closed", "true or false")
    clicks = _clicks(session, step, closed)
    path = spline_through(np.array(clicks), closed)
    image = session.source.image
    limit = np.array([image.width_px, image.height_px]) - 0.5
    path = np.clip(path, -0.5, limit)
    geometry = state.geometry
    if not closed and not adds:
        number = _stroke_at(geometry, step, path)
        if number is not None:
            stroke = geometry.strokes[number].redraw(path, geometry.ink)
            return state.changed(geometry=geometry.with_stroke(number, stroke))
    if geometry.ink is None:
        line = drawn_by_hand(path, closed)
    else:
        line = geometry.ink.draw(path, closed, REACH_PX, (True, True))
    stroke = MendedStroke.of(line)
    strokes: tuple[MendedStroke, ...] = (*geometry.strokes, stroke) if adds else (stroke,)
    return state.changed(geometry=geometry.with_strokes(strokes))


def _clicks(session: Session, step: Step, closed: bool) -> list[np.ndarray]:
    """The places of a drawn line, without doubled ones; enough of them to draw it."""
    points = step.get("points")
    if not isinstance(points, (list, tuple)) or not 2 <= len(points) <= MAX_CLICKS:
        raise _malformed(step, "points", f"a list of 2 to {MAX_CLICKS} places")
    clicks: list[np.ndarray] = []
    for point in points:
        place = _numbers({"do": "draw", "points": point}, "points", 2)
        place = _on_slice(session, np.array(place))
        if not clicks or np.hypot(*(place - clicks[-1])) >= 1.0:
            clicks.append(place)
    needed = 2
    if closed:
        needed = 3
        if len(clicks) > 1 and np.hypot(*(clicks[0] - clicks[-1])) < 1.0:
            clicks.pop()
    if len(clicks) < needed:
        raise SettingError(
            f"{len(clicks)} places a pixel or more apart draw no line. Click {needed} places.",
            code="too-few-clicks",
            numbers={"places": len(clicks), "needed": needed},
        )
    return clicks


def _stroke_at(geometry: Geometry, step: Step, path: np.ndarray) -> int | None:
    """The stroke on which a drawn line begins or ends; `None` for none."""
    if "stroke" in step:
        number = _whole(step, "stroke")
        geometry.stroke(number)
        return number
    distances = []
    for number, stroke in enumerate(geometry.strokes):
        for end in (path[0], path[-1]):
            _, distance = nearest_point(stroke.points, end)
            distances.append((distance, number))
    return None if not distances or min(distances)[0] > JOIN_PX else min(distances)[1]


def cut(session: Session, step: Step) -> State:
    """Cut off what lies before `start` or behind `end`, places near the curve."""
    state, number, stroke = _stroke_of(session, step)
    if "start" not in step and "end" not in step:
        raise _malformed(step, "start", "a place, as start or as end")
    start, end = None, None
    if "start" in step:
        start = _place(session, step, "start")
    if "end" in step:
        end = _place(session, step, "end")
    return state.changed(geometry=state.geometry.with_stroke(number, stroke.cut(start, end)))


def join(session: Session, step: Step) -> State:
    """Join two strokes where two of their ends lie nearest."""
    state, number, stroke = _stroke_of(session, step)
    other = _whole(step, "other", 1)
    second = state.geometry.stroke(other)
    if other == number or stroke.closed or second.closed:
        raise SettingError(
            "Two different open strokes can be joined. Choose another one.",
            code="cannot-join",
            numbers={"stroke": number, "other": other},
        )
    joined = stroke.join(second, state.geometry.ink)
    strokes = list(state.geometry.strokes)
    strokes[min(number, other)] = joined
    del strokes[max(number, other)]
    return state.changed(geometry=state.geometry.with_strokes(tuple(strokes)))


def delete_stroke(session: Session, step: Step) -> State:
    """Take a stroke out of the curve."""
    state, number, _ = _stroke_of(session, step)
    strokes = state.geometry.strokes
    strokes = strokes[:number] + strokes[number + 1 :]
    return state.changed(geometry=state.geometry.with_strokes(strokes))


def reverse(session: Session, step: Step) -> State:
    """Let a stroke run the other way round."""
    state, number, stroke = _stroke_of(session, step)
    return state.changed(geometry=state.geometry.with_stroke(number, stroke.reversed()))


def choose(session: Session, step: Step) -> State:
    """Take a candidate, by its number, as the curve."""
    state = session.current
    settings = session.source.extraction_with(_needs_ink(session), state.exclude)
    number = _whole(step, "candidate")
    geometry = with_chosen(session.source.slice_path, settings, state.geometry, number)
    return state.changed(geometry=geometry)


def choose_pen(session: Session, step: Step) -> State:
    """Take another pen than the settings name; the slice is extracted anew."""
    state = session.current
    ink = _needs_ink(session).of_pen(_label(step, "colour"))
    return state.changed(geometry=session.source.geometry_with(ink, state.exclude))


def exclude(session: Session, step: Step) -> State:
    """Let ink in a box not count.

    The slice is extracted anew. A curve that a hand has shaped stays, and only its part in the box
    is measured again.
    """
    state = session.current
    ink = _needs_ink(session)
    # The whole pixels of the box that lie on the slice.
    u, v, width, height = _numbers(step, "box", 4)
    image = session.source.image
    first_u, first_v = max(0, math.floor(u)), max(0, math.floor(v))
    last_u = min(image.width_px, math.ceil(u + width))
    last_v = min(image.height_px, math.ceil(v + height))
    if last_u <= first_u or last_v <= first_v:
        raise SettingError(
            f"The box at ({u:.0f}, {v:.0f}), {width:.0f} x {height:.0f} px, holds no pixel of the "
            "slice. Draw it over the slice.",
            code="box-empty",
            numbers={"width_px": width, "height_px": height},
        )
    exclude = (*state.exclude, (first_u, first_v, last_u - first_u, last_v - first_v))
    if len(exclude) > MAX_EXCLUDED:
        raise SettingError(
            f"{MAX_EXCLUDED} boxes are excluded, and no more can be. Undo one of them.",
            code="too-many-boxes",
        )
    geometry = state.geometry
    is_shaped = any(stroke.edited.any() for stroke in geometry.strokes)
    for earlier in session.steps:
        if earlier["do"] in BY_HAND:
            is_shaped = True
    if not is_shaped:
        extracted = session.source.geometry_with(ink, exclude)
        # A line that was chosen among several stays, if extraction alone still finds no curve.
        if extracted.strokes or not geometry.strokes:
            geometry = replace(extracted, excluded_ink=geometry.excluded_ink)
            return state.changed(geometry=geometry, exclude=exclude)
    ink = ink.without(exclude)
    strokes = [stroke.measured_in(exclude[-1], ink) for stroke in geometry.strokes]
    geometry = replace(geometry, strokes=tuple(strokes), ink=ink)
    return state.changed(geometry=geometry, exclude=exclude)


def take(session: Session, step: Step) -> State:
    """Take ink of the account as the curve, or as a part of it."""
    state = session.current
    ink = _needs_ink(session)
    route = route_over(state.geometry.entry(_whole(step, "ink")))
    meaning = step.get("as", "curve")
    if meaning not in ("curve", "part"):
        raise _malformed(step, "as", '"curve" or "part"')
    stroke = MendedStroke.of(ink.trace(route.points, route.closed))
    strokes = (*state.geometry.strokes, stroke) if meaning == "part" else (stroke,)
    return state.changed(geometry=state.geometry.with_strokes(strokes))


def leave(session: Session, step: Step) -> State:
    """Leave ink of the account out of the curve; it is shown as settled."""
    state = session.current
    entry = state.geometry.entry(_whole(step, "ink"))
    return replace(state, geometry=state.geometry.with_excluded(entry.middle))


# The markers.


def move_marker(session: Session, step: Step) -> State:
    """Move a marker on the slice, or give it another place in front of the robot."""
    fit = session.current.fit
    number = fit.index(step.get("marker"))
    changes: dict[str, Any] = {}
    if "to" in step:
        changes["place_px"] = tuple(_place(session, step, "to").tolist())
    if "target_m" in step:
        changes["target_m"] = _numbers(step, "target_m", 3)
    if not changes:
        raise _malformed(step, "to", "a place, or target_m")
    return session.current.changed(fit=fit.with_marker(number, **changes))


def add_marker(session: Session, step: Step) -> State:
    """A further marker; it counts once both of its positions are known."""
    fit = session.current.fit
    label = _label(step, "label")
    fit.refuse_label(label)
    if len(fit.markers) >= MAX_MARKERS:
        raise SettingError(
            f"There are {MAX_MARKERS} markers, and no more can be added. Delete one.",
            code="too-many-markers",
        )
    place = tuple(_place(session, step, "at").tolist()) if step.get("at") is not None else None
    target = _numbers(step, "target_m", 3) if step.get("target_m") is not None else None
    markers = (*fit.markers, Marker(label, place, target))
    return session.current.changed(fit=replace(fit, markers=markers))


def delete_marker(session: Session, step: Step) -> State:
    """Take a marker out of the list."""
    fit = session.current.fit
    number = fit.index(step.get("marker"))
    markers = fit.markers[:number] + fit.markers[number + 1 :]
    return session.current.changed(fit=replace(fit, markers=markers))


def rename_marker(session: Session, step: Step) -> State:
    """Give a marker another label."""
    fit = session.current.fit
    number = fit.index(step.get("marker"))
    label = _label(step, "label")
    fit.refuse_label(label, besides=number)
    return session.current.changed(fit=fit.with_marker(number, label=label))


def leave_out_marker(session: Session, step: Step) -> State:
    """Leave a marker out of the registration, or use it again."""
    fit = session.current.fit
    number = fit.index(step.get("marker"))
    out = step.get("out", fit.markers[number].is_used)
    if not isinstance(out, bool):
        raise _malformed(step, "out", "true or false")
    return session.current.changed(fit=fit.with_marker(number, is_used=not out))


def set_markers(session: Session, step: Step) -> State:
    """Take a pasted table of markers, a CSV with both positions of each."""
    table = step.get("table")
    if not isinstance(table, str):
        raise _malformed(step, "table", "a table as text")
    fit = session.current.fit
    try:
        pairs = pairs_of_table(table)
    except MarkerError as error:
        raise SettingError(
            f"The table of markers cannot be read: {error.message}", code=error.code
        ) from None
    fit = fit_of(pairs, session.source.image, fit.settings)
    if len(fit.markers) > MAX_MARKERS:
        raise SettingError(
            f"The table holds {len(fit.markers)} markers. At most {MAX_MARKERS} are allowed.",
            code="too-many-markers",
        )
    return session.current.changed(fit=fit)


def find_markers(session: Session, step: Step) -> State:
    """Move every marker in use to the cross or dot that is drawn next to it."""
    state = session.current
    fit = state.fit
    if session.source.slice_path is None:
        raise SettingError(
            "This step needs the slice. Open the bundle with it: --slice IMAGE.", code="no-slice"
        )
    if not state.geometry.strokes or fit.registration is None:
        raise SettingError(
            "There is no curve or no registration yet. Marks are looked for once there are both.",
            code="no-registration",
        )
    settings = replace(fit.settings, find_markers=True)
    with fit.as_files() as files:
        try:
            planned = register(session.curve(), *files, settings, image=session.source.image)
        except VfplanError as error:
            raise SettingError(
                f"The marks were not found: {error.message}", code=error.code
            ) from None
    labels = [marker.label for marker in fit.used]
    for label, place in zip(labels, planned.registration.source.tolist(), strict=True):
        fit = fit.with_marker(fit.index(label), place_px=tuple(place))
    return state.changed(fit=fit)


# Answers, and what was looked at.


def answer(session: Session, step: Step) -> State:
    """Accept a finding by its number in the state's list, or all of one code."""
    findings = session.outcome.findings
    which = step.get("finding")
    if isinstance(which, str):
        accepted = [finding for finding in findings if finding.code == which]
    elif isinstance(which, int) and not isinstance(which, bool) and 0 <= which < len(findings):
        accepted = [findings[which]]
    else:
        accepted = []
    if not accepted:
        raise SettingError(
            f"There is no finding {which!r}. There are {len(findings)}, from 0.",
            code="no-such-finding",
            numbers={"findings": len(findings)},
        )
    by = step.get("by")
    if by is not None:
        by = _label(step, "by")
    utc = step.get("utc")
    if utc is None:
        utc = now_utc()
    if not isinstance(utc, str) or len(utc) != len("2026-01-31T12:00:00Z"):
        raise _malformed(step, "utc", "a time such as 2026-01-31T12:00:00Z")
    answers = dict(session.current.answers)
    for finding in accepted:
        # The latest answer stands last.
        answers.pop(key_of(finding), None)
        answers[key_of(finding)] = (by, utc)
    return replace(session.current, answers=answers)


def viewed(session: Session, step: Step) -> State:
    """A part of a stroke was in view, from one share of its length to another."""
    state = session.current
    number = _whole(step, "stroke", 0)
    start, stop = _share(step, "from", 0.0), _share(step, "to", 1.0)
    return replace(state, geometry=state.geometry.with_viewed(number, start, stop))


STEPS: dict[str, Callable[[Session, Step], State]] = {
    function.__name__: function
    for function in (
        move_knot,
        insert_knot,
        delete_knot,
        draw,
        cut,
        join,
        delete_stroke,
        reverse,
        choose,
        choose_pen,
        exclude,
        take,
        leave,
        move_marker,
        add_marker,
        delete_marker,
        rename_marker,
        leave_out_marker,
        set_markers,
        find_markers,
        answer,
        viewed,
    )
}

# Steps by which a hand shapes the curve; extraction anew would undo them.
BY_HAND = ("move_knot", "delete_knot", "draw", "cut", "join", "delete_stroke", "reverse", "take")
