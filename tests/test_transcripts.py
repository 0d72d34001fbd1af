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


def test_no_page_has_a_transcript_that_the_reader_overlooks():
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        text = page.read_text()
        read = "".join(match[match.lastgroup] for match in transcripts.BLOCK.finditer(text))
        for row in text.splitlines():
            if row.lstrip().startswith("$ "):
                assert row in read, f"{page.name}: {row}"
