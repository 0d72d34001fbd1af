// Findings as pins on the slice and as a list; both ends enlarged.
import { byId, fixed, inPageWords, make, makeAt, refill } from "./dom.js";

const INSET_PX = 168; // side of an inset on the screen
const END_PX = 21; // pixels of the slice around an end: eight times enlarged
const FINDING_PX = 42; // and around a finding: four times
const HATCH_PX = [2, 6]; // a stripe, and the ground up to the next
const END_ZOOM = 8; // of the slice once an end's inset is clicked
// A pin upright, on a stem, so that what it stands on is seen.
const PIN = "M0 -3L-5 -25A11 11 0 1 1 5 -25Z";
const [PIN_REACH_PX, PIN_RADIUS_PX] = [35, 11]; // of its head, from its foot

export class Findings {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    view.settled.push(() => {
      if (app.state) this.pins(app.state);
    });
    byId("slice").addEventListener("load", () => {
      if (this.app.state) this.render(this.app.state);
    });
  }

  render(state) {
    this.list(state);
    this.pins(state);
    this.ends(state);
  }

  // The index of the selected finding, or -1.
  chosen() {
    if (this.app.selected?.kind === "finding") return this.app.selected.key;
    return -1;
  }

  list(state) {
    const unanswered = state.findings.filter((f) => f.severity === "doubt" && f.answered_by === null);
    let count = state.curve_px.length ? "none" : "none yet";
    if (state.findings.length) count = `${unanswered.length} to answer, ${state.findings.length} in all`;
    byId("findings-count").textContent = count;
    refill(byId("findings"), state.findings.map((finding, k) => this.row(finding, k)));
  }

  row(finding, k) {
    const isChosen = k === this.chosen();
    const button = make(
      "button",
      { type: "button", class: "row", "aria-expanded": String(isChosen), onclick: () => this.goTo(k) },
      make("span", { class: `badge ${kindOf(finding)}` }, `#${k + 1}`),
      make("span", {}, inPageWords(finding.text)),
    );
    const more = make("div", { class: "more" });
    if (isChosen && finding.place_px) {
      more.append(this.inset(finding.place_px, FINDING_PX, `Finding #${k + 1} enlarged`));
    }
    if (finding.answered_by !== null) {
      more.append(muted(finding.answered_by ? `Accepted as it is by ${finding.answered_by}.` : "Accepted as it is."));
    } else if (finding.severity === "doubt") {
      const accept = () => this.accept(k);
      more.append(make("button", { type: "button", class: "accept", onclick: accept }, "Accept as it is"));
      more.append(muted("The plan then stays as shown. Or mend it: then the finding goes by itself."));
    } else {
      more.append(muted("For your information."));
    }
    return make("li", { class: isChosen ? "chosen" : "", "data-finding": k }, button, more);
  }

  accept(k) {
    const by = byId("name").value.trim();
    if (!by) {
      this.app.toast("Write your name first: whoever accepts a finding answers for it.");
      byId("name").focus();
      return;
    }
    this.app.step({ do: "answer", finding: k, by });
  }

  goTo(k) {
    const finding = this.app.state.findings[k];
    if (!finding) return;
    this.app.select({ kind: "finding", key: k });
    if (finding.place_px) this.view.goTo(finding.place_px);
    this.app.say(`Finding ${k + 1} of ${this.app.state.findings.length}. ${inPageWords(finding.text)}`);
    byId("findings").children[k]?.scrollIntoView({ block: "nearest" });
  }

  // Go to the next finding, or with -1 to the one before.
  turn(by) {
    const count = this.app.state.findings.length;
    if (count) this.goTo((this.chosen() + by + count) % count);
  }

  select() {
    if (!this.app.state) return;
    this.list(this.app.state);
    for (const node of byId("pins").querySelectorAll(".pin")) {
      node.classList.toggle("chosen", Number(node.dataset.finding) === this.chosen());
    }
  }

  pins(state) {
    const nodes = [];
    const markers = state.markers.filter((one) => one.place_px).map((one) => one.place_px);
    const placed = [...markers, ...state.knots_px.flat()].map((place) => this.view.onStage(place));
    state.findings.forEach((finding, k) => {
      if (!finding.place_px) return;
      const chosen = k === this.chosen() ? " chosen" : "";
      const attributes = { class: `thing pin ${kindOf(finding)}${chosen}`, "data-finding": k };
      const [x, y] = this.view.freeWay(finding.place_px, PIN_REACH_PX, placed, PIN_RADIUS_PX);
      const turn = (Math.atan2(x, -y) * 180) / Math.PI;
      const number = make("text", { x, y }, `#${k + 1}`);
      nodes.push(makeAt(finding.place_px, attributes, make("path", { d: PIN, transform: `rotate(${turn})` }), number));
    });
    byId("pins").replaceChildren(...nodes);
  }

  ends(state) {
    const figures = [];
    state.curve_px.forEach((points, k) => {
      if (state.closed[k]) return;
      const stroke = state.curve_px.length > 1 ? ` of stroke ${k + 1}` : "";
      figures.push(this.end(points[0], `Start${stroke}`));
      figures.push(this.end(points[points.length - 1], `End${stroke}`));
    });
    const question = figures.length > 2 ? "Do your lines end here?" : "Does your line end here?";
    byId("ends-card").querySelector("h2").textContent = question;
    byId("ends-card").hidden = figures.length === 0;
    refill(byId("ends"), figures);
  }

  end(place, name) {
    const label = `${name} at (${fixed(place[0], 0)}, ${fixed(place[1], 0)})`;
    const button = make(
      "button",
      { type: "button", "aria-label": label, onclick: () => this.view.goTo(place, END_ZOOM) },
      this.inset(place, END_PX, label),
    );
    const { mmPerPx } = this.view;
    const width = mmPerPx ? `${fixed(END_PX * mmPerPx, 1)}\u00a0mm` : `${END_PX}\u00a0px`;
    return make("figure", {}, button, make("figcaption", {}, `${label}, ${width}\u00a0wide`));
  }

  // A part of the slice enlarged, with the measured line as a thin stroke in the ink, and a ring.
  inset([u, v], span, label) {
    const attributes = { class: "inset", width: INSET_PX, height: INSET_PX, role: "img", "aria-label": label };
    const canvas = make("canvas", attributes);
    const pen = canvas.getContext("2d");
    const enlarged = INSET_PX / span;
    const left = Math.round(u - (span - 1) / 2);
    const top = Math.round(v - (span - 1) / 2);
    pen.imageSmoothingEnabled = false;
    pen.fillStyle = "#888";
    pen.fillRect(0, 0, INSET_PX, INSET_PX);
    // Outside the picture stands a hatch, the dashes of one very broad line: no grey of a slice.
    pen.strokeStyle = "#ddd";
    pen.lineWidth = 2 * INSET_PX;
    pen.setLineDash(HATCH_PX);
    pen.stroke(new Path2D(`M0 0L${INSET_PX} ${INSET_PX}`));
    pen.setLineDash([]);
    if (byId("slice").complete && byId("slice").naturalWidth) {
      pen.drawImage(byId("slice"), left, top, span, span, 0, 0, INSET_PX, INSET_PX);
    }
    // From here on in pixels of the slice, whose first pixel has its middle at (0, 0).
    pen.setTransform(enlarged, 0, 0, enlarged, (0.5 - left) * enlarged, (0.5 - top) * enlarged);
    const line = this.lineWithin([u, v], span);
    const ring = new Path2D();
    ring.arc(u, v, 18 / enlarged, 0, 2 * Math.PI);
    for (const [colour, width] of [["#fff", 3.4], ["#2f52e9", 1.6]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = width / enlarged;
      pen.stroke(line);
      pen.stroke(ring);
    }
    return canvas;
  }

  // The parts of the measured line within a distance of a place.
  lineWithin([u, v], distance) {
    const line = new Path2D();
    for (const points of this.app.state.curve_px) {
      let isDrawing = false;
      for (const [x, y] of points) {
        const isNear = Math.abs(x - u) < distance && Math.abs(y - v) < distance;
        if (isNear && isDrawing) line.lineTo(x, y);
        else if (isNear) line.moveTo(x, y);
        isDrawing = isNear;
      }
    }
    return line;
  }
}

function kindOf(finding) {
  if (finding.answered_by !== null) return "answered";
  return finding.severity;
}

function muted(text) {
  return make("span", { class: "muted" }, text);
}
