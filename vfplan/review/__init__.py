"""A person looks at a plan: the review page, the review sheet, and how the answer is stored.

plan         a plan under review: what it begins with, and what the steps made of that
session      the steps of a review, the way back, what the page shows, and the approval
steps        each step, from one plan to the next
geometry     the curve on its slice, or why there is none; the account and the routes over its ink
strokes      the pen's ink near a path, and a line that can be mended by its knots
markers      the markers, and what the registration says of them
server       the page's server and the draft; the page itself is in `page`
rendered     what the robot renders, by its engine and in words; its digest, and who accepts it
sheet        the same as pages: facts, enlarged places, findings and other ink
picture      the slice on the sheet, or a bundle without one from three sides
paper        pages, letters, what stands where, and where captions go
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """`Session` when it is asked for: who signs and verifies needs `rendered` alone."""
    if name == "Session":
        from vfplan.review.session import Session

        return Session
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
