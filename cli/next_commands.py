"""The command that follows another one, to be pasted as it stands.

In capitals stands what only the person knows: IMAGE, MARKERS, SESSION, CASE.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click
from vfplan.cli.main import cli
from vfplan.cli.options import SETTINGS, SIGNED_FOR, settings_of_file

from vfplan.display import Report, command_of
from vfplan.errors import VfplanError
from vfplan.settings import option_words

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.markers.correspondences import Correspondences


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
    return (has_slice or "image" in frames) and fixture.curve is not None and fixture.mesh is None


def review_command(fixture: Path, image: Path | None, *, has_page: bool = True) -> str:
    """The command that shows a fixture to a person.

    image: the slice that it was drawn on, or a folder that is searched for it; `None`: none
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


def sign_command(fixture: Path, signed_for: Report) -> str:
    """The command that signs a fixture which a person approved.

    signed_for: what an earlier signature was for, if there is one; the new one is for the same.
        Without a case the command asks for one, because a robot may demand it
    """
    first, key = private_key_beside(fixture)
    words = ["sign", fixture, "--key", key]
    words += words_of_signature(signed_for | {"case": signed_for.get("case") or "CASE"})
    return first + command_of(*words, "-o", file_beside(fixture, "signed"))


def private_key_beside(fixture: Path) -> tuple[str, Path | str]:
    """What makes a private key first, where none is here or beside a bundle, and the key's file.

    Of several keys only the person knows whose signature it is to be: "KEY".
    """
    from vfplan.bundle.seal import read_private

    keys = {}
    for path in (*Path().glob("*.key"), *fixture.parent.glob("*.key")):
        with suppress(VfplanError):
            read_private(path)
            keys.setdefault(path.resolve(), path)
    if keys:
        return "", next(iter(keys.values())) if len(keys) == 1 else "KEY"
    new = Path("planner.key")
    if new.exists():
        new = file_beside(new, "new", ".key")
    return f"{command_of('keygen', '-o', new)} && ", new


def verify_command(fixture: Path, keys: Path | str, signed_for: Report) -> str:
    """The command that checks a signature, also that it is for this case and this robot."""
    return command_of("verify", fixture, "--keys", keys, *words_of_signature(signed_for))


def words_of_signature(signed_for: Report) -> Iterator[str]:
    """The options that name what a signature is for: `case` and `robot_serial`."""
    for name, demand in SIGNED_FOR.items():
        if signed_for.get(name):
            yield from (demand.split()[0], signed_for[name])


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


def approval_command(fixture: Path, content: Report) -> str:
    """The command that is open on a sound bundle's way to the robot: review, sign or verify.

    content: what it holds, as `vfplan.bundle.validation.describe` gives it
    """
    seal = content["seal"]
    if seal["signed"]:
        return verify_command(fixture, public_key_beside(fixture, seal["key_id"]), seal)
    if content["reviewed"] is not None:
        return sign_command(fixture, {"case": content.get("/@case")})
    has_image = any(path.startswith("/image@") for path in content)
    has_page = "/curve/stroke" in content and "/mesh/triangles" not in content
    return review_command(fixture, fixture.parent if has_image else None, has_page=has_page)


def page_command(
    *files: Path | None, output: Path, overwrites: bool = True, leaving_out: Sequence[str] = ()
) -> str:
    """The command that opens the review page of a slice and its markers, with the same options.

    overwrites: whether --overwrite, if it was typed, was meant for this output
    leaving_out: as `typed_options` takes it
    """
    first, typed = "", typed_options("review", overwrites=overwrites, leaving_out=leaving_out)
    names = {word.partition("=")[0] for word in typed}
    if "--case" in names and "--key" not in names:
        # The page gives a plan its case by a signature.
        first, key = private_key_beside(output)
        typed += ["--key", key]
    return first + command_of("review", *files, *typed, "-o", output)


def rectify_command(
    image: Path, markers: Path, markers2: Path | None = None, *, output: Path,
    overwrites: bool = True,
) -> str:  # fmt: skip
    """The two commands that make a photograph flat and plan on it, with the same options.

    output, overwrites: of the plan, as `page_command` takes them
    """
    from vfplan.markers.correspondences import read_markers

    pairs = read_markers(markers, markers2, common=True)
    flat = file_beside(Path(image.name), "flat", ".png")
    typed = typed_options("rectify", overwrites=False, leaving_out=["--settings"])
    rectify = command_of("rectify", image, markers, markers2, *typed, "-o", flat)
    plan = plan_flat_command(flat, pairs, markers2, output=output, overwrites=overwrites)
    return f"{rectify} && {plan}"


# Options of `plan` that say something of a photograph, and not of the flat picture.
OF_PHOTOGRAPH = (
    "--frame", "--page", "--pixels", "--find-markers", "--pixel-spacing", "--imager-spacing",
)  # fmt: skip

# Options of `plan` that name places on a photograph: what stands for those on the flat picture.
PLACES = {
    "--roi": "U,V,W,H", "--exclude": "U,V,W,H", "--start": "U,V", "--end": "U,V",
    "--curve": "CURVE",
}  # fmt: skip


def plan_flat_command(
    flat: Path, pairs: Correspondences, markers2: Path | None, *, output: Path,
    overwrites: bool = False,
) -> str:  # fmt: skip
    """The command that plans on the flat picture of a photograph, with the same options.

    pairs, markers2: the markers, and the file of their other side if that is a file of its own
    """
    words = ["plan", flat, flat_markers(flat)]
    leaving_out = [*OF_PHOTOGRAPH, "--settings", "-o", "--output"]
    if pairs.target_frame == "robot_base" or markers2 is None:
        # The table beside the flat picture holds both sides.
        leaving_out.append("--common")
    else:
        words.append(markers2)
    words += typed_options(
        "plan", overwrites=overwrites, leaving_out=leaving_out, all_outputs=True, instead=PLACES
    )
    return command_of(*words, "-o", output)


def flat_markers(picture: Path) -> Path:
    """Where the places of the markers on a flat picture stand."""
    return picture.with_name(f"{picture.stem}_markers.csv")


def typed_options(
    name: str, *, overwrites: bool, leaving_out: Sequence[str] = (), all_outputs: bool = False,
    instead: Mapping[str, str] = {},
) -> list[str]:  # fmt: skip
    """The options that were typed and that the command `name` has too, with their values.

    --json is left out: a person at the page reads text.
    overwrites: as `page_command` takes it
    leaving_out: options that mean something else to the other command; without --settings its
        file's own settings stand there, of those whose options are not left out
    all_outputs: whether the other command writes the pictures that were asked for too
    instead: what stands in place of the value of an option
    """
    unwanted = ("as_json",) if all_outputs else ("as_json", "_out", "output", "paper")
    takes_value = {}
    for parameter in cli.get_command(click.Context(cli), name).params:
        if isinstance(parameter, click.Option) and not parameter.name.endswith(unwanted):
            takes_value |= dict.fromkeys(parameter.opts, not (parameter.is_flag or parameter.count))
    if not overwrites:
        leaving_out = (*leaving_out, "--overwrite")
    words = []
    typed = iter(sys.argv[2:])
    for word in typed:
        option, equals, value = word.partition("=")
        if option not in takes_value or option in leaving_out:
            continue
        if equals:
            words.append(f"{option}={instead.get(option, value)}")
        elif takes_value[option]:
            words += [option, instead.get(option, next(typed, ""))]
        else:
            words.append(option)
    if "--settings" not in leaving_out:
        return words
    path = click.get_current_context().params["settings_file"]
    if path is not None:
        chosen, kept = settings_of_file(path), {}
        for setting in SETTINGS:
            option = f"--{option_words(setting)[-1]}"
            if setting.name in chosen and option in takes_value and option not in leaving_out:
                kept[setting.name] = instead.get(option, chosen[setting.name])
        if kept:
            words += ["--settings", json.dumps(kept)]
    return words
