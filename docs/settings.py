"""Makes docs/settings.md of config/default.toml (what a key means) and companion.app.settings (what it may be).

python docs/settings.py > docs/settings.md
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from companion.app.settings import Settings

DEFAULTS = Path(__file__).resolve().parent.parent / "config" / "default.toml"
HEAD = """# Every setting

Made by `python docs/settings.py` of [config/default.toml](../config/default.toml) and of what the program accepts.
Copy what you want to change into a file of your own and name it with `--config`. An option on the command line wins
over the file; an unknown key, a wrong type or a value out of range is an error that names the line.

```sh
companion analyze demo --config config/default.toml
```
"""


def page() -> str:
    """The whole page."""
    text = DEFAULTS.read_text(encoding="utf-8")
    values, notes = tomllib.loads(text), meanings(text)
    accepted = msgspec.json.schema(Settings)["$defs"]
    sections = accepted["Settings"]["properties"]
    lines = [HEAD]
    for section, settings in values.items():
        allowed = accepted[sections[section]["$ref"].rsplit("/", 1)[-1]]["properties"]
        lines += [f"## `[{section}]`\n", "| key | default | may be | meaning |", "|---|---|---|---|"]
        for key, value in settings.items():
            cells = (f"`{key}`", f"`{_toml(value)}`", may_be(allowed[key]), notes[section, key])
            lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
        lines.append("")
    return "\n".join(lines)


def meanings(text: str) -> dict[tuple[str, str], str]:
    """(section, key) → the comment above it."""
    found: dict[tuple[str, str], str] = {}
    section, said = "", list[str]()
    for line in text.splitlines():
        if header := re.match(r"\[(\w+)\]", line):
            section, said = header[1], []
        elif line.startswith("#"):
            said.append(line.lstrip("# "))
        elif key := re.match(r"(\w+) =", line):
            found[section, key[1]], said = " ".join(said), []
    return found


def may_be(schema: dict[str, Any]) -> str:
    """What a JSON schema accepts, in words."""
    return "; ".join(_accepted(schema)) or "any"


def _accepted(schema: dict[str, Any]) -> Iterator[str]:
    for option in schema.get("anyOf", ()):
        yield from _accepted(option)
    if "enum" in schema:
        yield ", ".join(f"`{_toml(value)}`" for value in schema["enum"])
    elif schema.get("type") == "array":
        yield f"list of: {may_be(schema['items'])}"
    elif schema.get("type") in ("number", "integer"):
        kind = "whole number" if schema["type"] == "integer" else "number"
        bounds = [schema.get(name) for name in ("exclusiveMinimum", "minimum", "maximum")]
        above, low, high = ("" if bound is None else f"{bound:,}".removesuffix(".0") for bound in bounds)
        yield f"{kind} above {above}, up to {high}" if above else f"{kind}, {low} to {high}" if low else kind
    elif schema.get("type") == "boolean":
        yield "`true`, `false`"
    elif schema.get("type") == "string":
        yield "text"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


if __name__ == "__main__":
    sys.stdout.write(page())
