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

// Options of the command line for which the page has a control, and what stands on it. A label in a
// sentence is quoted.
const CONTROLS = {
  "contact-radius": "“Keep a distance of”",
  exclude: "“Exclude”",
  "find-markers": "“Find marks”",
  model: "“From slice to robot”",
  "pixel-spacing": "“A pixel is”",
  robust: "its box in the table",
  "seen-from": "“The slice is seen from”",
};
// The same with what the plan says.
const NAMES = { ...CONTROLS, "max-residual": "the plan", "max-tre": "the plan" };
// An option, with what stands for its value in capitals.
const OPTION = /--([a-z][a-z-]*)(?: [A-Z_]{2,}(?:,[A-Z_]+)*\b)?/g;
const MODEL = /\b(affine|similarity|rigid)\b/g;

// Advice within a sentence that names an option: in brackets, or after ", or".
const ADVICE = / \([^()]*--[^()]*\)|, or [^,.;]*--[^,.;]*/g;

// A text of the program in the words of the page. What `vfplan review` and `vfplan rectify` do, the
// page does. Advice to use an option for which it has no control is left out, be it a sentence or a
// part of one; any other command stays as it is.
export function inPageWords(text) {
  const plain = text.replaceAll(" with vfplan rectify", "");
  const ofPage = plain.replace(ADVICE, (advice) => (isOfPage(advice, CONTROLS) ? advice : ""));
  const sentences = ofPage.split(/(?<=\.) /).filter((words, k) => k === 0 || isOfPage(words, NAMES));
  return sentences.map((words) => (isCommand(words) ? words : withNames(words))).join(" ");
}

// A sentence with the page's names of options and of the values of --model.
function withNames(words) {
  const named = words.replace(OPTION, nameOf).replace(/\bGive (“[^”]*”)(?= if|\.)/g, "Fill in $1");
  if (!words.includes("--model")) return named;
  return named.replace(MODEL, (value) => byId("plan-model").querySelector(`[value=${value}]`).textContent);
}

function isCommand(words) {
  return words.includes("vfplan ");
}

function isOfPage(words, names) {
  if (words.includes("vfplan review")) return false;
  return isCommand(words) || [...words.matchAll(OPTION)].every(([, name]) => name in names);
}

function nameOf(_, option, at) {
  const name = NAMES[option] || option.replaceAll("-", " ");
  return at === 0 ? name[0].toUpperCase() + name.slice(1) : name;
}

// Put new elements in place of a holder's. Whoever stood on a control with the keyboard then stands
// on the control of the same name, or of the same place if its name has changed.
export function refill(holder, nodes) {
  const controlsOf = () => [...holder.querySelectorAll("button, input")];
  const wordsOf = (node) => node.getAttribute("aria-label") || node.textContent;
  const place = controlsOf().indexOf(document.activeElement);
  const name = place >= 0 ? wordsOf(document.activeElement) : "";
  holder.replaceChildren(...nodes);
  if (place < 0) return;
  const controls = controlsOf();
  const control = controls.find((node) => wordsOf(node) === name) || controls[place];
  control?.focus({ preventScroll: true });
}
