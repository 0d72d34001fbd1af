// The tool Push: the pointer is the robot's tool, and the robot's own engine answers it.
import { byId, make, makeAt, translation } from "./dom.js";
import { Engine, loadModule } from "./engine.js";

const NEWTON_PX = 25; // length of the force's arrow on the screen

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
    if (this.engine) this.engine.hip = null; // it begins anew where the pointer comes in
    if (!this.isChosen()) return;
    this.load();
    this.before = performance.now();
    this.loops += 1;
    this.nextFrame(this.loops);
  }

  nextFrame(loop) {
    requestAnimationFrame((now) => {
      if (this.isChosen() && loop === this.loops) this.frame(now, loop);
    });
  }

  // The engine of the plan as it stands, which the server describes.
  async load() {
    const digest = this.app.state?.digest;
    if (!digest || this.digest === digest) return;
    this.digest = digest;
    this.engine = null;
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

  frame(now, loop) {
    const place = this.tools.cross || this.pointer;
    const isCurrent = this.engine !== null && this.app.state.digest === this.digest;
    if (!isCurrent) byId("push").replaceChildren();
    else if (place) {
      this.show(place, this.engine.moveTo(this.inRobot(place), now - this.before));
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
    if (newtons > 0) nodes.push(arrow(pointer, this.onSlice(force), NEWTON_PX * newtons));
    nodes.push(makeAt(place, {}, make("circle", { class: "tool-proxy", r: 4 })));
    nodes.push(makeAt(pointer, {}, make("circle", { class: "tool-hip", r: 4 })));
    byId("push").replaceChildren(...nodes);
    const mm = 1e3 * Math.hypot(...away);
    byId("felt").textContent = `${newtons.toFixed(2)} N, the hand ${mm.toFixed(2)} mm from the tool's place`;
  }
}

// The force on the hand.
function arrow(place, [fu, fv], length) {
  const turn = (Math.atan2(fv, fu) * 180) / Math.PI;
  const shape = make("path", { class: "tool-force", d: `M0 0H${length}m-7 -5l7 5l-7 5` });
  const node = makeAt(place, {}, shape);
  node.setAttribute("transform", `${translation(place)} rotate(${turn})`);
  return node;
}
