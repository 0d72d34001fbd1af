"""The program that renews the pages' transcripts: what it reads, runs, keeps and leaves alone."""

from __future__ import annotations

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


def test_no_page_has_a_transcript_that_the_reader_overlooks():
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        text = page.read_text()
        read = "".join(match[match.lastgroup] for match in transcripts.BLOCK.finditer(text))
        for row in text.splitlines():
            if row.lstrip().startswith("$ "):
                assert row in read, f"{page.name}: {row}"
