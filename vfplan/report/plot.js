"use strict";
// One quantity over time as an envelope {time, low, high}, stretches in contact behind it, limits across it.
function makePlot(canvas, label, name, limits = []) {
  const left = 48, below = 22, above = 20;
  let span = [0, 1], held = null;
  const inner = () => canvas.clientWidth - left - 8;
  function draw() {
    if (!held) return;
    const { rows, bands, cursor } = held, { pen, width, height } = fitted(canvas);
    const x = (t) => left + (t - span[0]) / (span[1] - span[0]) * inner();
    const inside = rows.time.map((t, k) => k).filter((k) => rows.time[k] >= span[0] && rows.time[k] <= span[1]);
    const most = 1.05 * Math.max(1e-9, ...limits, ...inside.map((k) => rows.high[k]));
    const y = (v) => height - below - v / most * (height - below - above);
    pen.save(); pen.beginPath(); pen.rect(left, 0, inner(), height); pen.clip();
    pen.fillStyle = colour("contact-ground");
    for (const [from, to] of bands) pen.fillRect(x(from), above, Math.max(1, x(to) - x(from)), height - below - above);
    pen.strokeStyle = pen.fillStyle = colour(name); pen.lineWidth = 1.5; pen.beginPath();
    inside.forEach((k) => pen.lineTo(x(rows.time[k]), y(rows.high[k])));
    pen.stroke(); pen.globalAlpha = 0.3;
    inside.slice().reverse().forEach((k) => pen.lineTo(x(rows.time[k]), y(rows.low[k])));
    pen.fill(); pen.globalAlpha = 1;
    pen.strokeStyle = colour(name); pen.setLineDash([6, 4]);
    for (const limit of limits) { pen.beginPath(); pen.moveTo(left, y(limit)); pen.lineTo(width, y(limit)); pen.stroke(); }
    pen.setLineDash([]);
    if (cursor !== null) { pen.fillStyle = colour("cloud"); pen.fillRect(x(cursor) - 0.75, above, 1.5, height - below - above); }
    pen.restore();
    pen.fillStyle = colour("pale-ink"); pen.textAlign = "left"; pen.fillText(label + (limits.length ? ", dashed: limit " + limits.map(shownRound).join(" and ") : ""), left, 13);
    pen.textAlign = "right";
    const step = roundBelow(most * 0.6);
    for (let v = 0; v <= most; v += step) { pen.fillText(shownRound(v), left - 6, y(v) + 4); pen.fillRect(left - 4, y(v), 4, 1); }
    pen.textAlign = "center";
    // 80 px or more between two.
    const stride = roundBelow((span[1] - span[0]) * 80 / inner() * 2.5);
    for (let k = Math.ceil(span[0] / stride); k * stride <= span[1]; k += 1) {
      const at = k * stride;
      pen.fillText(shownRound(at) + " s", Math.min(x(at), width - 18), height - 5); pen.fillRect(x(at), height - below, 1, 4);
    }
  }
  keptDrawn(canvas, draw);
  return {
    show(rows, bands, cursor, window) { held = { rows, bands, cursor }; span = window; draw(); },
    timeAt: (event) => span[0] + (event.offsetX - left) / inner() * (span[1] - span[0]),
  };
}
