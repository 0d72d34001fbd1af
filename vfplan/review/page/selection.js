// What is selected, a knot, a marker or a piece of ink, and what can be done with it.
import { byId, fixed, make, refill } from "./dom.js";

const NUDGE_REST_MS = 350; // several presses of an arrow are one step, sent once the keys rest
const BAR_PX = 110; // height of the window's foot that the bar of buttons covers

export class Selection {
  constructor(app, view, curve, markers) {
    this.app = app;
    this.view = view;
    this.curve = curve;
    this.markers = markers;
    this.nudged = null;
  }

  render(state) {
    const thing = this.app.selected;
    const isKnotGone = thing?.kind === "knot" && !this.curve.knotPlace(thing.key);
    const isMarkerGone = thing?.kind === "marker" && !state.markers[thing.key];
    if (isKnotGone || isMarkerGone) this.app.select(null);
    this.showBar();
  }

  select() {
    this.showBar();
  }

  // A bar of buttons below the slice, or above it where it would cover what is selected.
  showBar() {
    const thing = this.app.selected;
    let nodes = [];
    if (thing?.kind === "knot") nodes = this.knotButtons(thing.key);
    if (thing?.kind === "ink") nodes = this.inkButtons(thing.key);
    if (thing?.kind === "marker") nodes = this.markerButtons(this.app.state.markers[thing.key]);
    const place = this.place();
    const isLow = place && this.view.onStage(place)[1] > this.view.size()[1] - BAR_PX;
    byId("context").classList.toggle("above", Boolean(isLow));
    byId("context").hidden = nodes.length === 0;
    refill(byId("context"), nodes);
  }

  knotButtons(key) {
    const [stroke, knot] = key.split("/").map(Number);
    const place = this.curve.knotPlace(key);
    const nodes = [
      `Knot ${knot + 1}`,
      button("Delete", "Del", () => this.remove()),
      button("Insert behind", "I", () => this.insert()),
      this.stepButton("Cut before", "[", { do: "cut", stroke, start: place }),
      this.stepButton("Cut behind", "]", { do: "cut", stroke, end: place }),
      this.stepButton("Turn round", "", { do: "reverse", stroke }),
    ];
    if (this.app.state.curve_px.length > 1) {
      for (const other of this.strokesToJoin(stroke)) {
        nodes.push(this.stepButton(`Join with stroke ${other + 1}`, "", { do: "join", stroke, other }));
      }
      nodes.push(this.stepButton("Delete stroke", "", { do: "delete_stroke", stroke }));
    }
    return nodes;
  }

  // Every other open stroke, if this one is open.
  strokesToJoin(stroke) {
    const closed = this.app.state.closed;
    if (closed[stroke]) return [];
    return [...closed.keys()].filter((other) => other !== stroke && !closed[other]);
  }

  inkButtons(ink) {
    const nodes = [
      `Ink ${ink}`,
      this.stepButton("Take as the curve", "", { do: "take", ink, as: "curve" }),
      this.stepButton("Take as a part", "", { do: "take", ink, as: "part" }),
    ];
    const isLeftOut = this.app.state.account.some((one) => one.number === ink && one.left_out);
    if (!isLeftOut) nodes.push(this.stepButton("Leave out", "", { do: "leave", ink }));
    return nodes;
  }

  markerButtons(marker) {
    if (!marker) return [];
    const words = marker.used ? "Leave out" : "Use";
    const step = { do: "leave_out_marker", marker: marker.label, out: marker.used };
    return [`Marker ${marker.label}`, this.stepButton(words, "", step), button("Delete", "Del", () => this.remove())];
  }

  stepButton(words, key, step) {
    return button(words, key, () => this.app.step(step));
  }

  // Where the selected knot or marker lies on the slice.
  place() {
    const thing = this.app.selected;
    if (thing?.kind === "knot") return this.curve.knotPlace(thing.key);
    if (thing?.kind === "marker") return this.markers.place(thing.key);
    return null;
  }

  remove() {
    const thing = this.app.selected;
    if (thing?.kind === "knot") {
      const [stroke, knot] = thing.key.split("/").map(Number);
      this.app.step({ do: "delete_knot", stroke, knot });
    } else if (thing?.kind === "marker") {
      this.app.step({ do: "delete_marker", marker: this.markers.label(thing.key) });
    }
  }

  // Insert a knot half-way between the selected one and the next.
  insert() {
    if (this.app.selected?.kind !== "knot") return;
    const [stroke, knot] = this.app.selected.key.split("/").map(Number);
    const points = this.app.state.curve_px[stroke];
    const knots = this.app.state.knots_px[stroke];
    const first = this.curve.pointIndex(stroke, knots[knot]);
    let next = points.length - 1;
    if (knot + 1 < knots.length) next = this.curve.pointIndex(stroke, knots[knot + 1]);
    this.app.step({ do: "insert_knot", stroke, at: points[Math.round((first + next) / 2)] });
  }

  // Cut the stroke at the selected knot, which becomes its "start" or its "end".
  cut(end) {
    if (this.app.selected?.kind !== "knot") return;
    const stroke = Number(this.app.selected.key.split("/")[0]);
    this.app.step({ do: "cut", stroke, [end]: this.place() });
  }

  // Move the selected knot or marker by the keyboard.
  nudge(du, dv) {
    const thing = this.app.selected;
    const place = this.place();
    if (!place) return;
    let from = place;
    if (this.nudged?.key === thing.key) from = this.nudged.to;
    const to = this.view.clamp([from[0] + du, from[1] + dv]);
    this.nudged = { key: thing.key, to };
    if (thing.kind === "knot") this.curve.dragKnot(thing.key, to);
    else this.markers.drag(thing.key, to);
    clearTimeout(this.nudgeTimer);
    this.nudgeTimer = setTimeout(() => {
      this.nudged = null;
      this.moveTo(thing, to);
    }, NUDGE_REST_MS);
  }

  // Send the step that moves a knot or a marker.
  moveTo(thing, to) {
    if (thing.kind === "knot") {
      const [stroke, knot] = thing.key.split("/").map(Number);
      this.app.step({ do: "move_knot", stroke, knot, to });
    } else {
      this.app.step({ do: "move_marker", marker: this.markers.label(thing.key), to });
    }
  }

  // Select the next knot, or with -1 the one before; after the last comes the first.
  nextKnot(by) {
    const keys = [];
    this.app.state.knots_px.forEach((knots, stroke) => {
      knots.forEach((_, knot) => keys.push(`${stroke}/${knot}`));
    });
    if (!keys.length) return;
    let now = by > 0 ? -1 : 0;
    if (this.app.selected?.kind === "knot") now = keys.indexOf(this.app.selected.key);
    const index = (now + by + keys.length) % keys.length;
    const place = this.curve.knotPlace(keys[index]);
    this.selectInView({ kind: "knot", key: keys[index] }, place);
    const [u, v] = place.map((x) => fixed(x, 0));
    this.app.say(`Knot ${index + 1} of ${keys.length} at ${u}, ${v}`);
  }

  nextMarker(by) {
    const count = this.app.state.markers.length;
    if (!count) return;
    let now = by > 0 ? -1 : 0;
    if (this.app.selected?.kind === "marker") now = this.app.selected.key;
    const key = (now + by + count) % count;
    this.selectInView({ kind: "marker", key }, this.markers.place(key));
    this.app.say(`Marker ${this.markers.label(key)}`);
  }

  selectInView(thing, place) {
    if (place && !this.view.isIn(place)) this.view.goTo(place, this.view.zoom);
    this.app.select(thing);
  }
}

function button(words, key, call) {
  return make("button", { type: "button", onclick: call, title: key }, words);
}
