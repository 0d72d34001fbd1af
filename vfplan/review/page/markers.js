// Markers on the slice and in the table; their residuals, and the bound that follows.
import { byId, fixed, inPageWords, make, makeAt, refill, translation } from "./dom.js";

const CROSS = "M-9 0H9M0 -9V9";
const ARROW_SCALES = [1, 2, 5, 10, 20, 50, 100, 200, 500];
const MIN_ARROW_PX = 0.3; // of the slice; a shorter arrow is not drawn
const PREVIEW_PAUSE_MS = 33; // a drag asks thirty times a second what would follow
const LABEL_REACH_PX = 60; // half of the window around a marker in which its label may stand
// Where a label may stand beside its marker: [x, y, anchor], and the corner of its box.
const LABEL_PLACES = [
  [11, -11, "start"], [11, 23, "start"], [-11, -11, "end"], [-11, 23, "end"],
  [0, -24, "middle"], [0, 36, "middle"], [24, 5, "start"], [-24, 5, "end"],
];
const LABEL_HEIGHT_PX = 14;
const NO_PLACE = 1e12; // more than any label can cover
const FLAT_M = 5e-5; // depth below which a marker counts as on the slice

export class Markers {
  constructor(app, view) {
    this.app = app;
    this.view = view;
    this.previewedAt = 0;
    this.dragged = null;
    view.settled.push(() => this.placeLabels());
    this.fields();
    byId("find-marks").addEventListener("click", () => app.step({ do: "find_markers" }));
    byId("make-flat").addEventListener("click", () => app.makeFlat());
  }

  // The fields of the plan: each is a step once it is left.
  fields() {
    const set = (id, fields) => byId(id).addEventListener("change", () => this.app.step({ do: "set_plan", ...fields(byId(id).value) }));
    set("plan-model", (model) => ({ model }));
    set("plan-side", (side) => ({ seen_from: side || null }));
    this.setNumber("plan-spacing", (size) => ({ pixel_spacing_mm: [size, size] }));
    this.setNumber("plan-distance", (distance) => ({ contact_radius: [distance / 1e3] }));
    this.setNumber("plan-guide", (radius) => ({ guide_m: [radius / 1e3] }));
  }

  // A field of millimetres. What is no number above 0 is told, and the field shows the plan's again.
  setNumber(id, fields) {
    byId(id).addEventListener("change", () => {
      const size = Number(byId(id).value.trim().replace(",", "."));
      if (size > 0 && Number.isFinite(size)) {
        this.app.step({ do: "set_plan", ...fields(size) });
        return;
      }
      this.app.toast(`“${byId(id).value}” is no length. Write a number of millimetres above 0.`);
      this.showFields(this.app.state.plan);
    });
  }

  showFields({ model, contact_radius: distance, guide_m: guide, guide_stroke: guiding, seen_from: side, pixel_spacing_mm: spacing }) {
    // A plan that only guides keeps no distance.
    byId("plan-guide").parentNode.hidden = guide === null;
    byId("plan-distance").parentNode.hidden = guide !== null && guiding === null;
    const values = {
      "plan-spacing": spacing ? String(Number(spacing[0].toFixed(6))) : "",
      "plan-model": model,
      "plan-distance": String(Number((1e3 * distance).toFixed(6))),
      "plan-guide": String(Number((1e3 * guide).toFixed(6))),
      "plan-side": typeof side === "string" ? side : "",
    };
    for (const [id, value] of Object.entries(values)) {
      if (document.activeElement !== byId(id)) byId(id).value = value;
    }
  }

  render(state) {
    this.dragged = null;
    this.showFields(state.plan);
    this.layer(state);
    this.table(state);
    this.bound(state);
    byId("make-flat").hidden = !state.at_angle || !state.image.has_ink;
    byId("find-marks").disabled = !state.image.has_slice || state.fre_rms_m === null;
  }

  label(key) {
    return this.app.state.markers[key]?.label;
  }

  place(key) {
    return this.app.state.markers[key]?.place_px;
  }

  layer(state) {
    const scale = arrowScale(state);
    const nodes = [];
    state.markers.forEach((marker, k) => {
      if (!marker.place_px) return;
      let kind = "thing marker";
      if (!marker.used) kind += " out";
      if (this.app.isSelected("marker", k)) kind += " chosen";
      nodes.push(
        ...["arrow edge", "arrow"].map((kind) => make("path", { class: kind, "data-arrow": k, d: this.arrow(marker, marker.place_px, scale) })),
        makeAt(
          marker.place_px,
          { class: kind, "data-marker": k },
          make("circle", { class: "grip", r: 13 }),
          make("circle", { class: "halo", r: 13 }),
          make("path", { d: CROSS }),
          make("path", { d: CROSS }),
          make("text", { x: 11, y: -11 }, marker.label),
        ),
      );
    });
    byId("markers").replaceChildren(...nodes);
    this.raise();
    this.placeLabels();
  }

  // A label stands where it covers least of what the slice shows, such as a label printed there.
  placeLabels() {
    const slice = byId("slice");
    if (!slice.complete || !slice.naturalWidth) return;
    const size = 2 * LABEL_REACH_PX;
    const reach = LABEL_REACH_PX / this.view.zoom;
    const options = { willReadFrequently: true };
    const canvas = make("canvas", { width: size, height: size }).getContext("2d", options);
    const [width, height] = this.view.size();
    const stage = byId("stage").getBoundingClientRect();
    // What a label may not lie on, as [left, top, right, bottom] on the stage.
    const taken = [...byId("stage").querySelectorAll(".chip, .pin path")].map((node) => {
      const box = node.getBoundingClientRect();
      return [box.left - stage.left, box.top - stage.top, box.right - stage.left, box.bottom - stage.top];
    });
    const isFree = ([left, top, right, bottom]) => left >= 0 && top >= 0 && right <= width && bottom <= height
      && !taken.some((box) => left < box[2] && right > box[0] && top < box[3] && bottom > box[1]);
    for (const node of byId("markers").querySelectorAll(".marker")) {
      const [u, v] = this.place(Number(node.dataset.marker)) || [0, 0];
      const text = node.querySelector("text");
      const length = text.getComputedTextLength();
      const middle = this.view.onStage([u, v]);
      canvas.clearRect(0, 0, size, size);
      canvas.drawImage(slice, u + 0.5 - reach, v + 0.5 - reach, 2 * reach, 2 * reach, 0, 0, size, size);
      const { data } = canvas.getImageData(0, 0, size, size);
      const boxes = LABEL_PLACES.map((place) => boxOfLabel(place, length));
      const onStage = boxes.map((box) => box.map((edge, k) => edge - LABEL_REACH_PX + middle[k % 2]));
      const costs = boxes.map((box, k) => covered(data, size, box) + (isFree(onStage[k]) ? 0 : NO_PLACE));
      const best = costs.indexOf(Math.min(...costs));
      const [x, y, anchor] = LABEL_PLACES[best];
      taken.push(onStage[best]);
      for (const [name, value] of Object.entries({ x, y })) text.setAttribute(name, value);
      text.style.textAnchor = anchor;
    }
  }

  // The path of a residual's arrow, from the marker to where the fit puts it.
  arrow(marker, [u, v], scale) {
    if (!marker.used || !marker.residual_px) return "";
    const [du, dv] = marker.residual_px.map((x) => x * scale);
    const length = Math.hypot(du, dv);
    if (length < MIN_ARROW_PX) return "";
    const [along, across] = [du / length, dv / length];
    const head = Math.min(length / 2, 6 / Math.max(this.view.zoom, 0.3));
    const tip = [u + du, v + dv];
    const left = [tip[0] - head * (along + across / 2), tip[1] - head * (across - along / 2)];
    const right = [tip[0] - head * (along - across / 2), tip[1] - head * (across + along / 2)];
    return `M${u} ${v}L${tip}M${left}L${tip}L${right}`;
  }

  bound(state) {
    const words = [];
    if (state.tre95_m !== null) {
      words.push(`The curve lies within ${mm(state.tre95_m)} of its place (95\u00a0%). The residuals are ${mm(state.fre_rms_m)} rms.`);
    } else if (state.markers.length) {
      words.push(inPageWords(state.markers_why_not) || (state.curve_px.length ? "No bound can be told." : "The bound follows once there is a curve."));
    } else {
      words.push("No markers: the output is the curve alone, in pixels.");
    }
    const deepest = Math.max(0, ...state.markers.map((marker) => Math.abs(marker.depth_m)));
    if (deepest > FLAT_M) {
      words.push(`Markers lie up to ${mm(deepest)} off the slice and are shown where they project onto it.`);
    }
    const scale = arrowScale(state);
    if (scale > 1) words.push(`Arrows are residuals, ${scale} times enlarged.`);
    byId("bound").textContent = words.join(" ");
  }

  table(state) {
    if (this.isTyping()) {
      const field = document.activeElement;
      field.onblur = () => this.app.afterRelease(() => this.table(this.app.state));
      return;
    }
    const rows = [];
    state.markers.forEach((marker, k) => {
      rows.push(this.row(marker, k));
      if (this.app.isSelected("marker", k) || !marker.target_m) rows.push(this.coordinates(marker));
    });
    byId("marker-table").hidden = rows.length === 0;
    refill(byId("marker-table").tBodies[0], rows);
  }

  // A text that is being typed is not overwritten: its table is made anew once it is left.
  isTyping() {
    const field = document.activeElement;
    if (!byId("marker-table").contains(field) || field.type !== "text") return false;
    return field.value !== field.defaultValue;
  }

  row(marker, k) {
    const step = (fields) => this.app.step({ marker: marker.label, ...fields });
    const isChosen = this.app.isSelected("marker", k);
    const use = make("input", {
      type: "checkbox",
      "aria-label": `Use marker ${marker.label}`,
      onchange: () => step({ do: "leave_out_marker", out: !use.checked }),
    });
    use.checked = marker.used;
    const name = make("input", {
      value: marker.label,
      "aria-label": `Label of marker ${marker.label}`,
      maxlength: 64,
      onfocus: () => {
        if (!isChosen) this.choose(k);
      },
      onchange: () => {
        name.defaultValue = name.value;
        step({ do: "rename_marker", label: name.value });
      },
    });
    const remove = make(
      "button",
      {
        type: "button",
        "aria-label": `Delete marker ${marker.label}`,
        title: "Delete",
        onclick: () => step({ do: "delete_marker" }),
      },
      "✕",
    );
    let kind = "";
    if (isChosen) kind += "chosen";
    if (!marker.used) kind += " out";
    return make(
      "tr",
      { class: kind, "data-row": k },
      make("td", {}, use),
      make("td", {}, name),
      make("td", { class: "residual" }, mm(marker.residual_m)),
      make("td", { class: "loo" }, mm(marker.loo_m)),
      make("td", {}, remove),
    );
  }

  // Where the marker is in front of the robot.
  coordinates(marker) {
    const inputs = ["x", "y", "z"].map((axis, k) =>
      make("input", {
        value: marker.target_m ? fixed(1e3 * marker.target_m[k], 3) : "",
        placeholder: axis,
        "aria-label": `${axis} of marker ${marker.label} in millimetres`,
        inputmode: "decimal",
      }),
    );
    const take = () => {
      for (const input of inputs) input.defaultValue = input.value;
      const texts = inputs.map((input) => input.value.trim().replace(",", "."));
      const target_m = texts.map((text) => Number(text) / 1e3);
      if (texts.every((text) => text) && target_m.every(Number.isFinite)) {
        this.app.step({ do: "move_marker", marker: marker.label, target_m });
      }
    };
    for (const input of inputs) input.addEventListener("change", take);
    const cell = make("td", { colspan: 5 }, "robot [mm] ", ...inputs);
    return make("tr", { class: "chosen coordinates" }, cell);
  }

  // Select a marker and leave the keyboard in its row.
  choose(k) {
    this.app.select({ kind: "marker", key: k }, true);
  }

  select() {
    for (const node of byId("markers").querySelectorAll(".marker")) {
      node.classList.toggle("chosen", this.app.isSelected("marker", Number(node.dataset.marker)));
    }
    this.raise();
    if (this.app.state) this.table(this.app.state);
  }

  // The selected marker lies over another on the same mark, so that a drag takes it.
  raise() {
    const chosen = byId("markers").querySelector(".marker.chosen");
    if (chosen && chosen !== chosen.parentNode.lastChild) chosen.parentNode.append(chosen);
  }

  // While a marker is dragged, the session is asked what would follow.
  drag(key, to) {
    this.dragged = { key, to };
    const node = byId("markers").querySelector(`[data-marker="${key}"]`);
    node?.setAttribute("transform", translation(to));
    if (performance.now() - this.previewedAt < PREVIEW_PAUSE_MS) return;
    this.previewedAt = performance.now();
    this.app.send({ preview: { marker: this.label(key), to } });
  }

  // Show what would follow from the drag.
  preview(shown) {
    if (!this.dragged) return;
    const state = { ...this.app.state, ...shown };
    const scale = arrowScale(state);
    this.bound(state);
    shown.markers.forEach((marker, k) => {
      const row = byId("marker-table").querySelector(`tr[data-row="${k}"]`);
      if (row) {
        row.querySelector(".residual").textContent = mm(marker.residual_m);
        row.querySelector(".loo").textContent = mm(marker.loo_m);
      }
      const place = k === this.dragged.key ? this.dragged.to : marker.place_px;
      for (const arrow of byId("markers").querySelectorAll(`[data-arrow="${k}"]`)) {
        if (place) arrow.setAttribute("d", this.arrow(marker, place, scale));
      }
    });
  }

  forgetDrag() {
    this.dragged = null;
  }
}

// [left, top, right, bottom] of a label in the window around its marker.
function boxOfLabel([x, y, anchor], width) {
  const share = { start: 0, middle: 0.5, end: 1 }[anchor];
  const left = LABEL_REACH_PX + x - share * width;
  const foot = LABEL_REACH_PX + y + 3;
  return [left - 3, foot - LABEL_HEIGHT_PX - 3, left + width + 3, foot].map(Math.round);
}

// How much a box covers: the steps from each pixel to the next, which letters have and a ground has not.
function covered(data, size, [left, top, right, bottom]) {
  let sum = 0;
  for (let row = Math.max(top, 0); row < Math.min(bottom, size - 1); row += 1) {
    for (let column = Math.max(left, 0); column < Math.min(right, size - 1); column += 1) {
      const at = 4 * (row * size + column);
      for (let band = 0; band < 3; band += 1) {
        const [across, down] = [data[at + band] - data[at + 4 + band], data[at + band] - data[at + 4 * size + band]];
        sum += across * across + down * down;
      }
    }
  }
  return sum;
}

function mm(metres) {
  if (metres === null || metres === undefined) return "–";
  return `${(1e3 * metres).toFixed(2)} mm`;
}

// Residuals are far shorter than a pixel on the screen: they are drawn enlarged, and it is said. A
// marker that is left out has none, as on the sheet: it would dwarf the others.
function arrowScale(state) {
  let longest = 0;
  for (const marker of state.markers) {
    if (marker.used && marker.residual_px) longest = Math.max(longest, Math.hypot(...marker.residual_px));
  }
  if (longest === 0) return 1;
  const wanted = Math.max(state.image.width_px, 300) / 10 / longest;
  return ARROW_SCALES.findLast((scale) => scale <= wanted) || 1;
}
