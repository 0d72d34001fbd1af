// The page's elements: found by their id, or made.
export const byId = (id) => document.getElementById(id);

export function make(name, attributes = {}, ...children) {
  const isSvg = ["g", "path", "polyline", "polygon", "circle", "text", "rect"].includes(name);
  const node = isSvg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
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
