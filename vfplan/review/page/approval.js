// Whether the plan may be approved, what was looked at, and the end of the review.
import { byId, make } from "./dom.js";

export class Approval {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    view.settled.push(() => this.report());
    document.addEventListener("visibilitychange", () => this.report());
    byId("look").addEventListener("click", () => this.lookAlong());
    byId("approve").addEventListener("click", () => this.approve());
    byId("leave").addEventListener("click", () => app.send({ leave: true }));
    byId("name").addEventListener("input", () => this.buttons());
  }

  render(state) {
    byId("why-not").replaceChildren(...state.why_not.map((text) => make("li", {}, text)));
    const status = byId("status");
    if (state.approvable) this.tell("ready to approve", "pass");
    else if (state.approved) this.tell(`approved by ${state.approved.by}`, "pass");
    else if (state.refusal && !state.curve_px.length) this.tell("no curve yet", "fail");
    else if (state.refusal) this.tell("refused", "fail");
    else this.tell("not approved", "none");
    status.title = state.why_not.join("\n");
    byId("look").disabled = state.unseen.every((runs) => runs.length === 0);
    this.buttons();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.report(), 300);
  }

  tell(text, kind) {
    byId("status").textContent = text;
    byId("status").className = `verdict ${kind}`;
  }

  lost(text) {
    this.tell("connection lost", "fail");
    byId("approve").disabled = true;
    this.app.toast(text || "The program does not answer. Your steps are kept: start the same command again, and open the new address.");
  }

  buttons() {
    byId("approve").disabled = !this.app.state?.approvable || !byId("name").value.trim();
    byId("approve").textContent = this.app.about.signs ? "Approve and sign" : "Approve";
  }

  approve() { this.app.send({ approve: byId("name").value.trim() }); }

  // Parts of the line that are in view at one screen pixel a pixel or more count as looked at.
  report() {
    const state = this.app.state;
    if (!state || document.hidden || this.view.zoom * devicePixelRatio < 0.999) return;
    state.unseen.forEach((runs, stroke) => {
      const points = state.curve_px[stroke];
      const arc = [0];
      for (let k = 1; k < points.length; k += 1) {
        arc.push(arc[k - 1] + Math.hypot(points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]));
      }
      const total = arc[arc.length - 1];
      for (const [first, last] of runs) {
        let start = -1;
        for (let k = first; k <= last + 1; k += 1) {
          const seen = k <= last && this.view.isIn(points[k]);
          if (seen && start < 0) start = k;
          if (!seen && start >= 0) {
            this.app.send({ step: { do: "viewed", stroke, from: this.share(arc[start] - 0.4, total), to: this.share(arc[k - 1] + 0.4, total) }, version: this.app.version });
            return; // one at a time: the answer brings the next
          }
        }
      }
    });
  }

  // With less than half of a point's distance added, so that rounding loses no point.
  share(arc, total) { return Math.min(1, Math.max(0, arc / total)); }

  // To the middle of the first part that was not in view, at a size that counts.
  lookAlong() {
    const state = this.app.state;
    for (let k = 0; k < state.unseen.length; k += 1) {
      const run = state.unseen[k][0];
      if (!run) continue;
      const [width, height] = this.view.size();
      const reach = Math.round(Math.min(width, height) / (2.4 * Math.max(this.view.zoom, 1)));
      const middle = Math.min(run[0] + reach, Math.round((run[0] + run[1]) / 2));
      this.view.goTo(state.curve_px[k][middle], Math.max(this.view.zoom, 1));
      return;
    }
  }
}
