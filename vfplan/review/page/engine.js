// The robot's own engine: the C++ headers as WebAssembly (vfplan/native/src/browser.cpp).
// Its reports and demonstrations carry this file as well, with what they hand it packed.

const MAX_PAUSE_MS = 100; // a page that was asleep goes on from where it was

// Bytes that were packed by gzip and base64.
export async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

// The module's functions. A refusal of theirs throws an Error with the engine's own sentence.
export async function loadModule(bytes) {
  let said = "";
  const view = () => new DataView(instance.exports.memory.buffer);
  const wasi = {
    fd_write(file, list, count, written) {
      let total = 0;
      for (let k = 0; k < count; k += 1) {
        const start = view().getUint32(list + 8 * k, true);
        const length = view().getUint32(list + 8 * k + 4, true);
        said += new TextDecoder().decode(new Uint8Array(view().buffer, start, length));
        total += length;
      }
      view().setUint32(written, total, true);
      return 0;
    },
    fd_seek: () => 0,
    fd_close: () => 0,
  };
  const { instance } = await WebAssembly.instantiate(bytes, { wasi_snapshot_preview1: wasi });
  instance.exports._initialize();
  return { ...instance.exports, said: () => said };
}

// A region, a guide, or both of a fixture, as `bodies_of` of vfplan.engine.browser describes them.
// An engine that was refused takes no more: load the module anew.
export class Engine {
  static async of(module, bodies) {
    const engine = new Engine(module);
    for (const { shape, arrays } of bodies) {
      const numbers = [];
      for (const text of arrays) numbers.push(new Float64Array(await unpacked(text)));
      engine.add(shape, numbers);
    }
    return engine;
  }

  constructor(module) {
    this.module = module;
    this.bodies = [];
    this.hip = null; // of the last tick [m]
  }

  add(shape, arrays) {
    const { array, data, make, free_array, memory } = this.module;
    const places = arrays.map((numbers) => array(numbers.length));
    places.forEach((place, k) => {
      new Float64Array(memory.buffer, data(place), arrays[k].length).set(arrays[k]);
    });
    try {
      this.bodies.push(make(shape, ...places));
    } catch (error) {
      throw new Error(this.module.said() || error.message);
    }
    places.forEach((place) => free_array(place));
  }

  reset(hip) {
    this.hip = hip;
    for (const body of this.bodies) this.module.reset(body, ...hip);
  }

  // One tick for the HIP [m]: proxy [m], normal, force on the hand [N], state and status. The proxy
  // is that of the first body, and the force is that of both.
  step(hip) {
    this.hip = hip;
    let answer = null;
    for (const body of this.bodies) {
      const at = this.module.step(body, ...hip);
      const [...n] = new Float64Array(this.module.memory.buffer, at, 11);
      const force = n.slice(6, 9);
      if (answer) answer.force = answer.force.map((part, i) => part + force[i]);
      else answer = { proxy: n.slice(0, 3), normal: n.slice(3, 6), force, state: n[9], status: n[10] };
    }
    return answer;
  }

  // The last tick of a hand that goes straight to a place [m] in some milliseconds, by the robot's
  // loop of 1 kHz. The first place is where it begins.
  moveTo(place, milliseconds) {
    if (!this.hip) this.reset(place);
    const from = this.hip;
    const ticks = Math.max(1, Math.round(Math.min(milliseconds, MAX_PAUSE_MS)));
    let answer = null;
    for (let k = 1; k <= ticks; k += 1) {
      answer = this.step(from.map((x, axis) => x + ((place[axis] - x) * k) / ticks));
    }
    return answer;
  }

  free() {
    for (const body of this.bodies) this.module.free_rendered(body);
    this.bodies = [];
  }
}
