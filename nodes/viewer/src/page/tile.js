// A tile: an image of the shown moment with its overlays and its caption. In a wiped tile, a second image lies over the right part.

import { filterOf, veilFilter } from "./curve.js";
import { make, write } from "./dom.js";
import { drawMarks, scoreOf } from "./marks.js";
import { EXPOSED_ANEW, frameOf, nameOf, namespaceOf, stampMs } from "./state.js";

export class Tile {
  constructor(actions) {
    this.layers = [this.layer(), this.layer()];
    this.veil = make("canvas", { className: "veil" });
    this.edge = make("div", { className: "edge" });
    this.none = make("p", { className: "none" });
    this.badge = make("p", { className: "badge" });
    this.picture = make(
      "div",
      { className: "picture", tabIndex: 0, role: "img" },
      ...this.layers.flatMap(({ image, marks }) => [image, marks]),
      this.veil,
      this.edge,
      this.none,
      this.badge,
    );
    this.title = make("strong");
    this.facts = make("span");
    this.figure = make("figure", {}, this.picture, make("figcaption", {}, this.title, this.facts));
    this.actions = actions;
    this.listen();
  }

  layer() {
    return { image: make("canvas", { className: "image" }), marks: make("canvas", { className: "marks" }), drawn: null };
  }

  listen() {
    const shareOf = (event) => {
      const area = this.picture.getBoundingClientRect();
      return [(event.clientX - area.left) / area.width, (event.clientY - area.top) / area.height];
    };
    const inImage = (share) => share.map((part, axis) => this.zoom.origin[axis] + part / this.zoom.scale);
    this.picture.onpointermove = (event) => {
      const share = shareOf(event);
      if (!event.buttons) this.actions.point(this.topics[0], inImage(share));
      else if (this.topics.length > 1) this.actions.wipe(share[0]);
      else if (this.grabbed && this.zoom.scale > 1) this.actions.zoom(1, this.grabbed, share);
    };
    this.picture.onpointerdown = (event) => {
      this.grabbed = inImage(shareOf(event));
      this.actions.point(this.topics[0], this.grabbed);
    };
    this.picture.onwheel = (event) => {
      // Without the key, the wheel moves the page.
      if (!event.ctrlKey) return;
      event.preventDefault();
      const share = shareOf(event);
      this.actions.zoom(2 ** (-event.deltaY / 200), inImage(share), share);
    };
    this.picture.onclick = () => this.actions.select(this.topics[0]);
    this.picture.onkeydown = (event) => {
      if (event.key === "Enter") this.actions.open(this.topics[0]);
    };
    this.picture.ondblclick = () => this.actions.open(this.topics[0]);
  }

  // Draws the images of `topics` (the second one, if there is one, right of the wipe), `width` px wide.
  draw(state, topics, width, small) {
    const { shown, choice } = state;
    [this.topics, this.zoom] = [topics, choice.zoom];
    const images = topics.map((topic) => shown?.moment.images.get(topic) ?? null);
    const [first] = images;
    const aspect = first ?? images[1] ?? state.newest.get(topics[0]);
    const size = [width, Math.round((width * (aspect?.height ?? 3)) / (aspect?.width ?? 10))];
    Object.assign(this.picture.style, { width: `${size[0]}px`, height: `${size[1]}px` });
    this.layers.forEach((layer, index) => this.drawLayer(layer, images[index] ?? null, state, size, small));
    this.drawVeil(state, first, size);
    const wiped = topics.length > 1;
    const right = `inset(0 0 0 ${choice.wipe}%)`;
    this.layers[1].marks.style.clipPath = right;
    // The image is larger than its tile: its own share lies at the wipe.
    const { scale, origin } = choice.zoom;
    this.layers[1].image.style.clipPath = `inset(0 0 0 ${100 * origin[0] + choice.wipe / scale}%)`;
    const place = `scale(${scale}) translate(${origin.map((share) => `${-100 * share}%`)})`;
    for (const canvas of [...this.layers.map(({ image }) => image), this.veil]) canvas.style.transform = place;
    this.picture.classList.toggle("zoomed", scale > 1);
    this.layers[0].marks.style.clipPath = wiped ? `inset(0 ${100 - choice.wipe}% 0 0)` : "none";
    this.edge.hidden = !wiped;
    this.edge.style.left = `${choice.wipe}%`;
    this.picture.dataset.stamps = images.map((image) => image?.key ?? "").join(" ");
    this.picture.dataset.answers = images.map((image) => image?.boxes.length ?? "").join(" ");
    this.figure.classList.toggle("selected", !small && choice.selected === topics[0]);
    this.describe(state, images, small);
  }

  drawLayer(layer, image, state, size, small) {
    const bitmap = image && state.shown.bitmaps.get(image);
    layer.image.hidden = layer.marks.hidden = !bitmap;
    if (!bitmap) return;
    if (layer.drawn !== image) {
      if (layer.image.width !== image.width || layer.image.height !== image.height)
        Object.assign(layer.image, { width: image.width, height: image.height });
      layer.image.getContext("2d").drawImage(bitmap, 0, 0);
    }
    // What the file was not exposed by.
    const exposure = state.choice.exposure - (image.exposure ?? 0);
    layer.image.style.filter = filterOf(image.peaks, { ...state.choice, exposure });
    // Marks are drawn anew only when something about them has changed.
    const { boxes, truth, score, zoom } = state.choice;
    const marks = `${size} ${small} ${boxes} ${truth} ${score} ${zoom.scale} ${zoom.origin} ${window.devicePixelRatio}`;
    if (layer.drawn !== image || layer.marksAre !== marks) drawMarks(layer.marks, image, size, state.choice, !small);
    Object.assign(layer, { drawn: image, marksAre: marks });
  }

  drawVeil(state, image, size) {
    const veil =
      state.choice.confidence && image ? state.shown.moment.images.get(`${namespaceOf(image.topic)}/confidence`) : null;
    const bitmap = veil && veil.topic !== image.topic ? state.shown.bitmaps.get(veil) : null;
    this.veil.hidden = !bitmap;
    if (!bitmap || this.veiled === veil) return;
    Object.assign(this.veil, { width: veil.width, height: veil.height });
    this.veil.getContext("2d").drawImage(bitmap, 0, 0);
    this.veil.style.filter = veilFilter();
    this.veiled = veil;
  }

  describe(state, images, small) {
    const names = this.topics.join(" | ");
    write(this.title, names);
    const missing = images[0] ? "" : missingText(state, this.topics[0]);
    write(this.none, missing);
    this.none.hidden = !missing;
    const { moment } = state.shown ?? {};
    const frame = (image) => frameOf(state, { key: image.key, at: moment.at });
    const answered = images.filter((image) => image?.boxes.length);
    const count = answered.flatMap(({ boxes }) => boxes.flatMap(([, found]) => found)).length;
    const idealOf = ({ topic }) => moment.images.get(`${namespaceOf(topic)}/ideal`);
    const scores = answered.map((image) => scoreOf(image, idealOf(image), state.choice.score)).filter((score) => score);
    const behind = images[0] ? stampMs(moment.stamp) - stampMs(images[0].stamp) : 0;
    const unwrapped = images.find((image) => ["recovered", "metered", "hdr"].includes(image?.stream));
    const { trusted = null, message = "" } = (unwrapped && trustOf(state, frame(unwrapped), unwrapped.topic)) ?? {};
    const facts = [
      scores.join(" | "),
      answered.length ? `${count} ${count === 1 ? "box" : "boxes"}${exposureOf(answered, state.choice)}` : "",
      behind > 0 ? `${behind.toFixed(0)} ms behind` : "",
      small || !images[0] ? "" : nameOf(state, frame(images[0]), moment.at),
    ].filter((fact) => fact);
    write(this.facts, facts.join(", "));
    this.facts.title = images[0] ? `Stamp ${images[0].key}; found: by a box not below the score of "Labels above"` : "";
    const trust = trusted === null ? "" : small ? message.split(":")[0] : message;
    write(this.badge, trust);
    this.picture.dataset.trust = trusted ?? "";
    this.picture.setAttribute("aria-label", `${names}: ${[missing, trust, ...facts].filter((fact) => fact).join(", ")}`);
  }
}

// What the node that has made an image says of it; the player of a bag makes the images of all cameras.
function trustOf({ graph }, frame, topic) {
  const told = frame?.trust ?? {};
  return (graph.player ? null : told[graph.makers[topic]]) ?? told[namespaceOf(topic)];
}

// Which exposure of the frame the boxes belong to, where it is not the original one that is shown.
function exposureOf(images, { exposure }) {
  const exposed = exposure && images.find(({ stream }) => EXPOSED_ANEW.includes(stream));
  if (!exposed) return "";
  return exposed.anew && exposed.exposure === exposure ? " found anew" : " of the original exposure";
}

function missingText(state, topic) {
  if (!state.graph.images.includes(topic)) return "no publisher";
  const last = state.newest.get(topic);
  if (!last) return "no image has come yet";
  return "no image of this moment";
}
