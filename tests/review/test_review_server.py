"""The server of the review page: who may speak to it, and that nothing is lost."""

from __future__ import annotations

import json
import time
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from vfplan.errors import OutputError
from vfplan.review import server
from vfplan.review.server import MAX_MESSAGE_BYTES, Draft, ReviewServer
from vfplan.review.session import Session

ROOT = Path(__file__).parents[2]
SLICE = ROOT / "samples" / "elbow.png"


@pytest.fixture(scope="module")
def begun():
    return Session.open(SLICE)


@pytest.fixture
def draft(tmp_path):
    return Draft(tmp_path / "o.h5.draft.json", {"source": SLICE}, {})


@pytest.fixture
def served(begun, draft):
    server = ReviewServer(begun, draft, by="A. Planner")
    yield server
    server.close()


def tab(served, token=None, origin="own", **options):
    """A page's connection."""
    own = f"http://127.0.0.1:{served.port}"
    token = served.token if token is None else token
    where = f"ws://127.0.0.1:{served.port}/steps?token={token}"
    return connect(where, origin=own if origin == "own" else origin, **options)


def heard(client, name, seconds=20):
    """The next message of a kind."""
    end = time.monotonic() + seconds
    while True:
        message = json.loads(client.recv(timeout=max(end - time.monotonic(), 0.01)))
        if name in message:
            return message


def send_all(client, texts):
    """Send each text, and listen until the connection ends."""
    for text in texts:
        client.send(text)
    heard(client, "never")


def asked(served, path, **headers):
    try:
        request = Request(f"http://127.0.0.1:{served.port}{path}", headers=headers)
        with urlopen(request) as answer:
            return answer.status, answer.read(), dict(answer.headers)
    except HTTPError as error:
        return error.code, b"", {}


def test_the_page_needs_no_token_and_the_slice_does(served):
    assert served.address == f"http://127.0.0.1:{served.port}/#{served.token}"
    status, body, headers = asked(served, "/")
    assert status == 200
    assert b"<title>Review</title>" in body
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["Cache-Control"] == "no-store"
    for name in ("main.js", "review.css", "palette.css", "report.css"):
        assert asked(served, f"/{name}")[0] == 200
    assert asked(served, "/slice.png")[0] == 403
    assert asked(served, "/slice.png?token=" + "a" * 43)[0] == 403
    status, body, _ = asked(served, f"/slice.png?token={served.token}")
    assert (status, body[:4]) == (200, b"\x89PNG")


@pytest.mark.parametrize("path", ["/../session.py", "/session.py", "/page/main.js", "//", "/x"])
def test_nothing_else_is_served(served, path):
    assert asked(served, path)[0] == 404


def test_a_foreign_name_of_the_address_is_refused(served):
    assert asked(served, "/", Host="evil.example")[0] == 403
    assert asked(served, f"/slice.png?token={served.token}", Host="evil.example")[0] == 403


@pytest.mark.parametrize("origin", [None, "http://evil.example", "http://127.0.0.1:1", "null"])
def test_pages_from_elsewhere_are_refused(served, origin):
    with pytest.raises(InvalidStatus, match="403"):
        tab(served, origin=origin)


@pytest.mark.parametrize("token", ["", "x", "é", "a" * 43])
def test_no_step_without_the_token(served, token):
    with pytest.raises((InvalidStatus, UnicodeEncodeError)):
        tab(served, token=token)
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{served.port}/steps", origin=f"http://127.0.0.1:{served.port}")


@pytest.mark.parametrize("text", ["", "{", "3", "[]", '"x"', "[" * 30000, b"\x00\xff"])
def test_what_is_no_message_ends_the_connection(served, text):
    with tab(served) as client:
        client.send(text)
        with pytest.raises(ConnectionClosed) as closed:
            heard(client, "never")
        assert closed.value.rcvd.code == 1008
    assert served.session.steps == ()


@pytest.mark.parametrize(
    "message",
    [
        {}, {"step": None}, {"step": 3}, {"step": {"do": "fly"}}, {"preview": 3},
        {"preview": {"marker": "x9", "to": [1, 1]}}, {"undo": True}, {"redo": True},
        {"step": {"do": "move_knot", "stroke": 0, "knot": 1, "to": [None, 1]}},
        {"step": {"do": "draw", "points": [[1, 1]] * 501}},
    ],
)  # fmt: skip
def test_a_step_that_does_not_fit_is_answered_and_changes_nothing(served, message):
    with tab(served) as client:
        version = heard(client, "quick")["version"]
        client.send(json.dumps({**message, "version": version}))
        assert heard(client, "error")["error"]["code"]
    assert served.session.steps == ()
    assert not served._draft.path.exists()


def test_too_large_and_too_many_messages_end_the_connection(served):
    with tab(served) as client:
        client.send("x" * (MAX_MESSAGE_BYTES + 1))
        with pytest.raises(ConnectionClosed) as closed:
            heard(client, "never")
        assert closed.value.rcvd.code == 1009
    with tab(served) as client:
        flood = ['{"preview": 3}'] * 2000
        with pytest.raises(ConnectionClosed) as closed:
            send_all(client, flood)
    assert closed.value.rcvd.code == 1008
    assert served.session.steps == ()


def test_a_second_tab_shows_the_same_and_an_old_state_takes_no_step(served):
    with tab(served) as one, tab(served) as other:
        version = heard(one, "quick")["version"]
        heard(other, "quick")
        one.send(json.dumps({"step": {"do": "reverse", "stroke": 0}, "version": version}))
        shown = heard(other, "quick")
        assert shown["version"] == version + 1
        assert shown["quick"]["steps"] == ["reverse, stroke 1"]
        other.send(json.dumps({"step": {"do": "reverse", "stroke": 0}, "version": version}))
        assert heard(other, "error")["error"]["code"] == "stale-step"
        # A look at the line as it was is no fault, and nothing is said of it.
        look = {"do": "viewed", "stroke": 0, "from": 0.0, "to": 1.0}
        other.send(json.dumps({"step": look, "version": version, "number": 7}))
        messages = []
        while not messages or "answered" not in messages[-1]:
            messages.append(json.loads(other.recv(timeout=20)))
        assert not any("error" in message for message in messages)
        other.send(json.dumps({"undo": True, "version": version + 1}))
        assert heard(one, "quick")["quick"]["can_undo"]
        assert not heard(one, "quick")["quick"]["can_undo"]
    assert served.session.steps == ()


def test_a_tab_too_many_is_told_so(served, monkeypatch):
    monkeypatch.setattr(server, "MAX_TABS", 1)
    with tab(served) as one:
        heard(one, "quick")
        with tab(served) as other, pytest.raises(ConnectionClosed) as closed:
            heard(other, "never")
        assert closed.value.rcvd.code == 1013


def test_the_draft_has_each_step_before_it_is_shown(begun, served, draft):
    with tab(served) as client:
        version = heard(client, "quick")["version"]
        for place in ([300.0, 300.0], [310.0, 320.0]):
            step = {"do": "move_knot", "stroke": 0, "knot": 4, "to": place}
            client.send(json.dumps({"step": step, "version": version}))
            version = heard(client, "quick")["version"]
            steps = json.loads(draft.path.read_text())["steps"]
            assert steps[-1] == step
    again = draft.take_up(begun)
    assert again.state() == served.session.state()
    assert draft.path.stat().st_mode & 0o077 == 0


def test_a_step_that_cannot_be_kept_is_not_taken(served, draft):
    draft.path.mkdir()
    with tab(served) as client:
        version = heard(client, "quick")["version"]
        client.send(json.dumps({"step": {"do": "reverse", "stroke": 0}, "version": version}))
        assert heard(client, "error")["error"]["code"] == "output-is-folder"
    assert served.session.steps == ()


def test_an_approval_is_written_once_and_the_draft_goes(served, draft):
    written = []

    def write(fixture):
        written.append(fixture)
        return "wrote it"

    with tab(served) as client:
        version = heard(client, "quick")["version"]
        client.send(json.dumps({"step": {"do": "viewed"}, "version": version}))
        heard(client, "quick")
        for finding in range(len(served.session.current.findings)):
            step = {"do": "answer", "finding": finding}
            client.send(json.dumps({"step": step, "version": served._version}))
            heard(client, "quick")
        assert draft.path.exists()
        client.send(json.dumps({"approve": "A. Planner"}))
        assert served.run(write, lambda: False) == "A. Planner"
        assert heard(client, "approved")["approved"]["by"] == "A. Planner"
    assert [fixture.reviewed.by for fixture in written] == ["A. Planner"]
    assert not draft.path.exists()


def test_no_approval_of_what_is_not_approvable_and_leaving_keeps_the_draft(served, draft):
    with tab(served) as client:
        version = heard(client, "quick")["version"]
        client.send(json.dumps({"step": {"do": "reverse", "stroke": 0}, "version": version}))
        heard(client, "quick")
        client.send(json.dumps({"approve": "A. Planner"}))
        client.send(json.dumps({"leave": True}))
        assert served.run(lambda fixture: pytest.fail("written"), lambda: False) is None
        assert heard(client, "error")["error"]["code"] == "not-approvable"
        heard(client, "left")
    assert draft.path.exists()


def test_a_port_that_is_taken_is_an_error(begun, draft, served):
    with pytest.raises(OutputError) as refused:
        ReviewServer(begun, draft, port=served.port)
    assert refused.value.code == "port-taken"
