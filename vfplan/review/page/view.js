// Where the slice lies on the screen: zoom, pan, and from a pointer to a place on the slice.
import { byId, make } from "./dom.js";
import { Greys } from "./greys.js";

const BORDER_PX = 300; // as in review.css
const NICE = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

export class View {
  constructor(app) {
    this.app = app;
    this.stage = byId("stage");
    this.zoom = 1;
    this.x = 0;
    this.y = 0;
    this.settled = []; // called once the view rests
    this.stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.apply()).observe(this.stage);
    byId("fit").addEventListener("click", () => this.fit());
    byId("one").addEventListener("click", () => this.setZoom(1 / devicePixelRatio));
    this.stage.addEventListener("pointermove", (event) => this.tellPlace(this.place(event)));
  }

  render(state, first) {
    this.image = state.image;
    this.mmPerPx = state.mm_per_px;
    byId("title").textContent = `Review of ${state.image.name}`;
    if (first) {
      this.greys = new Greys(this.app, state.image.grey_max);
      document.title = `Review of ${state.image.name}`;
      this.letters(state.image.sides);
      this.fit();
    }
    this.scaleBar();
  }

  letters(sides) {
    const where = { left: "left:0;top:50%", right: "right:0;top:50%", top: "left:50%;top:0", bottom: "left:50%;bottom:0" };
    const nodes = Object.entries(sides || {}).map(([side, letter]) => make("span", { style: where[side] }, letter));
    byId("letters").replaceChildren(...nodes);
  }

  // From the screen to the slice: (0, 0) is the middle of the first pixel.
  place(event) {
    const box = this.stage.getBoundingClientRect();
    return [(event.clientX - box.left - this.x) / this.zoom, (event.clientY - box.top - this.y) / this.zoom];
  }

  // Copies of half and a quarter of the size, and so on: to draw 16 million pixels small is slow.
  shrink() {
    const slice = byId("slice");
    let from = slice;
    let [width, height] = [slice.naturalWidth, slice.naturalHeight];
    document.querySelectorAll("canvas.copy").forEach((copy) => copy.remove());
    this.copies = [slice];
    while (Math.max(width, height) > 1200) {
      [width, height] = [Math.ceil(width / 2), Math.ceil(height / 2)];
      const copy = make("canvas", { class: "copy", width, height });
      copy.getContext("2d").drawImage(from, 0, 0, width, height);
      slice.after(copy);
      this.copies.push(copy);
      from = copy;
    }
    this.apply();
  }

  placeSlice() {
    const copies = this.copies || [byId("slice")];
    const level = Math.min(copies.length - 1, Math.max(0, Math.floor(Math.log2(1 / (this.zoom * devicePixelRatio)))));
    copies.forEach((copy, k) => { copy.style.display = k === level ? "block" : "none"; });
    const shown = copies[level];
    const scale = (this.zoom * byId("slice").naturalWidth) / (shown.naturalWidth || shown.width) || this.zoom;
    shown.style.transform = `translate(${this.x - this.zoom / 2}px, ${this.y - this.zoom / 2}px) scale(${scale})`;
  }

  // What is drawn over the slice reaches beyond the stage: a pan shifts it as a picture, and it is
  // drawn anew once the view rests, or the shift leaves its border.
  placeDrawing(rests = false) {
    const base = this.base;
    const [dx, dy] = base ? [this.x - base.x, this.y - base.y] : [0, 0];
    if (base && !rests && base.zoom === this.zoom && Math.max(Math.abs(dx), Math.abs(dy)) < BORDER_PX) {
      byId("over").style.transform = `translate(${dx}px, ${dy}px)`;
      return;
    }
    this.base = { x: this.x, y: this.y, zoom: this.zoom };
    byId("over").style.transform = "";
    byId("world").setAttribute("transform", `matrix(${this.zoom} 0 0 ${this.zoom} ${this.x + BORDER_PX} ${this.y + BORDER_PX})`);
  }

  apply() {
    this.placeSlice();
    this.placeDrawing();
    if (this.unit !== 1 / this.zoom) {
      this.unit = 1 / this.zoom;
      byId("world").style.setProperty("--unit", this.unit);
      byId("slice").classList.toggle("near", this.zoom * devicePixelRatio >= 3);
      this.scaleBar();
      this.zoomed?.();
    }
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.placeDrawing(true);
      this.settled.forEach((call) => call());
    }, 250);
  }

  size() { return [this.stage.clientWidth, this.stage.clientHeight]; }

  fit() {
    if (!this.image) return;
    const [width, height] = this.size();
    this.zoom = Math.min(width / this.image.width_px, height / this.image.height_px) * 0.98;
    this.x = (width - (this.image.width_px - 1) * this.zoom) / 2;
    this.y = (height - (this.image.height_px - 1) * this.zoom) / 2;
    this.apply();
  }

  setZoom(zoom, about) {
    const [width, height] = this.size();
    const [x, y] = about || [width / 2, height / 2];
    const next = Math.min(64, Math.max(0.02, zoom));
    this.x = x - ((x - this.x) * next) / this.zoom;
    this.y = y - ((y - this.y) * next) / this.zoom;
    this.zoom = next;
    this.apply();
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
    this.apply();
  }

  goTo([u, v], zoom = Math.max(this.zoom, 3)) {
    const [width, height] = this.size();
    this.zoom = zoom;
    this.x = width / 2 - u * zoom;
    this.y = height / 2 - v * zoom;
    this.apply();
  }

  wheel(event) {
    event.preventDefault();
    const box = this.stage.getBoundingClientRect();
    const rate = event.ctrlKey ? 0.01 : 0.0016; // a pinch on a pad comes as small steps with Ctrl
    const lines = event.deltaMode === 1 ? 30 : 1;
    this.setZoom(this.zoom * Math.exp(-event.deltaY * lines * rate), [event.clientX - box.left, event.clientY - box.top]);
  }

  isIn([u, v]) {
    const [width, height] = this.size();
    const x = u * this.zoom + this.x;
    const y = v * this.zoom + this.y;
    return x >= 0 && y >= 0 && x <= width && y <= height;
  }

  tellPlace([u, v]) {
    if (!this.image || u < -0.5 || v < -0.5 || u > this.image.width_px - 0.5 || v > this.image.height_px - 0.5) return;
    const spacing = this.image.pixel_spacing_mm;
    const mm = spacing ? `  |  ${(u * spacing[0]).toFixed(1)}, ${(v * spacing[1]).toFixed(1)} mm` : "";
    byId("place").textContent = `u ${u.toFixed(1)}  v ${v.toFixed(1)} px${mm}`;
  }

  scaleBar() {
    const unit = this.mmPerPx || 1;
    const length = NICE.findLast((size) => (size / unit) * this.zoom <= 160) || 1;
    byId("bar").style.width = `${(length / unit) * this.zoom}px`;
    byId("bar-text").textContent = `${length} ${this.mmPerPx ? "mm" : "px"}`;
  }
}
