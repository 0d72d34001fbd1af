"""Write the tables of docs/format.md and the C++ constants from schemas/bundle-2.0.json.

python docs/make_format.py        (part of `make docs`; the tests compare both with the schema)
"""

from __future__ import annotations

import re
from pathlib import Path

from vfplan.bundle.schema import Row, document, table

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "format.md"
HEADER = ROOT / "vfplan" / "native" / "include" / "vfplan" / "bundle" / "schema.hpp"


def _shape(row: Row) -> str:
    if row.kind == "group":
        return "group"
    if row.kind == "attribute":
        return f"{row.type}"
    return f"{row.type} ({', '.join(map(str, row.shape))}{',' if len(row.shape) == 1 else ''})"


def _range(row: Row) -> str:
    if row.allowed:
        return " \\| ".join(f"`{value}`" for value in row.allowed)
    parts = [f"> {row.above:g}"] if row.above is not None else []
    parts += [f"≥ {row.min:g}"] if row.min is not None else []
    parts += [f"≤ {row.max:g}"] if row.max is not None else []
    parts += [f"abs ≤ {cap:g} {unit}" for unit, cap in (row.max_abs or {}).items()]
    return ", ".join(parts)


def _needed(row: Row) -> str:
    if row.required == "optional":
        return "MAY"
    if row.required == "rendering":
        return "V18"
    return "MUST"


def rows_table() -> str:
    """The normative table: a line for everything a bundle may hold."""
    lines = [
        "| path | type and shape | unit | frame | range | required | meaning |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in table():
        cells = (_shape(row), row.unit or "", row.frame or "", _range(row), _needed(row))
        lines.append(f"| `{row.path}` | " + " | ".join(cells) + f" | {row.meaning} |")
    return "\n".join(lines)


def sizes_table() -> str:
    """The sizes that shapes name, and the limits a reader holds to."""
    data = document()
    lines = ["| size | meaning | at most |", "|---|---|---|"]
    lines += [f"| {s} | {e['meaning']} | {e['max']} |" for s, e in data["sizes"].items()]
    lines += [f"| | {n.replace('_', ' ')} | {v} |" for n, v in data["limits"].items()]
    return "\n".join(lines)


def page(text: str) -> str:
    """The page with the text between its markers replaced."""
    for name, made in (("rows", rows_table()), ("sizes", sizes_table())):
        pattern = rf"(<!-- {name}: made by docs/make_format.py -->\n).*?(\n<!-- end -->)"
        text, found = re.subn(pattern, lambda m, made=made: m[1] + made + m[2], text, flags=re.S)
        if found != 1:
            raise ValueError(f"{found} places for the table of {name} in the page; 1 wanted")
    return text


def _number(value: float | None, absent: str) -> str:
    return absent if value is None else repr(float(value))


def _quoted(text: str | None) -> str:
    return '""' if text is None else f'"{text}"'


def _version(text: str) -> str:
    return "{" + ", ".join(text.split(".")) + "}"


def _cpp_row(row: Row) -> str:
    shape = [str(s) if isinstance(s, str) else str(int(s)) for s in row.shape] + ["", ""]
    cells = [
        _quoted(row.path),
        f"Kind::{row.kind}",
        f"Type::{row.type or 'none'}",
        f"Required::{row.required}",
        f"{{{_quoted(shape[0])}, {_quoted(shape[1])}}}",
        _quoted(row.unit),
        _quoted(row.frame),
        _quoted("|".join(row.allowed or ())),
        _number(row.min, "-infinity"),
        _number(row.max, "infinity"),
        _number(row.above, "-infinity"),
        _number((row.max_abs or {}).get("m"), "infinity"),
        _number((row.max_abs or {}).get("px"), "infinity"),
        _version(row.since),
    ]
    return "    Row{" + ", ".join(cells) + "},"


def header() -> str:
    """The C++ constants: the whole of vfplan/bundle/schema.hpp."""
    data, rows = document(), table()
    limits = "\n".join(
        f"inline constexpr std::uint64_t {name} = {value};"
        for name, value in data["limits"].items()
    )
    sizes = "\n".join(f"    Size{{'{s}', {e['max']}}}," for s, e in data["sizes"].items())
    return f"""// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Made by docs/make_format.py from schemas/bundle-{data["version"]}.json: do not edit.
// clang-format off
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>

#include "vfplan/bundle/bytes.hpp"

namespace vfplan::bundle {{

enum class Kind {{ group, dataset, attribute }};
enum class Type {{ none, text, f8, i4, u1 }};
enum class Required {{ always, group, rendering, optional }};

inline constexpr double infinity = std::numeric_limits<double>::infinity();

/// One thing a bundle may hold; an empty text means that there is none.
struct Row {{
    std::string_view path;
    Kind kind;
    Type type;
    Required required;
    std::array<std::string_view, 2> shape;  // a number, or the letter of a size
    std::string_view unit;                  // "@frame", "@source_frame": px in image, else m
    std::string_view frame;
    std::string_view allowed;  // separated by |
    double min, max, above, max_abs_m, max_abs_px;
    Version since;  // of the format that has it
}};

/// The schema's name of a type.
constexpr std::string_view name_of(Type type) {{
    constexpr std::array<std::string_view, 5> names{{"none", "text", "f8", "i4", "u1"}};
    return names[static_cast<std::size_t>(type)];
}}

/// The most that a shape's letter may stand for.
struct Size {{
    char letter;
    std::uint64_t max;
}};

inline constexpr std::string_view format_name = "{data["format"]}";
inline constexpr std::string_view format_version = "{data["version"]}";
inline constexpr Version newest{_version(data["version"])};

namespace limits {{
{limits}
}}  // namespace limits

inline constexpr std::array<Size, {len(data["sizes"])}> sizes{{
{sizes}
}};

inline constexpr std::array<Row, {len(rows)}> rows{{
{chr(10).join(map(_cpp_row, rows))}
}};

}}  // namespace vfplan::bundle
"""


if __name__ == "__main__":
    HEADER.write_text(header())
    if PAGE.exists():
        PAGE.write_text(page(PAGE.read_text()))
