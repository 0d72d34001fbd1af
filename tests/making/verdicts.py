"""What an extraction makes of a drawn slice: right, silently wrong, warned, refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from drawing import normal_errors, polyline, to_ends
from scipy.spatial import cKDTree

import vfplan
from vfplan.errors import CurveError

RMS_PX, WORST_PX, SHARE = 1.0, 3.0, 0.05
ACCOUNT_PX = 40.0  # from a wrong place: an entry of the account speaks of it
END_PX = 6.0  # of line at an open end, of which the deviation is not judged


@dataclass
class Verdict:
    """How one slice came out; `z` holds the inner points' errors over their stated deviation."""

    outcome: str  # "right", "silent", "warned", "refused", "falsely refused", "falsely warned"
    why: str = ""
    rms: float = np.nan
    ends: float = np.nan
    z: np.ndarray | None = None


def judge(drawn, **options):
    """The verdict on a `slices.Slice`.

    A wrong curve is told by a finding, or by an entry of the account close to where it is wrong.
    """
    try:
        found = vfplan.extract_curve(drawn.image, **options)
    except CurveError as error:
        return Verdict("falsely refused" if drawn.clear else "refused", str(error))
    # That the line leaves the picture is true of the slice, and that a gap is bridged is true of
    # every lift. Neither tells a fault of the curve. On a clear slice a lift near an end is a true
    # one too, about which vfplan has to ask.
    true_of_slice = {"leaves-picture", "bridge"}
    if drawn.clear:
        true_of_slice.add("bridge-near-end")
    told = "; ".join(f.text for f in found.findings if f.code not in true_of_slice)
    wrong, rms, ends = _wrong(found, drawn)
    if wrong:
        listed = _listed(found, drawn)
        outcome = "warned" if told or listed else "silent"
        return Verdict(outcome, f"{wrong}; {told or listed}", rms, ends)
    warned = "falsely warned" if drawn.clear else "warned"
    return Verdict(warned if told else "right", told, rms, ends, _z(found, drawn))


def _listed(found, drawn):
    """The entry of the account that lies closest to where the curve is wrong, in words."""
    points = np.vstack([s.points_px for s in found.strokes])
    places = points
    if drawn.truth is not None:
        off = np.abs(normal_errors(points, drawn.truth, drawn.closed)) > RMS_PX
        dense = polyline(drawn.truth, drawn.closed, 0.5)
        missing = cKDTree(points).query(dense)[0] > WORST_PX
        places = np.vstack([points[off], dense[missing], points[[0, -1]]])
    tree = cKDTree(places)
    for entry in found.account:
        if tree.query((entry.u, entry.v))[0] <= ACCOUNT_PX + entry.size_px / 2:
            return f"listed: {entry.what} at ({entry.u:.0f}, {entry.v:.0f})"
    return ""


def _wrong(found, drawn):
    if drawn.truth is None:
        return "there is no curve", np.nan, np.nan
    points = np.vstack([s.points_px for s in found.strokes])
    error = normal_errors(points, drawn.truth, drawn.closed)
    dense = polyline(drawn.truth, drawn.closed, 0.25)
    missing = cKDTree(points).query(dense)[0] > WORST_PX
    rms, worst = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    extra = (np.abs(error) > WORST_PX).mean()
    closed = found.strokes[0].closed
    ends = np.nan
    if not closed and not drawn.closed:
        a, b = points[[0, -1]], dense[[0, -1]]
        ends = min(np.hypot(*(a - c).T).max() for c in (b, b[::-1]))
    faults = [
        f"{rms:.1f} px RMS" if rms > RMS_PX else "",
        f"{worst:.0f} px off" if worst > WORST_PX else "",
        f"{missing.mean():.0%} missing" if missing.mean() > SHARE else "",
        f"{extra:.0%} extra" if extra > SHARE else "",
        "closed" if closed and not drawn.closed else "",
        "open" if drawn.closed and not closed else "",
    ]
    return ", ".join(filter(None, faults)), rms, ends


def _z(found, drawn):
    values = []
    for stroke in found.strokes:
        error = normal_errors(stroke.points_px, drawn.truth, drawn.closed)
        inner = ~stroke.bridged & (stroke.closed | (to_ends(stroke.points_px) > END_PX))
        values.append((error / stroke.sigma_px)[inner])
    return np.concatenate(values)
