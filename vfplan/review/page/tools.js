// Pointer and keys: what a press, a drag or a key does with the tool that is chosen.
import { byId, make, refill } from "./dom.js";

const KEYS = [
  ["V, D, X, M", "tools: select, draw, exclude, marker"], ["Wheel, pinch, + and -", "zoom at the pointer"], ["Drag, arrows", "move the slice; Space and drag with any tool"],
  ["F, 1", "fit; one to one"], ["H (hold)", "hide all that is drawn, to see the ink"], ["N, P", "next and previous finding"], ["A", "accept the finding"],
  ["K, Shift-K", "next and previous knot"], ["J, Shift-J", "next and previous marker"], ["Arrows", "move what is selected by a pixel (Shift: ten, Alt: a tenth)"],
  ["Del", "delete the knot or marker"], ["I", "insert a knot behind the selected one"], ["[ and ]", "cut the line before or behind the knot"],
  ["Click or Space", "while drawing: add a point; arrows move the cross"], ["Enter, C, Backspace, Esc", "while drawing: end, close, take back, cancel"],
  ["L", "look along the line, where it was not in view"], ["Ctrl-Z, Ctrl-Shift-Z", "undo and redo"], ["Esc", "select nothing"],
];
const HINTS = {
  select: "", draw: "Click along the line. Enter ends it, C closes it, Esc cancels. Begin or end on the curve to replace a stretch of it.",
  box: "Drag a box over ink that shall not count.", marker: "Click where the marker is.",
};

// Catmull and Rom's spline through points, eight pieces between two of them.
function smooth(points) {
  if (points.length < 3) return points;
  const shown = [points[0]];
  for (let k = 0; k + 1 < points.length; k += 1) {
    const [a, b, c, d] = [points[Math.max(k - 1, 0)], points[k], points[k + 1], points[Math.min(k + 2, points.length - 1)]];
    for (let step = 1; step <= 8; step += 1) {
      const t = step / 8;
      shown.push([0, 1].map((i) => b[i] + 0.5 * t * (c[i] - a[i] + t * (2 * a[i] - 5 * b[i] + 4 * c[i] - d[i] + t * (3 * (b[i] - c[i]) + d[i] - a[i])))));
    }
  }
  return shown;
}

export class Tools {
  constructor(app, view, curve, markers, findings, approval) {
    Object.assign(this, { app, view, curve, markers, findings, approval });
    this.stage = byId("stage");
    this.tool = "select";
    this.clicks = [];
    this.pointers = new Map();
    this.stage.addEventListener("pointerdown", (event) => this.down(event));
    this.stage.addEventListener("pointermove", (event) => this.move(event));
    this.stage.addEventListener("pointerup", (event) => this.up(event));
    this.stage.addEventListener("pointercancel", () => this.cancel());
    this.stage.addEventListener("dblclick", () => this.tool === "draw" && this.endDrawing(false));
    document.addEventListener("keydown", (event) => this.key(event));
    document.addEventListener("keyup", (event) => this.keyUp(event));
    document.querySelectorAll("[data-tool]").forEach((button) => button.addEventListener("click", () => this.choose(button.dataset.tool)));
    byId("help").addEventListener("click", () => this.help());
    byId("keys-list").append(...KEYS.flatMap(([key, words]) => [make("dt", {}, make("kbd", {}, key)), make("dd", {}, words)]));
  }

  choose(tool) {
    this.tool = tool;
    this.stage.className = tool;
    document.querySelectorAll("[data-tool]").forEach((b) => b.setAttribute("aria-checked", String(b.dataset.tool === tool)));
    byId("hint").textContent = HINTS[tool];
    this.clearDrawing();
    if (tool !== "select") this.app.select(null);
    this.stage.focus({ preventScroll: true });
  }

  render(state) {
    if (this.clicks.length) this.showDrawing();
    const knot = this.app.selected?.kind === "knot" ? this.curve.knotPlace(this.app.selected.key) : true;
    const marker = this.app.selected?.kind === "marker" ? state.markers[this.app.selected.key] : true;
    if (!knot || !marker) this.app.select(null);
    this.context();
  }

  select() { this.context(); }

  // What can be done with the selected thing, beside it for the pointer.
  context() {
    const thing = this.app.selected;
    const bar = byId("context");
    const button = (words, call, key) => make("button", { type: "button", onclick: call, title: key || "" }, words);
    const step = (fields) => () => this.app.step(fields);
    let nodes = [];
    if (thing?.kind === "knot") {
      const [stroke, knot] = thing.key.split("/").map(Number);
      const place = this.curve.knotPlace(thing.key);
      nodes = [`Knot ${knot + 1}`, button("Delete", () => this.remove(), "Del"), button("Insert behind", () => this.insert(), "I"),
        button("Cut before", step({ do: "cut", stroke, start: place }), "["), button("Cut behind", step({ do: "cut", stroke, end: place }), "]"),
        button("Turn round", step({ do: "reverse", stroke }))];
      if (this.app.state.curve_px.length > 1) {
        const other = stroke === 0 ? 1 : 0;
        nodes.push(button(`Join with stroke ${other + 1}`, step({ do: "join", stroke, other })), button("Delete stroke", step({ do: "delete_stroke", stroke })));
      }
    } else if (thing?.kind === "ink") {
      nodes = [`Ink ${thing.key}`, button("Take as the curve", step({ do: "take", ink: thing.key, as: "curve" })),
        button("Take as a part", step({ do: "take", ink: thing.key, as: "part" })), button("Leave out", step({ do: "leave", ink: thing.key }))];
    } else if (thing?.kind === "marker" && this.app.state.markers[thing.key]) {
      const marker = this.app.state.markers[thing.key];
      nodes = [`Marker ${marker.label}`, button(marker.used ? "Leave out" : "Use", step({ do: "leave_out_marker", marker: marker.label, out: marker.used })),
        button("Delete", () => this.remove(), "Del")];
    }
    bar.hidden = nodes.length === 0;
    refill(bar, nodes);
  }

  remove() {
    const thing = this.app.selected;
    if (thing?.kind === "knot") {
      const [stroke, knot] = thing.key.split("/").map(Number);
      this.app.step({ do: "delete_knot", stroke, knot });
    } else if (thing?.kind === "marker") this.app.step({ do: "delete_marker", marker: this.markers.label(thing.key) });
  }

  insert() {
    if (this.app.selected?.kind !== "knot") return;
    const [stroke, knot] = this.app.selected.key.split("/").map(Number);
    const state = this.app.state;
    const knots = state.knots_px[stroke];
    const index = (place) => state.curve_px[stroke].findIndex((p) => p[0] === place[0] && p[1] === place[1]);
    const first = index(knots[knot]);
    const next = knot + 1 < knots.length ? index(knots[knot + 1]) : state.curve_px[stroke].length - 1;
    this.app.step({ do: "insert_knot", stroke, at: state.curve_px[stroke][Math.round((first + next) / 2)] });
  }

  // Pointer.

  down(event) {
    if (event.target.closest("#context")) return;
    this.stage.focus({ preventScroll: true });
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.crossAt(null);
    const place = this.view.place(event);
    if (this.pointers.size === 2) { this.drag = { kind: "pinch", before: this.spread() }; return; }
    this.start = { at: [event.clientX, event.clientY], place };
    const target = event.target;
    const knot = target.closest(".knot");
    const marker = target.closest(".marker");
    const pin = target.closest(".pin");
    const ink = target.closest(".outline");
    if (this.space || event.button === 1) this.drag = { kind: "pan" };
    else if (this.tool === "box") this.drag = { kind: "box" };
    else if (this.tool === "draw" || this.tool === "marker") this.drag = { kind: "click" };
    else if (marker) this.grasp("marker", Number(marker.dataset.marker), this.markers.place(Number(marker.dataset.marker)), place);
    else if (knot) this.grasp("knot", knot.dataset.key, this.curve.knotPlace(knot.dataset.key), place);
    else if (pin) { this.findings.goTo(Number(pin.dataset.finding)); this.drag = null; }
    else if (target.closest(".way")) this.drag = { kind: "way", node: target };
    else this.drag = { kind: "pan", ink: ink ? Number(ink.dataset.ink) : null };
    this.stage.classList.toggle("busy", this.drag?.kind === "pan");
  }

  grasp(kind, key, own, place) {
    this.app.select({ kind, key });
    this.drag = { kind, key, shift: [own[0] - place[0], own[1] - place[1]], moved: false };
  }

  spread() {
    const [a, b] = [...this.pointers.values()];
    return { distance: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] };
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (this.pointers.has(event.pointerId)) this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const place = this.view.place(event);
    if (this.clicks.length) this.showDrawing(place);
    const drag = this.drag;
    if (!drag || !before) return;
    if (drag.kind === "pan") {
      this.view.pan(event.clientX - before[0], event.clientY - before[1]);
      if (Math.hypot(event.clientX - this.start.at[0], event.clientY - this.start.at[1]) > 4) drag.moved = true;
    } else if (drag.kind === "pinch") {
      const now = this.spread();
      const box = this.stage.getBoundingClientRect();
      this.view.setZoom((this.view.zoom * now.distance) / Math.max(drag.before.distance, 1), [now.middle[0] - box.left, now.middle[1] - box.top]);
      this.view.pan(now.middle[0] - drag.before.middle[0], now.middle[1] - drag.before.middle[1]);
      drag.before = now;
    } else if (drag.kind === "box") this.showBox(this.start.place, place);
    else if (drag.kind === "knot" || drag.kind === "marker") {
      if (!drag.moved && Math.hypot(event.clientX - this.start.at[0], event.clientY - this.start.at[1]) < 3) return;
      drag.moved = true;
      drag.to = this.clamp([place[0] + drag.shift[0], place[1] + drag.shift[1]]);
      if (drag.kind === "knot") this.curve.dragKnot(drag.key, drag.to);
      else this.markers.drag(drag.key, drag.to);
    }
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    this.stage.classList.remove("busy");
    const drag = this.drag;
    this.drag = null;
    if (!drag) return;
    const place = this.clamp(this.view.place(event));
    if (drag.kind === "knot" && drag.moved) this.moveKnot(drag.key, drag.to);
    else if (drag.kind === "marker" && drag.moved) this.moveMarker(drag.key, drag.to);
    else if (drag.kind === "box") this.endBox(place);
    else if (drag.kind === "click") this.click(place);
    else if (drag.kind === "way") drag.node.dispatchEvent(new Event("click"));
    else if (drag.kind === "pan" && !drag.moved && !this.space) this.app.select(drag.ink === null || drag.ink === undefined ? null : { kind: "ink", key: drag.ink });
  }

  cancel() {
    this.pointers.clear();
    this.drag = null;
    if (this.app.state) { this.curve.render(this.app.state); this.markers.render(this.app.state); }
  }

  clamp([u, v]) {
    const image = this.app.state.image;
    return [Math.min(Math.max(u, -0.5), image.width_px - 0.5), Math.min(Math.max(v, -0.5), image.height_px - 0.5)];
  }

  moveKnot(key, to) {
    const [stroke, knot] = key.split("/").map(Number);
    this.app.step({ do: "move_knot", stroke, knot, to });
  }

  moveMarker(key, to) { this.app.step({ do: "move_marker", marker: this.markers.label(key), to }); }

  // Clicks of a tool, by the pointer or at the keyboard's cross.

  click(place) {
    if (this.tool === "draw") {
      this.clicks.push(place);
      this.showDrawing(place);
    } else if (this.tool === "marker") {
      const taken = new Set(this.app.state.markers.map((m) => m.label));
      let number = this.app.state.markers.length + 1;
      while (taken.has(`M${number}`)) number += 1;
      this.app.step({ do: "add_marker", label: `M${number}`, at: place });
      this.choose("select");
    } else if (this.tool === "box") {
      if (this.corner) this.endBox(place, this.corner);
      else this.corner = place;
    }
  }

  // A smooth line through the clicks, near to the spline that the session will draw.
  showDrawing(place) {
    const points = place ? [...this.clicks, place] : this.clicks;
    byId("preview").setAttribute("points", smooth(points).map((p) => p.join(",")).join(" "));
    byId("clicks").replaceChildren(...this.clicks.map((p) => make("g", { transform: `translate(${p[0]} ${p[1]})` },
      make("g", { class: "fixed" }, make("circle", { r: 3.5 })))));
  }

  clearDrawing() {
    this.clicks = [];
    this.corner = null;
    byId("clicks").replaceChildren();
    byId("preview").setAttribute("points", "");
    byId("box").setAttribute("hidden", "");
  }

  endDrawing(closed) {
    const points = this.clicks;
    this.clearDrawing();
    if (points.length < 2) return;
    this.app.step({ do: "draw", points, closed });
    this.choose("select");
  }

  showBox(a, b) {
    const box = byId("box");
    box.removeAttribute("hidden");
    box.setAttribute("x", Math.min(a[0], b[0]));
    box.setAttribute("y", Math.min(a[1], b[1]));
    box.setAttribute("width", Math.abs(a[0] - b[0]));
    box.setAttribute("height", Math.abs(a[1] - b[1]));
  }

  endBox(place, start = this.start.place) {
    this.clearDrawing();
    const box = [Math.min(start[0], place[0]), Math.min(start[1], place[1]), Math.abs(start[0] - place[0]), Math.abs(start[1] - place[1])];
    if (box[2] >= 1 && box[3] >= 1) this.app.step({ do: "exclude", box });
    this.choose("select");
  }

  crossAt(place) {
    this.cross = place;
    byId("cross").setAttribute("visibility", place ? "visible" : "hidden");
    if (place) {
      byId("cross").setAttribute("transform", `translate(${place[0]} ${place[1]})`);
      this.view.tellPlace(place);
      if (this.clicks.length) this.showDrawing(place);
      if (this.corner) this.showBox(this.corner, place);
    }
  }

  // Keys.

  help() { byId("keys").showModal(); }

  key(event) {
    const typing = event.target.closest("input, textarea, select") && event.target.type !== "checkbox" && event.target.type !== "range";
    if (!this.app.state || document.querySelector("dialog[open]")) return;
    if ((event.ctrlKey || event.metaKey) && !typing) {
      const key = event.key.toLowerCase();
      if (key === "z" || key === "y") {
        event.preventDefault();
        byId(key === "y" || event.shiftKey ? "redo" : "undo").click();
      }
      return;
    }
    if (typing || event.ctrlKey || event.metaKey) return;
    const own = event.target === this.stage || event.target === document.body;
    if (own && event.key.startsWith("Arrow")) { this.arrow(event); event.preventDefault(); return; }
    if (own && event.key === " ") { this.space = true; event.preventDefault(); return; }
    if (this.tool === "draw" && own) {
      if (event.key === "Enter") { this.endDrawing(false); return; }
      if (event.key === "c" || event.key === "C") { this.endDrawing(true); return; }
      if (event.key === "Backspace") { this.clicks.pop(); this.showDrawing(this.cross); return; }
    }
    const back = event.shiftKey ? -1 : 1;
    const calls = {
      v: () => this.choose("select"), d: () => this.choose("draw"), x: () => this.choose("box"), m: () => this.choose("marker"),
      f: () => this.view.fit(), 1: () => byId("one").click(), "+": () => this.view.setZoom(this.view.zoom * 1.25), "=": () => this.view.setZoom(this.view.zoom * 1.25),
      "-": () => this.view.setZoom(this.view.zoom / 1.25), h: () => this.stage.classList.add("plain"), n: () => this.findings.turn(1), p: () => this.findings.turn(-1),
      a: () => this.app.selected?.kind === "finding" && this.findings.accept(this.app.selected.key), k: () => this.nextKnot(back), j: () => this.nextMarker(back),
      delete: () => this.remove(), i: () => this.insert(), "[": () => this.cut("start"), "]": () => this.cut("end"), l: () => this.approval.lookAlong(),
      "?": () => this.help(), escape: () => { if (this.clicks.length || this.corner) this.clearDrawing(); else if (this.tool !== "select") this.choose("select"); else this.app.select(null); this.crossAt(null); },
    };
    const call = calls[event.key.toLowerCase()];
    if (call) { event.preventDefault(); call(); }
  }

  keyUp(event) {
    if (event.key.toLowerCase() === "h") this.stage.classList.remove("plain");
    if (event.key === " " && this.space) {
      this.space = false;
      if (this.cross && !this.drag && this.tool !== "select") this.click(this.cross);
    }
  }

  cut(side) {
    if (this.app.selected?.kind !== "knot") return;
    const stroke = Number(this.app.selected.key.split("/")[0]);
    this.app.step({ do: "cut", stroke, [side]: this.curve.knotPlace(this.app.selected.key) });
  }

  arrow(event) {
    const step = event.shiftKey ? 10 : event.altKey ? 0.1 : 1;
    const [du, dv] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    const thing = this.app.selected;
    if (this.tool !== "select") {
      const image = this.app.state.image;
      const [width, height] = this.view.size();
      const from = this.cross || [(width / 2 - this.view.x) / this.view.zoom, (height / 2 - this.view.y) / this.view.zoom];
      const to = this.clamp([from[0] + du, from[1] + dv]);
      this.crossAt(image ? to : null);
    } else if (thing?.kind === "knot" || thing?.kind === "marker") this.nudge(thing, du, dv);
    else this.view.pan(-60 * Math.sign(du), -60 * Math.sign(dv));
  }

  // Several presses are one step, sent once the keys rest.
  nudge(thing, du, dv) {
    const own = thing.kind === "knot" ? this.curve.knotPlace(thing.key) : this.markers.place(thing.key);
    if (!own) return;
    const from = this.nudged?.key === thing.key ? this.nudged.to : own;
    const to = this.clamp([from[0] + du, from[1] + dv]);
    this.nudged = { key: thing.key, to };
    if (thing.kind === "knot") this.curve.dragKnot(thing.key, to);
    else this.markers.drag(thing.key, to);
    clearTimeout(this.nudgeTimer);
    this.nudgeTimer = setTimeout(() => {
      this.nudged = null;
      if (thing.kind === "knot") this.moveKnot(thing.key, to);
      else this.moveMarker(thing.key, to);
    }, 350);
  }

  nextKnot(by) {
    const keys = this.app.state.knots_px.flatMap((knots, stroke) => knots.map((_, knot) => `${stroke}/${knot}`));
    if (!keys.length) return;
    const now = this.app.selected?.kind === "knot" ? keys.indexOf(this.app.selected.key) : by > 0 ? -1 : 0;
    const key = keys[(now + by + keys.length) % keys.length];
    this.app.select({ kind: "knot", key });
    const place = this.curve.knotPlace(key);
    if (!this.view.isIn(place)) this.view.goTo(place, this.view.zoom);
    this.app.say(`Knot ${keys.indexOf(key) + 1} of ${keys.length} at ${place.map((x) => x.toFixed(0)).join(", ")}`);
  }

  nextMarker(by) {
    const count = this.app.state.markers.length;
    if (!count) return;
    const now = this.app.selected?.kind === "marker" ? this.app.selected.key : by > 0 ? -1 : 0;
    const key = (now + by + count) % count;
    this.app.select({ kind: "marker", key });
    const place = this.markers.place(key);
    if (place && !this.view.isIn(place)) this.view.goTo(place, this.view.zoom);
    this.app.say(`Marker ${this.markers.label(key)}`);
  }
}
