"""The `vfplan` command line: one file a command, loaded only when it is called."""

from __future__ import annotations
