"""The command that follows another one, to be pasted as it stands.

In capitals stands what only the person knows: IMAGE, MARKERS, SESSION, KEY.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
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
    frames = fixture.frame, getattr(fixture.registration, "source_frame", None)
    is_placed = has_slice or "image" in frames
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


def sign_command(fixture: Path, signed_for: dict[str, Any]) -> str:
    """The command that signs a fixture which a person approved.

    signed_for: what an earlier signature was for, if there is one; the new one is for the same.
        Without a case the command asks for one, because a robot may demand it
    """
    words = ["sign", fixture, "--key", "KEY"]
    words += words_of_signature(signed_for | {"case": signed_for.get("case") or "CASE"})
    return command_of(*words, "-o", file_beside(fixture, "signed"))


def verify_command(fixture: Path, keys: Path | str, signed_for: dict[str, Any]) -> str:
    """The command that checks a signature, also that it is for this case and this robot."""
    return command_of("verify", fixture, "--keys", keys, *words_of_signature(signed_for))


def words_of_signature(signed_for: dict[str, Any]) -> list[str]:
    """The options that name what a signature is for: `case` and `robot_serial`."""
    words = []
    for option, name in (("--case", "case"), ("--robot-serial", "robot_serial")):
        if signed_for.get(name):
            words += [option, signed_for[name]]
    return words


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
    fixture: Path, seal: dict[str, Any], *, case: str | None, is_reviewed: bool, has_image: bool,
    has_page: bool,
) -> str:  # fmt: skip
    """The command that is open on a sound bundle's way to the robot: review, sign or verify.

    seal: as `Seal.describe` gives it
    case: what the bundle is for, where it says so
    has_image: whether it was drawn on a slice
    has_page: as `review_command` takes it
    """
    if seal["signed"]:
        return verify_command(fixture, public_key_beside(fixture, seal["key_id"]), seal)
    if is_reviewed:
        return sign_command(fixture, {"case": case})
    return review_command(fixture, "IMAGE" if has_image else None, has_page=has_page)


def page_command(*files: Path | None, output: Path, overwrites: bool = True) -> str:
    """The command that opens the review page of a slice and its markers, with the same options.

    overwrites: whether --overwrite, if it was typed, was meant for this output
    """
    typed = typed_options("review", overwrites=overwrites)
    names = {word.partition("=")[0] for word in typed}
    if "--case" in names and "--key" not in names:
        # The page gives a plan its case by a signature.
        typed += ["--key", "KEY"]
    return command_of("review", *files, *typed, "-o", output)


def rectify_command(
    image: Path, markers: Path, markers2: Path | None = None, *, output: Path,
    overwrites: bool = True,
) -> str:  # fmt: skip
    """The two commands that make a photograph flat and plan on it, with the same options.

    output, overwrites: of the plan, as `page_command` takes them
    """
    from vfplan.markers.correspondences import read_markers

    flat = file_beside(Path(image.name), "flat", ".png")
    words = [image, markers, markers2, *typed_options("rectify", overwrites=False), "-o", flat]
    pairs = read_markers(markers, markers2, common=True)
    plan = plan_flat_command(flat, pairs, markers2, output=output, overwrites=overwrites)
    return f"{command_of('rectify', *words)} && {plan}"


# Options of `plan` that say something of a photograph, and not of the flat picture.
OF_PHOTOGRAPH = ("--frame", "--pixels", "--find-markers", "--pixel-spacing", "--imager-spacing")

# Options of `plan` that name places on a photograph: what stands for those on the flat picture.
PLACES = {
    "--roi": "U,V,W,H", "--exclude": "U,V,W,H", "--start": "U,V", "--end": "U,V",
    "--curve": "CURVE",
}  # fmt: skip


def plan_flat_command(
    flat: Path, pairs: Any, markers2: Path | None, *, output: Path, overwrites: bool = False
) -> str:
    """The command that plans on the flat picture of a photograph, with the same options.

    pairs: the markers; the table beside the flat picture holds both sides of those in robot_base
    markers2: the file of their other side
    """
    words, leaving_out = ["plan", flat, flat_markers(flat)], [*OF_PHOTOGRAPH, "-o", "--output"]
    if pairs.target_frame == "robot_base":
        leaving_out.append("--common")
    else:
        words.append(markers2)
    typed = typed_options("plan", overwrites=overwrites, leaving_out=leaving_out, all_outputs=True)
    for number, word in enumerate(typed):
        name, has_value, _ = word.partition("=")
        if name in PLACES and has_value:
            typed[number] = f"{name}={PLACES[name]}"
        elif name in PLACES:
            typed[number + 1] = PLACES[name]
    return command_of(*words, *typed, "-o", output)


def flat_markers(flat: Path) -> Path:
    """Where the places of the markers on a flat picture stand."""
    return flat.with_name(f"{flat.stem}_markers.csv")


def typed_options(
    name: str, *, overwrites: bool, leaving_out: Sequence[str] = (), all_outputs: bool = False
) -> list[str]:
    """The options that were typed and that the command `name` has too, with their values.

    --json is left out: a person at the page reads text.
    overwrites: as `page_command` takes it
    leaving_out: options that mean something else to the other command
    all_outputs: whether the other command writes the pictures that were asked for too
    """
    others = ("as_json",) if all_outputs else ("as_json", "_out", "output", "paper")
    named = cli.get_command(click.Context(cli), name)
    takes_value = {
        opt: not (parameter.is_flag or parameter.count)
        for parameter in named.params
        if isinstance(parameter, click.Option)
        and not parameter.name.endswith(others)
        for opt in parameter.opts if opt not in leaving_out
    }  # fmt: skip
    words = []
    typed = iter(sys.argv[2:])
    for word in typed:
        name, has_value, _ = word.partition("=")
        if name in takes_value and (overwrites or name != "--overwrite"):
            words.append(word)
            if takes_value[name] and not has_value:
                words.append(next(typed, ""))
    return words
