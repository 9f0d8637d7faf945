// Elements of the page. Whatever comes from files becomes text, never markup.

const SVG = "http://www.w3.org/2000/svg";

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export const element = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);
export const shape = (tag, attributes = {}, ...children) => filled(document.createElementNS(SVG, tag), attributes, children);
export const byId = (id) => document.getElementById(id);

export const minus = (text) => text.replace("-", "−");

// Multiples of 1, 2 or 5 times a power of ten within [low, high], at most so many intervals, with labels.
export function marks(low, high, intervals) {
  const power = 10 ** Math.floor(Math.log10((high - low) / intervals));
  const step = [1, 2, 5, 10].map((nice) => nice * power).find((width) => (high - low) / width <= intervals);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const values = [];
  for (let number = Math.ceil(low / step - 1e-9); number * step <= high + 1e-9 * step; number += 1) values.push(number * step);
  return values.map((value) => [value, minus(value.toFixed(digits))]);
}

// An SVG path that breaks where a value is missing.
export function trace(xs, ys) {
  let path = "";
  let isDown = false;
  for (let row = 0; row < xs.length; row += 1) {
    if (xs[row] === null || ys[row] === null) isDown = false;
    else {
      path += `${isDown ? "L" : "M"}${xs[row].toFixed(1)} ${ys[row].toFixed(1)}`;
      isDown = true;
    }
  }
  return path;
}

export const iso = (ms) => new Date(ms).toISOString();
export const clock = (ms) => iso(ms).slice(11, 21);
export const seconds = (ms) => minus((ms / 1000).toFixed(1));
export const signed = (ms) => `${ms < 0 ? "−" : "+"}${(Math.abs(ms) / 1000).toFixed(1)} s`;

// Index of the last of ascending times that is not after a time, −1 before the first.
export function placeOf(times, time) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}
