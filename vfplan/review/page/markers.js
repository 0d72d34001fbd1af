// Markers on the slice and in the table; their residuals, and the bound that follows.
import { byId, make, refill } from "./dom.js";

const mm = (metres) => (metres === null || metres === undefined ? "–" : (1e3 * metres).toFixed(2));

export class Markers {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    this.sentAt = 0;
    byId("find-marks").addEventListener("click", () => app.step({ do: "find_markers" }));
    byId("paste-open").addEventListener("click", () => {
      byId("paste").hidden = !byId("paste").hidden;
      if (!byId("paste").hidden) byId("paste-text").focus();
    });
    byId("paste-take").addEventListener("click", () => app.step({ do: "set_markers", table: byId("paste-text").value }));
  }

  render(state) {
    this.dragged = null;
    this.shown = state;
    this.layer(state);
    this.table(state);
    this.bound(state);
    byId("find-marks").disabled = !state.image.has_slice || state.fre_rms_m === null;
  }

  label(key) { return this.app.state.markers[key]?.label; }
  place(key) { return this.app.state.markers[key]?.place_px; }

  layer(state) {
    const scale = this.arrowScale(state);
    const nodes = [];
    state.markers.forEach((marker, k) => {
      if (!marker.place_px) return;
      const cross = "M-9 0H9M0 -9V9";
      const body = make("g", { class: "fixed" }, make("circle", { class: "grip", r: 13 }), make("circle", { class: "halo", r: 13 }),
        make("path", { d: cross }), make("path", { d: cross }), make("text", { x: 11, y: -11 }, marker.label));
      const kind = `thing marker${marker.used ? "" : " out"}${this.app.isSelected("marker", k) ? " chosen" : ""}`;
      nodes.push(make("path", { class: "arrow", "data-arrow": k, d: this.arrow(marker, marker.place_px, scale) }));
      nodes.push(make("g", { class: kind, "data-marker": k, transform: `translate(${marker.place_px[0]} ${marker.place_px[1]})` }, body));
    });
    byId("markers").replaceChildren(...nodes);
  }

  // Residuals are far shorter than a pixel on the screen: they are drawn enlarged, and it is said.
  arrowScale(state) {
    const longest = Math.max(...state.markers.map((m) => (m.residual_px ? Math.hypot(...m.residual_px) : 0)), 0);
    if (!longest) return 1;
    const wanted = Math.max(state.image.width_px, 300) / 20 / longest;
    return [1, 2, 5, 10, 20, 50, 100, 200, 500].findLast((factor) => factor <= wanted) || 1;
  }

  arrow(marker, [u, v], scale) {
    if (!marker.residual_px) return "";
    const [du, dv] = marker.residual_px.map((x) => x * scale);
    const length = Math.hypot(du, dv);
    if (length < 0.3) return "";
    const [a, b] = [du / length, dv / length];
    const head = Math.min(length / 2, 6 / Math.max(this.view.zoom, 0.3));
    const tip = [u + du, v + dv];
    const wing = (side) => `${tip[0] - head * (a + side * 0.5 * b)} ${tip[1] - head * (b - side * 0.5 * a)}`;
    return `M${u} ${v}L${tip[0]} ${tip[1]}M${wing(1)}L${tip[0]} ${tip[1]}L${wing(-1)}`;
  }

  bound(state) {
    const words = [];
    if (state.tre95_m !== null) words.push(`The curve lies within ${mm(state.tre95_m)} mm of its place (95\u00a0%). FRE ${mm(state.fre_rms_m)} mm.`);
    else if (state.markers.length) words.push(state.markers_why_not || "No bound can be told.");
    else words.push("No markers: the output is the curve alone, in pixels.");
    const deepest = Math.max(0, ...state.markers.map((marker) => Math.abs(marker.depth_m)));
    if (deepest > 5e-5) words.push(`Markers lie up to ${mm(deepest)} mm off the slice and are shown where they project onto it.`);
    const scale = this.arrowScale(state);
    if (scale > 1) words.push(`Arrows are residuals, ${scale} times enlarged.`);
    byId("bound").textContent = words.join(" ");
  }

  table(state) {
    if (this.isTyping()) {
      document.activeElement.onblur = () => this.app.afterRelease(() => this.table(this.app.state));
      return;
    }
    const rows = [];
    state.markers.forEach((marker, k) => {
      const step = (fields) => this.app.step({ marker: marker.label, ...fields });
      const chosen = this.app.isSelected("marker", k);
      const use = make("input", { type: "checkbox", "aria-label": `Use marker ${marker.label}`, onchange: (e) => step({ do: "leave_out_marker", out: !e.target.checked }) });
      use.checked = marker.used;
      const name = make("input", { value: marker.label, "aria-label": `Label of marker ${marker.label}`, maxlength: 64, onfocus: () => chosen || this.choose(k),
        onchange: (e) => { e.target.defaultValue = e.target.value; step({ do: "rename_marker", label: e.target.value }); } });
      const gone = make("button", { type: "button", "aria-label": `Delete marker ${marker.label}`, title: "Delete", onclick: () => step({ do: "delete_marker" }) }, "✕");
      rows.push(make("tr", { class: `${chosen ? "chosen" : ""}${marker.used ? "" : " out"}`, "data-row": k },
        make("td", {}, use), make("td", {}, name), make("td", { class: "residual" }, `${mm(marker.residual_m)} mm`), make("td", { class: "loo" }, `${mm(marker.loo_m)} mm`), make("td", {}, gone)));
      if (chosen || !marker.target_m) rows.push(this.coordinates(marker, step));
    });
    refill(byId("marker-table").tBodies[0], rows);
  }

  // A text that is being typed is not overwritten: its table is made anew once it is left.
  isTyping() {
    const field = document.activeElement;
    return byId("marker-table").contains(field) && field.type === "text" && field.value !== field.defaultValue;
  }

  // Where the marker is in front of the robot.
  coordinates(marker, step) {
    const inputs = ["x", "y", "z"].map((axis, k) => make("input", { value: marker.target_m ? (1e3 * marker.target_m[k]).toFixed(3) : "", placeholder: `${axis} mm`,
      "aria-label": `${axis} of marker ${marker.label} in millimetres`, inputmode: "decimal", onchange: (e) => {
        e.target.defaultValue = e.target.value;
        const values = inputs.map((input) => Number(input.value.trim().replace(",", ".")) / 1e3);
        if (inputs.every((input) => input.value.trim()) && values.every(Number.isFinite)) step({ do: "move_marker", target_m: values });
      } }));
    return make("tr", { class: "chosen coordinates" }, make("td", { colspan: 5 }, ...inputs));
  }

  choose(k) {
    this.app.selected = { kind: "marker", key: k };
    this.select(this.app.selected);
    this.table(this.app.state);
  }

  select(thing) {
    const key = thing !== null && thing.kind === "marker" ? thing.key : -1;
    byId("markers").querySelectorAll(".marker").forEach((node) => node.classList.toggle("chosen", Number(node.dataset.marker) === key));
    byId("marker-table").querySelectorAll("tr[data-row]").forEach((row) => row.classList.toggle("chosen", Number(row.dataset.row) === key));
  }

  // While a marker is dragged, the session is asked thirty times a second what would follow.
  drag(key, to) {
    this.dragged = { key, to };
    byId("markers").querySelector(`[data-marker="${key}"]`)?.setAttribute("transform", `translate(${to[0]} ${to[1]})`);
    if (performance.now() - this.sentAt < 33) return;
    this.sentAt = performance.now();
    this.app.send({ preview: { marker: this.label(key), to } });
  }

  preview(shown) {
    if (!this.dragged) return;
    const state = { ...this.app.state, ...shown };
    this.bound(state);
    const scale = this.arrowScale(state);
    shown.markers.forEach((marker, k) => {
      const row = byId("marker-table").querySelector(`tr[data-row="${k}"]`);
      if (row) {
        row.querySelector(".residual").textContent = `${mm(marker.residual_m)} mm`;
        row.querySelector(".loo").textContent = `${mm(marker.loo_m)} mm`;
      }
      const place = k === this.dragged.key ? this.dragged.to : marker.place_px;
      if (place) byId("markers").querySelector(`[data-arrow="${k}"]`)?.setAttribute("d", this.arrow(marker, place, scale));
    });
  }

  forget() { this.dragged = null; }
}
