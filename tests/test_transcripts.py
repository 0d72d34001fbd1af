"""The program that renews the pages' transcripts: what it reads, runs, keeps and leaves alone."""

from __future__ import annotations

import pytest
from conftest import ROOT
from docs_modules import load

transcripts = load(ROOT / "docs" / "make_transcripts.py")

PAGE = """Text, and $ not a command.

    $ printf 'a 1\\n b 2\\n\\nc 3\\n'
    a 0

    c 0

    x = 1 in a block that is no transcript

```console
$ printf 'one\\n' > made; \\
      cat made
old
$ printf hidden
$ printf '%s\\n' first more -- middle -- last
first
...
middel
...
```
"""

NOW = (
    PAGE.replace("    a 0\n\n    c 0\n", "    a 1\n     b 2\n\n    c 3\n")
    .replace("\nold\n", "\none\n")
    .replace("middel", "middle")
)


def test_page_holds_what_its_commands_print_in_its_own_form(capfd):
    page = PAGE.replace("    x = 1", "End of it.\n\n    x = 1")
    now = NOW.replace("    x = 1", "End of it.\n\n    x = 1")
    assert transcripts.renewed("page.md", page) == now
    assert transcripts.renewed("page.md", now) == now
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        ("$ vfplan info FILE.h5\nold\n", "FILE.h5 stands for something"),
        ("$ printf x\n$ sudo true\nold\n", "calls sudo"),
        ("$ vfplan info nowhere.h5\nold\n", "there is no such file"),
        ("$ python nowhere.py\nold\n", "No such file"),
        ("$ printf entirely\nfirst\n...\nsecond\n", "prints nothing like 'first' any more"),
    ],
)
def test_what_cannot_be_run_is_left_alone_and_named(block, reason, capfd):
    page = f"# Page\n\n```\n{block}```\n"
    assert transcripts.renewed("page.md", page) == page
    named = capfd.readouterr().err
    assert named.startswith("page.md:4: ")
    assert reason in named


def test_an_error_that_the_page_shows_is_renewed():
    page = "```\n$ vfplan info nowhere.h5\nvfplan: error: there is no such file\n```\n"
    now = transcripts.renewed("page.md", page)
    assert "\nvfplan: error: nowhere.h5: cannot be read: there is no such file" in now


@pytest.mark.parametrize(
    ("shown", "printed", "kept"),
    [
        ("time a tick  0.3 µs, 70 times real time", "time a tick  0.4 µs, 9 times real time", True),
        ("time a tick  0.3 µs median", "time a tick  0.3 µs mean", False),
        ("for 12.2 s, 3 mm", "for 12.3 s, 3 mm", False),
        ("2026-11-21T08:42:21Z from 0.1", "2027-01-02T03:04:05Z from 0.1", True),
        ("2026-11-21T08:42:21Z from 0.1", "2027-01-02T03:04:05Z from 1.0", False),
        (f"signed by key {'0a' * 16}", f"signed by key {'1b' * 16}", True),
        (f"/@id = {'0a' * 16}", f"/@id = {'1b' * 16}", False),
    ],
)
def test_only_what_every_run_prints_anew_stays(shown, printed, kept):
    assert transcripts.merged([shown], [printed]) == [shown if kept else printed]


def test_lines_are_left_out_where_they_were():
    printed = ["head 1", "head 2", "row a 5", "row b 6 marked", "row c 7", "foot 8", "foot 9"]
    shown = ["head 0", "head 0", "  ...", "row b 0 marked", "  ...", "foot 0", "foot 9"]
    now = ["head 1", "head 2", "  ...", "row b 6 marked", "  ...", "foot 8", "foot 9"]
    assert transcripts.merged(shown, printed) == now
    assert transcripts.merged(["...", "foot 0"], printed) == ["...", "foot 8", "foot 9"]
    assert transcripts.merged(["..."], printed) == ["..."]
    assert transcripts.merged([], printed) == []


def test_no_page_has_a_transcript_that_the_reader_overlooks():
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        text = page.read_text()
        read = "".join(match[match.lastgroup] for match in transcripts.BLOCK.finditer(text))
        for row in text.splitlines():
            if row.lstrip().startswith("$ "):
                assert row in read, f"{page.name}: {row}"
