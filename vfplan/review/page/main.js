// The page shows the session's state and sends steps; nothing is decided here.
import { byId, inPageWords, make, refill } from "./dom.js";
import { View } from "./view.js";
import { Curve } from "./curve.js";
import { Findings } from "./findings.js";
import { Markers } from "./markers.js";
import { Approval } from "./approval.js";
import { Selection } from "./selection.js";
import { Tools } from "./tools.js";
import { Pointer } from "./pointer.js";
import { Keys } from "./keys.js";
import { Push } from "./push.js";

const TOAST_MS = 7000;
const RECONNECT_MS = 1000;
const SAME_KNOT_PX = 0.5; // of the slice; a knot that lies so near to where one was is that one

export const app = {
  token: location.hash.slice(1),
  socket: null,
  ended: false,
  state: null,
  version: 0, // of the state that is shown
  about: {}, // the name that is proposed, and whether the output will be signed
  selected: null, // {kind: "knot", "marker", "finding" or "ink", key}
  waiting: [], // changes that the session has not answered yet
  isWhole: true, // whether the findings belong to the state that is shown
  changes: 0,
  refusalShown: false,

  send(message) {
    if (this.socket && this.socket.readyState === 1) this.socket.send(JSON.stringify(message));
  },
  // A change waits for the answer to the one before, whose state it is made in.
  change(message) {
    this.changes += 1;
    this.waiting.push({ ...message, number: this.changes });
    if (this.waiting.length === 1) this.sendFirst();
    this.showWork();
  },
  sendFirst() {
    this.send({ ...this.waiting[0], version: this.version });
  },
  answered(number) {
    if (this.waiting.length === 0 || this.waiting[0].number !== number) return;
    this.waiting.shift();
    if (this.waiting.length) this.sendFirst();
    this.showWork();
    tools.showDrawn();
  },
  // While a change is made or planned, the page says so; the findings are those of before.
  showWork() {
    document.body.classList.toggle("working", this.waiting.length > 0 || !this.isWhole);
  },
  step(step) {
    this.change({ step });
  },
  // A steep photograph takes some seconds; the words stand there until it is flat or refused.
  makeFlat() {
    this.toast("The picture is being made flat, which may take some seconds.");
    clearTimeout(this.toastTimer);
    this.step({ do: "rectify" });
  },
  // For readers of the screen.
  say(text) {
    byId("say").textContent = text;
  },
  toast(text) {
    byId("toast").textContent = inPageWords(text);
    byId("toast").hidden = false;
    clearTimeout(this.toastTimer);
    this.toastTimer = setTimeout(() => this.hideToast(), TOAST_MS);
  },
  hideToast() {
    byId("toast").hidden = true;
  },
  select(thing, isFocusKept = false) {
    this.selected = thing;
    for (const part of parts) part.select?.();
    if (thing && !isFocusKept) byId("stage").focus({ preventScroll: true });
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
const selection = new Selection(app, view, curve, markers);
const tools = new Tools(app, view);
const push = new Push(app, view, tools);
const pointer = new Pointer(app, view, { curve, markers, findings, tools, selection });
const keys = new Keys(app, view, { findings, approval, selection, tools, pointer });
const parts = [view, curve, findings, markers, approval, selection, tools, push, keys];

// A button that is pressed and a knot that is dragged stay as they are: what would change the page
// waits for the release. Without this a new row of buttons would stand in place of the one that is
// pressed, and the browser makes no click of a press and a release on two elements.
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
    if (document.querySelector(PRESSED) || pointer.isDragging()) {
      releaseCheck = setTimeout(doPostponed, RELEASE_CHECK_MS);
      return;
    }
    postponed.shift()();
  }
}

function receive(message) {
  // A preview shows what a drag would do, while it goes on.
  if (message.preview) markers.preview(message.preview);
  else afterRelease(() => showMessage(message));
}

function showMessage(message) {
  if (message.about) {
    app.about = message.about;
    if (!byId("name").value) byId("name").value = message.about.by;
    approval.sendName();
    approval.showDraft(message.about.draft);
  } else if (message.quick || message.state) {
    if (message.version < app.version) return; // overtaken by a later state
    app.version = message.version;
    if (message.state) show(message.state, true);
    else show(withPlanOf(app.state, message.quick), false);
  } else if (message.error?.code === "replace-or-add") {
    tools.ask();
  } else if (message.error) {
    app.toast(message.error.message);
    markers.forgetDrag();
  } else if (message.answered) {
    app.answered(message.answered);
  } else if (message.approved) {
    finish("Approved", `${message.approved.text} You can close this page.`);
  } else if (message.left) {
    finish("Left without approval", "Your steps are kept. The same command takes them up again. You can close this page.");
  }
}

// A state without what takes the whole plan: that stays as it was until it comes anew.
function withPlanOf(before, quick) {
  const state = { findings: [], why_not: ["The plan is being made."], refusal: null, ...quick };
  if (before) {
    state.findings = before.findings;
    state.why_not = before.why_not;
    if (!quick.candidates.length) state.refusal = before.refusal;
    state.at_angle = before.at_angle && !quick.image.is_flat;
  }
  state.approvable = false;
  return state;
}

function show(state, isWhole) {
  const isFirst = app.state === null;
  if (!isFirst && state.image.is_flat && !app.state.image.is_flat) app.hideToast();
  if (!isFirst) app.selected = stillSelected(app.state, state);
  app.state = state;
  app.isWhole = isWhole;
  app.showWork();
  for (const part of parts) part.render?.(state, isFirst);
  showRefusal(state);
  if (isWhole) goToRefusal(state.refusal);
  byId("undo").disabled = !state.can_undo;
  byId("redo").disabled = !state.can_redo;
  byId("steps").replaceChildren(...state.steps.map((step) => make("li", {}, titleOf(step))));
  byId("steps-count").textContent = state.steps.length;
}

// A step in the list of steps. Strokes, knots and findings count from 1 here.
function titleOf(step) {
  const words = [step.do === "leave" ? "leave out" : step.do.replaceAll("_", " ")];
  for (const name of ["stroke", "knot", "candidate", "ink", "marker", "finding", "label", "colour"]) {
    if (!(name in step)) continue;
    const isFrom0 = ["stroke", "knot", "finding"].includes(name) && Number.isInteger(step[name]);
    words.push(`${name} ${isFrom0 ? step[name] + 1 : step[name]}`);
  }
  return words.join(", ");
}

// A step may give the number of what is selected to another one: it is found again by its place, its
// label or its words. What was only moved or renamed is one of as many as before.
function stillSelected(before, state) {
  const thing = app.selected;
  if (thing?.kind === "ink") {
    const ink = before.account.find((one) => one.number === thing.key);
    const same = state.account.find((one) => one.what === "ink" && one.u === ink?.u && one.v === ink?.v);
    return same ? { kind: "ink", key: same.number } : null;
  }
  if (thing?.kind === "finding") {
    const sign = (one) => JSON.stringify([one.code, one.text, one.place_px]);
    const key = state.findings.findIndex((one) => sign(one) === sign(before.findings[thing.key]));
    return key >= 0 ? { kind: "finding", key } : null;
  }
  if (thing?.kind === "marker") {
    const label = before.markers[thing.key]?.label;
    const key = state.markers.findIndex((one) => one.label === label);
    if (key >= 0) return { kind: "marker", key };
    return before.markers.length === state.markers.length ? thing : null;
  }
  if (thing?.kind === "knot") {
    const [u, v] = knotsOf(before).get(thing.key) ?? [];
    const isThere = ([, [x, y]]) => Math.hypot(x - u, y - v) < SAME_KNOT_PX;
    const same = [...knotsOf(state)].find(isThere);
    if (same) return { kind: "knot", key: same[0] };
    return isOfAsManyKnots(before, state) ? thing : null;
  }
  return thing;
}

// The place of each knot by its key, "stroke/knot".
function knotsOf(state) {
  return new Map(state.knots_px.flatMap((knots, stroke) => knots.map((place, knot) => [`${stroke}/${knot}`, place])));
}

function isOfAsManyKnots(before, state) {
  const counts = [before, state].map((one) => one.knots_px.map((knots) => knots.length).join());
  return counts[0] === counts[1];
}

function showRefusal(state) {
  const refusal = state.refusal;
  const isOfCurve = refusal?.stage === "extract";
  const isShown = refusal !== null && !(isOfCurve && state.curve_px.length > 0);
  byId("refusal").hidden = !isShown;
  if (!isShown) return;
  const lines = isOfCurve ? state.candidates.map((way) => curve.candidateRow(way)) : [];
  const rows = []; // ways out that are no lines
  const colour = refusal.other_pen;
  if (colour) {
    const swatch = make("span", { class: "pen", style: `background:${colour}` });
    rows.push(wayRow(() => app.step({ do: "choose_pen", colour }), swatch, `Take the line in ${colour}`));
  }
  if (!byId("make-flat").hidden) rows.push(wayRow(() => app.makeFlat(), "Make the picture flat"));
  if (refusal.code === "arcs-coarse" && state.plan.arcs_m) {
    const finer = { do: "set_plan", arcs_m: null };
    rows.push(wayRow(() => app.step(finer), "Take finer lines and arcs"));
  }
  let text = refusal.text;
  if (refusal.code === "several-candidates" && lines.length) {
    text = `There are ${lines.length} candidates. Choose the line that is meant, or draw it.`;
  }
  if (refusal.code === "image-grey") text = "The picture is grey, so no pen can be told from it. Draw the curve.";
  byId("refusal").querySelector("h2").textContent = isOfCurve ? "No curve yet" : "The plan is refused";
  byId("refusal-text").textContent = inPageWords(text);
  refill(byId("candidates"), lines);
  refill(byId("other-ways"), rows);
  byId("other-ways-heading").hidden = !lines.length || !rows.length;
}

// A way out of a refusal, by a button: another pen than the command named, a photograph made flat.
function wayRow(onclick, ...words) {
  return make("li", {}, make("button", { type: "button", class: "row", onclick }, ...words));
}

// Once, so that the planner can look elsewhere. To choose among several lines he has to see the
// whole slice.
function goToRefusal(refusal) {
  if (app.refusalShown || !refusal?.place_px || refusal.code === "several-candidates") return;
  app.refusalShown = true;
  view.goTo(refusal.place_px, 2 * view.zoom);
}

function finish(title, text) {
  app.ended = true;
  approval.tell(title.toLowerCase(), title === "Approved" ? "pass" : "none");
  approval.showReasons();
  app.hideToast();
  byId("done-title").textContent = title;
  byId("done-text").textContent = text;
  byId("done").showModal();
}

function connect() {
  app.socket = new WebSocket(`ws://${location.host}/steps?token=${encodeURIComponent(app.token)}`);
  app.socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  app.socket.addEventListener("close", () => {
    app.waiting = [];
    app.isWhole = true;
    app.showWork();
    tools.showDrawn();
    if (app.ended) return;
    approval.lost(app.token ? "" : "The address lacks its end. Open it as the command printed it.");
    setTimeout(connect, RECONNECT_MS);
  });
}

byId("slice").addEventListener("load", () => view.makeCopies());
byId("slice").src = `slice.png?token=${encodeURIComponent(app.token)}`;
byId("undo").addEventListener("click", () => app.change({ undo: true }));
byId("redo").addEventListener("click", () => app.change({ redo: true }));
Object.assign(app, { receive, afterRelease, view, push });
window.review = app; // for the tests, which look at what is shown
connect();
