"""Folders of public keys beside a bundle, right and wrong."""

from __future__ import annotations

from pathlib import Path

# Text beside the key PEM of a file of keys, whether it may stand there, and what is said if not.
BESIDE = {
    "blank_lines": (b"\n \t\r\n%s\r\n\n", None),
    "comments": (b"# alice, until 2027\n%s  # no more\n# end", None),
    "text_after": (b"%sand bob's, which is elsewhere\n", "Line 4"),
    "text_before": (b"alice\n%s", "Line 1"),
    "half_a_key_after": (b"%s-----BEGIN PUBLIC KEY-----\nMCow\n", "ends within"),
    "a_damaged_key_first": (
        b"-----BEGIN PUBLIC KEY-----\nMCow!\n-----END PUBLIC KEY-----\n%s",
        "cannot be read",
    ),
    "a_private_key": (
        b"%s-----BEGIN PRIVATE KEY-----\nMC4CAQ==\n-----END PRIVATE KEY-----",
        "Line 4",
    ),
    "text_on_the_last_line": (b"%s\0", "Line 4"),
}  # fmt: skip


def keys_beside(name, folder):
    """A file of keys with something beside the key."""
    path = folder / f"{name}.pub"
    path.write_bytes(BESIDE[name][0] % SIGNED_PUB.read_bytes())
    return path


SIGNED_PUB = Path(__file__).parents[1] / "data" / "bundles" / "signed.pub"
