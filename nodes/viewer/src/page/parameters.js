// The parameters of all nodes, in groups, with what their nodes say of them.

import { byId, make, offer, write } from "./dom.js";
import { nodesInOrder, sensorOf, shortName } from "./state.js";

const FIRST = ["alpha", "psf_sigma", "method", "score_threshold"]; // what is changed most
const USEFUL = { alpha: 16, psf_sigma: 3 }; // the ends of sliders, where the field takes more
const MOST_USED = "Most used";
const SENSOR = "Sensor";
const QOS = "Quality of service";
const OPEN_NODES = 3; // a camera, unwrap and a detector
// A slider of a wider range would skip most values.
const SLIDER_SPAN = 1000;

export class Parameters {
  constructor(actions) {
    this.actions = actions;
    this.nodes = new Map(); // node -> { element, groups, fields }
    byId("search").oninput = (event) => actions.choose({ search: event.target.value });
  }

  draw(state) {
    const nodes = nodesInOrder(state).filter((node) => state.graph.nodes.includes(node) && state.parameters.has(node));
    const shape = JSON.stringify(nodes.map((node) => [node, state.parameters.get(node).map(({ name }) => name)]));
    if (this.shape !== shape) this.build(state, nodes, shape);
    for (const node of nodes) {
      for (const parameter of state.parameters.get(node))
        this.nodes
          .get(node)
          .fields.get(parameter.name)
          ?.show(parameter, state.refusals.get(`${node} ${parameter.name}`) ?? "");
    }
    this.filter(state, nodes);
  }

  build(state, nodes, shape) {
    this.shape = shape;
    this.nodes = new Map(nodes.map((node, index) => [node, this.buildNode(state, node, index < OPEN_NODES)]));
    byId("parameter-list").replaceChildren(...nodes.map((node) => this.nodes.get(node).element));
    this.searched = null;
  }

  buildNode(state, node, open) {
    const fields = new Map();
    const groups = new Map([MOST_USED, shortName(node), SENSOR, QOS].map((group) => [group, []]));
    for (const parameter of state.parameters.get(node)) {
      const field = new Field(node, parameter, this.actions);
      fields.set(parameter.name, field);
      const group = groupOf(parameter.name, node, sensorOf(state, node));
      groups.get(group).push(field);
    }
    const elements = [...groups].filter(([, all]) => all.length).map(([group, all]) => {
      const details = make(
        "details",
        { className: "group", open: group === MOST_USED },
        make("summary", { textContent: `${group} (${all.length})` }),
        make("div", { className: "fields" }, ...all.map(({ element }) => element)),
      );
      return { details, all, open: group === MOST_USED };
    });
    const element = make(
      "details",
      { className: "node", open },
      make("summary", { textContent: node }),
      ...elements.map(({ details }) => details),
    );
    return { element, groups: elements, fields, open };
  }

  // A search opens what it finds; without one, the user's folds stay.
  filter({ choice, parameters }, nodes) {
    if (this.searched === choice.search) return;
    const before = this.searched;
    this.searched = choice.search;
    const words = choice.search
      .toLowerCase()
      .split(/\s+/)
      .filter((word) => word);
    for (const node of nodes) {
      const { element, groups, fields, open } = this.nodes.get(node);
      const found = new Set(
        parameters
          .get(node)
          .filter(({ name, description }) => words.every((word) => `${node} ${name} ${description}`.toLowerCase().includes(word)))
          .map(({ name }) => fields.get(name)),
      );
      for (const group of groups) {
        group.all.forEach((field) => {
          field.element.hidden = !found.has(field);
        });
        const some = group.all.some((field) => found.has(field));
        group.details.hidden = !some;
        if (words.length) group.details.open = some;
        else if (before) group.details.open = group.open;
      }
      element.hidden = found.size === 0;
      if (words.length) element.open = true;
      else if (before) element.open = open;
    }
  }
}

function groupOf(name, node, sensor) {
  if (FIRST.includes(name)) return MOST_USED;
  if (name.startsWith("qos_overrides.")) return QOS;
  return name in sensor ? SENSOR : shortName(node);
}

// A value in the words of the page: both spellings of booleans and both quotes are the same.
const plain = (text) => {
  const bare = String(text).replace(/^(['"])(.*)\1$/, "$2");
  return /^(true|false)$/i.test(bare)
    ? bare.toLowerCase()
    : Number.isFinite(Number(bare)) && bare !== ""
      ? String(Number(bare))
      : bare;
};

let fieldCount = 0;

// One parameter: its control, its description, and the sentence with which the node has refused a value.
class Field {
  constructor(node, parameter, actions) {
    const { name, description, range, words, type, read_only: fixed } = parameter;
    const id = `parameter-${(fieldCount += 1)}`;
    const set = (value) => actions.set(node, name, value);
    this.control = controlOf(parameter, set);
    Object.assign(this.control, { id, disabled: fixed });
    this.control.setAttribute("aria-describedby", `${id}-text`);
    const most = Math.min(range?.[1], USEFUL[name] ?? Infinity);
    const slides = range && !fixed && !words.length && most - range[0] <= SLIDER_SPAN && (type === "double" || type === "integer");
    this.slider = slides
      ? make("input", { type: "range", min: range[0], max: most, step: type === "integer" ? 1 : "any" })
      : null;
    if (this.slider) {
      this.slider.setAttribute("aria-label", `${name}, slider`);
      this.slider.oninput = () => {
        this.control.value = shortened(this.slider.value);
      };
      this.slider.onchange = () => set(shortened(this.slider.value));
    }
    this.reset = make("button", { type: "button", className: "reset", hidden: true });
    this.reset.onclick = () => set(this.fallback);
    this.refusal = make("p", { className: "refused", role: "alert" });
    const limits = range ? ` From ${range[0]} to ${range[1]}.` : "";
    const about = make("p", { id: `${id}-text`, className: "quiet", textContent: `${description}${limits}` });
    const head = make("label", { htmlFor: id, textContent: name });
    if (fixed) head.append(make("span", { className: "fixed", textContent: "fixed" }));
    this.element = make(
      "div",
      { className: fixed ? "field read-only" : "field" },
      head,
      make("div", { className: "values" }, ...[this.slider, this.control, this.reset].filter((part) => part)),
      about,
      this.refusal,
    );
  }

  show({ value, words, default: fallback, read_only: fixed }, refusal) {
    const state = JSON.stringify([value, words, refusal]);
    if (this.state === state) return;
    this.state = state;
    this.fallback = fallback;
    if (this.control.type === "checkbox") this.control.checked = plain(value) === "true";
    else if (words.length) offer(this.control, words, value);
    else if (document.activeElement !== this.control || refusal) this.control.value = value;
    if (this.slider) this.slider.value = value;
    this.reset.hidden = fixed || fallback === null || plain(fallback) === plain(value);
    write(this.reset, `Reset to ${plain(fallback ?? "") || "nothing"}`);
    write(this.refusal, refusal);
  }
}

const shortened = (text) => String(Number(Number(text).toPrecision(4)));

function controlOf({ type, words }, set) {
  if (type === "boolean") return make("input", { type: "checkbox", onchange: (event) => set(String(event.target.checked)) });
  // The list shows what the node has, which a refusal leaves as it was: it gives up the focus.
  const changed = (event) => {
    set(event.target.value);
    event.target.blur();
  };
  return words.length
    ? make("select", { onchange: changed })
    : make("input", { type: "text", onchange: (event) => set(event.target.value) });
}
