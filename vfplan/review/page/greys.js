// Window and level: which grey of the slice is black and which is white on the screen. The server
// draws the slice between these two greys, so that a slice of 16 bits keeps its depth.
import { byId } from "./dom.js";

const REST_MS = 120; // a slider that moves asks for one picture once it rests

export class Greys {
  constructor(app, image) {
    this.app = app;
    this.greyMax = image.grey_max;
    this.range = this.rangeOf(image);
    this.low = byId("low");
    this.high = byId("high");
    this.low.max = this.greyMax - 1;
    this.high.max = this.greyMax;
    this.reset();
    this.low.addEventListener("input", () => this.changed(this.low));
    this.high.addEventListener("input", () => this.changed(this.high));
    byId("bone").addEventListener("click", () => this.window(500, 2000));
    byId("soft").addEventListener("click", () => this.window(40, 400));
    byId("greys").addEventListener("click", () => {
      this.reset();
      this.load();
    });
  }

  // A window of a CT, by its middle and width [HU], as far as the picture holds it.
  window(middle, width) {
    this.wanted = [middle - width / 2, middle + width / 2];
    this.show();
    this.loadSoon();
  }

  // Put the sliders where the wanted values are, as far as this slice holds them.
  show() {
    const [black, white] = this.range;
    const greys = this.wanted.map((value) => Math.round((this.greyMax * (value - black)) / (white - black || 1)));
    this.low.value = Math.min(...greys);
    this.high.value = Math.max(...greys, Number(this.low.value) + 1);
  }

  // The value of the slice where a slider stands: Hounsfield units in a CT.
  valueAt(slider) {
    const [black, white] = this.range;
    return black + ((white - black) * slider.value) / this.greyMax;
  }

  // Another slice: the wanted values stay, though a slice may not hold them; all greys stay all.
  turn() {
    this.range = this.rangeOf(this.app.state.image);
    if (this.wanted) this.show();
    this.showNumbers();
    this.load();
  }

  // The values of the slice at the first and the last grey.
  rangeOf(image) {
    return image.grey_range ?? [0, this.greyMax];
  }

  // A drag with the right button: to the right for a wider window, down for a brighter slice.
  drag(dx, dy) {
    const share = this.greyMax / 400;
    const width = Math.max(this.high.value - this.low.value + dx * share, share);
    const middle = (Number(this.low.value) + Number(this.high.value)) / 2 - dy * share;
    this.low.value = middle - width / 2;
    this.high.value = middle + width / 2;
    this.changed(this.low);
  }

  reset() {
    this.wanted = null;
    this.low.value = 0;
    this.high.value = this.greyMax;
    this.showNumbers();
  }

  // Black stays below white: the slider that moves pushes the other one.
  changed(slider) {
    if (Number(this.low.value) >= Number(this.high.value)) {
      if (slider === this.low) {
        this.high.value = Number(this.low.value) + 1;
      } else {
        this.low.value = Number(this.high.value) - 1;
      }
    }
    this.wanted = [this.low, this.high].map((one) => this.valueAt(one));
    if (Number(this.low.value) === 0 && Number(this.high.value) === this.greyMax) this.wanted = null;
    this.loadSoon();
  }

  loadSoon() {
    this.showNumbers();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load(), REST_MS);
  }

  showNumbers() {
    for (const slider of [this.low, this.high]) {
      const value = Math.round(this.valueAt(slider));
      byId(`${slider.id}-text`).textContent = value;
      slider.setAttribute("aria-valuetext", value);
    }
  }

  load() {
    const token = encodeURIComponent(this.app.token);
    const version = this.app.version; // a picture that was made flat is another picture
    byId("slice").src = `slice.png?token=${token}&low=${this.low.value}&high=${this.high.value}&version=${version}`;
  }
}
