"""The contract of the JSON that commands print and write: `schema.toml` lists its stable keys."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

# Raised when a stable key is removed or changes its meaning.
SCHEMA = 1


@cache
def records() -> dict[str, dict[str, Any]]:
    """Return the keys of each kind of record, each with its meaning, or with the kind of the records that it contains.

    The name of a key that may be missing ends in "?".
    """
    table: dict[str, dict[str, Any]] = tomllib.loads(files(__package__).joinpath("schema.toml").read_text("utf-8"))
    for keys in table.values():
        own = {name.rstrip("?") for name in keys}
        for like, mark in (("like", ""), ("like?", "?")):
            for name, key in table.get(keys.pop(like, ""), {}).items():
                plain = name.rstrip("?")
                if plain not in own:
                    keys[plain + (mark or name[len(plain) :])] = key
    return table


def arranged(kind: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return facts under the keys of the contract, and all others under "details"."""
    keys = {name.rstrip("?"): key for name, key in records()[kind].items()}
    stable, details = {}, dict(facts.get("details", {}))
    for name, value in facts.items():
        if name in keys:
            stable[name] = _within(keys[name], value)
        elif name != "details":
            details[name] = value
    return stable | ({"details": details} if details else {})


def _within(key: str | Mapping[str, str], value: Any) -> Any:
    if isinstance(key, str) or value is None:
        return value
    ((form, kind),) = key.items()
    if form == "list":
        return [arranged(kind, each) for each in value]
    if form == "map":
        return {name: arranged(kind, each) for name, each in value.items()}
    return arranged(kind, value)


def described(kind: str, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the path of each stable key of a kind, like ``modes.*.check.verdict``, and its meaning."""
    for name, key in records()[kind].items():
        if isinstance(key, str):
            yield prefix + name, key
        else:
            ((form, inner),) = key.items()
            yield from described(inner, prefix + name + {"list": "[].", "map": ".*.", "record": "."}[form])
