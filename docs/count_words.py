"""Count the words of the pages that people write, and the words a sentence.

    python docs/count_words.py            a row a page, and the sum
    python docs/count_words.py PAGE ...   these pages

Prose counts: no blocks of code, tables, headings, formulas, comments or pictures, and nothing
between backquotes. Pages that a command makes and the list of references are left out.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
NOT_COUNTED = ("cli.md", "findings.md", "references.md")
MAX_WORDS_A_SENTENCE = 20
"""On average over a page."""
NOT_PROSE = (
    r"(?ms)^```.*?^```[^\n]*$",  # fenced code
    r"(?m)^    (?! *[-*] ).*$",  # indented code
    r"(?s)<!--.*?-->",
    r"(?s)\$\$.*?\$\$",
    r"(?m)^#+ .*$",
    r"(?m)^\s*\|.*$",  # tables
    r"!\[[^\]]*\]\([^)]*\)",  # pictures
)
LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
PARAGRAPH = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.)\s)")
END_OF_SENTENCE = re.compile(r"(?<=[.?!])[\")*]*\s+(?=[A-Z0-9*(\"`$])")


class Count(NamedTuple):
    """The words and the sentences of a page."""

    words: int
    sentences: int

    @property
    def words_a_sentence(self) -> float:
        """On average; 0 for a page without prose."""
        return self.words / max(1, self.sentences)


def count(text: str) -> Count:
    """The words and sentences of a page's prose."""
    for pattern in NOT_PROSE:
        text = re.sub(pattern, "\n", text)
    text = LINK.sub(r"\1", text)
    text = re.sub(r"`[^`]*`", "`", text)
    words = sentences = 0
    for paragraph in PARAGRAPH.split(text):
        for sentence in END_OF_SENTENCE.split(" ".join(paragraph.split())):
            parts = re.findall(r"\S*[^\W_]\S*|`", sentence)
            words += len(parts)
            sentences += bool(parts)
    return Count(words, sentences)


def pages() -> list[Path]:
    """The pages that people write."""
    written = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in written if page.name not in NOT_COUNTED]


def main(arguments: list[str]) -> None:
    """Print a row a page, and the sum."""
    total = 0
    for page in [Path(argument).resolve() for argument in arguments] or pages():
        counted = count(page.read_text())
        total += counted.words
        name = str(page.relative_to(ROOT))
        print(f"{name:24} {counted.words:6} words {counted.words_a_sentence:6.1f} a sentence")
    print(f"{'':24} {total:6} words")


if __name__ == "__main__":
    main(sys.argv[1:])
