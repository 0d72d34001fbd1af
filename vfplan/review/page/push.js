// The tool Push: the pointer is the robot's tool, and the robot's own engine answers it.
import { byId, make, makeAt, translation } from "./dom.js";
import { Engine, loadModule } from "./engine.js";

const TICKS_PER_MS = 1; // the robot's loop runs at 1 kHz
const MAX_FRAME_MS = 100; // a page that was asleep goes on from where it was
const NEWTON_PX = 25; // length of the force's arrow on the screen

export class Push {
  constructor(app, view, tools) {
    Object.assign(this, { app, view, tools });
    this.engine = null;
    this.digest = null; // of the plan that the engine was made of
    this.pointer = null; // [u, v] on the slice
    this.hip = null; // [u, v] of the last tick
    byId("stage").addEventListener("pointermove", (event) => {
      this.pointer = view.place(event);
    });
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
    byId("push").replaceChildren();
    byId("felt").textContent = "";
    this.hip = null;
    if (!this.isChosen()) return;
    this.load();
    this.before = performance.now();
    requestAnimationFrame((now) => this.frame(now));
  }

  // The engine of the plan as it stands, which the server describes.
  async load() {
    const digest = this.app.state?.digest;
    if (!digest || this.digest === digest) return;
    this.digest = digest;
    this.engine = null;
    this.hip = null;
    try {
      const [compiled, described] = await Promise.all([fetch("engine.wasm"), fetch(`bodies.json?token=${encodeURIComponent(this.app.token)}`)]);
      const plan = await described.json();
      if (plan.why_not) throw new Error(plan.why_not);
      const engine = await Engine.of(await loadModule(await compiled.arrayBuffer()), plan.bodies);
      if (plan.digest !== digest || this.digest !== digest) {
        this.digest = null; // the plan has changed meanwhile; its next state brings another one
        return;
      }
      Object.assign(this, { engine, plan });
    } catch (error) {
      this.digest = null;
      this.app.toast(`The plan cannot be felt: ${error.message}`);
    }
  }

  frame(now) {
    if (!this.isChosen()) return;
    const place = this.tools.cross || this.pointer;
    if (this.engine && place && !this.app.state.digest) this.engine = null;
    if (this.engine && place) this.show(this.move(place, Math.min(now - this.before, MAX_FRAME_MS)));
    this.before = now;
    requestAnimationFrame((next) => this.frame(next));
  }

  // The ticks of a frame, in which the tool goes straight from its place to another one.
  move(to, milliseconds) {
    if (!this.hip) {
      this.hip = to;
      this.engine.reset(this.inRobot(to));
    }
    const from = this.hip;
    const ticks = Math.max(1, Math.round(milliseconds * TICKS_PER_MS));
    let answer = null;
    for (let k = 1; k <= ticks; k += 1) {
      this.hip = [0, 1].map((axis) => from[axis] + ((to[axis] - from[axis]) * k) / ticks);
      answer = this.engine.step(this.inRobot(this.hip));
    }
    this.hip = to;
    return answer;
  }

  // From the slice [px] to the plan's frame [m], and a way there [m] back to the slice [px].
  inRobot([u, v]) {
    return this.plan.plane.map((row) => row[0] * u + row[1] * v + row[2]);
  }

  onSlice(way) {
    return this.plan.back.map((row) => row[0] * way[0] + row[1] * way[1] + row[2] * way[2]);
  }

  show({ proxy, force }) {
    const hip = this.inRobot(this.hip);
    const [du, dv] = this.onSlice(proxy.map((x, axis) => x - hip[axis]));
    const place = [this.hip[0] + du, this.hip[1] + dv];
    const newtons = Math.hypot(...force);
    const nodes = [];
    if (this.plan.radius_px) {
      const ring = make("circle", { class: "tool-ring", r: this.plan.radius_px });
      nodes.push(make("g", { transform: translation(place) }, ring));
    }
    if (newtons > 0) nodes.push(this.arrow(this.onSlice(force), newtons));
    nodes.push(makeAt(place, {}, make("circle", { class: "tool-proxy", r: 4 })));
    nodes.push(makeAt(this.hip, {}, make("circle", { class: "tool-hip", r: 4 })));
    byId("push").replaceChildren(...nodes);
    const mm = 1e3 * Math.hypot(...proxy.map((x, axis) => x - hip[axis]));
    byId("felt").textContent = `${newtons.toFixed(2)} N, the hand ${mm.toFixed(2)} mm from the tool's place`;
    this.answer = { hip, proxy, force }; // for the tests
  }

  // The force on the hand.
  arrow([fu, fv], newtons) {
    const length = NEWTON_PX * newtons;
    const size = Math.hypot(fu, fv) || 1;
    const turn = (Math.atan2(fv / size, fu / size) * 180) / Math.PI;
    const shape = make("path", { class: "tool-force", d: `M0 0H${length}m-7 -5l7 5l-7 5` });
    const arrow = makeAt(this.hip, {}, shape);
    arrow.setAttribute("transform", `${translation(this.hip)} rotate(${turn})`);
    return arrow;
  }
}
