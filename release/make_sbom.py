"""Write the list of parts (SBOM) of an installed vfplan as CycloneDX 1.6 JSON.

    python release/make_sbom.py FILE.cdx.json            the base install
    python release/make_sbom.py FILE.cdx.json --all       with every extra

Each package that an install brings along is listed with version, licence and package URL, and with
the packages that it needs. Nothing but the standard library and `packaging` is used. With
SOURCE_DATE_EPOCH set, the same environment gives the same bytes.
"""

from __future__ import annotations

import json
import os
import re
import sys
import time
import uuid
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

NANOBIND_LICENCE = "BSD-3-Clause"
"""Of nanobind, which is compiled into vfplan's extension module."""


def main(arguments: list[str]) -> None:
    """Write the list of parts to the file that is named."""
    extras = {"all"} if "--all" in arguments else set()
    path = Path(next(argument for argument in arguments if not argument.startswith("--")))
    text = json.dumps(bill_of_materials("vfplan", extras), indent=2, sort_keys=True)
    path.write_text(text + "\n")
    print(f"wrote {path}")


def bill_of_materials(name: str, extras: set[str]) -> dict[str, Any]:
    """The CycloneDX document of an installed package and of all that it needs."""
    needs = needed_packages(name, extras)
    components = [component(distribution(package)) for package in sorted(needs) if package != name]
    components.append(compiled_in("nanobind", NANOBIND_LICENCE))
    dependencies = []
    for package in sorted(needs):
        dependencies.append({
            "ref": reference(distribution(package)),
            "dependsOn": [reference(distribution(other)) for other in sorted(needs[package])],
        })  # fmt: skip
    root = component(distribution(name)) | {"type": "application"}
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"timestamp": timestamp(), "component": root},
        "components": components,
        "dependencies": dependencies,
    }
    digest = json.dumps(document, sort_keys=True)
    document["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, digest)}"
    return document


def needed_packages(name: str, extras: set[str]) -> dict[str, set[str]]:
    """The package and all that it needs here, each with the packages that it needs itself."""
    needs: dict[str, set[str]] = {}
    open_packages = [(name, extras)]
    while open_packages:
        package, wanted = open_packages.pop()
        known = needs.setdefault(package, set())
        for text in distribution(package).requires or []:
            requirement = Requirement(text)
            other = canonical(requirement.name)
            if not is_wanted(requirement, wanted) or not is_installed(other):
                continue
            is_new = other not in needs
            if other != package:
                known.add(other)
            if is_new or requirement.extras:
                open_packages.append((other, set(requirement.extras)))
    return needs


def is_wanted(requirement: Requirement, extras: set[str]) -> bool:
    """Whether a requirement holds on this platform, for the package or for one of its extras."""
    if requirement.marker is None:
        return True
    return any(requirement.marker.evaluate({"extra": extra}) for extra in ("", *extras))


def is_installed(name: str) -> bool:
    """Whether the package is here; one that is needed on another platform only is not."""
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def canonical(name: str) -> str:
    """A package's name as the index spells it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def component(package: Distribution) -> dict[str, Any]:
    """One part: name, version, licence and package URL."""
    part = {
        "type": "library",
        "name": canonical(package.metadata["Name"]),
        "version": package.version,
        "purl": reference(package),
        "bom-ref": reference(package),
    }
    licence = licence_of(package)
    if licence:
        part["licenses"] = [{"license": {"name": licence}}]
    return part


def compiled_in(name: str, licence: str) -> dict[str, Any]:
    """A part whose code is compiled into vfplan; its version is that of the build."""
    part = {"type": "library", "name": name, "scope": "required", "bom-ref": f"compiled-in/{name}"}
    if is_installed(name):
        part |= {"version": distribution(name).version, "purl": reference(distribution(name))}
    return part | {"licenses": [{"license": {"name": licence}}]}


def reference(package: Distribution) -> str:
    """The package URL."""
    return f"pkg:pypi/{canonical(package.metadata['Name'])}@{package.version}"


def licence_of(package: Distribution) -> str:
    """The licence that a package states, in one line."""
    metadata = package.metadata
    if metadata.get("License-Expression"):
        return metadata["License-Expression"]
    for classifier in metadata.get_all("Classifier") or []:
        if classifier.startswith("License ::"):
            return classifier.rsplit(" :: ", 1)[-1]
    stated = (metadata.get("License") or "").strip()
    if "\n" in stated:  # the whole text of a licence
        return stated.splitlines()[0][:80]
    return stated


def timestamp() -> str:
    """The time of SOURCE_DATE_EPOCH, or of now."""
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))


if __name__ == "__main__":
    main(sys.argv[1:])
