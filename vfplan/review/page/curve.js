// The curve, its bands and its knots; candidates and other ink.
import { byId, make, refill } from "./dom.js";

const text = (points) => points.map((p) => `${p[0]},${p[1]}`).join(" ");
const between = (points, [first, last]) => points.slice(Math.max(first - 1, 0), last + 2);
const ease = (t) => t * t * t * (10 - 15 * t + 6 * t * t);

function line(points, closed, kind) {
  return make(closed ? "polygon" : "polyline", { points: text(points), class: kind });
}

export class Curve {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    view.zoomed = () => this.sizeKnots();
    byId("show-bands").addEventListener("change", () => this.render(app.state));
  }

  render(state) {
    const bands = [];
    const lines = [];
    state.curve_px.forEach((points, k) => {
      bands.push(...this.bands(state, points, state.closed[k]));
      lines.push(line(points, state.closed[k], "casing"), line(points, state.closed[k], "line"));
      state.unseen[k].forEach((run) => lines.push(line(between(points, run), false, "line unseen-part")));
      state.bridged[k].forEach((run) => lines.push(line(between(points, run), false, "line bridged")));
      state.edited[k].forEach((run) => lines.push(line(between(points, run), false, "line edited")));
      lines.push(...this.direction(points, state.closed[k]));
    });
    byId("bands").replaceChildren(...(byId("show-bands").checked ? bands : []));
    byId("lines").replaceChildren(...lines);
    byId("preview").setAttribute("points", "");
    this.knots(state);
    this.otherInk(state);
    this.ways(state);
    this.key(state);
  }

  // The bands in pixels: what the tool keeps away by, the margin, the bound of the registration.
  bands(state, points, closed) {
    const scale = state.mm_per_px;
    if (!scale) return [];
    const made = [];
    for (const [kind, metres] of [["contact", state.contact_m], ["margin", state.margin_m], ["tre", state.tre95_m]]) {
      if (!metres) continue;
      const width = (2e3 * metres) / scale;
      const step = Math.max(1, Math.floor(width / 12)); // a broad band needs few points
      const some = points.filter((_, k) => k % step === 0 || k === points.length - 1);
      const band = line(some, closed, `band ${kind}`);
      band.setAttribute("stroke-width", width);
      made.push(band);
    }
    return made;
  }

  direction(points, closed) {
    const marks = [];
    const count = points.length;
    const step = Math.max(40, Math.round(count / 6));
    for (let k = Math.round(step / 2); k < count - 3; k += step) {
      const [a, b] = [points[k - 2] || points[0], points[k + 2]];
      const angle = (Math.atan2(b[1] - a[1], b[0] - a[0]) * 180) / Math.PI;
      const mark = make("g", { class: "fixed" }, make("path", { class: "chevron", d: "M-4 -5L4 0L-4 5" }), make("path", { class: "chevron", d: "M-4 -5L4 0L-4 5" }));
      marks.push(make("g", { transform: `translate(${points[k][0]} ${points[k][1]}) rotate(${angle})` }, mark));
    }
    if (closed) return marks;
    const start = make("g", { class: "fixed" }, make("circle", { class: "end-mark", r: 8 }));
    const stop = make("g", { class: "fixed" }, make("path", { class: "end-mark", d: "M-7 -7H7V7H-7Z" }));
    marks.push(make("g", { transform: `translate(${points[0]})` }, start));
    marks.push(make("g", { transform: `translate(${points[count - 1]})` }, stop));
    return marks;
  }

  knots(state) {
    const nodes = [];
    state.knots_px.forEach((knots, stroke) => knots.forEach((place, knot) => {
      const key = `${stroke}/${knot}`;
      const chosen = this.app.isSelected("knot", key) ? " chosen" : "";
      const body = make("g", { class: "fixed" }, make("circle", { class: "halo", r: 10 }), make("circle", { class: "dot-of-knot", r: 4.5 }));
      nodes.push(make("g", { class: `thing knot${chosen}`, "data-key": key, transform: `translate(${place[0]} ${place[1]})` }, body));
    }));
    byId("knots").replaceChildren(...nodes);
    this.sizeKnots();
  }

  // A knot's radius stays below half of the knots' distance on the screen.
  sizeKnots() {
    const state = this.app.state;
    if (!state) return;
    let radius = 4.5;
    state.curve_px.forEach((points, k) => {
      radius = Math.min(radius, (0.4 * points.length * this.view.zoom) / Math.max(state.knots_px[k].length, 1));
    });
    if (radius === this.radius && this.sized === state) return;
    this.radius = radius;
    this.sized = state;
    byId("knots").querySelectorAll(".dot-of-knot").forEach((node) => node.setAttribute("r", radius));
    byId("knots").style.display = radius < 1.2 ? "none" : "";
  }

  select(thing) {
    byId("knots").querySelectorAll(".knot").forEach((node) => {
      node.classList.toggle("chosen", thing !== null && thing.kind === "knot" && thing.key === node.dataset.key);
    });
    byId("ink").querySelectorAll(".outline").forEach((node) => {
      node.classList.toggle("chosen", thing !== null && thing.kind === "ink" && String(thing.key) === node.dataset.ink);
    });
    byId("account").querySelectorAll("li").forEach((node) => {
      node.classList.toggle("chosen", thing !== null && thing.kind === "ink" && String(thing.key) === node.dataset.ink);
    });
  }

  knotPlace(key) {
    const [stroke, knot] = key.split("/").map(Number);
    return this.app.state.knots_px[stroke]?.[knot];
  }

  // While a knot is dragged the stretch between its neighbours follows, as the session will move it.
  dragKnot(key, to) {
    const [stroke, knot] = key.split("/").map(Number);
    const state = this.app.state;
    const points = state.curve_px[stroke];
    const knots = state.knots_px[stroke];
    const closed = state.closed[stroke];
    const index = (place) => points.findIndex((p) => p[0] === place[0] && p[1] === place[1]);
    const count = knots.length;
    const own = index(knots[knot]);
    const before = closed || knot > 0 ? index(knots[(knot + count - 1) % count]) : own;
    const after = closed || knot < count - 1 ? index(knots[(knot + 1) % count]) : own;
    const total = points.length;
    const back = (own - before + total) % total;
    const ahead = (after - own + total) % total;
    const shown = [];
    for (let k = -back; k <= ahead; k += 1) {
      const p = points[(own + k + total) % total];
      const share = k <= 0 ? (back ? ease(1 + k / back) : 1) : ease(1 - k / ahead);
      shown.push([p[0] + share * (to[0] - knots[knot][0]), p[1] + share * (to[1] - knots[knot][1])]);
    }
    byId("preview").setAttribute("points", text(shown));
    this.knotNode(key)?.setAttribute("transform", `translate(${to[0]} ${to[1]})`);
  }

  knotNode(key) { return byId("knots").querySelector(`[data-key="${key}"]`); }

  ways(state) {
    const open = state.curve_px.length === 0;
    const nodes = [];
    for (const way of open ? state.candidates : []) {
      const choose = () => this.app.step({ do: "choose", candidate: way.number });
      const hot = (on) => () => this.heat(way.number, on);
      const reach = line(way.points_px, way.closed, "way reach");
      reach.addEventListener("click", choose);
      reach.addEventListener("pointerenter", hot(true));
      reach.addEventListener("pointerleave", hot(false));
      const shown = line(way.points_px, way.closed, "way");
      shown.dataset.way = way.number;
      nodes.push(shown, reach);
    }
    if (open) nodes.push(...state.candidates.map((way) => this.number(way, state.candidates)));
    if (open && state.refusal?.place_px) nodes.push(this.refusedPlace(state.refusal.place_px));
    byId("ways").replaceChildren(...nodes);
  }

  // A candidate's number stands where it lies farthest from the others.
  number(way, ways) {
    let best = [-1, way.points_px[0]];
    for (const p of way.points_px) {
      let off = Infinity;
      for (const other of ways) {
        if (other !== way) for (const q of other.points_px) off = Math.min(off, Math.hypot(p[0] - q[0], p[1] - q[1]));
      }
      if (off > best[0]) best = [off, p];
    }
    const body = make("g", { class: "fixed" }, make("circle", { r: 11 }), make("text", {}, String(way.number)));
    return make("g", { class: "thing way-number", transform: `translate(${best[1][0]} ${best[1][1]})` }, body);
  }

  refusedPlace(place) {
    const body = make("g", { class: "fixed" }, make("circle", { class: "refused", r: 20 }));
    return make("g", { transform: `translate(${place[0]} ${place[1]})` }, body);
  }

  heat(number, on) {
    byId("ways").querySelector(`[data-way="${number}"]`)?.classList.toggle("hot", on);
  }

  wayRow(way) {
    const button = make("button", {
      type: "button", class: "row", onclick: () => this.app.step({ do: "choose", candidate: way.number }),
      onpointerenter: () => this.heat(way.number, true), onpointerleave: () => this.heat(way.number, false),
      onfocus: () => this.heat(way.number, true), onblur: () => this.heat(way.number, false),
    }, make("span", { class: "badge way-badge" }, String(way.number)), `Take this line: ${way.text}`);
    return make("li", {}, button);
  }

  otherInk(state) {
    const shown = state.curve_px.length ? state.account.filter((ink) => ink.is_ink) : [];
    const select = (ink) => this.app.select({ kind: "ink", key: ink.number });
    byId("ink").replaceChildren(...shown.flatMap((ink) => ink.outline.map((points) => {
      const node = line(points, true, `outline${ink.left_out ? " left-out" : ""}`);
      node.dataset.ink = ink.number;
      return node;
    })));
    byId("ink-card").hidden = shown.length === 0;
    byId("ink-count").textContent = `${shown.length}`;
    refill(byId("account"), shown.slice(0, 40).map((ink) => {
      const words = `${ink.pixels} px at (${ink.u.toFixed(0)}, ${ink.v.toFixed(0)})${ink.left_out ? ", left out" : ""}`;
      const go = () => { select(ink); this.view.goTo([ink.u, ink.v]); };
      return make("li", { "data-ink": ink.number }, make("button", { type: "button", class: "row", onclick: go },
        make("span", { class: `badge ${ink.left_out ? "answered" : "doubt"}` }, String(ink.number)), words));
    }));
    for (const box of state.boxes) {
      byId("ink").append(make("rect", { class: "box", x: box[0] - 0.5, y: box[1] - 0.5, width: box[2], height: box[3], "pointer-events": "none" }));
    }
  }

  key(state) {
    const mm = (metres) => `${(1e3 * metres).toFixed(2)} mm`;
    const parts = ["Blue: the measured line, from the ring to the square.", "Dashed orange: bridged. Dotted purple: placed by hand. Yellow: not yet looked at."];
    if (state.tre95_m) parts.push(`Pale blue band: within ${mm(state.tre95_m)} (95 %).`);
    if (state.margin_m) parts.push(`Yellow band: the margin, ${mm(state.margin_m)}.`);
    if (state.mm_per_px) parts.push(`Green band: where the tool's centre is kept out, ${mm(state.contact_m)}.`);
    byId("key").textContent = parts.join(" ");
  }
}
