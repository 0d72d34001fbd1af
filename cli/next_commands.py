"""The command that follows another one, to be pasted as it stands.

In capitals stands what only the person knows: IMAGE, MARKERS, SESSION, KEY.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli.main import cli

from vfplan.display import command_of
from vfplan.errors import VfplanError

if TYPE_CHECKING:
    from vfplan.fixture import Fixture


def file_beside(path: Path, ending: str, suffix: str = ".h5") -> Path:
    """The name of a new file beside another: elbow.h5 and "signed" give elbow-signed.h5.

    Where that is there already, a number follows: elbow-signed-2.h5.
    """
    name = path.with_name(f"{path.stem}-{ending}{suffix}")
    number = 2
    while name.exists():
        name = path.with_name(f"{path.stem}-{ending}-{number}{suffix}")
        number += 1
    return name


def register_command(curve: Path, image: Path | None = None) -> str:
    """The command that carries a curve over by markers; `image`: the slice it was drawn on."""
    words = ["register", curve, "MARKERS"]
    if image is not None:
        words += ["--image", image]
    return command_of(*words, "-o", file_beside(curve, "fixture"))


def page_shows(fixture: Fixture, *, has_slice: bool) -> bool:
    """Whether the review page can show a fixture: a drawn curve that has its place on a slice."""
    record = fixture.registration
    is_placed = has_slice or fixture.frame == "image"
    is_placed = is_placed or (record is not None and record.source_frame == "image")
    return is_placed and fixture.curve is not None and fixture.mesh is None


def review_command(fixture: Path, image: Path | str | None, *, has_page: bool = True) -> str:
    """The command that shows a fixture to a person.

    image: the slice that it was drawn on, or "IMAGE" where only the person knows it; `None`: none
    has_page: whether the page can show it, as it does drawn curves; of others the sheet is drawn
    """
    words = ["review", fixture]
    if image is not None:
        words += ["--slice", image]
    if not has_page:
        return command_of(*words, "--sheet-out", file_beside(fixture, "sheet", ".png"))
    return command_of(*words, "-o", file_beside(fixture, "approved"))


def accept_command(fixture: Path, digest: str) -> str:
    """The command that accepts a fixture whose sheet a person has seen."""
    words = ["accept", fixture, "--digest", digest, "--by", "NAME"]
    return command_of(*words, "-o", file_beside(fixture, "approved"))


def sign_command(fixture: Path, *, case: str = "", robot_serial: str = "") -> str:
    """The command that signs a fixture which a person approved.

    case, robot_serial: what an earlier signature was for; the new one is for the same. Without a
        case the command asks for one, because a robot may demand it
    """
    words = ["sign", fixture, "--key", "KEY", *words_of_signature(case or "CASE", robot_serial)]
    return command_of(*words, "-o", file_beside(fixture, "signed"))


def verify_command(
    fixture: Path, keys: Path | str = "KEYS.pub", *, case: str = "", robot_serial: str = ""
) -> str:
    """The command that checks a signature, also that it is for this case and this robot."""
    return command_of("verify", fixture, "--keys", keys, *words_of_signature(case, robot_serial))


def words_of_signature(case: str, robot_serial: str) -> list[str]:
    """The options that name what a signature is for."""
    named = ("--case", case), ("--robot-serial", robot_serial)
    return [word for name, value in named if value for word in (name, value)]


def public_key_of(private_key: Path) -> Path | str:
    """The file with the public key: `keygen` names it so; a key from elsewhere may be without."""
    public = private_key.with_suffix(".pub")
    return public if public.exists() else "KEYS.pub"


def public_key_beside(fixture: Path, key_id: str) -> Path | str:
    """The file beside a bundle with the public key that signed it."""
    from vfplan.bundle.seal import read_keys

    for path in sorted(fixture.parent.glob("*.pub")):
        with suppress(VfplanError):
            if bytes.fromhex(key_id) in read_keys(path):
                return path
    return "KEYS.pub"


def approval_command(
    fixture: Path, seal: dict[str, Any], *, is_reviewed: bool, has_image: bool, has_page: bool
) -> str:
    """The command that is open on a sound bundle's way to the robot: review, sign or verify.

    seal: as `Seal.describe` gives it
    has_image: whether it was drawn on a slice
    has_page: as `review_command` takes it
    """
    if seal["signed"]:
        signed_for = {name: seal.get(name, "") for name in ("case", "robot_serial")}
        return verify_command(fixture, public_key_beside(fixture, seal["key_id"]), **signed_for)
    if is_reviewed:
        return sign_command(fixture)
    return review_command(fixture, "IMAGE" if has_image else None, has_page=has_page)


def page_command(*files: Path | None, output: Path, overwrites: bool = True) -> str:
    """The command that opens the review page of a slice and its markers, with the same options.

    overwrites: whether --overwrite, if it was typed, was meant for this output
    """
    words = ["review", *(file for file in files if file is not None)]
    return command_of(*words, *typed_options("review", overwrites=overwrites), "-o", output)


def flat_command(image: Path, *markers: Path | None) -> str:
    """The command that makes a photograph flat by its markers, with the same options."""
    words = ["rectify", image, *(file for file in markers if file is not None)]
    options = typed_options("rectify", overwrites=False)
    return command_of(*words, *options, "-o", file_beside(image, "flat", ".png"))


def typed_options(name: str, *, overwrites: bool) -> list[str]:
    """The options that were typed and that the command `name` has too, with their values.

    --json is left out: a person at the page reads text.
    overwrites: as `page_command` takes it
    """
    named = cli.get_command(click.Context(cli), name)
    takes_value = {
        opt: not (parameter.is_flag or parameter.count)
        for parameter in named.params
        if isinstance(parameter, click.Option)
        and not parameter.name.endswith(("as_json", "_out", "output", "paper"))
        for opt in parameter.opts
    }
    words = []
    typed = iter(sys.argv[2:])
    for word in typed:
        name, has_value, _ = word.partition("=")
        if name in takes_value and (overwrites or name != "--overwrite"):
            words.append(word)
            if takes_value[name] and not has_value:
                words.append(next(typed, ""))
    return words
