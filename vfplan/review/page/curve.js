// The curve, its bands and its knots; candidates and other ink.
import { byId, fixed, make, makeAt, refill, translation } from "./dom.js";

const KNOT_PX = 4.5; // radius of a knot on the screen
const MIN_KNOT_PX = 1.2; // knots that would be smaller are not shown
const CHEVRON = "M-4 -5L4 0L-4 5";
const CHEVRON_POINTS = 40; // a chevron at most every so many points, and six a stroke
const MAX_INK_ROWS = 40;
const NUMBER_PX = 11; // radius of a candidate's number on the screen
const STEM_PX = 30; // from a line to its number, where the number does not fit onto it
const INK_NUMBER_PX = 18; // between two numbers of ink at least; of nearer ones the first is shown
const KNOT_STEP_PX = 24; // between two knots that are shown at least

export class Curve {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    view.zoomed = () => this.sizeKnots();
    view.settled.push(() => {
      if (app.state?.curve_px.length === 0) this.candidates(app.state);
      else if (app.state) this.inkNumbers(app.state);
    });
    byId("show-bands").addEventListener("change", () => this.render(app.state));
  }

  render(state) {
    const bands = [];
    // What the robot renders, as its own engine gives it. A preview of a drag has none.
    const kind = state.rendered?.kind;
    const lines = (state.outline_px ?? []).flatMap((points) => [
      line(points, false, "casing"),
      line(points, false, `rendered ${kind}`),
    ]);
    state.curve_px.forEach((points, k) => {
      const closed = state.closed[k];
      const bound = state.bound_px?.[k];
      if (bound && byId("show-bands").checked) bands.push(make("path", { d: bandAlong(points, closed, bound), class: "band" }));
      lines.push(line(points, closed, "casing of-line"), line(points, closed, "line"));
      for (const run of state.unseen[k]) lines.push(line(stretch(points, run), false, "line unseen-part"));
      for (const run of state.bridged[k]) lines.push(line(stretch(points, run), false, "line bridged"));
      for (const run of state.edited[k]) lines.push(line(stretch(points, run), false, "line edited"));
      lines.push(...chevrons(points));
      if (!closed) lines.push(...endMarks(points));
    });
    byId("bands").replaceChildren(...bands);
    byId("lines").replaceChildren(...lines);
    this.knots(state);
    this.otherInk(state);
    this.candidates(state);
    // The row that takes the focus of the one before it showed its line.
    byId("preview").setAttribute("points", "");
    this.legend(state);
  }

  knots(state) {
    const nodes = [];
    state.knots_px.forEach((knots, stroke) => {
      knots.forEach((place, knot) => {
        const key = `${stroke}/${knot}`;
        const chosen = this.app.isSelected("knot", key) ? " chosen" : "";
        const attributes = { class: `thing knot${chosen}`, "data-key": key };
        const grip = make("circle", { class: "grip", r: 2 * KNOT_PX });
        const halo = make("circle", { class: "halo", r: 10 });
        const dot = make("circle", { class: "dot-of-knot", r: KNOT_PX });
        nodes.push(makeAt(place, attributes, grip, halo, dot));
      });
    });
    byId("knots").replaceChildren(...nodes);
    this.sizeKnots();
  }

  // A knot's grip reaches twice as far as its radius, which stays below half of the knots' distance on
  // the screen: none hides another.
  sizeKnots() {
    const state = this.app.state;
    if (!state) return;
    let spacing = Infinity; // of the closest knots
    state.curve_px.forEach((points, k) => {
      spacing = Math.min(spacing, (points.length * this.view.zoom) / Math.max(state.knots_px[k].length, 1));
    });
    const radius = Math.min(KNOT_PX, 0.4 * spacing);
    // Of knots that would lie like beads every second, fourth ... is shown; each can be taken.
    const every = 2 ** Math.max(0, Math.ceil(Math.log2(KNOT_STEP_PX / spacing)));
    if (radius === this.radius && every === this.every && this.sized === state) return;
    Object.assign(this, { radius, every, sized: state });
    for (const node of byId("knots").children) {
      node.classList.toggle("between", Number(node.dataset.key.split("/")[1]) % every > 0);
    }
    for (const node of byId("knots").querySelectorAll(".dot-of-knot")) node.setAttribute("r", Math.min(radius * every, KNOT_PX));
    for (const node of byId("knots").querySelectorAll(".grip")) node.setAttribute("r", 2 * radius);
    byId("knots").style.display = radius < MIN_KNOT_PX ? "none" : "";
  }

  select() {
    for (const node of byId("knots").querySelectorAll(".knot")) {
      node.classList.toggle("chosen", this.app.isSelected("knot", node.dataset.key));
    }
    for (const node of document.querySelectorAll("#ink .outline, #account li")) {
      node.classList.toggle("chosen", this.app.isSelected("ink", Number(node.dataset.ink)));
    }
  }

  knotPlace(key) {
    const [stroke, knot] = key.split("/").map(Number);
    return this.app.state.knots_px[stroke]?.[knot];
  }

  // The index of the point of a stroke that a knot lies on.
  pointIndex(stroke, [u, v]) {
    return this.app.state.curve_px[stroke].findIndex((p) => p[0] === u && p[1] === v);
  }

  // While a knot is dragged the stretch between its neighbours follows, as the session will move it:
  // the knot by the whole way, its neighbours by nothing, and what lies between by a smooth share.
  dragKnot(key, to) {
    const [stroke, knot] = key.split("/").map(Number);
    const points = this.app.state.curve_px[stroke];
    const knots = this.app.state.knots_px[stroke];
    const closed = this.app.state.closed[stroke];
    const own = this.pointIndex(stroke, knots[knot]);
    let [before, after] = [own, own];
    if (closed || knot > 0) {
      before = this.pointIndex(stroke, knots[(knot + knots.length - 1) % knots.length]);
    }
    if (closed || knot < knots.length - 1) {
      after = this.pointIndex(stroke, knots[(knot + 1) % knots.length]);
    }
    const total = points.length;
    const back = (own - before + total) % total;
    const ahead = (after - own + total) % total;
    const [du, dv] = [to[0] - knots[knot][0], to[1] - knots[knot][1]];
    const shown = [];
    for (let k = -back; k <= ahead; k += 1) {
      const [u, v] = points[(own + k + total) % total];
      let share = 1;
      if (k < 0) share = ease(1 + k / back);
      if (k > 0) share = ease(1 - k / ahead);
      shown.push([u + share * du, v + share * dv]);
    }
    byId("preview").setAttribute("points", textOf(shown));
    const node = byId("knots").querySelector(`[data-key="${key}"]`);
    node?.setAttribute("transform", translation(to));
  }

  // The lines that may be meant, and the place where extraction stopped.
  candidates(state) {
    const nodes = [];
    if (state.curve_px.length === 0) {
      // The longest is painted last, so that a click takes it where several lie at one place.
      const ways = [...state.candidates].sort((a, b) => a.length_px - b.length_px);
      for (const way of ways) nodes.push(...this.candidate(way));
      const placed = [];
      for (const way of state.candidates) nodes.push(this.number(way, state.candidates, placed));
      const refusal = state.refusal;
      if (refusal?.place_px && refusal.code !== "several-candidates") {
        nodes.push(makeAt(refusal.place_px, {}, make("circle", { class: "refused", r: 20 })));
      }
    }
    byId("ways").replaceChildren(...nodes);
    // Once a line was chosen, the others stay at hand.
    const last = state.steps.at(-1);
    const isJustChosen = state.curve_px.length > 0 && last?.do === "choose";
    const others = isJustChosen ? state.candidates.filter((way) => way.name !== last.candidate) : [];
    byId("others-card").hidden = others.length === 0;
    refill(byId("others"), others.map((way) => this.candidateRow(way)));
  }

  // A candidate's line, and a broad invisible one over it that is easy to hit.
  candidate(way) {
    const shown = line(way.points_px, way.closed, "way");
    shown.dataset.way = way.name;
    const reach = line(way.points_px, way.closed, "way reach");
    reach.addEventListener("click", () => this.choose(way));
    reach.addEventListener("pointerenter", () => this.heat(way, true));
    reach.addEventListener("pointerleave", () => this.heat(way, false));
    return [shown, reach];
  }

  choose(way) {
    this.app.step({ do: "choose", candidate: way.name });
  }

  heat(way, isHot) {
    const node = byId("ways").querySelector(`[data-way="${way.name}"]`);
    node?.classList.toggle("hot", isHot);
    if (!node) byId("preview").setAttribute("points", isHot ? textOf(way.points_px) : "");
  }

  // A candidate's number stands in view, off the other lines and off the numbers placed before it,
  // by as much as can be told on the screen.
  number(way, ways, placed) {
    const others = ways.filter((other) => other !== way).flatMap((other) => other.points_px);
    const taken = placed.map((at) => this.view.onSlice(at));
    const enough = 2 * NUMBER_PX / this.view.zoom;
    let place = way.points_px[0];
    let best = -1;
    for (const p of way.points_px) {
      let score = distanceTo(others, p, enough) + distanceTo(taken, p, enough);
      if (this.view.isIn(p, 2 * NUMBER_PX)) score += 4 * enough;
      if (score > best) {
        best = score;
        place = p;
      }
    }
    // A short line beside others has no room for it: it then stands beside its line, on a stem.
    const isFree = distanceTo(taken, place, enough) >= enough;
    const [x, y] = this.view.freeWay(place, isFree ? 0 : STEM_PX, placed, NUMBER_PX);
    const stem = make("path", { d: `M0 0L${x} ${y}` });
    const number = make("text", { x, y }, way.name);
    return makeAt(place, { class: "thing way-number" }, stem, make("circle", { cx: x, cy: y, r: NUMBER_PX }), number);
  }

  candidateRow(way) {
    const button = make(
      "button",
      {
        type: "button",
        class: "row",
        onclick: () => this.choose(way),
        onpointermove: () => this.heat(way, true), // and not where a row comes to lie below it
        onpointerleave: () => this.heat(way, false),
        onfocus: () => this.heat(way, true),
        onblur: () => this.heat(way, false),
      },
      make("span", { class: "badge way-badge" }, way.name),
      `Take this line: ${way.words}`,
    );
    return make("li", {}, button);
  }

  otherInk(state) {
    const outlines = [];
    const rows = [];
    if (state.curve_px.length) {
      const pieces = state.account.filter((ink) => ink.what === "ink");
      for (const ink of pieces) {
        for (const points of ink.outline) {
          const outline = line(points, true, ink.left_out ? "outline left-out" : "outline");
          outline.dataset.ink = ink.number;
          outlines.push(outline);
        }
      }
      for (const ink of pieces.slice(0, MAX_INK_ROWS)) rows.push(this.inkRow(ink));
      byId("ink-count").textContent = pieces.length;
    }
    for (const [x, y, width, height] of state.boxes) {
      const place = { x: x - 0.5, y: y - 0.5, width, height };
      outlines.push(make("rect", { class: "box", "pointer-events": "none", ...place }));
    }
    byId("ink").replaceChildren(...outlines);
    this.inkNumbers(state);
    byId("ink-card").hidden = rows.length === 0;
    refill(byId("account"), rows);
  }

  // The number of each piece of ink above it, if no other's stands there.
  inkNumbers(state) {
    const [placed, nodes] = [[], []];
    const pieces = state.account.filter((ink) => ink.outline.length && !ink.left_out);
    for (const ink of state.curve_px.length ? pieces.slice(0, MAX_INK_ROWS) : []) {
      const top = ink.outline.flat().reduce((a, b) => (b[1] < a[1] ? b : a));
      const at = this.view.onStage(top);
      if (distanceTo(placed, at, INK_NUMBER_PX) < INK_NUMBER_PX) continue;
      placed.push(at);
      nodes.push(makeAt(top, { class: "thing ink-number" }, make("circle", { cy: -9, r: 8 }), make("text", { y: -9 }, String(ink.number))));
    }
    byId("ink-numbers").replaceChildren(...nodes);
  }

  inkRow(ink) {
    const goTo = () => {
      this.app.select({ kind: "ink", key: ink.number });
      this.view.goTo([ink.u, ink.v]);
    };
    let words = `ink of ${fixed(ink.size_px, 0)} px at ${pixelOf([ink.u, ink.v])}`;
    if (ink.left_out) words += ", left out";
    const kind = ink.left_out ? "answered" : "ink";
    const badge = make("span", { class: `badge ${kind}` }, String(ink.number));
    const button = make("button", { type: "button", class: "row", onclick: goTo }, badge, words);
    return make("li", { "data-ink": ink.number }, button);
  }

  // What each line, band and sign means that is drawn now.
  legend(state) {
    const mm = (metres) => `${(1e3 * metres).toFixed(2)} mm`;
    const has = (severity) => state.findings.some((one) => one.severity === severity && one.place_px);
    const hasInk = (isOut) => state.curve_px.length > 0 && state.account.some((one) => one.what === "ink" && one.left_out === isOut);
    const isOpen = state.curve_px.length === 0;
    const hasRuns = (name) => state[name].some((runs) => runs.length);
    const rows = [
      [isOpen && state.candidates.length, "of-way", "a line that may be the curve"],
      [isOpen && state.refusal?.place_px, "of-refused", "where the line is in doubt"],
      [state.curve_px.length, "measured", "the measured line, from the ring to the square"],
      [hasRuns("bridged"), "bridged", "carried across a gap in the ink"],
      [hasRuns("edited"), "edited", "placed by hand"],
      [hasRuns("unseen"), "unseen-part", "not looked at yet"],
      [state.curve_px.length, "of-knot", "a knot, by which the line can be moved"],
      [hasInk(false), "of-ink", "ink that is not the curve"],
      [hasInk(true), "of-ink left-out", "ink that was left out"],
      [state.boxes.length, "of-box", "excluded"],
      [has("doubt"), "of-pin doubt", "a finding to answer"],
      [has("note"), "of-pin", "a finding for your information"],
      [state.markers.some((one) => one.used && one.residual_px), "of-arrow", "from a marker to where the fit puts it, enlarged"],
      [state.rendered, "of-tip", "with Push: the tool tip"],
      [state.rendered, "of-proxy", "with Push: the proxy, which the wall stops, and its circle"],
      [state.rendered, "of-force", "with Push: the force on the tip"],
    ].filter(([isDrawn]) => isDrawn).map(([, ...row]) => row);
    if (state.bound_px?.length) rows.push(["tre", `the line lies within this of its place (95 %), ${mm(state.tre95_m)} where that is largest`]);
    if (state.rendered) {
      const words = { wall: "the wall: it holds the tip back", guide: "the tube: the tip is held within it" };
      rows.push([`rendered ${state.rendered.kind}`, `${words[state.rendered.kind]}, as the robot's engine says`]);
    }
    for (const [heading, words] of state.described ?? []) rows.push(["none", `${heading}: ${words}`]);
    const items = rows.map(([kind, words]) => make("li", {}, make("span", { class: `swatch ${kind}` }), words));
    byId("legend").replaceChildren(...items);
  }
}

function textOf(points) {
  return points.map((p) => `${p[0]},${p[1]}`).join(" ");
}

function pixelOf([u, v]) {
  return `(${fixed(u, 0)}, ${fixed(v, 0)})`;
}

// The distance of a place from the nearest of some points, or `enough` where that is less.
function distanceTo(points, [u, v], enough) {
  let nearest = enough;
  for (const [x, y] of points) nearest = Math.min(nearest, Math.hypot(u - x, v - y));
  return nearest;
}

function line(points, closed, kind) {
  return make(closed ? "polygon" : "polyline", { points: textOf(points), class: kind });
}

// The points of a run, [first, last], with a neighbour on either side, so that no gap is seen.
function stretch(points, [first, last]) {
  return points.slice(Math.max(first - 1, 0), last + 2);
}

// What lies within a distance of a line that varies along it: a disc around each point, and a
// quadrilateral from each to the next. All run the same way round, so that together they are filled.
function bandAlong(points, closed, bound) {
  const step = Math.max(1, Math.floor(Math.min(...bound) / 6)); // a broad band needs few points
  const some = [...points.keys()].filter((k) => k % step === 0 || k === points.length - 1);
  if (closed) some.push(0);
  const shapes = some.map((k, n) => {
    const [[u, v], half] = [points[k], bound[k]];
    const disc = `M${u - half} ${v}a${half} ${half} 0 1 0 ${2 * half} 0a${half} ${half} 0 1 0 ${-2 * half} 0`;
    if (n === 0) return disc;
    const [[x, y], before] = [points[some[n - 1]], bound[some[n - 1]]];
    const length = Math.hypot(u - x, v - y) || 1;
    const [across, down] = [(y - v) / length, (u - x) / length];
    const corners = [[x, y, before], [u, v, half], [u, v, -half], [x, y, -before]];
    return `${disc}M${corners.map(([p, q, away]) => `${p + away * across} ${q + away * down}`).join("L")}Z`;
  });
  return shapes.join("");
}

// From 0 to 1 with no speed and no acceleration at either end.
function ease(t) {
  return t ** 3 * (10 - 15 * t + 6 * t ** 2);
}

// Arrow heads along a stroke, which show its direction.
function chevrons(points) {
  const marks = [];
  const step = Math.max(CHEVRON_POINTS, Math.round(points.length / 6));
  for (let k = Math.round(step / 2); k < points.length - 3; k += step) {
    const before = points[Math.max(k - 2, 0)];
    const after = points[k + 2];
    const turn = (Math.atan2(after[1] - before[1], after[0] - before[0]) * 180) / Math.PI;
    const shape = [make("path", { class: "chevron", d: CHEVRON }), make("path", { class: "chevron", d: CHEVRON })];
    const mark = makeAt(points[k], {}, ...shape);
    mark.setAttribute("transform", `${translation(points[k])} rotate(${turn})`);
    marks.push(mark);
  }
  return marks;
}

// A ring at the start of an open stroke, and a square at its end.
function endMarks(points) {
  const ring = make("circle", { class: "end-mark", r: 8 });
  const square = make("path", { class: "end-mark", d: "M-7 -7H7V7H-7Z" });
  return [makeAt(points[0], {}, ring), makeAt(points[points.length - 1], {}, square)];
}
