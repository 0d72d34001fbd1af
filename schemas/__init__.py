"""JSON schemas and shipped settings: data, read through `importlib.resources`."""
