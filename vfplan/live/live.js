"use strict";
// Shows the newest tick, the force of the last while, and whether anything comes.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const scene = makeScene(data), plot = makePlot(document.getElementById("force"), "force [N]", "force");
  const connection = document.getElementById("connection"), readout = document.getElementById("readout");
  const FLAGS = [[1, "bad tip"], [2, "inside"], [4, "limit"]];
  const SPAN_S = 20, QUIET_S = 1, AGAIN_MS = 1000, TRAIL = 400;
  let ticks = [], arrived = 0, open = false, due = false;

  function say(kind, words) {
    if (connection.textContent !== words) { connection.className = "verdict " + kind; connection.textContent = words; }
  }
  function state() {
    const quiet = Math.floor((performance.now() - arrived) / 1000);
    if (!open) say("fail", "connection lost, trying again: what is shown is old");
    else if (!arrived) say("none", "connected, nothing has come yet");
    else if (quiet >= QUIET_S) say("fail", "nothing has come for " + quiet + " s: what is shown is old");
    else say("pass", "live");
  }
  function draw() {
    due = false;
    if (!ticks.length) return;
    const now = ticks[ticks.length - 1], flags = FLAGS.filter(([bit]) => now.status & bit).map(([, name]) => name);
    const trail = ticks.slice(-TRAIL - 1, -1).flatMap((t) => t.hip);
    scene.show({ ...now, trail }, trail.concat(now.hip));
    readout.textContent = "t = " + fixed(now.t, 3) + " s, " + [STATES[now.state] || "unknown", ...flags].join(", ") +
      ", force = " + now.strength.toFixed(3) + " N, penetration = " + now.depth.toFixed(3) + " mm";
    const strength = ticks.map((t) => t.strength);
    plot.show({ time: ticks.map((t) => t.t), low: strength, high: strength }, [], null, [now.t - SPAN_S, now.t]);
  }
  function take(row) {
    const n = data.dims, [t, state, status] = row, at = (k) => row.slice(3 + k * n, 3 + (k + 1) * n);
    const tick = { t, state, status, strength: row[3 + 4 * n], depth: row[4 + 4 * n], hip: at(0), proxy: at(1), normal: at(2), force: at(3) };
    if (ticks.length && t < ticks[ticks.length - 1].t) ticks = []; // it began again
    ticks.push(tick);
    let old = 0; while (ticks[old].t < t - SPAN_S) old++;
    ticks = old ? ticks.slice(old) : ticks;
  }
  function connect() {
    const socket = new WebSocket("ws://" + location.host + "/ticks");
    socket.onopen = () => { open = true; arrived = 0; state(); };
    socket.onmessage = (event) => {
      const said = JSON.parse(event.data);
      if (said.scene !== undefined && said.scene !== data.scene) return location.reload(); // another fixture
      if (!said.ticks) return;
      said.ticks.forEach(take); arrived = performance.now(); state();
      if (!due) { due = true; requestAnimationFrame(draw); }
    };
    socket.onclose = () => { open = false; state(); setTimeout(connect, AGAIN_MS); };
  }
  setInterval(state, 250);
  connect();
})();
