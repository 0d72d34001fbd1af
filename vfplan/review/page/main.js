// The page shows the session's state and sends steps; nothing is decided here.
import { byId, make, refill } from "./dom.js";
import { View } from "./view.js";
import { Curve } from "./curve.js";
import { Findings } from "./findings.js";
import { Markers } from "./markers.js";
import { Approval } from "./approval.js";
import { Tools } from "./tools.js";

export const app = {
  state: null, version: 0, about: {}, selected: null, socket: null, ended: false, waiting: [], changes: 0,
  token: location.hash.slice(1),

  send(message) {
    if (this.socket && this.socket.readyState === 1) this.socket.send(JSON.stringify(message));
  },
  // A change waits for the answer to the one before, whose state it is made in.
  change(message) {
    this.changes += 1;
    this.waiting.push({ ...message, number: this.changes });
    if (this.waiting.length === 1) this.sendFirst();
  },
  sendFirst() { this.send({ ...this.waiting[0], version: this.version }); },
  answered(number) {
    if (this.waiting.length === 0 || this.waiting[0].number !== number) return;
    this.waiting.shift();
    if (this.waiting.length) this.sendFirst();
  },
  step(step) { this.change({ step }); },
  say(text) { byId("say").textContent = text; },
  toast(text) {
    byId("toast").textContent = text;
    byId("toast").hidden = false;
    clearTimeout(this.toastTimer);
    this.toastTimer = setTimeout(() => { byId("toast").hidden = true; }, 7000);
  },
  select(thing) {
    this.selected = thing;
    for (const part of parts) part.select?.(thing);
    if (thing) byId("stage").focus({ preventScroll: true });
  },
  isSelected(kind, key) {
    return this.selected !== null && this.selected.kind === kind && this.selected.key === key;
  },
};

const view = new View(app);
const curve = new Curve(app, view);
const findings = new Findings(app, view);
const markers = new Markers(app, view);
const approval = new Approval(app, view);
const tools = new Tools(app, view, curve, markers, findings, approval);
const parts = [view, curve, findings, markers, approval, tools];

function show(state, isWhole) {
  // What takes the whole plan stays as it was until it comes anew.
  if (!isWhole && app.state) {
    for (const name of ["findings", "why_not", "approvable", "refusal"]) {
      if (name !== "refusal" || !state.candidates.length) state[name] = app.state[name];
    }
  }
  const first = app.state === null;
  app.state = { findings: [], why_not: ["The plan is being made."], approvable: false, ...state };
  if (!isWhole) app.state.approvable = false;
  for (const part of parts) part.render?.(app.state, first);
  const place = state.refusal?.place_px;
  // To choose among several lines the planner has to see the whole slice.
  const isPlace = place && state.refusal.code !== "several-candidates";
  if (isPlace && isWhole && !app.refusalShown) {
    app.refusalShown = true; // once, so that the planner can look elsewhere
    view.goTo(place, 2 * view.zoom);
  }
  byId("undo").disabled = !state.can_undo;
  byId("redo").disabled = !state.can_redo;
  byId("steps").replaceChildren(...state.steps.map((text) => make("li", {}, text)));
  byId("steps-count").textContent = state.steps.length;
}

function showRefusal(state) {
  const refusal = state.refusal;
  byId("refusal").hidden = !refusal || (state.curve_px.length > 0 && refusal.stage === "extract");
  if (byId("refusal").hidden) return;
  const isCurve = refusal.stage === "extract";
  byId("refusal").querySelector("h2").textContent = isCurve ? "No curve yet" : "The plan is refused";
  byId("refusal-text").textContent = refusal.text;
  const rows = isCurve ? state.candidates.map((way) => curve.wayRow(way)) : [];
  refill(byId("candidates"), rows);
}
parts.push({ render: showRefusal });

// A button that is pressed stays where it is: what would change the page waits for its release.
// Without this a new row of buttons would stand in place of the one that is pressed, and the
// browser makes no click of a press and a release on two elements.
const PRESSED = "button:active, input[type=checkbox]:active, label:active, summary:active";
const RELEASE_CHECK_MS = 30;
const postponed = [];
let releaseCheck = null;

function afterRelease(call) {
  postponed.push(call);
  if (releaseCheck === null) doPostponed();
}

function doPostponed() {
  releaseCheck = null;
  while (postponed.length) {
    if (document.querySelector(PRESSED)) {
      releaseCheck = setTimeout(doPostponed, RELEASE_CHECK_MS);
      return;
    }
    postponed.shift()();
  }
}

function receive(message) {
  afterRelease(() => showMessage(message));
}

function showMessage(message) {
  if (message.about) {
    app.about = message.about;
    if (!byId("name").value) byId("name").value = message.about.by;
  } else if (message.quick || message.state) {
    if (message.version < app.version) return; // overtaken by a later state
    app.version = message.version;
    show(message.state || message.quick, Boolean(message.state));
  } else if (message.preview) markers.preview(message.preview);
  else if (message.error) {
    app.toast(message.error.message);
    markers.forget();
  } else if (message.answered) app.answered(message.answered);
  else if (message.approved) finish("Approved", `${message.approved.text} You can close this page.`);
  else if (message.left) finish("Left without approval", "Your steps are kept. The same command takes them up again. You can close this page.");
}

function finish(title, text) {
  app.ended = true;
  byId("done-title").textContent = title;
  byId("done-text").textContent = text;
  byId("done").showModal();
}

function connect() {
  app.socket = new WebSocket(`ws://${location.host}/steps?token=${encodeURIComponent(app.token)}`);
  app.socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  app.socket.addEventListener("close", () => {
    app.waiting = [];
    if (app.ended) return;
    approval.lost(app.token ? "" : "The address lacks its end. Open it as the command printed it.");
    setTimeout(connect, 1000);
  });
}

byId("slice").addEventListener("load", () => view.shrink());
byId("slice").src = `slice.png?token=${encodeURIComponent(app.token)}`;
byId("undo").addEventListener("click", () => app.change({ undo: true }));
byId("redo").addEventListener("click", () => app.change({ redo: true }));
Object.assign(app, { receive, afterRelease, view });
window.review = app; // for the tests, which look at what is shown
connect();
