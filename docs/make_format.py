"""Write the tables of docs/format.md and the C++ constants from schemas/bundle-2.0.json.

python docs/make_format.py        (part of `make docs`; the tests compare both with the schema)
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

from vfplan.bundle.content import Row, document, table

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "format.md"
HEADER = ROOT / "vfplan" / "native" / "include" / "vfplan" / "bundle" / "schema.hpp"


def shape_cell(row: Row) -> str:
    """Type and shape, the shape as Python writes it."""
    if row.kind == "group":
        return "group"
    if row.kind == "attribute":
        return f"{row.type}"
    shape = ", ".join(map(str, row.shape))
    if len(row.shape) == 1:
        shape += ","
    return f"{row.type} ({shape})"


def range_cell(row: Row) -> str:
    """What is allowed."""
    if row.allowed:
        return " \\| ".join(f"`{value}`" for value in row.allowed)
    parts = []
    if row.above is not None:
        parts.append(f"> {row.above:g}")
    if row.min is not None:
        parts.append(f"≥ {row.min:g}")
    if row.max is not None:
        parts.append(f"≤ {row.max:g}")
    for unit, limit in (row.max_abs or {}).items():
        parts.append(f"abs ≤ {limit:g} {unit}")
    return ", ".join(parts)


def required_cell(row: Row) -> str:
    """Whether it must be held, in the words of the specification."""
    if row.required == "optional":
        return "MAY"
    if row.required == "rendering":
        return "V18"
    return "MUST"


def rows_table() -> str:
    """The normative table: a line for everything a bundle may hold."""
    lines = [
        "| path | type and shape | unit | frame | range | required | mark | meaning |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in table():
        cells = [
            f"`{row.path}`",
            shape_cell(row),
            row.unit or "",
            row.frame or "",
            range_cell(row),
            required_cell(row),
            row.mark or "",
            row.meaning,
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def sizes_table() -> str:
    """The sizes that shapes name, and the limits a reader holds to."""
    data = document()
    lines = ["| size | meaning | at most |", "|---|---|---|"]
    for letter, size in data["sizes"].items():
        lines.append(f"| {letter} | {size['meaning']} | {size['max']} |")
    for name, limit in data["limits"].items():
        lines.append(f"| | {name.replace('_', ' ')} | {limit} |")
    return "\n".join(lines)


def page(text: str) -> str:
    """The page with the text between its markers replaced."""
    text = with_table(text, "rows", rows_table())
    return with_table(text, "sizes", sizes_table())


def with_table(text: str, name: str, lines: str) -> str:
    """The page with a table in its place."""
    pattern = rf"(<!-- {name}: made by docs/make_format.py -->\n).*?(\n<!-- end -->)"
    text, count = re.subn(pattern, lambda match: match[1] + lines + match[2], text, flags=re.S)
    if count != 1:
        raise ValueError(f"The page has {count} places for the table of {name}. Give it one.")
    return text


def cpp_text(text: str) -> str:
    """A text in C++."""
    return f'"{text}"'


def cpp_version(text: str) -> str:
    """A version in C++."""
    return "{" + ", ".join(text.split(".")) + "}"


def cpp_row(row: Row) -> str:
    """One line of the table in C++: what differs from the members' defaults."""
    cells = {"path": cpp_text(row.path), "kind": f"Kind::{row.kind}"}
    if row.type:
        cells["type"] = f"Type::{row.type}"
    if row.required != "optional":
        cells["required"] = f"Required::{row.required}"
    if row.shape:
        cells["shape"] = "{" + ", ".join(cpp_text(str(side)) for side in row.shape) + "}"
    for name, text in (("unit", row.unit), ("frame", row.frame)):
        if text:
            cells[name] = cpp_text(text)
    if row.allowed:
        cells["allowed"] = cpp_text("|".join(row.allowed))
    largest = row.max_abs or {}
    for name, number in (
        ("min", row.min), ("max", row.max), ("above", row.above),
        ("max_abs_m", largest.get("m")), ("max_abs_px", largest.get("px")),
    ):  # fmt: skip
        if number is not None:
            cells[name] = str(float(number))
    if row.mark:
        cells["mark"] = f"Mark::{row.mark}"
    if row.form:
        cells["form"] = f"Form::{row.form}"
    if row.needs:
        cells["needs"] = cpp_text(row.needs)
    if row.frames:
        cells["frames"] = cpp_text("|".join(row.frames))
    if row.unique:
        cells["unique"] = "true"
    return "    {" + ", ".join(f".{name} = {text}" for name, text in cells.items()) + "},"


def header() -> str:
    """The C++ constants: the whole of vfplan/bundle/schema.hpp."""
    data = document()
    rows = table()
    limits = []
    for name, value in data["limits"].items():
        limits.append(f"inline constexpr std::uint64_t {name} = {value};")
    sizes = [f"Size{{'{letter}',~{size['max']}}}" for letter, size in data["sizes"].items()]
    lines = textwrap.fill(", ".join(sizes), 100, initial_indent="    ", subsequent_indent="    ")
    newline = "\n"
    return f"""// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Made by docs/make_format.py from schemas/bundle-{data["version"]}.json: do not edit.
// clang-format off
#pragma once

#include "vfplan/base/vec.hpp"
#include "vfplan/bundle/bytes.hpp"

namespace vfplan::bundle {{

enum class Kind {{ group, dataset, attribute }};
enum class Type {{ none, text, f8, i4, u1 }};
enum class Required {{ always, group, rendering, optional }};
/// What an engine renders, or what is reviewed beside it: a review's digest covers both.
enum class Mark {{ none, rendered, reviewed }};
/// What a text must be.
enum class Form {{ any, name, plain, utc, sha256, setting }};

inline constexpr Version newest{cpp_version(data["version"])};

/// One thing a bundle may hold; an empty text means that there is none.
struct Row {{
    std::string_view path;
    Kind kind;
    Type type = Type::none;
    Required required = Required::optional;
    std::array<std::string_view, 2> shape{{}};  // a number, or the letter of a size
    std::string_view unit{{}};                  // "@frame", "@source_frame": px in image, else m
    std::string_view frame{{}};
    std::string_view allowed{{}};  // separated by |
    double min = -infinity, max = infinity, above = -infinity;
    double max_abs_m = infinity, max_abs_px = infinity;
    Mark mark = Mark::none;
    Form form = Form::any;
    std::string_view needs{{}};   // the path of a value that is there if this one is, and only then
    std::string_view frames{{}};  // of the points, in which it may be there; separated by |
    bool unique = false;         // its texts differ, and none is empty
}};

/// The schema's names of types.
inline constexpr std::array<std::string_view, 5> type_names{{"none", "text", "f8", "i4", "u1"}};

/// The most that a shape's letter may stand for.
struct Size {{
    char letter;
    std::uint64_t max;
}};

inline constexpr std::string_view format_name = "{data["format"]}";
inline constexpr std::string_view format_version = "{data["version"]}";

namespace limits {{
{newline.join(limits)}
}}  // namespace limits

inline constexpr std::array<Size, {len(data["sizes"])}> sizes{{
{lines.replace("~", " ")}
}};

inline constexpr std::array<Row, {len(rows)}> rows{{{{
{newline.join(map(cpp_row, rows))}
}}}};

}}  // namespace vfplan::bundle
"""


if __name__ == "__main__":
    HEADER.write_text(header())
    if PAGE.exists():
        PAGE.write_text(page(PAGE.read_text()))
