"""Pictures, drawn by Matplotlib without a screen; imported only when a picture is asked for."""

from __future__ import annotations
