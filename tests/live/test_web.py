"""The page to watch, in a browser: it moves, says when nothing comes, and finds its way back."""

from __future__ import annotations

import json
import socket
import time
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import bundles
import numpy as np
import pytest
from chromium import Page
from conftest import need_program
from refusals import refuses

from vfplan.errors import OutputError
from vfplan.live.server import Web
from vfplan.live.sources import PositionStream
from vfplan.session.bags import TICK

pytest.importorskip("websockets", reason="needs pip install 'vfplan[live]'")
FIXTURE = bundles.whole()
WORDS = "document.getElementById('connection').textContent"
READOUT = "document.getElementById('readout').textContent"
PICTURE = "document.getElementById('view').toDataURL()"
PLOT = "document.getElementById('force').toDataURL()"


def served(feed, port=0, name="f.h5"):
    return Web(FIXTURE, name, port, feed)


def tick(t, force=3.0):
    made = np.zeros(1, TICK)
    made["t"], made["state"], made["force"][0, 2] = t, 1, force
    made["proxy"] = FIXTURE.points[0] + [0, 0, 1e-3 * t]
    made["hip"] = made["proxy"] - [0, 0, 2e-3]
    return made


def test_in_a_browser(tmp_path):
    feed = PositionStream()
    web = served(feed)
    with Page(need_program("chromium", "chromium"), tmp_path / "profile") as browser:
        browser.open(f"http://127.0.0.1:{web.port}/")
        browser.until(WORDS, lambda w: w == "connected, nothing has come yet")
        feed.put(tick(1.0))
        browser.until(READOUT, lambda w: "t = 1.000 s, in contact, force = 3.000 N" in w)
        assert "penetration = 2.000 mm" in browser.run(READOUT)
        before = browser.run(PICTURE), browser.run(PLOT)
        feed.put(tick(2.5, force=5.0))
        browser.until(READOUT, lambda w: "t = 2.500 s" in w and "5.000 N" in w)
        assert browser.run(PICTURE) != before[0]
        assert browser.run(PLOT) != before[1]
        browser.until(WORDS, lambda w: w.startswith("nothing has come for"))
        web.close()
        browser.until(WORDS, lambda w: w.startswith("connection lost"))
        web = served(feed, web.port)  # the same program comes again
        browser.until(WORDS, lambda w: not w.startswith("connection lost"))
        feed.put(tick(0.5))
        browser.until(READOUT, lambda w: "t = 0.500 s" in w)
        web.close()
        browser.until(WORDS, lambda w: w.startswith("connection lost"))
        web = served(feed, web.port, "other.h5")  # another scene: the page shows that one
        browser.loaded(2)
        assert browser.run("document.querySelector('h1').textContent") == "Live: other.h5"
        assert [e for e in browser.events if e["method"] == "Runtime.exceptionThrown"] == []
        assert browser.run("document.documentElement.scrollWidth <= window.innerWidth")
        web.close()


def asked(port, path="/", **headers):
    try:
        with urlopen(Request(f"http://127.0.0.1:{port}{path}", headers=headers)) as answer:
            return answer.status, answer.read().decode()
    except HTTPError as error:
        return error.code, ""


def test_only_pages_from_here_are_told():
    """Another site's page in the same browser may reach the port: it gets nothing."""
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    web = served(PositionStream())
    own = f"http://127.0.0.1:{web.port}"
    assert asked(web.port)[0] == 200
    assert asked(web.port, Host="evil.example")[0] == 403
    assert asked(web.port, "/x")[0] == 404
    for origin in (None, "http://evil.example", "http://127.0.0.1:1"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{web.port}/ticks", origin=origin)
    with connect(f"ws://127.0.0.1:{web.port}/ticks", origin=own) as client:
        assert "scene" in json.loads(client.recv())
    with refuses(OutputError, "port-taken", port=web.port):
        served(PositionStream(), web.port)
    web.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", web.port))


def test_a_client_too_many_is_told_so_and_one_that_reads_nothing_holds_up_nobody(monkeypatch):
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    monkeypatch.setattr("vfplan.live.server.MAX_CLIENTS", 1)
    feed = PositionStream()
    web = served(feed)
    where = {"uri": f"ws://127.0.0.1:{web.port}/ticks", "origin": f"http://127.0.0.1:{web.port}"}
    with connect(**where, max_queue=1, close_timeout=0.1):  # it never reads the answer either
        with (
            pytest.raises(ConnectionClosed, match="1 clients are served, and no more"),
            connect(**where) as other,
        ):
            other.recv()
        for k in range(3000):
            feed.put(tick(k / 100))
        began = time.monotonic()
        web.close()
        assert web.refused == 1
        assert time.monotonic() - began < 5
