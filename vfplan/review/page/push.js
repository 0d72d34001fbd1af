// The tool Push: the pointer is the tool tip, and the robot's own engine answers it.
import { byId, inPageWords, make, makeAt, translation } from "./dom.js";
import { Engine, loadModule } from "./engine.js";

const NEWTON_PX = 25; // length of the force's arrow on the screen, as far as the stage reaches
const BORDER_PX = 10; // between the arrow's head and the border of the stage
const WORDS_PX = 70; // room that the newtons beside it need

export class Push {
  constructor(app, view, tools) {
    Object.assign(this, { app, view, tools });
    this.engine = null;
    this.digest = null; // of the plan that the engine was made of
    this.pointer = null; // [u, v] on the slice
    this.loops = 0; // of frames; the last one goes on
    byId("stage").addEventListener("pointermove", (event) => {
      this.pointer = view.place(event);
    });
    // The stage leaves the pointer, or the pointer the stage.
    const forget = () => {
      this.pointer = null;
      this.endTouch();
    };
    byId("stage").addEventListener("pointerleave", forget);
    window.addEventListener("resize", forget);
    tools.chosen = () => this.begin();
  }

  isChosen() {
    return this.tools.tool === "push";
  }

  // Another plan has another engine.
  render() {
    if (this.isChosen()) this.load();
  }

  begin() {
    this.endTouch();
    if (!this.isChosen()) return;
    this.load();
    this.before = performance.now();
    this.loops += 1;
    this.nextFrame(this.loops);
  }

  // Nothing is felt. The next touch begins where the tip then is, not where it was: from the last
  // place the engine would drag the proxy there, through what lies between.
  endTouch() {
    byId("push").replaceChildren();
    byId("felt").textContent = "";
    if (this.engine) this.engine.hip = null;
  }

  // Say in the hint why nothing can be felt.
  refuse(text) {
    this.tools.whyNoPush = inPageWords(text);
    this.tools.showHint();
  }

  nextFrame(loop) {
    requestAnimationFrame((now) => {
      if (this.isChosen() && loop === this.loops) this.frame(now, loop);
    });
  }

  // The engine of the plan as it stands, which the server describes.
  async load() {
    const { state } = this.app;
    const digest = state?.digest;
    if (state && !digest) this.refuse(`No plan yet: ${state.why_not[0]}`);
    if (!digest || this.digest === digest) {
      if (digest && this.engine) this.refuse("");
      return;
    }
    this.digest = digest;
    this.engine = null;
    try {
      const [compiled, described] = await Promise.all([fetch("engine.wasm"), fetch(`bodies.json?token=${encodeURIComponent(this.app.token)}`)]);
      const plan = await described.json();
      if (plan.why_not) throw new Error(`No plan yet: ${plan.why_not}`);
      const engine = await Engine.of(await loadModule(await compiled.arrayBuffer()), plan.bodies);
      // The plan may have changed before the server described it, or since: the next state then
      // brings the digest for which this is asked again.
      if (plan.digest !== digest || this.digest !== digest) {
        this.digest = null;
        return;
      }
      Object.assign(this, { engine, plan });
      this.refuse("");
    } catch (error) {
      this.digest = null;
      this.refuse(error.message);
    }
  }

  frame(now, loop) {
    const place = this.tools.cross || this.pointer;
    const isByKeys = this.tools.cross !== null;
    if (isByKeys !== this.isByKeys) this.endTouch(); // the tip leaps from the one to the other
    this.isByKeys = isByKeys;
    const isCurrent = this.engine !== null && this.app.state.digest === this.digest;
    if (isCurrent && place) {
      this.show(place, this.engine.moveTo(this.inRobot(place), now - this.before));
    } else {
      this.endTouch();
    }
    this.before = now;
    this.nextFrame(loop);
  }

  // From the slice [px] to the plan's frame [m], and a way there [m] back to the slice [px].
  inRobot([u, v]) {
    return this.plan.plane.map((row) => row[0] * u + row[1] * v + row[2]);
  }

  onSlice(way) {
    return this.plan.back.map((row) => row[0] * way[0] + row[1] * way[1] + row[2] * way[2]);
  }

  show(pointer, { proxy, force }) {
    const away = proxy.map((x, axis) => x - this.engine.hip[axis]);
    const [du, dv] = this.onSlice(away);
    const place = [pointer[0] + du, pointer[1] + dv];
    const newtons = Math.hypot(...force);
    const nodes = [];
    if (this.plan.radius_px) {
      const ring = make("circle", { class: "tool-ring", r: this.plan.radius_px });
      nodes.push(make("g", { transform: translation(place) }, ring));
    }
    if (newtons > 0) nodes.push(...this.arrow(pointer, this.onSlice(force), newtons));
    nodes.push(makeAt(place, {}, make("circle", { class: "tool-proxy", r: 4 })));
    nodes.push(makeAt(pointer, {}, make("circle", { class: "tool-tip", r: 4 })));
    byId("push").replaceChildren(...nodes);
    const mm = 1e3 * Math.hypot(...away);
    byId("felt").textContent = `${newtons.toFixed(2)} N, the tip ${mm.toFixed(2)} mm from the proxy`;
  }

  // The force on the tip, and its newtons beside the arrow's middle.
  arrow(place, [fu, fv], newtons) {
    const angle = Math.atan2(fv, fu);
    const way = [Math.cos(angle), Math.sin(angle)];
    const [at, size] = [this.view.onStage(place), this.view.size()];
    const rooms = way.map((x, axis) => (x > 0 ? size[axis] - at[axis] : at[axis]) / Math.max(Math.abs(x), 1e-9));
    const length = Math.max(BORDER_PX, Math.min(NEWTON_PX * newtons, Math.min(...rooms) - BORDER_PX));
    const shape = make("path", { class: "tool-force", d: `M0 0H${length}m-7 -5l7 5l-7 5` });
    const node = makeAt(place, {}, shape);
    node.setAttribute("transform", `${translation(place)} rotate(${(angle * 180) / Math.PI})`);
    const [x, y] = way.map((part) => (part * length) / 2);
    const isRight = at[0] + x < size[0] - WORDS_PX;
    const isAbove = way[0] * way[1] >= 0 === isRight; // off the arrow
    const words = make("text", { class: "tool-newtons", x: x + (isRight ? 10 : -10), y: y + (isAbove ? -8 : 18) });
    words.style.textAnchor = isRight ? "start" : "end";
    words.textContent = `${newtons.toFixed(1)} N`;
    return [node, makeAt(place, {}, words)];
  }
}
