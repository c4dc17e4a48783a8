"""Other sites' pages, strangers' paths and killed servers: the page answers itself alone and leaves nothing behind."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from importlib.util import find_spec

import pytest
from app_process import started

from kfit.app.serve import PREFIX, OnlySelf, remove_left


def asked(**headers):
    """Status and headers that a browser gets of a server that answers everything."""
    sent = []

    async def everything(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"secret"})

    async def send(message):
        sent.append(message)

    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    asyncio.run(OnlySelf(everything)({"type": "http", "headers": pairs}, None, send))
    return sent[0]["status"], dict(sent[0]["headers"])


def test_what_another_site_s_page_asks_is_refused():
    own = "127.0.0.1:7860"
    status, headers = asked(host=own, origin=f"http://{own}")
    assert status == 200
    assert b"frame-ancestors 'none'" in headers[b"content-security-policy"]
    assert asked(host=own)[0] == 200
    for other in ("http://example.org", "null", "http://127.0.0.1:8000", "http://127.0.0.1:7860.example.org", ""):
        assert asked(host=own, origin=other)[0] == 403


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows tells no owner of a folder")
def test_what_a_killed_server_left_is_deleted_at_the_next_start(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left, running = tmp_path / f"{PREFIX}{ended.pid}-x", tmp_path / f"{PREFIX}{os.getpid()}-x"
    others = [tmp_path / name for name in (f"{PREFIX}x-y", f"{PREFIX}-1-", "kfit-other", "photos")]
    for folder in (left, running, *others):
        folder.mkdir()
        (folder / "photo.png").touch()
    (tmp_path / f"{PREFIX}{ended.pid}-link").symlink_to(tmp_path / "photos")
    remove_left(tmp_path)
    assert not left.exists()
    assert all((folder / "photo.png").exists() for folder in (running, *others))


def start(folder):
    server, port = started(folder)
    assert server.stderr.readline().startswith("kfit: open")
    return server, f"http://127.0.0.1:{port}"


def ask(address, data=None, **headers):
    """Status and content; a refusal is one too."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, data, headers), timeout=20) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def upload(address, name, data=b"secret", **headers):
    body = b'--x\r\nContent-Disposition: form-data; name="files"; filename="%s"\r\n\r\n%s\r\n--x--\r\n' % (name, data)
    kind = {"Content-Type": "multipart/form-data; boundary=x"}
    return ask(f"{address}/gradio_api/upload", body, **kind, **headers)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("gradio") is None, reason="gradio is not installed")
def test_a_served_page_gives_out_and_takes_in_only_its_own(tmp_path):
    outside, folder = tmp_path / "outside.png", tmp_path / "server"
    outside.write_bytes(b"secret")
    folder.mkdir()
    server, address = start(folder)
    try:
        (held,) = folder.iterdir()
        away = [outside, "/etc/passwd", held, f"{held}/../../outside.png", "%2e%2e/%2e%2e/outside.png", __file__]
        for place in (*away, f"{held}/session-x/pose.json", "http://127.0.0.1:9/x"):
            status, content = ask(f"{address}/gradio_api/file={place}")
            assert status in (403, 404), place
            assert b"secret" not in content
        for name in (b"../../evil.png", b"/tmp/evil.png", b"..\\..\\evil.png", b"%2e%2e%2fevil.png", b"-rf.png"):
            status, content = upload(address, name)
            assert status == 200
            assert all(path.startswith(f"{held}/") and ".." not in path.split("/") for path in json.loads(content))
        assert upload(address, b"large.png", b"\0" * (65 << 20))[0] == 413
        assert {path for path in tmp_path.rglob("*.png") if not path.is_relative_to(held)} == {outside}
        for headers in ({"Origin": "http://example.org"}, {"Origin": "null"}):
            assert upload(address, b"a.png", **headers)[0] == 403
        assert ask(address, Host="example.org")[0] == 400
        # A page says to which file an upload went; a stranger's says another.
        for place in (str(outside), "/etc/passwd"):
            data = {"path": place, "meta": {"_type": "gradio.FileData"}, "orig_name": "a.png"}
            number = next(
                k for k, one in enumerate(json.loads(ask(f"{address}/config")[1])["dependencies"])
                if one["api_name"] == "take"
            )  # fmt: skip
            joined = json.dumps({"data": [data], "fn_index": number, "session_hash": "s"}).encode()
            assert ask(f"{address}/gradio_api/queue/join", joined, **{"Content-Type": "application/json"})[0] == 200
            with urllib.request.urlopen(f"{address}/gradio_api/queue/data?session_hash=s", timeout=20) as answer:
                assert b'"success":true' not in next(line for line in answer if b"process_completed" in line)
            assert outside.read_bytes() == b"secret"
        server.send_signal(signal.SIGKILL)
        server.wait()
        assert list(folder.iterdir()) == [held]
        server.stderr.close()
        server, address = start(folder)
        assert held not in folder.iterdir()
    finally:
        server.terminate()
        assert server.wait(30) == 0
        server.stderr.close()
    assert list(folder.iterdir()) == []
