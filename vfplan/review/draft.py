"""The draft of a review: its steps, in a file beside the output, written after every step.

Whatever ends the program, the next call with the same files takes the review up where it was.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from vfplan.errors import InputError, SettingError
from vfplan.io.files import MAX_TEXT_BYTES, read_whole
from vfplan.io.writing import write_whole
from vfplan.review.session import Session
from vfplan.review.source import sha256_of

FORMAT = "vfplan-draft"
VERSION = "1.0"
MAX_BYTES = MAX_TEXT_BYTES // 4
"""Largest size of a draft. Thousands of steps take some megabytes."""


class Draft:
    """The file of a draft, and what the draft belongs to.

    Parameters
    ----------
    path
        Where it is kept.
    files
        Role ("source", "markers", "markers2", "slice", "curve") -> the file of the review.
    settings
        The settings of the review, by name.
    """

    def __init__(self, path: Path, files: dict[str, Path | None], settings: dict[str, Any]) -> None:
        self.path = path
        sha256 = {role: sha256_of(file) for role, file in files.items() if file is not None}
        texts = {name: repr(value) for name, value in sorted(settings.items())}
        self._header = {
            "format": FORMAT,
            "version": VERSION,
            "sha256": sha256,
            "settings": texts,
        }

    def take_up(self, session: Session) -> Session:
        """The session with the draft's steps applied; as it is if there is no draft.

        Raises
        ------
        InputError
            The file is no draft, belongs to other files or settings, or holds a step that does not
            fit.
        """
        if not self.path.exists():
            return session
        where = str(self.path)
        advice = f"Move {self.path.name} away to begin anew."
        text = read_whole(self.path, MAX_BYTES, InputError)
        try:
            draft = json.loads(text)
            steps, undone = draft["steps"], draft["undone"]
            header = {name: draft[name] for name in self._header}
            if not isinstance(steps, list) or not isinstance(undone, list):
                raise TypeError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InputError(
                f"This is no draft of a review. {advice}", where=where, code="no-draft"
            ) from None
        if header != self._header:
            what = "other files" if header["sha256"] != self._header["sha256"] else "other settings"
            raise InputError(
                f"This is the draft of a review with {what}. {advice}",
                where=where,
                code="another-draft",
            )
        try:
            for step in steps:
                session = session.apply(step)
            after = session
            for step in undone:
                after = after.apply(step)
        except SettingError as error:
            raise InputError(
                f"The draft holds a step that does not fit. {error.message} {advice}",
                where=where,
                code="draft-does-not-fit",
            ) from None
        return session.with_undone(undone)

    def keep(self, session: Session) -> None:
        """Write the session's steps; raises `OutputError` if that fails."""
        steps = {"steps": list(session.steps), "undone": list(session.undone)}
        text = json.dumps(self._header | steps, indent=0)
        write_whole(self.path, [text.encode()], overwrite=True, mode=0o600)

    def discard(self) -> None:
        """Take the file away: the review is approved."""
        self.path.unlink(missing_ok=True)


def draft_path(output: Path) -> Path:
    """Where the draft of an output is kept."""
    return output.with_name(f"{output.name}.draft.json")
