"""The server of the review page: who may speak to it, and that nothing is lost."""

from __future__ import annotations

import errno
import json
import os
import resource
import socket
import threading
import time
from contextlib import suppress
from multiprocessing import get_context
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from conftest import names_in
from refusals import refuses
from review_slices import SLICE
from tab import Tab
from vfplan.cli.review import write_approved
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import vfplan
from vfplan.errors import InputError
from vfplan.io import writing
from vfplan.review.server import MAX_MESSAGE_BYTES, Draft, ReviewServer
from vfplan.review.session import Session


@pytest.fixture(scope="module")
def begun():
    return Session.open(SLICE)


@pytest.fixture
def draft(tmp_path):
    return Draft(tmp_path / "o.h5.draft.json", {"source": "0" * 64}, {})


@pytest.fixture
def served(begun, draft):
    server = ReviewServer(begun, draft, by="A. Planner")
    yield server
    server.close()


REVERSE = {"step": {"do": "reverse", "stroke": 0}}


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


def test_nothing_else_is_served_and_a_foreign_name_of_the_address_is_refused(served):
    for path in ("/../session.py", "/session.py", "/page/main.js", "//", "/x"):
        assert asked(served, path)[0] == 404
    for path in ("/", f"/slice.png?token={served.token}"):
        assert asked(served, path, Host="evil.example")[0] == 403


@pytest.mark.parametrize("origin", [None, "http://evil.example", "http://127.0.0.1:1", "null"])
def test_pages_from_elsewhere_are_refused(served, origin):
    with pytest.raises(InvalidStatus, match="403"):
        Tab(served, origin=origin)


@pytest.mark.parametrize("token", ["", "x", "é", "a" * 43])
def test_no_step_without_the_token(served, token):
    with pytest.raises((InvalidStatus, UnicodeEncodeError)):
        Tab(served, token=token)
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{served.port}/steps", origin=f"http://127.0.0.1:{served.port}")


NO_MESSAGE = [(text, 1008) for text in ("", "{", "3", "[]", '"x"', "[" * 30000, b"\x00\xff")]


@pytest.mark.parametrize("text, code", [*NO_MESSAGE, ("x" * (MAX_MESSAGE_BYTES + 1), 1009)])
def test_what_is_no_message_or_too_large_ends_the_connection(served, text, code):
    with Tab(served) as client:
        assert client.ends_by(text) == code
    assert served.session.steps == ()


BAD_MESSAGES = [
    {}, {"step": None}, {"step": 3}, {"step": {"do": "fly"}}, {"preview": 3},
    {"preview": {"marker": "x9", "to": [1, 1]}}, {"undo": True}, {"redo": True},
]  # fmt: skip


@pytest.mark.parametrize("message", BAD_MESSAGES)
def test_a_step_that_does_not_fit_is_answered_and_changes_nothing(served, message):
    with Tab(served) as client:
        client.heard("quick")
        client.send(**message)
        assert client.heard("error")["error"]["code"]
    assert served.session.steps == ()
    assert not served._draft.path.exists()


def test_a_second_tab_shows_the_same_and_an_old_state_takes_no_step(served):
    with Tab(served) as one, Tab(served) as other:
        version = one.heard("quick")["version"]
        other.heard("quick")
        one.send(**REVERSE)
        shown = other.heard("quick")
        assert (shown["version"], shown["quick"]["steps"]) == (version + 1, [REVERSE["step"]])
        other.send(**REVERSE, version=version)
        assert other.heard("error")["error"]["code"] == "stale-step"
        # A look at the line as it was is no fault, and nothing is said of it.
        look = {"do": "viewed", "stroke": 0, "from": 0.0, "to": 1.0}
        other.send(step=look, version=version, number=7)
        messages = []
        while not messages or "answered" not in messages[-1]:
            messages.append(json.loads(other.page.recv(timeout=20)))
        assert not any("error" in message for message in messages)
        other.send(undo=True, version=version + 1)
        assert one.heard("quick")["quick"]["can_undo"]
        assert not one.heard("quick")["quick"]["can_undo"]
    assert served.session.steps == ()


def test_the_draft_has_each_step_before_it_is_shown(begun, served, draft):
    with Tab(served) as client:
        client.heard("quick")
        for place in ([300.0, 300.0], [310.0, 320.0]):
            step = {"do": "move_knot", "stroke": 0, "knot": 4, "to": place}
            client.send(step=step)
            client.heard("quick")
            assert json.loads(draft.path.read_text())["steps"][-1] == step
    assert draft.take_up(begun).state() == served.session.state()
    assert draft.path.stat().st_mode & 0o077 == 0


def test_a_step_that_cannot_be_kept_is_not_taken(served, draft):
    draft.path.mkdir()
    with Tab(served) as client:
        client.heard("quick")
        client.send(**REVERSE)
        assert client.heard("error")["error"]["code"] == "output-is-folder"
    assert served.session.steps == ()


STALE = [{"version": -1}, {"version": None}, {"digest": "0" * 64}, {"digest": None}]
NAMES = ["", " ", 3, "x" * 65, "a\u202eb", "\u200bA", "A\u3164", "\u2800", "\ud83d", "A\ufe0f"]
REFUSED = [(wish, "stale-approval") for wish in STALE]
REFUSED += [({"by": name}, "name-missing") for name in NAMES] + [({"by": "B"}, "not-approvable")]


@pytest.mark.parametrize("wish, code", REFUSED)
def test_an_approval_names_its_state_and_a_person_who_looked_at_it(wish, code, served):
    with Tab(served) as client:
        client.approvable()
        client.approve(**wish)
        client.send(approve="A. Planner")
        written, codes = client.leave(served)
    assert (written, sorted(codes)) == ([], sorted([code, "step-malformed"]))


def test_an_older_tab_does_not_approve_the_plan_of_a_newer_one(served):
    with Tab(served) as one, Tab(served) as other:
        one.approvable()
        other.approvable()
        other.send(**REVERSE)
        # Messages of what was looked at may come first.
        while not other.heard("quick")["quick"]["steps"]:
            pass
        one.approve()
        assert one.leave(served) == ([], ["stale-approval"])


def test_what_somebody_looked_at_counts_for_that_name_and_that_session(begun, served, draft):
    with Tab(served) as one, Tab(served) as other:
        one.heard("quick")
        one.send(**REVERSE)
        one.heard("quick")
        one.approvable()
        other.send(name="B. Planner")
        while (seen := other.heard("state")["state"])["steps"] == []:
            pass
        assert (seen["approvable"], len(seen["unseen"][0])) == (False, 1)
    assert "viewed" not in draft.path.read_text()
    assert draft.take_up(begun).why_not("A. Planner")


@pytest.mark.parametrize("choice, steps", [("resume", 1), ("anew", 0)])
def test_a_draft_is_announced_and_is_gone_on_with_or_not(choice, steps, begun, draft):
    draft.keep(begun.apply(REVERSE["step"]), "A. Planner")
    served = ReviewServer(draft.take_up(begun), draft)
    with Tab(served) as client:
        found = client.heard("about")["about"]["draft"]
        assert (found["by"], found["steps"], len(found["utc"])) == ("A. Planner", 1, 20)
        client.approvable()
        client.approve()
        assert client.leave(served) == ([], ["draft-not-chosen"])
        client.send(draft=choice)
        assert client.heard("about")["about"]["draft"] is None
        assert len(client.heard("quick")["quick"]["steps"]) == steps
    served.close()
    assert draft.path.exists() == (choice == "resume")


def test_a_draft_belongs_to_one_process_and_to_its_own_user(begun, draft):
    with draft.held(), refuses(InputError, "draft-in-use"), Draft(draft.path, {}, {}).held():
        pass
    assert list(draft.path.parent.iterdir()) == []
    if os.geteuid() != 0:
        pytest.skip("only root gives a file to another user")
    draft.keep(begun)
    os.chown(draft.path, 65534, 65534)
    with refuses(InputError, "draft-of-another-user"):
        draft.take_up(begun)


def test_no_number_of_connections_ends_the_server(served):
    used = len(os.listdir("/proc/self/fd"))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    opened = []
    with Tab(served) as first:
        resource.setrlimit(resource.RLIMIT_NOFILE, (used + 400, hard))
        with suppress(OSError):
            while True:
                opened.append(socket.create_connection(("127.0.0.1", served.port)))
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        with Tab(served) as client:
            assert client.heard("state")
        assert first.heard("state")
    for one in opened:
        one.close()


@pytest.mark.slow
def test_a_tab_that_does_not_read_is_dropped_and_stops_no_other(served):
    with Tab(served) as client, Tab(served):  # The second takes sixteen messages, and then none.
        client.heard("quick")
        for _ in range(1000):  # Until the buffers between the two are full.
            client.send(**REVERSE)
            client.heard("quick", seconds=5)
            if len(served._server.connections) == 1:
                break
        assert len(served._server.connections) == 1


def play(begun, folder, say):
    """A review of three steps that ends with an approval; `say` gets what the page hears."""
    draft = Draft(folder / "o.h5.draft.json", {}, {})
    served = ReviewServer(begun, draft)

    def person():
        with Tab(served) as client:
            client.heard("quick")
            for k in (1, 2, 3):
                while client.version < k:
                    client.send(**REVERSE)
                    client.heard("quick")
                say(str(k))
            client.approvable()
            client.approve()
            while "error" in client.heard("approved", "error"):
                client.approve()
            say("approved")

    reviewing = threading.Thread(target=person, daemon=True)
    with draft.held():
        reviewing.start()
        output, words = folder / "o.h5", {"key": None, "case": ""}
        served.run(
            lambda fixture: write_approved(fixture, output, words) or "written",
            lambda: not reviewing.is_alive(),
        )
        reviewing.join()
        served.close()


def check_kept(folder, heard):
    """No approval without its bundle, no bundle without its approval, no step lost before it."""
    if (folder / "o.h5").exists():
        assert vfplan.read_fixture(folder / "o.h5").reviewed.by == "A. Planner"
        return
    assert "approved" not in heard
    draft = folder / "o.h5.draft.json"
    assert len(json.loads(draft.read_text())["steps"] if draft.exists() else []) >= len(heard)


@pytest.mark.slow
def test_a_review_that_is_killed_at_any_moment_loses_nothing(begun, tmp_path):
    begun.state()
    started = time.monotonic()
    play(begun, tmp_path, lambda heard: None)
    moments = np.random.default_rng(7).uniform(0, time.monotonic() - started, 50)
    for k, moment in enumerate(moments):
        folder = tmp_path / str(k)
        folder.mkdir()
        read, write = os.pipe()
        say = lambda heard, end=write: os.write(end, f"{heard}\n".encode())  # noqa: E731
        child = get_context("fork").Process(target=play, args=(begun, folder, say))
        child.start()
        time.sleep(moment)
        child.kill()
        child.join()
        os.close(write)
        with open(read) as pipe:
            check_kept(folder, pipe.read().split())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["create", "sync", "put_in_place"])
def test_a_full_disk_at_any_write_of_a_review_loses_nothing(name, begun, tmp_path, monkeypatch):
    whole = getattr(writing, name)
    for nth in range(10):
        folder, heard, calls = tmp_path / str(nth), [], []
        folder.mkdir()

        def failing(*words, nth=nth, calls=calls, **more):
            calls.append(name)
            if len(calls) == nth:
                raise OSError(errno.ENOSPC, "no space")
            return whole(*words, **more)

        def say(text, folder=folder, heard=heard):
            heard.append(text)
            check_kept(folder, heard)

        monkeypatch.setattr(writing, name, failing)
        play(begun, folder, say)
        assert heard == ["1", "2", "3", "approved"]
        assert names_in(folder) == ["o.h5"]
