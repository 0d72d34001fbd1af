"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

docs/format.md is the normative text, schemas/bundle-2.0.json its machine-readable twin.
"""

from vfplan.bundle.content import rendered_values, review_digest

__all__ = ["rendered_values", "review_digest"]
