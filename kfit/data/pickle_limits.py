"""Limits of an untrusted pickle, measured from its operations before they run."""

from __future__ import annotations

import io
import pickletools
from collections.abc import Iterator
from typing import Any

MOST_ITEMS = 10_000_000
DEEPEST = 100

_OPERATIONS = {operation.code: operation for operation in pickletools.opcodes}
_FILL = ("APPEND", "APPENDS", "SETITEM", "SETITEMS", "ADDITEMS")
_MARK = (0, 0)


def check_pickle(content: bytes) -> None:
    """Refuse a pickle whose values would hold more than 10,000,000 items, or lie more than 100 deep in one another.

    A tuple that holds another twice, which holds a third twice and so on, takes a few bytes a level in the file, but
    hashing or printing it doubles with each level. The sizes are upper bounds: a stack of (items, depth) simulates the
    stack of values. Items added to a list or dict after it was used elsewhere are not counted.

    Raises:
        ValueError: if it is larger, memorises values under numbers beyond its length, or is damaged.
    """
    stack: list[tuple[int, int]] = []
    memo: dict[int, tuple[int, int]] = {}
    for operation, argument in _operations(content):
        name = operation.name
        if "PUT" in name or name == "MEMOIZE":
            number = len(memo) if name == "MEMOIZE" else int(argument)
            if number > len(content):
                raise ValueError(f"it memorises a value under the number {number:,}")
            memo[number] = _top(stack)
        elif "GET" in name:
            if int(argument) not in memo:
                raise ValueError("it recalls a value that it has not memorised")
            stack.append(memo[int(argument)])
        elif name == "MARK":
            stack.append(_MARK)
        elif name == "DUP":
            stack.append(_top(stack))
        else:
            taken = _taken(stack, operation)
            filled = taken[:1] if name in _FILL else []  # a container, which is no deeper than before for its own sake
            size = 1 + sum(items for items, _ in taken)
            depth = max(1 + max((below for _, below in taken[len(filled) :]), default=0), *(d for _, d in filled), 1)
            if size > MOST_ITEMS or depth > DEEPEST:
                raise ValueError(f"it holds more than {MOST_ITEMS:,} items, or they lie more than {DEEPEST} deep")
            stack += [(size, depth)] * len(operation.stack_after)


def _top(stack: list[tuple[int, int]]) -> tuple[int, int]:
    if not stack:
        raise ValueError("it takes more values than it has")
    return stack[-1]


def _taken(stack: list[tuple[int, int]], operation: pickletools.OpcodeInfo) -> list[tuple[int, int]]:
    """Take from the stack what an operation does: single values, and all above the last mark where it names one."""
    taken: list[tuple[int, int]] = []
    before = list(operation.stack_before)
    if pickletools.markobject in before:
        while _top(stack) is not _MARK:
            taken.insert(0, stack.pop())
        stack.pop()
        before = before[: before.index(pickletools.markobject)]
    for _ in before:
        _top(stack)
        taken.insert(0, stack.pop())
    return taken


def _operations(content: bytes) -> Iterator[tuple[pickletools.OpcodeInfo, Any]]:
    """Operations with their arguments; text of Python 2 stays bytes, which `pickletools.genops` refuses."""
    file = io.BytesIO(content)
    while code := file.read(1):
        operation = _OPERATIONS.get(code.decode("latin1"))
        if operation is None:
            raise ValueError(f"it holds the unknown operation {code!r}")
        if operation.arg is None:
            yield operation, None
        else:
            yield operation, file.readline() if operation.name == "STRING" else operation.arg.reader(file)
        if operation.name == "STOP":
            return
    raise ValueError("it is cut short")
