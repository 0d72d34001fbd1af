"""The engine for pages gives the controller's bits, in node and in Chromium, and is built anew."""

from __future__ import annotations

import base64
import importlib.util
import json

import numpy as np
import pytest
from chromium import Page
from conftest import ROOT, need_program, output
from docs_modules import load

from vfplan import Guide, ProxyEngine
from vfplan.conformance import fixtures
from vfplan.conformance.kit import RENDERED, path_of
from vfplan.engine.browser import bodies_of, module, packed
from vfplan.io.files import to_json_types
from vfplan.replaying.guiding import make_engine

SCRIPT = (ROOT / "vfplan/review/page/engine.js").read_text().replace("export ", "")
SCRIPT += (ROOT / "tests/support/answers.js").read_text()


def played(where, cases, folder):
    """What `answersOf` says in node or in Chromium."""
    call = f"answersOf({json.dumps(to_json_types(cases))}, '{packed(module())}')"
    program = need_program("node", "nodejs") if where == "node" else need_program(where, where)
    if where == "node":
        path = folder / "play.mjs"
        path.write_text(f"{SCRIPT}\nconsole.log(JSON.stringify(await {call}));")
        return json.loads(output(program, path))
    path = folder / "page.html"
    path.write_text(f"<script>{SCRIPT}\n{call}.then((made) => {{ window.made = made; }})</script>")
    with Page(program, folder / "profile") as browser:
        browser.open(path.as_uri())
        return browser.until("window.made")


def hips_of(fixture):
    """(T, 3) the kit's path, then a hand that trembles, presses and leaps about [m]."""
    path = path_of(fixture)
    rng = np.random.default_rng(len(fixture.points))
    walk = np.cumsum(rng.normal(0, 3e-4, (1500, 3)), axis=0)
    start = np.where(np.arange(1500)[:, None] % 300 < 250, path[0], rng.permuted(fixture.points)[0])
    return np.vstack([path, start + walk])


@pytest.mark.parametrize("where", ["node", "chromium"])
def test_the_kits_vectors_and_more_to_the_bit_and_faster_than_the_loop(where, tmp_path):
    assert len(module()) <= 300_000
    names = [(name, rule) for name, rules in RENDERED.items() for rule in rules]
    cases, truths = [], []
    for name, rule in [*names, ("guided", "robust")]:
        fixture = getattr(fixtures, name)()
        hips = hips_of(fixture)
        if rule == "guide":  # the kit's file of the guide alone
            engine, bodies = Guide.of(fixture), bodies_of(fixture)[1:]
        else:
            made = make_engine if fixture.guidance else ProxyEngine.of
            engine, bodies = made(fixture, rule), bodies_of(fixture, rule)
        engine.reset(hips[0])
        trace = engine.run(hips) if rule == "guide" else engine.run_timed(hips)[0]
        assert np.linalg.norm(trace.force, axis=1).max() > 0.1
        cases.append({"bodies": bodies, "hips": hips})
        truths.append(np.hstack([trace.proxy, trace.force]))
    found = played(where, cases, tmp_path)
    assert base64.b64decode(found["answers"]) == b"".join(truth.tobytes() for truth in truths)
    assert found["slowest"] > 1000


def test_what_no_engine_takes_is_refused_with_its_sentence(tmp_path):
    (body,) = bodies_of(fixtures.cloud())
    far = {**body, "arrays": [body["arrays"][0], packed(np.full(3, 2e6).tobytes()), packed(b"")]}
    said = played("node", [{"bodies": [far], "hips": [[0, 0, 0]]}], tmp_path)["refused"]
    assert "1e6 m" in said


@pytest.mark.slow
def test_the_same_sources_give_the_same_module(tmp_path):
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("the compiler is not here: pip install --group wasm")
    load(ROOT / "release" / "make_wasm.py").compile_to(tmp_path / "engine.wasm")
    assert (tmp_path / "engine.wasm").read_bytes() == module()
