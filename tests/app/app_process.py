"""`kfit app` in a process of its own."""

import os
import socket
import subprocess
import sys


def started(folder):
    """The process, which keeps its files in a folder, and the port that it was told."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    screenless = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    words = [sys.executable, "-m", "kfit", "app", "--port", str(port)]
    server = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env={**screenless, "TMPDIR": str(folder)})
    return server, port
