// The answers of the engine for pages: proxy and force of each tick of each case as float64 in
// base64, and the ticks a second of the slowest case; or the sentence by which it refuses.
async function answersOf(cases, wasm) {
  let text = "";
  let slowest = Infinity;
  try {
    const module = await loadModule(await unpacked(wasm));
    for (const { bodies, hips } of cases) {
      const engine = await Engine.of(module, bodies);
      engine.reset(hips[0]);
      const began = performance.now();
      const answers = hips.flatMap((hip) => {
        const { proxy, force } = engine.step(hip);
        return [...proxy, ...force];
      });
      slowest = Math.min(slowest, (1e3 * hips.length) / (performance.now() - began));
      for (const byte of new Uint8Array(new Float64Array(answers).buffer)) text += String.fromCharCode(byte);
      engine.free();
    }
  } catch (error) {
    return { refused: error.message };
  }
  return { answers: btoa(text), slowest };
}
