"""Correspondences -> transform, with its error wherever it is used."""
