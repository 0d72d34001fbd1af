"""A person looks at a plan: the review page, the review sheet, and how the answer is stored.

session      the state of a review: what a person sees, and what each step makes of it
steps        the steps
source       a slice or a bundle, read, with its markers
geometry     the curve on its slice, or why there is none
account      all other ink, and where the curve is bridged
strokes      a line that can be mended by its knots, `paths` its geometry
ink          the pen's ink near a path that a person drew, by its `profiles`
routes       the routes that a curve may take over forked ink
markers      the markers, and what the registration says of them
draft        the steps in a file
server       the page's server; the page itself is in `page`
approval     a person's approval, stored in a bundle
sheet_input  everything that a sheet shows, as one plain record, with its `facts` in words
sheet        the record as a picture, with `picture` (the slice), `insets` and `lists`
views        a bundle without a slice, from three sides
labels       where the captions on the slice go
paper        pages, letters, and what stands where
digest       64 hexadecimal digits over what a sheet shows
acceptance   answers, a name and the digest, stored in a bundle
"""

from __future__ import annotations

__all__ = ["Session"]
