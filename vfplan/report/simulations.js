"use strict";
// One of four scenes under the mouse.
(function () {
  const all = JSON.parse(document.getElementById("data").textContent), data = { ...Object.values(all.scenes)[0] };
  const which = document.getElementById("which"), rule = document.getElementById("rule");
  const readout = document.getElementById("readout"), scene = makeScene(data);
  const hand = makeHand(scene, data, (now) => {
    scene.show(now);
    readout.textContent = STATES[now.state] + ", force = " + scene.size(now.force).toFixed(3) + " N, penetration = " +
      scene.size(now.proxy.map((x, i) => x - now.hip[i])).toFixed(3) + " mm";
  });
  let module = null, engine = null;
  async function choose() {
    module = module || await loadModule(await unpacked(all.module));
    hand.use(null); engine?.free(); engine = null;
    Object.assign(data, all.scenes[which.value]);
    // With room for the tip on every side.
    const room = 4 * data.radius, x = data.cloud.filter((_, i) => i % 2 === 0), y = data.cloud.filter((_, i) => i % 2);
    scene.show(null, [Math.min(...x) - room, Math.min(...y) - room, Math.max(...x) + room, Math.max(...y) + room]);
    scene.whole();
    const made = await Engine.of(module, data.bodies[rule.value]);
    engine?.free(); // of a choice that overtook this one
    engine = made; hand.use(engine);
  }
  for (const name of Object.keys(all.scenes)) which.add(new Option(name, name));
  which.selectedIndex = which.length - 1; // the first is a single point
  for (const control of [which, rule]) control.addEventListener("change", choose);
  choose().catch((error) => { readout.textContent = "The robot's engine does not run in this browser: " + error.message; });
})();
