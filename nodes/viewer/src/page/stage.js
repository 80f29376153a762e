// The images: a grid that fills the window, one large image with a film strip, or two of them with a wipe between.

import { byId, make, offer } from "./dom.js";
import { topicsOf } from "./state.js";
import { Tile } from "./tile.js";

export const LAYOUTS = { grid: "Grid", one: "Large", wipe: "Wipe" };
const GAP = 8;
const CAPTION = 26;
const STRIP = 96; // height of the film strip
const BELOW = 190; // what is seen of the strip of time below

export class Stage {
  constructor(actions) {
    this.actions = actions;
    this.tiles = new Map(); // place on the stage -> tile
    this.large = make("div", { className: "large" });
    this.film = make("div", { className: "film" });
    byId("stage").append(this.large, byId("wipe-control"), this.film);
    byId("layouts").append(
      ...Object.entries(LAYOUTS).map(([name, text]) => {
        const button = make("button", { type: "button", textContent: text, value: name });
        button.setAttribute("role", "radio");
        button.onclick = () => actions.choose({ layout: name });
        return button;
      }),
    );
    byId("wipe").oninput = (event) => actions.choose({ wipe: Number(event.target.value) });
    for (const side of ["left", "right"]) byId(side).onchange = (event) => actions.choose({ [side]: event.target.value });
  }

  draw(state) {
    const { choice } = state;
    const topics = topicsOf(state).slice().sort((a, b) => state.graph.images.indexOf(a) - state.graph.images.indexOf(b));
    byId("empty").hidden = topics.length > 0;
    const of = (name) => topics.find((topic) => topic.endsWith(name));
    const left = topics.includes(choice.left) ? choice.left : ((choice.layout === "wipe" && of("/saturated")) || topics[0]);
    const others = topics.filter((topic) => topic !== left);
    const right = topics.includes(choice.right) ? choice.right : (others.find((topic) => topic.endsWith("/recovered")) ?? others[0]);
    this.drawControls(state, topics, { left, right });
    const size = this.size(state, topics);
    let large = topics.map((topic) => [topic]);
    if (choice.layout === "one") large = left ? [[left]] : [];
    if (choice.layout === "wipe") large = left ? [[left, right].filter((topic) => topic)] : [];
    const film = choice.layout === "grid" ? [] : topics;
    const width = choice.layout === "grid" ? size.tile : size.large;
    this.fill(this.large, "large", large, (tile, names) => tile.draw(state, names, width, false));
    this.fill(
      this.film,
      "film",
      film.map((topic) => [topic]),
      (tile, names) => tile.draw(state, names, size.film, true),
    );
    this.large.style.gridTemplateColumns = `repeat(${choice.layout === "grid" ? size.columns : 1}, ${width}px)`;
    byId("wipe-control").hidden = choice.layout !== "wipe" || !right;
    if (document.activeElement !== byId("wipe")) byId("wipe").value = choice.wipe;
  }

  // Reuses tiles: what is drawn on them stays until the next image.
  fill(parent, place, groups, draw) {
    const tiles = groups.map((names, index) => {
      const key = `${place} ${index}`;
      if (!this.tiles.has(key)) this.tiles.set(key, new Tile(this.actions));
      draw(this.tiles.get(key), names);
      return this.tiles.get(key).figure;
    });
    if (parent.children.length !== tiles.length) parent.replaceChildren(...tiles);
  }

  // The widths with which all images fit into the window.
  size(state, topics) {
    const width = byId("stage").clientWidth;
    const image = state.newest.get(topics[0]);
    const aspect = image ? image.width / image.height : 10 / 3;
    const top = byId("stage").getBoundingClientRect().top + window.scrollY;
    const height = Math.max(220, window.innerHeight - top - BELOW);
    const fit = (columns) => {
      const rows = Math.ceil(topics.length / columns);
      return Math.min((width - GAP * (columns - 1)) / columns, ((height - GAP * (rows - 1)) / rows - CAPTION) * aspect);
    };
    // Of layouts with images of about the same size, the one that fills the width.
    const counts = topics.map((_, index) => index + 1);
    const columns = counts.findLast((many) => fit(many) >= 0.9 * Math.max(...counts.map(fit))) ?? 1;
    const least = Math.min(width, 360);
    return {
      columns: fit(columns) >= least ? columns : Math.max(1, Math.floor((width + GAP) / (least + GAP))),
      tile: Math.floor(Math.min(width, Math.max(fit(columns), least))),
      large: Math.floor(Math.min(width, Math.max(least, (height - STRIP - CAPTION) * aspect))),
      film: Math.floor(
        Math.min((STRIP - CAPTION) * aspect, Math.max(90, (width - GAP * (topics.length - 1)) / Math.max(1, topics.length))),
      ),
    };
  }

  drawControls({ choice, graph }, topics, chosen) {
    for (const button of byId("layouts").children) button.setAttribute("aria-checked", String(button.value === choice.layout));
    for (const [side, topic] of Object.entries(chosen)) {
      byId(`${side}-control`).hidden =
        choice.layout === "grid" || (side === "right" && choice.layout !== "wipe") || topics.length === 0;
      offer(byId(side), topics, topic ?? "");
    }
    byId("left-control").firstChild.textContent = choice.layout === "one" ? "Image " : "Left ";
    this.drawTopics(graph.images, topics);
  }

  drawTopics(images, shown) {
    const text = JSON.stringify([images, shown]);
    if (this.topicsAre === text) return;
    const focused = document.activeElement?.dataset?.topic;
    byId("topic-list").replaceChildren(
      ...images.map((topic, index) => {
        const box = make("input", { type: "checkbox", checked: shown.includes(topic) });
        box.dataset.topic = topic;
        box.onchange = () => this.actions.turn(topic);
        return make("label", { title: index < 9 ? `Key: ${index + 1}` : "" }, box, ` ${topic}`);
      }),
    );
    this.topicsAre = text;
    if (focused) [...byId("topic-list").querySelectorAll("input")].find((box) => box.dataset.topic === focused)?.focus();
  }
}
