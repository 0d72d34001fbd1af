"use strict";
// What every drawing on the page shares: the palette, sharp pixels, round numbers.
const STATES = { "-1": "far away", 0: "free", 1: "in contact", 2: "proxy inside the wall" };
function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}
// A number with so many decimals; one that rounds to 0 has no sign.
function fixed(number, decimals) {
  return (Number(number.toFixed(decimals)) + 0).toFixed(decimals);
}
// The canvas cleared, as many pixels as the screen has for it, measured in CSS pixels.
function fitted(canvas) {
  const scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.max(1, Math.round(width * scale));
  canvas.height = Math.max(1, Math.round(height * scale));
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.fillStyle = colour("ground"); pen.fillRect(0, 0, width, height);
  pen.font = "13px system-ui, sans-serif";
  return { pen, width, height };
}
// 1, 2 or 5 times a power of ten, at most the value.
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return Math.max(...[1, 2, 5].map((n) => n * power).filter((v) => v <= value));
}
function shownRound(value) { return String(Number(value.toPrecision(12))); }
// Draw when the canvas has another size, or the screen another theme.
function keptDrawn(canvas, draw) {
  new ResizeObserver(draw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}
