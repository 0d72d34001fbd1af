"use strict";
// Moves the scene through time, and zooms the plots.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const scene = makeScene(data), push = document.getElementById("push"), engineNote = document.getElementById("engine");
  const slider = document.getElementById("time"), readout = document.getElementById("readout");
  const play = document.getElementById("play"), zoomed = document.getElementById("zoomed");
  // As over time: what is beyond the line has the tip's colour, the penetration the proxy's.
  const deep = data.deep ? [data.deep + " [mm]", "tip"] : ["penetration [mm]", "proxy"];
  const plots = [["force", "force [N]", "force", data.limits], ["depth", ...deep, []]].map(
    ([id, label, name, limits]) => ({ id, canvas: document.getElementById(id), plot: makePlot(document.getElementById(id), label, name, limits) }));
  if (!data.forbids) STATES[1] = "outside the tube";
  const TRAIL_S = 0.5;
  document.getElementById("trail").textContent = ` in the last ${TRAIL_S} s`;
  let frames = data.time.length;
  const whole = [data.time[0], Math.max(data.time[frames - 1], data.time[0] + 1e-3)];
  let frame = 0, playing = false, last = 0, clock = 0, span = whole;

  let strength = [];
  function measure() {
    frames = data.time.length; slider.max = frames - 1;
    strength = data.time.map((_, k) => scene.size(scene.row(data.force, k)));
  }

  // The finest envelope that holds all that is to be seen.
  function envelope() {
    return data.zooms.find((z) => z.span[0] <= span[0] && z.span[1] >= span[1]) || data.zooms[data.zooms.length - 1];
  }
  function drawPlots() {
    const rows = envelope();
    for (const { id, plot } of plots)
      plot.show({ time: rows.time, low: rows[id + "_low"], high: rows[id + "_high"] }, data.episodes, data.time[frame], span);
  }
  function look(from, to) {
    const width = Math.max(2e-3, Math.min(to - from, whole[1] - whole[0]));
    const start = Math.max(whole[0], Math.min(from, whole[1] - width));
    span = [start, start + width]; drawPlots();
  }
  function zoom(by, about) {
    const at = about === undefined ? data.time[frame] : about, middle = at >= span[0] && at <= span[1] ? at : (span[0] + span[1]) / 2;
    look(middle - (middle - span[0]) / by, middle + (span[1] - middle) / by);
  }
  function lookAt(choice) {
    if (choice === "whole") return look(...whole);
    const [from, to] = data.episodes[Number(choice)], margin = Math.max(0.02, 0.1 * (to - from));
    look(from - margin, to + margin);
  }
  function show(k) {
    frame = Math.max(0, Math.min(frames - 1, k));
    slider.value = frame;
    const now = { trail: data.hip.slice(frameAt(data.time[frame] - TRAIL_S) * data.dims, frame * data.dims) };
    for (const name of ["hip", "proxy", "normal", "force"]) now[name] = scene.row(data[name], frame);
    scene.show(now, data.hip);
    readout.textContent = "t = " + fixed(data.time[frame], 3) + " s, " + STATES[data.state[frame]] +
      ", force = " + strength[frame].toFixed(3) + " N, penetration = " + data.depth[frame].toFixed(3) + " mm";
    slider.setAttribute("aria-valuetext", readout.textContent);
    drawPlots();
  }
  function frameAt(time) {
    let low = 0, high = frames - 1;
    while (low < high) { const mid = (low + high) >> 1; if (data.time[mid] < time) low = mid + 1; else high = mid; }
    return low;
  }
  function tick(now) {
    if (!playing) return;
    clock += (now - last) / 1000; last = now;
    show(frameAt(clock));
    if (frame >= frames - 1) setPlaying(false); else requestAnimationFrame(tick);
  }
  function setPlaying(on) {
    playing = on; play.textContent = on ? "pause" : "play";
    if (!on) return;
    if (frame >= frames - 1) show(0);
    clock = data.time[frame]; last = performance.now();
    requestAnimationFrame(tick);
  }
  slider.addEventListener("input", () => { setPlaying(false); show(Number(slider.value)); });
  play.addEventListener("click", () => setPlaying(!playing));
  data.episodes.forEach((episode, k) => zoomed.add(new Option("episode " + episode[2], k)));
  zoomed.addEventListener("change", () => lookAt(zoomed.value));
  document.getElementById("zoom-in").addEventListener("click", () => zoom(2));
  document.getElementById("zoom-out").addEventListener("click", () => zoom(0.5));
  for (const { canvas, plot } of plots) {
    canvas.addEventListener("click", (event) => show(frameAt(plot.timeAt(event))));
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return;
      event.preventDefault(); zoom(Math.exp(-event.deltaY / 300), plot.timeAt(event));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -0.1, ArrowRight: 0.1 }[event.key], by = { "+": 2, "=": 2, "-": 0.5 }[event.key];
      if (step) look(span[0] + step * (span[1] - span[0]), span[1] + step * (span[1] - span[0]));
      else if (by) zoom(by);
      else if (event.key === "0") look(...whole);
      else return;
      event.preventDefault();
    });
  }
  for (const button of document.querySelectorAll("button.go"))
    button.addEventListener("click", () => {
      setPlaying(false); show(frameAt(Number(button.dataset.time)));
      zoomed.value = button.dataset.episode; lookAt(zoomed.value);
      document.getElementById("scrubber").scrollIntoView({ block: "center" });
    });
  // The session again by the robot's own engine: all its ticks, in place of the recorded ones if
  // they are these to the bit.
  async function playAgain() {
    const module = await loadModule(await unpacked(data.played.module));
    const engine = await Engine.of(module, data.played.bodies);
    const rows = new Float64Array(await unpacked(data.played.rows)), n = rows.length / 4;
    const answers = new Float64Array(6 * n), ticks = { time: [], hip: [], proxy: [], normal: [], force: [], depth: [], state: [] };
    const along = (v) => data.basis[0].map((_, j) => v.reduce((sum, x, i) => sum + x * data.basis[i][j], 0));
    const shown = (x) => along(x.map((v, i) => 1e3 * (v - data.centre[i])));
    engine.reset([...rows.slice(1, 4)]);
    for (let k = 0; k < n; k++) {
      const [time, ...hip] = rows.slice(4 * k, 4 * k + 4), { proxy, normal, force, state } = engine.step(hip);
      answers.set(proxy, 6 * k); answers.set(force, 6 * k + 3);
      ticks.time.push(time); ticks.hip.push(...shown(hip)); ticks.proxy.push(...shown(proxy));
      ticks.normal.push(...along(normal)); ticks.force.push(...along(force)); ticks.state.push(state);
      ticks.depth.push(1e3 * scene.size(proxy.map((x, i) => x - hip[i])));
    }
    const digest = [...new Uint8Array(await crypto.subtle.digest("SHA-256", answers))];
    const isSame = digest.map((byte) => byte.toString(16).padStart(2, "0")).join("") === data.played.sha256;
    if (!isSame) throw new Error("it gives other ticks than the recorded ones");
    const at = data.time[frame];
    Object.assign(data, ticks); measure(); show(frameAt(at));
    engineNote.textContent = "These are the ticks of the robot's own engine, made in this page: all " + n + " proxies and forces are the recorded ones to the bit.";
    const hand = makeHand(scene, data, (now) => {
      scene.show(now);
      readout.textContent = "by hand: force = " + scene.size(now.force).toFixed(3) + " N, penetration = " +
        scene.size(now.proxy.map((x, i) => x - now.hip[i])).toFixed(3) + " mm";
    });
    push.disabled = false;
    push.addEventListener("change", () => {
      setPlaying(false); hand.use(push.checked ? engine : null);
      if (!push.checked) show(frame);
    });
  }
  measure();
  let deepest = 0;
  data.depth.forEach((depth, k) => { if (depth > data.depth[deepest]) deepest = k; });
  show(deepest);
  scene.whole();
  if (!data.played) push.parentElement.hidden = true;
  else playAgain().catch((error) => { engineNote.textContent = "The robot's engine does not run in this page: " + error.message + ". These are recorded ticks."; });
})();
