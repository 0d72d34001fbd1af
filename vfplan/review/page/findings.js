// Findings as pins on the slice and as a list; both ends enlarged.
import { byId, make, refill } from "./dom.js";

const INSET_PX = 168; // side of an inset on the screen
const END_PX = 21; // pixels of the slice around an end: eight times enlarged
const FINDING_PX = 42; // and around a finding: four times

export class Findings {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    byId("slice").addEventListener("load", () => this.app.state && this.render(this.app.state));
  }

  render(state) {
    this.list(state);
    this.pins(state);
    this.ends(state);
  }

  chosen() { return this.app.selected?.kind === "finding" ? this.app.selected.key : -1; }

  list(state) {
    const open = state.findings.filter((f) => f.severity === "doubt" && f.answered_by === null).length;
    byId("findings-count").textContent = state.findings.length ? `${open} to answer, ${state.findings.length} in all` : "none";
    refill(byId("findings"), state.findings.map((finding, k) => this.row(finding, k)));
  }

  row(finding, k) {
    const answered = finding.answered_by !== null;
    const kind = answered ? "answered" : finding.severity;
    const button = make("button", { type: "button", class: "row", "aria-expanded": String(k === this.chosen()), onclick: () => this.goTo(k) },
      make("span", { class: `badge ${kind}` }, String(k + 1)), make("span", {}, finding.text));
    const row = make("li", { class: k === this.chosen() ? "chosen" : "", "data-finding": k }, button);
    const more = make("div", { class: "more" });
    if (answered) more.append(make("span", { class: "muted" }, `Accepted${finding.answered_by ? ` by ${finding.answered_by}` : ""}.`));
    else if (finding.severity === "doubt") {
      more.append(make("button", { type: "button", class: "accept", onclick: () => this.accept(k) }, "Accept"));
      more.append(make("span", { class: "muted" }, "or mend it, and it goes."));
    } else more.append(make("span", { class: "muted" }, "For your information."));
    if (k === this.chosen() && finding.place_px) more.prepend(this.inset(finding.place_px, FINDING_PX, `Finding ${k + 1} enlarged`));
    row.append(more);
    return row;
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
    this.app.say(`Finding ${k + 1} of ${this.app.state.findings.length}. ${finding.text}`);
    byId("findings").children[k]?.scrollIntoView({ block: "nearest" });
  }

  turn(by) {
    const count = this.app.state.findings.length;
    if (count) this.goTo((this.chosen() + by + count) % count);
  }

  select() {
    if (!this.app.state) return;
    this.list(this.app.state);
    byId("pins").querySelectorAll(".pin").forEach((node) => {
      node.classList.toggle("chosen", Number(node.dataset.finding) === this.chosen());
    });
  }

  pins(state) {
    const nodes = [];
    state.findings.forEach((finding, k) => {
      if (!finding.place_px) return;
      const kind = finding.answered_by !== null ? "answered" : finding.severity;
      const body = make("g", { class: "fixed" }, make("path", { d: "M0 -2L-9 -20A11 11 0 1 1 9 -20Z" }), make("text", { y: -25 }, String(k + 1)));
      nodes.push(make("g", { class: `thing pin ${kind}${k === this.chosen() ? " chosen" : ""}`, "data-finding": k,
        transform: `translate(${finding.place_px[0]} ${finding.place_px[1]})` }, body));
    });
    byId("pins").replaceChildren(...nodes);
  }

  ends(state) {
    const figures = [];
    state.curve_px.forEach((points, k) => {
      if (state.closed[k]) return;
      const name = state.curve_px.length > 1 ? ` of stroke ${k + 1}` : "";
      for (const [place, word] of [[points[0], "Start"], [points[points.length - 1], "End"]]) {
        const label = `${word}${name} at (${place[0].toFixed(0)}, ${place[1].toFixed(0)})`;
        const button = make("button", { type: "button", "aria-label": label, onclick: () => this.view.goTo(place, 8) }, this.inset(place, END_PX, label));
        figures.push(make("figure", {}, button, make("figcaption", {}, label)));
      }
    });
    byId("ends-card").hidden = figures.length === 0;
    refill(byId("ends"), figures);
  }

  // A part of the slice enlarged, with the measured line as a thin stroke in the ink, and a ring.
  inset([u, v], span, label) {
    const side = INSET_PX;
    const enlarged = side / span;
    const canvas = make("canvas", { class: "inset", width: side, height: side, role: "img", "aria-label": label });
    const pen = canvas.getContext("2d");
    pen.imageSmoothingEnabled = false;
    const left = Math.round(u - (span - 1) / 2);
    const top = Math.round(v - (span - 1) / 2);
    pen.fillStyle = "#888";
    pen.fillRect(0, 0, side, side);
    if (byId("slice").complete && byId("slice").naturalWidth) pen.drawImage(byId("slice"), left, top, span, span, 0, 0, side, side);
    pen.setTransform(enlarged, 0, 0, enlarged, (0.5 - left) * enlarged, (0.5 - top) * enlarged);
    const near = (p) => Math.abs(p[0] - u) < span && Math.abs(p[1] - v) < span;
    for (const [colour, width] of [["#fff", 3.4], ["#2f52e9", 1.6]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = width / enlarged;
      pen.beginPath();
      for (const points of this.app.state.curve_px) {
        let last = null;
        for (const p of points) {
          if (near(p)) pen[last ? "lineTo" : "moveTo"](p[0], p[1]);
          last = near(p) ? p : null;
        }
      }
      pen.stroke();
      pen.beginPath();
      pen.arc(u, v, 18 / enlarged, 0, 2 * Math.PI);
      pen.stroke();
    }
    return canvas;
  }
}
