// What a press, a drag and a release do on the slice.
import { byId } from "./dom.js";

const PAN_SLACK_PX = 4; // a press that moves less is a click
const GRASP_SLACK_PX = 3; // a knot or marker that is moved less stays where it is

export class Pointer {
  constructor(app, view, { curve, markers, findings, tools, selection }) {
    Object.assign(this, { app, view, curve, markers, findings, tools, selection });
    this.stage = byId("stage");
    this.pointers = new Map(); // fingers or mouse that are down -> [x, y] in the window
    this.drag = null; // what the press began: {kind, ...}
    this.isSpaceDown = false;
    this.stage.addEventListener("pointerdown", (event) => this.down(event));
    this.stage.addEventListener("pointermove", (event) => this.move(event));
    this.stage.addEventListener("pointerup", (event) => this.up(event));
    this.stage.addEventListener("pointercancel", () => this.cancel());
    this.stage.addEventListener("contextmenu", (event) => event.preventDefault());
    this.stage.addEventListener("dblclick", () => {
      if (tools.tool === "draw") tools.endDrawing(false);
    });
  }

  down(event) {
    if (event.target.closest("#context")) return;
    this.stage.focus({ preventScroll: true });
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.tools.crossAt(null);
    if (this.pointers.size === 2) {
      this.drag = { kind: "pinch", before: this.spread() };
      return;
    }
    this.start = { at: [event.clientX, event.clientY], place: this.view.place(event) };
    this.drag = this.begin(event);
    this.stage.classList.toggle("busy", this.drag?.kind === "pan");
  }

  // What a press begins, by the tool and by what lies under the pointer.
  begin(event) {
    const under = (kind) => event.target.closest(kind);
    if (this.isSpaceDown || event.button === 1) return { kind: "pan" };
    if (event.button === 2) return { kind: "greys" };
    if (this.tools.tool === "box") return { kind: "box" };
    if (this.tools.tool !== "select") return { kind: "click", isDrawing: this.tools.tool === "draw" };
    if (under(".marker")) return this.grasp({ kind: "marker", key: Number(under(".marker").dataset.marker) });
    if (under(".knot")) return this.grasp({ kind: "knot", key: under(".knot").dataset.key });
    if (under(".pin")) {
      this.findings.goTo(Number(under(".pin").dataset.finding));
      return null;
    }
    if (under(".way")) return { kind: "candidate", node: event.target };
    const ink = under(".outline");
    return { kind: "pan", ink: ink ? Number(ink.dataset.ink) : null };
  }

  // Select a knot or marker and begin to drag it; it keeps its distance from the pointer.
  grasp(thing) {
    const wasChosen = this.app.isSelected(thing.kind, thing.key);
    this.app.select(thing);
    const own = this.selection.place();
    const shift = [own[0] - this.start.place[0], own[1] - this.start.place[1]];
    return { kind: thing.kind, thing, shift, to: null, wasChosen };
  }

  // A click on the marker that is selected takes the lowest one beneath it; each has its turn.
  selectBeneath(event) {
    const nodes = document.elementsFromPoint(event.clientX, event.clientY).map((node) => node.closest(".marker"));
    const lowest = nodes.filter((node) => node).at(-1);
    if (lowest) this.app.select({ kind: "marker", key: Number(lowest.dataset.marker) });
  }

  // Whether a knot or a marker is held.
  isDragging() {
    return Boolean(this.drag?.thing);
  }

  // Of two fingers: their distance, and the place between them.
  spread() {
    const [a, b] = [...this.pointers.values()];
    const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    return { distance: Math.hypot(a[0] - b[0], a[1] - b[1]), middle };
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    const place = this.view.place(event);
    if (this.tools.clicks.length) this.tools.showDrawing(place);
    if (!before) return;
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (!this.drag) return;
    const moved = Math.hypot(event.clientX - this.start.at[0], event.clientY - this.start.at[1]);
    if (this.drag.kind === "pan") {
      this.view.pan(event.clientX - before[0], event.clientY - before[1]);
      if (moved > PAN_SLACK_PX) this.drag.hasMoved = true;
    } else if (this.drag.kind === "greys") {
      this.view.greys.drag(event.clientX - before[0], event.clientY - before[1]);
    } else if (this.drag.kind === "pinch") {
      this.pinch();
    } else if (this.drag.kind === "box") {
      this.tools.showBox(this.start.place, place);
    } else if (this.drag.kind === "trail" || (this.drag.isDrawing && moved > PAN_SLACK_PX)) {
      if (this.drag.kind === "click") this.tools.trail(this.start.place, true);
      this.drag = { kind: "trail" };
      this.tools.trail(this.view.clamp(place), false);
    } else if (this.drag.thing && (this.drag.to || moved >= GRASP_SLACK_PX)) {
      this.drag.to = this.view.clamp([place[0] + this.drag.shift[0], place[1] + this.drag.shift[1]]);
      if (this.drag.kind === "knot") this.curve.dragKnot(this.drag.thing.key, this.drag.to);
      else this.markers.drag(this.drag.thing.key, this.drag.to);
    }
  }

  // Zoom by how far the fingers spread, and move with the place between them.
  pinch() {
    const { before } = this.drag;
    const now = this.spread();
    const box = this.stage.getBoundingClientRect();
    const about = [now.middle[0] - box.left, now.middle[1] - box.top];
    this.view.setZoom((this.view.zoom * now.distance) / Math.max(before.distance, 1), about);
    this.view.pan(now.middle[0] - before.middle[0], now.middle[1] - before.middle[1]);
    this.drag.before = now;
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    this.stage.classList.remove("busy");
    const drag = this.drag;
    this.drag = null;
    if (!drag) return;
    const place = this.view.clamp(this.view.place(event));
    if (drag.thing && drag.to) this.selection.moveTo(drag.thing, drag.to);
    else if (drag.kind === "marker" && drag.wasChosen) this.selectBeneath(event);
    else if (drag.kind === "box") this.tools.endBox(this.start.place, place);
    else if (drag.kind === "trail") this.tools.endTrail(place);
    else if (drag.kind === "click") this.tools.click(place);
    else if (drag.kind === "candidate") drag.node.dispatchEvent(new Event("click"));
    else if (drag.kind === "pan" && !drag.hasMoved && !this.isSpaceDown) this.clickOnSlice(drag.ink, place);
  }

  // Before there is a curve, a click chooses the line there, or is told why there is none. Later a
  // click beside everything selects nothing.
  clickOnSlice(ink, place) {
    const { state, selected } = this.app;
    if (ink !== null && ink !== undefined) this.app.select({ kind: "ink", key: ink });
    else if (selected === null && state.image.has_ink && !state.curve_px.length) this.app.step({ do: "choose", at: place });
    else this.app.select(null);
  }

  cancel() {
    this.pointers.clear();
    this.drag = null;
    if (!this.app.state) return;
    this.curve.render(this.app.state);
    this.markers.render(this.app.state);
  }
}
