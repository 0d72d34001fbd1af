// The tool that is chosen, and what its clicks draw: a line, a box, a marker.
import { byId, make, makeAt, translation } from "./dom.js";

const HINTS = {
  select: "",
  draw: "Click along the line, or press and draw it. Enter ends it, C closes it, Esc cancels. Begin or end on the curve to replace a stretch of it.",
  box: "Drag a box over ink that shall not count.",
  marker: "Click each mark. Esc ends.",
  push: "The pointer is the tool tip. The robot's own engine pushes it towards the proxy.",
};
const STEP_PX = 8; // of the screen, between two places of a line that is drawn in one go
const MAX_PLACES = 400; // of such a line
const SAME_MARK_PX = 6; // of the screen; two markers that are nearer lie on one mark
const PIECES = 8; // straight pieces that a smooth line has from one click to the next

export class Tools {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    this.tool = "select";
    this.clicks = []; // of the line that is being drawn
    this.corner = null; // the first corner of a box that is drawn by the keyboard
    this.cross = null; // the keyboard's place
    this.whyNoPush = ""; // why Push feels nothing
    this.drawn = null; // the step of the line that was drawn last, until the session has taken it
    const again = { "replace-all": { replace: true }, "add-stroke": { add: true }, "not-drawn": null };
    for (const [id, meaning] of Object.entries(again)) {
      byId(id).addEventListener("click", () => {
        const drawn = meaning && { ...this.drawn, ...meaning };
        byId("where").close();
        if (drawn) this.send(drawn);
      });
    }
    byId("where").addEventListener("close", () => this.showDrawn());
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.addEventListener("click", () => this.choose(button.dataset.tool));
    }
  }

  render(state, isFirst) {
    // Markers that were given without places are clicked at once.
    if (isFirst && this.nextLabel() && state.image.has_slice) this.choose("marker");
    this.showHint();
    if (this.clicks.length) this.showDrawing();
    this.showDrawn();
  }

  choose(tool) {
    this.tool = tool;
    byId("stage").dataset.chosen = tool; // no class: the drawing has classes of its own
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.setAttribute("aria-checked", String(button.dataset.tool === tool));
    }
    this.showHint();
    this.clearDrawing();
    if (tool !== "select") this.app.select(null);
    this.chosen?.();
    byId("stage").focus({ preventScroll: true });
  }

  // A click of the tool, by the pointer or at the keyboard's cross.
  click(place) {
    if (this.tool === "draw") {
      this.clicks.push(place);
      this.showDrawing(place);
    } else if (this.tool === "marker") {
      const snap = Math.min(60, Math.max(8, 12 / this.view.zoom));
      const label = this.nextLabel();
      if (label) this.app.step({ do: "move_marker", marker: label, to: place, snap });
      else this.app.step({ do: "add_marker", label: this.freeLabel(), at: place, snap });
      this.showHint();
    } else if (this.tool === "box" && this.corner) {
      this.endBox(this.corner, place);
    } else if (this.tool === "box") {
      this.corner = place;
    }
  }

  showHint() {
    const label = this.tool === "marker" && this.app.state && this.nextLabel();
    let text = HINTS[this.tool];
    if (label) text = `Click the mark of ${label}. Esc ends.`;
    else if (this.tool === "push" && this.whyNoPush) text = this.whyNoPush;
    byId("hint").textContent = [this.sameMark(), text].filter(Boolean).join(" ");
  }

  // What to do about two markers on one mark, of which the one hides the other.
  sameMark() {
    const placed = this.app.state?.markers.filter((one) => one.place_px) || [];
    for (const [k, { label, place_px: [u, v] }] of placed.entries()) {
      const reach = SAME_MARK_PX / this.view.zoom;
      const other = placed.slice(k + 1).find(({ place_px: at }) => Math.hypot(at[0] - u, at[1] - v) < reach);
      if (other) return `${label} and ${other.label} lie on one mark. Click there until the one that is meant is selected, then drag it to its own.`;
    }
    return "";
  }

  // The first marker that has no place on the slice, and none on its way to the session.
  nextLabel() {
    const sent = this.app.waiting.map((change) => change.step?.marker);
    return this.app.state.markers.find((one) => !one.place_px && !sent.includes(one.label))?.label;
  }

  freeLabel() {
    const sent = this.app.waiting.map((change) => change.step?.label);
    const taken = [...this.app.state.markers.map((marker) => marker.label), ...sent];
    let number = taken.length + 1;
    while (taken.includes(`M${number}`)) number += 1;
    return `M${number}`;
  }

  // A smooth line through the clicks, near to the spline that the session will draw, and on to a
  // place that is not clicked yet.
  showDrawing(place) {
    const points = place ? [...this.clicks, place] : this.clicks;
    byId("preview").setAttribute("points", smooth(points).join(" "));
    const dots = this.clicks.map((click) => makeAt(click, {}, make("circle", { r: 3.5 })));
    byId("clicks").replaceChildren(...dots);
  }

  clearDrawing() {
    this.clicks = [];
    this.corner = null;
    byId("clicks").replaceChildren();
    byId("preview").setAttribute("points", "");
    byId("box").setAttribute("visibility", "hidden");
  }

  takeBackClick() {
    this.clicks.pop();
    this.showDrawing(this.clicks.length && this.cross);
  }

  endDrawing(closed) {
    const points = this.clicks;
    this.clearDrawing();
    if (points.length < 2) return;
    this.choose("select");
    this.send({ do: "draw", points, closed });
  }

  send(drawn) {
    this.drawn = drawn;
    this.app.step(drawn);
    this.showDrawn();
  }

  // The line that was drawn last stands there until the session has it, or the question is answered.
  showDrawn() {
    if (!this.drawn) return;
    const { points, closed } = this.drawn;
    const isOpen = byId("where").open || this.app.waiting.some((change) => change.step === this.drawn);
    if (!isOpen) this.drawn = null;
    if (this.clicks.length) return;
    const shown = closed ? [...points, points[0]] : points;
    byId("preview").setAttribute("points", isOpen ? smooth(shown).join(" ") : "");
  }

  // The line that was drawn last lies apart from the curve: ask what becomes of it.
  ask() {
    byId("where").showModal();
  }

  // A line that is being drawn in one go; it begins anew, or goes on from the clicks.
  trail(place, isFirst) {
    if (isFirst) this.clicksBefore = this.clicks.length;
    const last = this.clicks.at(-1);
    const step = STEP_PX / this.view.zoom;
    if (!last || Math.hypot(place[0] - last[0], place[1] - last[1]) >= step) this.clicks.push(place);
    this.showDrawing(place);
  }

  endTrail(place) {
    this.clicks.push(place);
    const every = Math.ceil(this.clicks.length / MAX_PLACES);
    this.clicks = this.clicks.filter((_, k) => k % every === 0 || k === this.clicks.length - 1);
    if (this.clicksBefore === 0) this.endDrawing(false);
    else this.showDrawing();
  }

  showBox(a, b) {
    const [x, y, width, height] = boxOf(a, b);
    for (const [name, value] of Object.entries({ x, y, width, height, visibility: "visible" })) {
      byId("box").setAttribute(name, value);
    }
  }

  endBox(a, b) {
    this.clearDrawing();
    const box = boxOf(a, b);
    if (box[2] >= 1 && box[3] >= 1) this.app.step({ do: "exclude", box });
    this.choose("select");
  }

  // Move the keyboard's cross to a place; null hides it.
  crossAt(place) {
    this.cross = place;
    byId("cross").setAttribute("visibility", place ? "visible" : "hidden");
    if (!place) return;
    byId("cross").setAttribute("transform", translation(place));
    this.view.tellPlace(place);
    if (this.clicks.length) this.showDrawing(place);
    if (this.corner) this.showBox(this.corner, place);
  }

  // Move the cross by an arrow key; it begins in the middle of the window.
  moveCross(du, dv) {
    const [width, height] = this.view.size();
    const [u, v] = this.cross || this.view.onSlice([width / 2, height / 2]);
    this.crossAt(this.view.clamp([u + du, v + dv]));
  }

  // One step back: the drawing, then the tool, then the selection.
  escape() {
    if (this.clicks.length || this.corner) this.clearDrawing();
    else if (this.tool !== "select") this.choose("select");
    else this.app.select(null);
    this.crossAt(null);
  }
}

// (left, top, width, height) between two corners.
function boxOf(a, b) {
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
}

// A smooth line through points, eight pieces between two of them. Its slope at a point is that from the
// one before to the next, by the lengths between them: clicks lie unevenly.
function smooth(points) {
  if (points.length < 3) return points;
  const slopes = points.map((_, k) => {
    const [before, after] = [points[Math.max(k - 1, 0)], points[Math.min(k + 1, points.length - 1)]];
    const length = distance(before, points[k]) + distance(points[k], after) || 1;
    return [0, 1].map((axis) => (after[axis] - before[axis]) / length);
  });
  const shown = [points[0]];
  for (let k = 0; k + 1 < points.length; k += 1) {
    const length = distance(points[k], points[k + 1]);
    for (let piece = 1; piece <= PIECES; piece += 1) {
      const t = piece / PIECES;
      const at = (axis) => hermite(points[k][axis], points[k + 1][axis], length * slopes[k][axis], length * slopes[k + 1][axis], t);
      shown.push([at(0), at(1)]);
    }
  }
  return shown;
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

// From a at t = 0 to b at t = 1, with these slopes there.
function hermite(a, b, slopeA, slopeB, t) {
  const linear = slopeA;
  const square = 3 * (b - a) - 2 * slopeA - slopeB;
  const cubic = 2 * (a - b) + slopeA + slopeB;
  return a + t * linear + t ** 2 * square + t ** 3 * cubic;
}
