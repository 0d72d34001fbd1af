// Whether the plan may be approved, what was looked at, and the end of the review.
import { byId, inPageWords, make } from "./dom.js";

const LOST = "The program does not answer. Your steps are kept: start the same command again, and open the new address.";
const REPORT_DELAY_MS = 300; // a new state is on the screen by then

// Half of a point's distance at most, so that rounding loses no point [px].
const POINT_REACH_PX = 0.4;

export class Approval {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    view.settled.push(() => this.report());
    const renew = () => {
      if (!app.state || app.socket.readyState !== 1) return; // a lost connection stays told
      this.showStatus(app.state);
      this.showReasons();
    };
    new MutationObserver(renew).observe(byId("preview"), { attributeFilter: ["points"] });
    document.addEventListener("visibilitychange", () => this.report());
    byId("look").addEventListener("click", () => this.lookAlong());
    byId("approve").addEventListener("click", () => this.approve());
    byId("leave").addEventListener("click", () => app.send({ leave: true }));
    byId("name").addEventListener("input", () => {
      app.hideToast();
      this.showReasons();
    });
    byId("name").addEventListener("change", () => this.sendName());
    byId("resume").addEventListener("click", () => app.send({ draft: "resume" }));
    byId("anew").addEventListener("click", () => app.send({ draft: "anew" }));
    byId("draft").addEventListener("cancel", (event) => event.preventDefault());
  }

  name() {
    return byId("name").value.trim();
  }

  // What is looked at from now on belongs to this name. Whoever comes after another has chosen no
  // view yet.
  sendName() {
    const name = this.name();
    if (!name) return;
    if (this.person && this.person !== name) this.view.isChosen = false;
    this.person = name;
    this.app.send({ name });
  }

  // An approval names the state that is on the screen, so that no other is approved by it.
  approve() {
    const { version, state } = this.app;
    this.app.send({ approve: { by: this.name(), version, digest: state.digest } });
  }

  // Whether the review goes on with a draft of earlier is asked before anything else.
  showDraft(draft) {
    if (!draft) return byId("draft").close();
    const steps = draft.steps === 1 ? "1 step" : `${draft.steps} steps`;
    const by = draft.by ? ` by ${draft.by}` : "";
    byId("draft-text").textContent = `This plan was begun${by}: ${steps}, the last at ${draft.utc}. What was looked at then does not count.`;
    if (!byId("draft").open) byId("draft").showModal();
  }

  render(state) {
    this.showStatus(state);
    this.showReasons();
    byId("look").disabled = state.unseen.every((runs) => runs.length === 0);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.report(), REPORT_DELAY_MS);
  }

  // A line that is drawn or dragged stands on the slice, and the plan does not have it.
  isDrawing() {
    return Boolean(byId("preview").getAttribute("points"));
  }

  showStatus(state) {
    if (this.app.ended) return;
    const hasCurve = state.curve_px.length > 0;
    if (this.isDrawing()) this.tell("line not in the plan", "none");
    else if (state.approvable) this.tell("ready to approve", "pass");
    else if (state.approved) this.tell(`approved by ${state.approved.by}`, "pass");
    else if (state.refusal && hasCurve) this.tell("refused", "fail");
    else if (state.refusal) this.tell("no curve yet", "fail");
    else this.tell("not approved", "none");
  }

  tell(text, kind) {
    byId("status").textContent = text;
    byId("status").className = `verdict ${kind}`;
  }

  // What stands against an approval, beside its button.
  showReasons() {
    const state = this.app.state;
    const reasons = [];
    for (const text of state?.why_not || []) {
      if (text === state.refusal?.text) reasons.push("The plan is refused. The top of this column says why.");
      else reasons.push(inPageWords(text));
    }
    if (state?.approvable && !this.name()) reasons.push("Write your name to approve the plan.");
    if (this.isDrawing()) reasons.push("The new line is not part of the plan yet.");
    byId("why-not").replaceChildren(...reasons.map((text) => make("li", {}, text)));
    byId("approve").disabled = !state?.approvable || !this.name() || this.isDrawing() || this.app.ended;
    byId("approve").textContent = this.app.about.signs ? "Approve and sign" : "Approve";
  }

  lost(text) {
    this.tell("connection lost", "fail");
    byId("approve").disabled = true;
    this.app.toast(text || LOST);
  }

  // Parts of the line that are in view at one screen pixel a pixel or more count as looked at. One
  // part is sent at a time: the answer brings the next.
  report() {
    const state = this.app.state;
    if (!state || document.hidden || !this.view.isChosen || byId("draft").open) return;
    if (this.view.zoom * devicePixelRatio < 0.999) return;
    for (let stroke = 0; stroke < state.unseen.length; stroke += 1) {
      const points = state.curve_px[stroke];
      for (const run of state.unseen[stroke]) {
        const seen = this.partInView(points, run);
        if (seen) {
          const [from, to] = sharesOf(points, seen);
          const step = { do: "viewed", stroke, from, to };
          this.app.send({ step, version: this.app.version });
          return;
        }
      }
    }
  }

  // The first points of a run, [first, last], that are in view without a break.
  partInView(points, [first, last]) {
    let start = first;
    while (start <= last && !this.view.isIn(points[start])) start += 1;
    if (start > last) return null;
    let end = start;
    while (end < last && this.view.isIn(points[end + 1])) end += 1;
    return [start, end];
  }

  // To the middle of the first part that was not in view, at a size that counts.
  lookAlong() {
    const state = this.app.state;
    const stroke = state.unseen.findIndex((runs) => runs.length > 0);
    if (stroke < 0) return;
    const [first, last] = state.unseen[stroke][0];
    const zoom = Math.max(this.view.zoom, 1);
    const [width, height] = this.view.size();
    const reach = Math.round(Math.min(width, height) / (2.4 * zoom));
    const middle = Math.min(first + reach, Math.round((first + last) / 2));
    this.view.goTo(state.curve_px[stroke][middle], zoom);
  }
}

// A part of a stroke, from point `first` to point `last`, in shares of the stroke's length.
function sharesOf(points, [first, last]) {
  const arc = [0];
  for (let k = 1; k < points.length; k += 1) {
    const [du, dv] = [points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]];
    arc.push(arc[k - 1] + Math.hypot(du, dv));
  }
  const total = arc[arc.length - 1];
  const from = Math.max(0, (arc[first] - POINT_REACH_PX) / total);
  const to = Math.min(1, (arc[last] + POINT_REACH_PX) / total);
  return [from, to];
}
