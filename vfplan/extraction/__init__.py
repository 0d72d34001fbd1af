"""Planning colour -> mask -> marks -> candidates: what on the slice may be the curve.

pen         the pen's colour, un-mixing, the mask
skeleton    a mask's skeleton as ordered pixel paths
marks       connected marks, and what each of them is
candidates  lines joined over pen lifts, in a fixed order
"""
