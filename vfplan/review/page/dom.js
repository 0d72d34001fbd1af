// The page's elements: found by their id, or made.
const SVG = "http://www.w3.org/2000/svg";
const SVG_NAMES = ["g", "path", "polyline", "polygon", "circle", "text", "rect"];

export const byId = (id) => document.getElementById(id);

// An element with attributes and children. An attribute that begins with "on" is a listener; true
// stands for an attribute without a value, and false or null for none.
export function make(name, attributes = {}, ...children) {
  let node;
  if (SVG_NAMES.includes(name)) node = document.createElementNS(SVG, name);
  else node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
}

export function translation([u, v]) {
  return `translate(${u} ${v})`;
}

// A group at a place of the slice whose children have their size in pixels of the screen.
export function makeAt(place, attributes, ...children) {
  const body = make("g", { class: "fixed" }, ...children);
  return make("g", { ...attributes, transform: translation(place) }, body);
}

// A number with so many decimals; one that rounds to 0 has no sign.
export function fixed(number, decimals) {
  return (Number(number.toFixed(decimals)) + 0).toFixed(decimals);
}

// Options of the command line, as the page calls what they do.
const PAGE_WORDS = {
  "find-markers": "Find marks",
  "max-residual": "the plan",
  "max-tre": "the plan",
  robust: "its box in the table",
};

// A text of the program in the words of the page.
export function inPageWords(text) {
  const plain = text.replace(/, or give --markers-as-given| with vfplan rectify| \(delete its row, and give --common\)/g, "");
  return plain.replace(/--([a-z][a-z-]*)/g, (_, name) => PAGE_WORDS[name] || name.replaceAll("-", " "));
}

// Put new elements in place of a holder's. Whoever stood on a control with the keyboard then stands
// on the control of the same name, or of the same place if its name has changed.
export function refill(holder, nodes) {
  const controlsOf = () => [...holder.querySelectorAll("button, input")];
  const nameOf = (node) => node.getAttribute("aria-label") || node.textContent;
  const place = controlsOf().indexOf(document.activeElement);
  const name = place >= 0 ? nameOf(document.activeElement) : "";
  holder.replaceChildren(...nodes);
  if (place < 0) return;
  const controls = controlsOf();
  const control = controls.find((node) => nameOf(node) === name) || controls[place];
  control?.focus({ preventScroll: true });
}
