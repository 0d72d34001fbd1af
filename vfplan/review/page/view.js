// Where the slice lies on the screen: zoom, pan, and from a pointer to a place on the slice.
import { byId, fixed, make } from "./dom.js";
import { Greys } from "./greys.js";

const BORDER_PX = 300; // as in review.css: how far the drawing reaches beyond the stage
const REST_MS = 250; // a view that does not change for so long is at rest
const [MIN_ZOOM, MAX_ZOOM] = [0.02, 64];
const GO_TO_ZOOM = 3;
const INK_ZOOM = 3; // below it what is drawn is as broad as the ink, and is drawn thin
const MAX_COPY_PX = 1200;
const MAX_BAR_PX = 160;
const BAR_LENGTHS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
// From upright on, to the one side and to the other.
const SIGN_ANGLES = [0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, Math.PI];
const LETTER_PLACES = {
  left: "left:0;top:50%",
  right: "right:0;top:50%",
  top: "left:50%;top:0",
  bottom: "left:50%;bottom:0",
};

// The slices of a folder or a file, among which one is chosen before the curve is drawn.
class Stack {
  constructor(app) {
    this.app = app;
    this.series = [];
    byId("stack").addEventListener("input", () => this.wish(this.first + Number(byId("stack").value)));
    byId("series").addEventListener("change", () => {
      const first = this.series.indexOf(byId("series").value);
      this.wish(first + Math.floor(this.count(byId("series").value) / 2));
    });
  }

  count(name) {
    return this.series.filter((one) => one === name).length;
  }

  render({ series, position }) {
    this.series = series;
    byId("stack-card").hidden = series.length < 2;
    if (series.length < 2) return;
    this.position = position;
    const name = series[position];
    this.first = series.indexOf(name);
    const names = [...new Set(series)];
    byId("series").hidden = names.length < 2;
    byId("series").replaceChildren(...names.map((one) => make("option", { selected: one === name }, one)));
    byId("stack").max = this.count(name) - 1;
    byId("stack").value = position - this.first;
    byId("stack-count").textContent = `${position - this.first + 1} of ${this.count(name)}`;
  }

  // The next slice of the series, or the one before; whether there are slices to turn.
  turn(by) {
    if (this.series.length < 2) return false;
    const last = this.first + this.count(this.series[this.first]) - 1;
    this.wish(Math.min(Math.max((this.wanted ?? this.position) + by, this.first), last));
    return true;
  }

  // Slices that are passed on the way are not read: the last one is, once the hand rests.
  wish(slice) {
    this.wanted = slice;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.wanted = undefined;
      if (slice !== this.position) this.app.step({ do: "choose_slice", slice });
    }, REST_MS);
  }
}

export class View {
  constructor(app) {
    this.app = app;
    this.stage = byId("stage");
    this.zoom = 1; // pixels of the window a pixel of the slice
    this.x = 0; // where the slice's (0, 0) lies on the stage
    this.y = 0;
    this.isChosen = true; // but not by the name's bearer if it is what another one left
    this.isFitted = false; // whether all of the slice is shown, however large the window is
    this.settled = []; // called once the view rests
    this.zoomed = null; // called with each new zoom
    this.stack = new Stack(app);
    this.stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.stage.addEventListener("pointermove", (event) => this.tellPlace(this.place(event)));
    new ResizeObserver(() => (this.isFitted ? this.fitAgain() : this.apply())).observe(this.stage);
    byId("fit").addEventListener("click", () => this.fit());
    byId("one").addEventListener("click", () => this.setZoom(1 / devicePixelRatio));
  }

  render(state, isFirst) {
    const isTurned = this.image && this.image.position !== state.image.position;
    const isOther = this.image && this.image.is_flat !== state.image.is_flat;
    this.image = state.image;
    const [along, down] = state.image.pixel_spacing_mm ?? [0, 0];
    this.mmPerPx = state.mm_per_px ?? Math.sqrt(along * down); // by the markers, else by the file
    byId("title").textContent = `Review of ${state.image.in_words || state.image.name}`;
    document.title = byId("title").title = byId("title").textContent;
    if (isFirst) {
      this.greys = new Greys(this.app, state.image);
      this.showLetters(state.image.sides);
      this.fitAgain();
    }
    if (isOther || isTurned) this.greys.turn();
    if (isOther) this.fitAgain();
    for (const id of ["bone", "soft"]) byId(id).hidden = !state.image.grey_range;
    this.stack.render(state.image);
    this.showScaleBar();
  }

  // Which side of the patient each side of the slice is.
  showLetters(sides) {
    const nodes = [];
    for (const [side, letter] of Object.entries(sides || {})) {
      nodes.push(make("span", { style: LETTER_PLACES[side] }, letter));
    }
    byId("letters").replaceChildren(...nodes);
  }

  // From the screen to the slice, whose (0, 0) is the middle of the first pixel, and back.
  place(event) {
    const box = this.stage.getBoundingClientRect();
    return this.onSlice([event.clientX - box.left, event.clientY - box.top]);
  }

  onSlice([x, y]) {
    return [(x - this.x) / this.zoom, (y - this.y) / this.zoom];
  }

  onStage([u, v]) {
    return [u * this.zoom + this.x, v * this.zoom + this.y];
  }

  isIn(place, border = 0) {
    const [width, height] = this.size();
    const [x, y] = this.onStage(place);
    return x >= border && y >= border && x <= width - border && y <= height - border;
  }

  // The way [x, y] on the screen, so far from a place, to where a sign stands on the stage and off
  // those that were placed before it; it counts as placed from then on.
  freeWay(place, reach, placed, radius) {
    const [x, y] = this.onStage(place);
    let best = null;
    for (const angle of SIGN_ANGLES) {
      const way = [reach * Math.sin(angle), -reach * Math.cos(angle)];
      const at = [x + way[0], y + way[1]];
      const near = placed.map((other) => Math.hypot(at[0] - other[0], at[1] - other[1]));
      const cost = near.filter((distance) => distance < 2 * radius).length + !this.isIn(this.onSlice(at), radius);
      if (best === null || cost < best.cost) best = { cost, way, at };
    }
    placed.push(best.at);
    return best.way;
  }

  // The nearest place on the slice.
  clamp([u, v]) {
    const right = this.image.width_px - 0.5;
    const bottom = this.image.height_px - 0.5;
    return [Math.min(Math.max(u, -0.5), right), Math.min(Math.max(v, -0.5), bottom)];
  }

  size() {
    return [this.stage.clientWidth, this.stage.clientHeight];
  }

  // Copies of half and a quarter of the size, and so on: to draw 16 million pixels small is slow.
  makeCopies() {
    const slice = byId("slice");
    let [width, height] = [slice.naturalWidth, slice.naturalHeight];
    for (const copy of document.querySelectorAll("canvas.copy")) copy.remove();
    this.copies = [slice];
    while (Math.max(width, height) > MAX_COPY_PX) {
      [width, height] = [Math.ceil(width / 2), Math.ceil(height / 2)];
      const copy = make("canvas", { class: "copy", width, height });
      copy.getContext("2d").drawImage(this.copies[this.copies.length - 1], 0, 0, width, height);
      slice.after(copy);
      this.copies.push(copy);
    }
    this.apply();
  }

  placeSlice() {
    const slice = byId("slice");
    const copies = this.copies || [slice];
    const halvings = Math.floor(Math.log2(1 / (this.zoom * devicePixelRatio)));
    const shown = copies[Math.min(Math.max(halvings, 0), copies.length - 1)];
    for (const copy of copies) copy.style.display = copy === shown ? "block" : "none";
    const width = shown === slice ? slice.naturalWidth : shown.width;
    const scale = (this.zoom * slice.naturalWidth) / width || this.zoom;
    const [x, y] = this.onStage([-0.5, -0.5]);
    shown.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
    slice.classList.toggle("near", this.zoom * devicePixelRatio >= 3);
  }

  // What is drawn over the slice reaches beyond the stage: a pan shifts it as a picture, and it is
  // drawn anew once the view rests, or the shift leaves its border.
  placeDrawing(isAtRest = false) {
    const base = this.base;
    if (base && !isAtRest && base.zoom === this.zoom) {
      const [dx, dy] = [this.x - base.x, this.y - base.y];
      if (Math.max(Math.abs(dx), Math.abs(dy)) < BORDER_PX) {
        byId("over").style.transform = `translate(${dx}px, ${dy}px)`;
        return;
      }
    }
    this.base = { x: this.x, y: this.y, zoom: this.zoom };
    const matrix = [this.zoom, 0, 0, this.zoom, this.x + BORDER_PX, this.y + BORDER_PX];
    byId("over").style.transform = "";
    byId("world").setAttribute("transform", `matrix(${matrix.join(" ")})`);
  }

  apply() {
    this.placeSlice();
    this.placeDrawing();
    if (this.shownZoom !== this.zoom) {
      this.shownZoom = this.zoom;
      byId("world").style.setProperty("--unit", 1 / this.zoom);
      byId("world").classList.toggle("far", this.zoom < INK_ZOOM);
      this.showScaleBar();
      this.zoomed?.();
    }
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.placeDrawing(true);
      for (const call of this.settled) call();
    }, REST_MS);
  }

  // Show the whole slice.
  fit() {
    if (!this.image) return;
    this.isChosen = true;
    this.fitAgain();
  }

  // The same by the page, as when the window changes: nobody chose it.
  fitAgain() {
    const [width, height] = this.size();
    this.isFitted = true;
    this.zoom = Math.min(width / this.image.width_px, height / this.image.height_px) * 0.98;
    this.x = (width - (this.image.width_px - 1) * this.zoom) / 2;
    this.y = (height - (this.image.height_px - 1) * this.zoom) / 2;
    this.apply();
  }

  // Zoom, and leave what lies at a place of the stage where it is: its middle unless said.
  setZoom(zoom, about) {
    const [width, height] = this.size();
    const [x, y] = about || [width / 2, height / 2];
    const [u, v] = this.onSlice([x, y]);
    this.isChosen = true;
    this.isFitted = false;
    this.zoom = Math.min(MAX_ZOOM, Math.max(MIN_ZOOM, zoom));
    this.x = x - u * this.zoom;
    this.y = y - v * this.zoom;
    this.apply();
  }

  pan(dx, dy) {
    this.isChosen = true;
    this.isFitted = false;
    this.x += dx;
    this.y += dy;
    this.apply();
  }

  // Bring a place of the slice to the middle.
  goTo([u, v], zoom = Math.max(this.zoom, GO_TO_ZOOM)) {
    const [width, height] = this.size();
    this.isChosen = true;
    this.isFitted = false;
    this.zoom = zoom;
    this.x = width / 2 - u * zoom;
    this.y = height / 2 - v * zoom;
    this.apply();
  }

  wheel(event) {
    event.preventDefault();
    if (event.shiftKey && this.stack.turn(Math.sign(event.deltaY || event.deltaX))) return;
    const box = this.stage.getBoundingClientRect();
    const rate = event.ctrlKey ? 0.01 : 0.0016; // a pinch on a pad comes as small steps with Ctrl
    const turned = event.deltaMode === 1 ? 30 * event.deltaY : event.deltaY; // mode 1 counts lines
    const about = [event.clientX - box.left, event.clientY - box.top];
    this.setZoom(this.zoom * Math.exp(-turned * rate), about);
  }

  // Say which place of the slice is under the pointer.
  tellPlace([u, v]) {
    if (!this.image || u < -0.5 || v < -0.5) return;
    if (u > this.image.width_px - 0.5 || v > this.image.height_px - 0.5) return;
    const words = [`u ${fixed(u, 1)}  v ${fixed(v, 1)} px`];
    const spacing = this.image.pixel_spacing_mm;
    if (spacing) words.push(`${fixed(u * spacing[0], 1)}, ${fixed(v * spacing[1], 1)} mm`);
    byId("place").textContent = words.join("  =  ");
  }

  showScaleBar() {
    const pxPerUnit = this.zoom / (this.mmPerPx || 1);
    const length = BAR_LENGTHS.findLast((size) => size * pxPerUnit <= MAX_BAR_PX) || 1;
    byId("bar").style.width = `${length * pxPerUnit}px`;
    byId("bar-text").textContent = `${length} ${this.mmPerPx ? "mm" : "px"}`;
  }
}
