"""A real disk of so many bytes: a tmpfs in a process's own mount namespace, which ends with the process."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

NEW_MOUNTS, NEW_USER = 0x00020000, 0x10000000
READ_ONLY, REMOUNT, RECURSIVE, PRIVATE = 1, 32, 0x4000, 0x40000
BLOCK = 4096


def _call(name: str, *args: object) -> None:
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*args):
        raise OSError(ctypes.get_errno(), f"{name} is refused: {os.strerror(ctypes.get_errno())}")


def own_mounts() -> None:
    """Have this process mount what nobody else sees; only while it has a single thread.

    Raises:
        OSError, AttributeError: where that is not permitted, or there is no such thing.
    """
    user, group = os.getuid(), os.getgid()
    _call("unshare", NEW_MOUNTS | (NEW_USER if user else 0))
    if user:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    _call("mount", None, b"/", None, RECURSIVE | PRIVATE, None)


@dataclass(frozen=True)
class Disk:
    """A file system of its own at a folder."""

    path: Path

    def mount(self) -> None:
        """Mount it empty, with room for all."""
        _call("mount", b"tmpfs", str(self.path).encode(), b"tmpfs", 0, b"size=1g")

    def leave(self, blocks: int | None) -> None:
        """Leave room for so many blocks of 4096 bytes; without a number, nothing can be written any more."""
        sizes = os.statvfs(self.path)
        size = sizes.f_blocks if blocks is None else sizes.f_blocks - sizes.f_bfree + blocks
        flags = REMOUNT | (READ_ONLY if blocks is None else 0)
        # A tmpfs of 0 blocks would be one without a limit.
        _call("mount", b"tmpfs", str(self.path).encode(), b"tmpfs", flags, f"size={max(1, size) * BLOCK}".encode())

    def files(self) -> dict[str, bytes]:
        """What is on it, by path."""
        paths = [path for path in sorted(self.path.rglob("*")) if path.is_file()]
        return {str(path.relative_to(self.path)): path.read_bytes() for path in paths}


@dataclass(frozen=True)
class End:
    """How a command ended: its status, and what it printed, libraries in C included."""

    status: object
    message: str

    @property
    def sentence(self) -> str:
        """The one sentence of an end with status 2."""
        assert self.status == 2, self
        (line,) = self.message.splitlines()
        assert line.startswith("kfit: "), self
        return line.removeprefix("kfit: ")


@dataclass(frozen=True)
class Try:
    """How a command ended, and what was on the disk before and after it."""

    end: End
    before: dict[str, bytes]
    after: dict[str, bytes]


def ended(command: Callable[[], object]) -> End:
    """How a command ends."""
    status: object = 0
    with tempfile.TemporaryFile(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as errors:
        kept = os.dup(2)
        os.dup2(errors.fileno(), 2)
        try:
            with (
                open(2, "w", closefd=False) as stderr,
                contextlib.redirect_stderr(stderr),
                contextlib.redirect_stdout(io.StringIO()),
            ):
                command()
        except SystemExit as end:
            status = end.code
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        errors.seek(0)
        return End(status, errors.read().decode())
