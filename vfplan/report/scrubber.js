"use strict";
// Moves HIP, proxy, normal, force and contact circle through time over the cloud.
// Plane scenes are drawn in their plane; others can be turned by dragging.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const dims = data.dims, frames = data.time.length;
  const view = document.getElementById("view"), pen = view.getContext("2d");
  const strip = document.getElementById("strip"), stripPen = strip.getContext("2d");
  const slider = document.getElementById("time"), readout = document.getElementById("readout");
  const play = document.getElementById("play"), follow = document.getElementById("follow");
  const STATES = { "-1": "no neighbour", 0: "free", 1: "in contact", 2: "entrenched" };
  const COLOUR = { cloud: "#1f5fbf", hip: "#2ca02c", proxy: "#b5179e", ring: "#d62728", force: "#222" };
  let frame = 0, playing = false, last = 0, clock = 0;
  let turn = dims === 3 ? [0.6, 0.5] : [0, 0];
  let camera = { x: 0, y: 0, zoom: 1 };

  const row = (list, k) => list.slice(k * dims, k * dims + dims);
  const size = (v) => Math.hypot(...v);

  // Picture coordinates [mm], y up: the plane itself, or seen from azimuth and elevation.
  function flat(v) {
    if (dims === 2) return v;
    const [a, e] = turn, ca = Math.cos(a), sa = Math.sin(a), ce = Math.cos(e), se = Math.sin(e);
    return [ca * v[0] + sa * v[1], se * (ca * v[1] - sa * v[0]) + ce * v[2]];
  }
  function toScreen(v) {
    const p = flat(v);
    return [view.width / 2 + (p[0] - camera.x) * camera.zoom,
            view.height / 2 - (p[1] - camera.y) * camera.zoom];
  }
  function showWhole() {
    let low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const list of [data.cloud, data.hip])
      for (let k = 0; k < list.length / dims; k++) {
        const p = flat(row(list, k));
        for (let i = 0; i < 2; i++) { low[i] = Math.min(low[i], p[i]); high[i] = Math.max(high[i], p[i]); }
      }
    camera.x = (low[0] + high[0]) / 2; camera.y = (low[1] + high[1]) / 2;
    const margin = 2.4 * data.radius;
    camera.zoom = Math.min(view.width / (high[0] - low[0] + margin), view.height / (high[1] - low[1] + margin));
  }
  function dots(list, colour, side, from, to) {
    pen.fillStyle = colour;
    for (let k = from; k < to; k++) {
      const [x, y] = toScreen(row(list, k));
      pen.fillRect(x - side / 2, y - side / 2, side, side);
    }
  }
  function arrow(from, to, colour) {
    const [a, b] = toScreen(from), [c, d] = toScreen(to), length = Math.hypot(c - a, d - b);
    if (length < 2) return;
    const x = (c - a) / length, y = (d - b) / length;
    pen.strokeStyle = pen.fillStyle = colour; pen.lineWidth = 2.5;
    pen.beginPath(); pen.moveTo(a, b); pen.lineTo(c, d); pen.stroke();
    pen.beginPath(); pen.moveTo(c + 6 * x, d + 6 * y);
    pen.lineTo(c - 5 * x - 5 * y, d - 5 * y + 5 * x); pen.lineTo(c - 5 * x + 5 * y, d - 5 * y - 5 * x); pen.fill();
  }
  function disc(at, radius, colour) {
    const [x, y] = toScreen(at);
    pen.fillStyle = colour; pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); pen.fill();
  }
  function draw() {
    const hip = row(data.hip, frame), proxy = row(data.proxy, frame);
    const normal = row(data.normal, frame), force = row(data.force, frame);
    if (follow.checked) { const p = flat(proxy); camera.x = p[0]; camera.y = p[1]; camera.zoom = 80 / data.radius; }
    pen.clearRect(0, 0, view.width, view.height);
    dots(data.cloud, COLOUR.cloud, 2.5, 0, data.cloud.length / dims);
    dots(data.hip, "#2ca02c55", 2, Math.max(0, frame - 400), frame);
    const [x, y] = toScreen(proxy);
    pen.strokeStyle = COLOUR.ring; pen.lineWidth = 2; pen.beginPath();
    pen.arc(x, y, data.radius * camera.zoom, 0, 2 * Math.PI); pen.stroke();
    arrow(proxy, proxy.map((v, i) => v + data.radius * normal[i]), COLOUR.proxy);
    const strength = size(force);
    if (strength > 0) arrow(hip, hip.map((v, i) => v + data.radius * force[i] / data.peak), COLOUR.force);
    disc(proxy, 5, COLOUR.proxy); disc(hip, 5, COLOUR.hip);
    readout.textContent = "t = " + data.time[frame].toFixed(3) + " s, " + STATES[data.state[frame]] +
      ", |F| = " + strength.toFixed(3) + " N, |proxy − HIP| = " + data.depth[frame].toFixed(3) + " mm";
    drawStrip();
  }
  function stripX(time) {
    const first = data.time[0], span = data.time[frames - 1] - first;
    return (time - first) / span * strip.width;
  }
  function drawStrip() {
    stripPen.clearRect(0, 0, strip.width, strip.height);
    stripPen.fillStyle = "#d9f2d9";
    for (const [from, to] of data.episodes)
      stripPen.fillRect(stripX(from), 0, Math.max(1, stripX(to) - stripX(from)), strip.height);
    stripPen.strokeStyle = COLOUR.force; stripPen.lineWidth = 1.5; stripPen.beginPath();
    for (let k = 0; k < frames; k++)
      stripPen.lineTo(stripX(data.time[k]), strip.height - 4 - data.strength[k] / data.peak * (strip.height - 22));
    stripPen.stroke();
    stripPen.fillStyle = "#4b5563"; stripPen.font = "13px sans-serif";
    stripPen.fillText("|F|, up to " + data.peak.toFixed(3) + " N", 6, 15);
    stripPen.strokeStyle = COLOUR.ring; stripPen.beginPath();
    stripPen.moveTo(stripX(data.time[frame]), 0); stripPen.lineTo(stripX(data.time[frame]), strip.height); stripPen.stroke();
  }
  function show(k) {
    frame = Math.max(0, Math.min(frames - 1, k));
    slider.value = frame;
    draw();
  }
  function frameAt(time) {
    let low = 0, high = frames - 1;
    while (low < high) { const mid = (low + high) >> 1; if (data.time[mid] < time) low = mid + 1; else high = mid; }
    return low;
  }
  function tick(now) {
    if (!playing) return;
    clock += (now - last) / 1000; last = now;
    show(frameAt(clock));
    if (frame >= frames - 1) setPlaying(false); else requestAnimationFrame(tick);
  }
  function setPlaying(on) {
    playing = on; play.textContent = on ? "pause" : "play";
    if (!on) return;
    if (frame >= frames - 1) show(0);
    clock = data.time[frame]; last = performance.now();
    requestAnimationFrame(tick);
  }

  data.strength = data.time.map((_, k) => size(row(data.force, k)));
  data.peak = Math.max(1e-9, ...data.strength);
  slider.max = frames - 1;
  slider.addEventListener("input", () => { setPlaying(false); show(Number(slider.value)); });
  play.addEventListener("click", () => setPlaying(!playing));
  follow.addEventListener("change", () => { if (!follow.checked) showWhole(); draw(); });
  document.getElementById("whole").addEventListener("click", () => { follow.checked = false; showWhole(); draw(); });
  strip.addEventListener("click", (event) => {
    const share = event.offsetX / strip.clientWidth;
    show(frameAt(data.time[0] + share * (data.time[frames - 1] - data.time[0])));
  });
  view.addEventListener("wheel", (event) => {
    event.preventDefault(); follow.checked = false;
    camera.zoom *= Math.exp(-event.deltaY / 500); draw();
  }, { passive: false });
  view.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    const scale = view.width / view.clientWidth;
    if (dims === 3 && !event.shiftKey) {
      turn = [turn[0] + event.movementX / 150, Math.max(-1.57, Math.min(1.57, turn[1] + event.movementY / 150))];
    } else {
      follow.checked = false;
      camera.x -= event.movementX * scale / camera.zoom; camera.y += event.movementY * scale / camera.zoom;
    }
    draw();
  });
  for (const button of document.querySelectorAll("button.go"))
    button.addEventListener("click", () => {
      setPlaying(false); show(frameAt(Number(button.dataset.time)));
      document.getElementById("scrubber").scrollIntoView({ block: "center" });
    });
  let deepest = 0;
  data.depth.forEach((depth, k) => { if (depth > data.depth[deepest]) deepest = k; });
  showWhole();
  show(deepest);
})();
