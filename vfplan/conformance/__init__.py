"""The conformance kit: files that say, rule by rule, what a reader of bundles must do.

`vfplan conformance --write DIR` writes the kit; `python -m vfplan.conformance CMD` runs a reader on
each of its files (docs/howto/reader.md).
"""
