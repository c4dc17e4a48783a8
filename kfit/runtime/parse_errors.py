"""Errors of jsonargparse about wrong arguments and recipes, in one sentence."""

from __future__ import annotations

import re

from kfit.runtime.class_paths import near_argument, near_class

KEY = re.compile(r'Parser key "([^"]+)"(?: element \d+)?: *(.*)')
EXPECTED = re.compile(r"Expected an? (?:<class '([\w.]+)'>|typing\.Literal\[(.*?)\])(?:\. Got value: *(.*))?")
GIVEN_VALUE = re.compile(r"Given value: (?:NestedArg\(key='[^']*', val=)?(.*?)\)?$")
# Lines that lead to others, and what is of no use to a user.
LEADING = (
    *("Does not validate", "Subtypes:", "Errors:", "Given value type", "Problem with given class_path"),
    "Expected a path but",  # where a class is expected, a file of its settings is tried first
)
NO_CLASS = re.compile(r"Expected a dot import path string: *(.*)")
NAMES = {"int": "a whole number", "float": "a number", "bool": "true or false", "str": "text", "NoneType": "null"}
LONGEST = 80


def sentence(message: str) -> str:
    """The innermost reason of the tree that jsonargparse draws of keys and of the types that were tried.

    ``trainer.max_epochs must be a whole number or null, got many``. What is no such tree is put on one line. Where a
    class or its argument is misspelt, the one that may be meant is named.
    """
    near = near_class(message) or near_argument(message)
    return _reason(message) + (f"; did you mean {near}?" if near else "")


def _reason(message: str) -> str:
    keys: list[tuple[int, str]] = []
    reasons: list[tuple[int, str, str]] = []  # depth, path of keys, and message
    wanted: list[tuple[int, str, str]] = []
    got = ""
    for line in message.splitlines():
        text = NO_CLASS.sub(r"there is no class \1", line.strip().removeprefix("- "))
        if not text:
            continue
        depth = len(line) - len(line.lstrip(" -"))
        keys = [(above, key) for above, key in keys if above < depth]
        if found := KEY.match(text):
            keys.append((depth, found[1]))
            text = found[2]
        path = ".".join(key for _, key in keys)
        if found := EXPECTED.match(text):
            kind = found[1] or f"one of {found[2]}".replace("'", "")
            wanted.append((depth, path, NAMES.get(kind, f"a {kind.rpartition('.')[2]}" if found[1] else kind)))
            got = found[3] if found[3] is not None else got
        elif found := GIVEN_VALUE.match(text):
            got = got or found[1]
        elif not text.startswith(LEADING):
            reasons.append((depth, path, text))
    if not wanted and not any(path for _, path, _ in reasons):
        return _on_one_line(message)
    deepest = max((one[0] for one in reasons + wanted), default=0)
    for depth, path, reason in reasons:
        if depth == deepest:
            return _on_one_line(f"{path}: {reason}" if path else reason)
    path, kinds = _last(wanted, deepest)
    if not path:
        return _on_one_line(message)
    came = _on_one_line(got)
    came = "nothing" if not came else came if len(came) <= LONGEST else f"{came[:LONGEST]}…"
    return f"{path} must be {' or '.join(kinds)}, got {came}"


def _last(wanted: list[tuple[int, str, str]], deepest: int) -> tuple[str, list[str]]:
    found = [(path, kind) for depth, path, kind in wanted if depth == deepest]
    return (found[0][0], list(dict.fromkeys(kind for _, kind in found))) if found else ("", [])


def _on_one_line(text: str) -> str:
    return " ".join(text.split())
