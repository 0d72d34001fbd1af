"""Plane and space geometry that several packages need."""
