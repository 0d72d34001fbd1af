"use strict";
// The mouse as the tool tip: from where it goes over the scene, the robot's own engine makes ticks at
// 1 kHz. `told` gets each frame's last tick in the picture's axes. Arrow keys move the tip as well.
function makeHand(scene, data, told) {
  const view = document.getElementById("view"), STEP_MM = 0.5;
  const start = () => [0, 8 * data.radius, 0].slice(0, data.dims); // where the arrow keys begin
  let engine = null, place = null, isOn = false, loops = 0, before = 0, trail = [];
  const metres = (p) => data.centre.map((c, i) => c + p.reduce((sum, x, j) => sum + x * data.basis[i][j] / 1e3, 0));
  const along = (v) => data.basis[0].map((_, j) => v.reduce((sum, x, i) => sum + x * data.basis[i][j], 0));
  const shown = (x) => along(x.map((v, i) => 1e3 * (v - data.centre[i])));
  function frame(now, loop) {
    if (loop !== loops) return;
    if (engine && place) {
      const answer = engine.moveTo(metres(place), now - before);
      const force = along(answer.force);
      trail = trail.concat(place).slice(-400 * data.dims);
      told({ hip: place, proxy: shown(answer.proxy), normal: along(answer.normal), force, trail, state: answer.state });
    }
    before = now; requestAnimationFrame((next) => frame(next, loop));
  }
  view.addEventListener("pointermove", (event) => {
    if (isOn && (data.dims === 2 || !event.buttons)) place = scene.placeOf(event, place || start());
  });
  view.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!isOn || !step) return;
    event.preventDefault(); event.stopImmediatePropagation();
    place = (place || start()).map((x, i) => x + STEP_MM * (step[i] || 0));
  }, true);
  return {
    // Begin with an engine, or stop without one.
    use(other) {
      engine = other; place = null; trail = []; isOn = Boolean(other); scene.push(isOn);
      if (engine) engine.hip = null;
      const loop = ++loops;
      if (isOn) { before = performance.now(); requestAnimationFrame((now) => frame(now, loop)); }
    },
  };
}
