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
