"""Pages stay short: sentences of 20 words on average at most, and a book that can be read."""

from __future__ import annotations

import pytest
from conftest import ROOT
from docs_modules import load

words = load(ROOT / "docs" / "count_words.py")
MOST_WORDS = 20_000
"""Of prose on all pages together."""


@pytest.mark.parametrize("page", words.pages(), ids=lambda page: page.stem)
def test_sentences_are_short(page):
    counted = words.count(page.read_text())
    assert counted.words_a_sentence <= words.MAX_WORDS_A_SENTENCE


def test_all_pages_together_are_no_more_than_a_book():
    assert sum(words.count(page.read_text()).words for page in words.pages()) <= MOST_WORDS


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("One two. Three `a b` four.", (5, 2)),
        ("# No heading\n\n| no | table |\n\n    no code\n\nOne [two](x.md).", (2, 1)),
        ("- One\n- Two three", (3, 2)),
        ("```text\nno code. None.\n```\n<!-- none -->", (0, 0)),
        ("One e.g. two: three 4 µm.", (6, 1)),
    ],
)
def test_only_prose_is_counted(text, expected):
    assert words.count(text) == expected
