"""An arm's model file: a shipped one, or the user's, which is read as what it is: untrusted text.

A model may name only what an arm without shapes needs. Nothing that opens another file, runs a
plugin or multiplies itself is let through to MuJoCo.
"""

from __future__ import annotations

import logging
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.parsers import expat

from vfplan.errors import InputError, requires_extra
from vfplan.io.files import MAX_SETTINGS_BYTES, read_whole

_LOG = logging.getLogger("vfplan")

MAX_NODES = 5_000
"""Largest number of elements. An arm has about a hundred."""

MAX_DEPTH = 64
"""Largest number of elements within each other. An arm has about twenty."""

ELEMENTS = {
    *("mujoco", "compiler", "option", "flag", "default", "statistic", "keyframe", "key"),
    *("worldbody", "body", "frame", "inertial", "joint", "geom", "site", "camera", "light"),
    *("actuator", "motor", "general", "position", "velocity", "contact", "exclude"),
}
FORBIDDEN = {"file", "meshdir", "texturedir", "assetdir", "plugin", "mesh", "hfield"}
"""Attributes that name a file or a folder, or load code."""


def mujoco() -> Any:
    """The module; `MissingExtra` without it."""
    with requires_extra("a simulated arm needs MuJoCo", "arm"):
        import mujoco
    if mujoco.get_mju_user_warning() is None:
        # By itself it would write them into a file of the current folder.
        mujoco.set_mju_user_warning(_LOG.warning)
    return mujoco


def compile_model(choice: str | Path, shipped: tuple[str, ...]) -> Any:
    """The `MjModel` of a shipped arm, or of an MJCF file.

    Raises InputError: a file that cannot be read, that names what is not allowed here, or that
        MuJoCo refuses
    Raises MissingExtra: no MuJoCo
    """
    module = mujoco()
    if str(choice) in shipped:
        model = files("vfplan.arm") / "models" / f"{choice}.xml"
        return module.MjModel.from_xml_string(model.read_text("utf-8"))
    try:
        data = read_whole(Path(choice), MAX_SETTINGS_BYTES)
    except InputError as error:
        known = ", ".join(shipped)
        raise InputError(
            f"{error.message}, or give {known} or an MJCF file", where=str(choice)
        ) from None
    check(data, str(choice))
    try:
        return module.MjModel.from_xml_string(data.decode("utf-8"))
    except (ValueError, module.FatalError) as error:
        raise InputError(
            f"MuJoCo refuses it: {error}. Correct the MJCF file", where=str(choice)
        ) from None


def check(data: bytes, where: str) -> None:
    """Raise `InputError` for the first thing in an MJCF that is not allowed here."""
    parser = expat.ParserCreate()
    node_count = 0
    depth = 0

    def refuse(what: str) -> None:
        raise InputError(
            f"line {parser.CurrentLineNumber}: {what}", where=where, code="mjcf-not-allowed",
            numbers={"line": parser.CurrentLineNumber},
        )  # fmt: skip

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal node_count, depth
        node_count += 1
        depth += 1
        if node_count == 1 and name != "mujoco":
            refuse(f"<{name}> is no MJCF. Give a file whose root is <mujoco>")
        if name not in ELEMENTS:
            refuse(f"<{name}> is not allowed. Give an arm without shapes, in one file")
        for attribute in attributes:
            if attribute in FORBIDDEN:
                refuse(
                    f'{attribute}="..." is not allowed. Put all into this file, as no other is read'
                )
        for value in attributes.values():
            if "nan" in value.lower().split():
                refuse("a number is nan. Give finite numbers")
        if node_count > MAX_NODES or depth > MAX_DEPTH:
            refuse(
                f"it has more than {MAX_NODES} elements, or {MAX_DEPTH} within each other. "
                "Give a smaller file"
            )

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = lambda *_: refuse("a document type is not allowed. Remove it")
    parser.EntityDeclHandler = lambda *_: refuse("an entity is not allowed. Remove it")
    try:
        data.decode("utf-8")
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(
            f"is no XML: {error}. Give an MJCF file", where=where, code="not-xml"
        ) from None
    except UnicodeDecodeError:
        raise InputError("is not text. Give an MJCF file", where=where, code="not-xml") from None
