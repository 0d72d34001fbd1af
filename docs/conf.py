"""Settings of the documentation site: `make site` builds it into build/site, with Sphinx and MyST.

The pages are written for a reader of the source tree. Two things are changed for the site: links to
files outside docs/ become the file's path, and the index gets the tree of pages.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
VERSION = re.search(
    r'VFPLAN_VERSION "(.*)"',
    (ROOT / "vfplan" / "native" / "include" / "vfplan" / "version.hpp").read_text(),
)[1]

project = "vfplan"
author = "the vfplan authors"
copyright = f"2026, {author}"  # noqa: A001 - Sphinx reads this name
release = VERSION
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["*.py", "*.toml", "Doxyfile"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
suppress_warnings = ["misc.highlighting_failure"]
html_theme = "alabaster"
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "description": "From a drawn line to a virtual fixture. Not a medical device.",
    "fixed_sidebar": True,
    "page_width": "1100px",
    "sidebar_width": "260px",
}
html_sidebars = {"**": ["about.html", "searchbox.html", "navigation.html"]}

OUTSIDE = re.compile(r"\[([^\]]*)\]\(((?:\.\./)+[^)\s#]*)[^)]*\)")
"""A Markdown link that begins with `../`."""


def setup(app):
    """Register what changes the pages for the site."""
    app.connect("source-read", prepare)


def prepare(app, name, source):
    """Name files outside docs/ in place of a link to them, and give the index its tree of pages."""
    page = DOCS / f"{name}.md"
    source[0] = OUTSIDE.sub(lambda match: without_outside_link(page, match), source[0])
    if name == root_doc:
        source[0] += tree_of_pages()


def without_outside_link(page: Path, match: re.Match) -> str:
    """The link as it is where it leads to a page, else its text and the file's path."""
    target = (page.parent / match[2]).resolve()
    if target.is_relative_to(DOCS):
        return match[0]
    path = target.relative_to(ROOT)
    if str(path) in match[1]:
        return match[1]
    return f"{match[1]} (`{path}`)"


def tree_of_pages() -> str:
    """The pages by their kinds, for the navigation beside each page."""
    tree = ""
    for kind, pages in tomllib.loads((DOCS / "site.toml").read_text())["pages"].items():
        names = "\n".join(pages)
        tree += f"\n```{{toctree}}\n:hidden:\n:caption: {kind}\n\n{names}\n```\n"
    return tree
