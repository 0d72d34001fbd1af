"""The fixture bundle: a versioned, sealed HDF5 file that a robot can trust.

docs/format.md is the normative text, schemas/bundle-2.0.json its machine-readable twin.
"""
