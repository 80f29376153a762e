// Elements of the page.

export const byId = (id) => document.getElementById(id);

export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

export function makeSvg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

// An unchanged text is left alone, so that a selection in it stays.
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function labelled(text, control, className = "control") {
  return make("label", { className }, make("span", { textContent: text }), control);
}

// The options of a list that the user has open are left alone.
export function offer(select, words, value) {
  const all = words.includes(value) ? words : [...words, value];
  const now = [...select.options].map((option) => option.value);
  if (document.activeElement !== select && now.join("\n") !== all.join("\n")) {
    select.replaceChildren(...all.map((word) => make("option", { value: word, textContent: word })));
  }
  if (document.activeElement !== select) select.value = value;
}

// A canvas with one sample for each pixel of the screen, and its context in px of the page.
export function fitted(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export const rounded = (value) =>
  Math.abs(value) >= 100 ? value.toFixed(0) : Math.abs(value) >= 10 ? value.toFixed(1) : value.toFixed(2);
