"use strict";
// Tool tip, proxy with its circle and normal, force, and the wall about the points, in mm. Plane scenes are drawn in
// their plane; others can be turned: by dragging, with the arrow keys, with the buttons.
const ARROW_PX = 60; // length of the arrow of a round force
function makeScene(data) {
  const dims = data.dims = data.axes.length, view = document.getElementById("view");
  const follow = document.getElementById("follow");
  if (!data.forbids) { // a guide has no contact and no normal
    view.setAttribute("aria-label", "line, tube, tool tip, proxy and force");
    for (const part of document.querySelectorAll(".forbids")) part.hidden = true;
  }
  if (!data.wall) for (const part of document.querySelectorAll(".walls")) part.hidden = true;
  if (!data.tube) for (const part of document.querySelectorAll(".guides")) part.hidden = true;
  const row = (list, k) => list.slice(k * dims, k * dims + dims);
  const size = (v) => Math.hypot(...v);
  // That force: the session's largest, rounded down, or a usual hand's.
  let newtons = 10;
  if (data.force) {
    let most = 0.1;
    for (let k = 0; k < data.force.length / dims; k++) most = Math.max(most, size(row(data.force, k)));
    newtons = roundBelow(most);
  }
  let turn = dims === 3 ? [0.6, 0.5] : [0, 0];
  let camera = { x: 0, y: 0, zoom: 1 }, chosen = false; // by hand, or all that there is
  let isPushed = false; // whether the pointer is the tool tip
  let pen, width = 1, height = 1, fittedTo = "", tick = null, path = data.cloud;

  // Picture coordinates [mm], y up: the plane itself, or seen from azimuth and elevation.
  function flat(v) {
    if (dims === 2) return v;
    const [a, e] = turn, ca = Math.cos(a), sa = Math.sin(a), ce = Math.cos(e), se = Math.sin(e);
    return [ca * v[0] + sa * v[1], se * (ca * v[1] - sa * v[0]) + ce * v[2]];
  }
  function toScreen(v) {
    const p = flat(v);
    return [width / 2 + (p[0] - camera.x) * camera.zoom, height / 2 - (p[1] - camera.y) * camera.zoom];
  }
  // The place under a pointer: in the plane, or as far from the eye as another place.
  function placeOf(event, other) {
    const p = [camera.x + (event.offsetX - width / 2) / camera.zoom, camera.y - (event.offsetY - height / 2) / camera.zoom];
    if (dims === 2) return p;
    const [a, e] = turn, ca = Math.cos(a), sa = Math.sin(a), ce = Math.cos(e), se = Math.sin(e);
    const right = [ca, sa, 0], up = [-se * sa, se * ca, ce], [x, y] = flat(other);
    return other.map((v, i) => v + (p[0] - x) * right[i] + (p[1] - y) * up[i]);
  }
  function whole() {
    chosen = false; fittedTo = width + " " + height;
    let low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const list of [data.cloud, path])
      for (let k = 0; k < list.length / dims; k++) {
        const p = flat(row(list, k));
        for (let i = 0; i < 2; i++) { low[i] = Math.min(low[i], p[i]); high[i] = Math.max(high[i], p[i]); }
      }
    const margin = Math.max(4.4 * (data.wall ? data.wall.radius : data.radius), data.tube ? 2.4 * data.tube.radius : 0);
    camera = { x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2,
               zoom: Math.min(width / (high[0] - low[0] + margin), height / (high[1] - low[1] + margin)) };
  }
  // The border of all balls about the points together: each is drawn, then each one's inside.
  function wall() {
    const places = [];
    for (let k = 0; k < data.wall.points.length / dims; k++) places.push(toScreen(row(data.wall.points, k)));
    for (const [name, radius] of [["wall", data.wall.radius * camera.zoom + 1], ["ground", data.wall.radius * camera.zoom - 1]]) {
      if (radius <= 0) continue;
      pen.fillStyle = colour(name); pen.beginPath();
      for (const [x, y] of places) { pen.moveTo(x + radius, y); pen.arc(x, y, radius, 0, 2 * Math.PI); }
      pen.fill();
    }
  }
  // A broad line, and in it a narrower one of the ground: its border stays. The inside is pale.
  function tube() {
    const broad = 2 * data.tube.radius * camera.zoom;
    pen.lineJoin = "round"; pen.lineCap = data.tube.cap; pen.beginPath();
    for (const line of data.tube.lines) {
      const last = line.length / dims - 1;
      for (let k = 0; k <= last; k++) pen[k ? "lineTo" : "moveTo"](...toScreen(row(line, k)));
      if (size(row(line, last).map((v, i) => v - line[i])) === 0) pen.closePath(); // a ring has no end
    }
    for (const [name, alpha, wide] of [["tube", 1, broad + 2], ["ground", 1, broad - 2], ["tube", 0.2, broad - 2]]) {
      pen.strokeStyle = colour(name); pen.globalAlpha = alpha; pen.lineWidth = Math.max(0.1, wide); pen.stroke();
    }
    pen.globalAlpha = 1; pen.lineJoin = "miter"; pen.lineCap = "butt";
  }
  function dots(list, name, side) {
    pen.fillStyle = colour(name);
    for (let k = 0; k < list.length / dims; k++) {
      const [x, y] = toScreen(row(list, k));
      pen.fillRect(x - side / 2, y - side / 2, side, side);
    }
  }
  function arrow(from, to, name) {
    const [a, b] = toScreen(from), [c, d] = toScreen(to), length = Math.hypot(c - a, d - b);
    if (length < 2) return;
    // The head ends at the tip, and is no longer than the arrow.
    const head = Math.min(11, length), x = head * (c - a) / length, y = head * (d - b) / length;
    pen.strokeStyle = pen.fillStyle = colour(name); pen.lineWidth = 2.5;
    pen.beginPath(); pen.moveTo(a, b); pen.lineTo(c - x, d - y); pen.stroke();
    pen.beginPath(); pen.moveTo(c, d);
    pen.lineTo(c - x - y / 2, d - y + x / 2); pen.lineTo(c - x + y / 2, d - y - x / 2); pen.fill();
  }
  // With a rim of the ground, which parts it from what lies below.
  function disc(at, radius, name) {
    const [x, y] = toScreen(at);
    pen.fillStyle = colour(name); pen.strokeStyle = colour("ground"); pen.lineWidth = 1.5;
    pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); pen.fill(); pen.stroke();
  }
  // The frame's axes at the bottom on the left, a length and a force at the bottom on the right.
  function rulers() {
    const origin = [34, height - 30];
    pen.fillStyle = pen.strokeStyle = colour("ink"); pen.lineWidth = 1.5; pen.textAlign = "center";
    data.axes.forEach((name, i) => {
      const p = flat(data.axes.map((_, j) => (i === j ? 1 : 0)));
      if (size(p) < 0.15) return; // it points at the eye
      pen.beginPath(); pen.moveTo(...origin); pen.lineTo(origin[0] + 24 * p[0], origin[1] - 24 * p[1]); pen.stroke();
      pen.fillText(name, origin[0] + 34 * p[0], origin[1] + 4 - 34 * p[1]);
    });
    const mm = roundBelow(Math.min(120, width / 4) / camera.zoom);
    bar(mm * camera.zoom, 16, shownRound(mm) + " mm");
    pen.fillStyle = colour("force"); bar(ARROW_PX, 44, shownRound(newtons) + " N");
    pen.textAlign = "left";
  }
  function bar(px, up, text) {
    pen.fillRect(width - 14 - px, height - up, px, 3);
    pen.fillText(text, width - 14 - px / 2, height - up - 6);
  }
  function outside(v) {
    const [x, y] = toScreen(v);
    return x < 0 || y < 0 || x > width || y > height;
  }
  function draw() {
    ({ pen, width, height } = fitted(view));
    if (!chosen && (fittedTo !== width + " " + height || (tick && outside(tick.hip)))) whole();
    if (tick && follow.checked) {
      const p = flat(tick.proxy);
      chosen = true; camera = { x: p[0], y: p[1], zoom: Math.min(width, height) / (8 * data.radius) };
    }
    if (data.wall) wall();
    if (data.tube) tube();
    dots(data.cloud, "cloud", 2.5);
    if (tick) {
      dots(tick.trail, "tip", 2);
      const [x, y] = toScreen(tick.proxy);
      if (data.forbids) {
        pen.strokeStyle = colour("proxy"); pen.lineWidth = 2; pen.beginPath();
        pen.arc(x, y, data.radius * camera.zoom, 0, 2 * Math.PI); pen.stroke();
        pen.beginPath(); pen.moveTo(x, y);
        pen.lineTo(...toScreen(tick.proxy.map((v, i) => v + data.radius * tick.normal[i]))); pen.stroke();
      }
      disc(tick.proxy, 5, "proxy");
      if (size(tick.force) > 0)
        arrow(tick.hip, tick.hip.map((v, i) => v + ARROW_PX / camera.zoom * tick.force[i] / newtons), "force");
      disc(tick.hip, 5, "tip");
    }
    rulers();
  }
  const zoom = (by) => { follow.checked = false; chosen = true; camera.zoom *= by; };
  const turned = (a, e) => { turn = [turn[0] + a, Math.max(-1.57, Math.min(1.57, turn[1] + e))]; };
  const moved = (x, y) => { follow.checked = false; chosen = true; camera.x -= x / camera.zoom; camera.y += y / camera.zoom; };
  const push = (x, y) => (dims === 3 ? turned(x * 0.1, y * 0.1) : moved(x * 40, y * 40));
  const acts = {
    left: () => push(-1, 0), right: () => push(1, 0), up: () => push(0, -1), down: () => push(0, 1),
    closer: () => zoom(1.25), farther: () => zoom(0.8), whole: () => { follow.checked = false; whole(); },
  };
  const keys = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down",
                 "+": "closer", "=": "closer", "-": "farther", 0: "whole" };
  for (const button of document.querySelectorAll("button[data-act]"))
    button.addEventListener("click", () => { acts[button.dataset.act](); draw(); });
  if (dims === 2) for (const button of document.querySelectorAll("button.turn")) button.hidden = true;
  view.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey) return;
    event.preventDefault(); acts[act](); draw();
  });
  // The wheel scrolls the page unless the scene has been chosen.
  view.addEventListener("wheel", (event) => {
    if (document.activeElement !== view) return;
    event.preventDefault(); zoom(Math.exp(-event.deltaY / 500)); draw();
  }, { passive: false });
  view.addEventListener("pointermove", (event) => {
    if (!event.buttons || (isPushed && dims === 2)) return;
    if (dims === 3 && !event.shiftKey) turned(event.movementX / 150, event.movementY / 150);
    else moved(event.movementX, event.movementY);
    draw();
  });
  follow.addEventListener("change", () => { if (!follow.checked) whole(); draw(); });
  keptDrawn(view, draw);
  return {
    // A tick {hip, proxy, normal, force, trail}; `all`: the path that the whole scene holds.
    show(now, all) { tick = now; path = all || path; draw(); },
    whole() { whole(); draw(); },
    push(on) {
      isPushed = on;
      document.getElementById("turning").hidden = on;
      document.getElementById("pushing").hidden = !on;
      view.style.cursor = on ? "crosshair" : "";
    },
    row, size, placeOf,
  };
}
