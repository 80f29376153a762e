// The nodes of the suite, from the camera on, with the topics between them.

import { byId, make, makeSvg, rounded, write } from "./dom.js";
import { healthOf, now, rateOf, shortName, visibleNodes } from "./state.js";

const HEALTH = { gone: "gone", skips: "skips frames", warns: "warns", fails: "fails", starts: "starts", runs: "runs" };
const GRAPH_REDRAW_MS = 500;

export class Graph {
  constructor() {
    this.cards = new Map(); // node -> its elements
    this.lines = makeSvg("svg", { class: "lines", "aria-hidden": "true" });
    this.columns = make("div", { className: "columns" });
    byId("graph").append(this.lines, this.columns);
    this.drawnAt = 0;
  }

  draw(state) {
    if (performance.now() - this.drawnAt < GRAPH_REDRAW_MS) return;
    this.drawnAt = performance.now();
    const names = visibleNodes(state);
    byId("suite").hidden = names.length === 0;
    const links = state.graph.links.filter(({ from, to }) => names.includes(from) && names.includes(to));
    this.arrange(names, links);
    for (const name of names)
      this.drawCard(
        state,
        name,
        links.filter(({ to }) => to === name),
      );
    this.drawLines(links);
  }

  card(name) {
    if (!this.cards.has(name)) {
      const parts = {
        state: make("span", { className: "state" }),
        message: make("p", { className: "quiet" }),
        inputs: make("ul"),
        five: make("dl", { className: "five" }),
        all: make("dl", { className: "all" }),
      };
      const head = make("h3", {}, make("span", { textContent: shortName(name) }), parts.state);
      const details = make("details", {}, make("summary", { textContent: "All values" }), parts.all);
      this.cards.set(name, {
        ...parts,
        details,
        element: make("article", {}, parts.inputs, head, parts.message, parts.five, details),
      });
    }
    return this.cards.get(name);
  }

  // A column for each step from the nodes that read nothing.
  arrange(names, links) {
    const text = JSON.stringify([names, links]);
    if (this.arrangedAs === text) return;
    this.arrangedAs = text;
    const depth = new Map(names.map((name) => [name, 0]));
    for (let round = 0; round < names.length; round += 1) {
      for (const { from, to } of links)
        if (from !== to) depth.set(to, Math.min(names.length, Math.max(depth.get(to), depth.get(from) + 1)));
    }
    const steps = [...new Set(depth.values())].sort((a, b) => a - b);
    this.columns.replaceChildren(
      ...steps.map((step) =>
        make(
          "div",
          { className: "column" },
          ...names.filter((name) => depth.get(name) === step).map((name) => this.card(name).element),
        ),
      ),
    );
  }

  drawCard(state, name, links) {
    const card = this.card(name);
    const { history, goneAt, restarts } = state.nodes.get(name);
    const health = healthOf(state, name);
    const last = history.at(-1);
    card.element.className = health;
    const since = goneAt === null ? "" : ` ${((now(state) - goneAt) / 1000).toFixed(0)} s ago`;
    write(card.state, `${HEALTH[health]}${since}${restarts ? `, restarted ${restarts} times` : ""}`);
    write(card.message, last?.message && last.message !== "running" ? last.message : "");
    rows(card.five, five(last?.values ?? {}));
    if (card.details.open) rows(card.all, Object.entries(last?.values ?? {}));
    const inputs = links.map((link) => inputText(link, history));
    if (JSON.stringify(inputs) !== card.inputsAre) {
      card.inputsAre = JSON.stringify(inputs);
      card.inputs.replaceChildren(
        ...inputs.map(([topic, facts]) =>
          make("li", {}, make("strong", { textContent: topic }), make("span", { textContent: facts })),
        ),
      );
    }
  }

  // From the right edge of a card, or the lower one where cards are below each other, to the entry of the topic in the next card.
  drawLines(links) {
    const origin = byId("graph").getBoundingClientRect();
    Object.entries({ width: origin.width, height: origin.height }).forEach(([name, value]) =>
      this.lines.setAttribute(name, value),
    );
    this.lines.replaceChildren(
      ...links.flatMap(({ from, to, topic }) => {
        const start = this.card(from).element.getBoundingClientRect();
        const entry =
          [...this.card(to).inputs.children].find((item) => item.firstChild.textContent === topic) ?? this.card(to).element;
        const end = entry.getBoundingClientRect();
        const beside = end.left > start.right;
        const [x1, y1] = beside ? [start.right, start.top + start.height / 2] : [start.left + 24, start.bottom];
        const card = this.card(to).element.getBoundingClientRect();
        const [x2, y2] = beside ? [card.left - 1, end.top + end.height / 2] : [card.left + 24, card.top - 1];
        const [a, b] = [
          [x1 - origin.left, y1 - origin.top],
          [x2 - origin.left, y2 - origin.top],
        ];
        const bend = beside ? `C ${(a[0] + b[0]) / 2} ${a[1]} ${(a[0] + b[0]) / 2} ${b[1]} ${b[0]} ${b[1]}` : `L ${b[0]} ${b[1]}`;
        const tip = beside
          ? `M ${b[0] - 6} ${b[1] - 4} L ${b[0]} ${b[1]} L ${b[0] - 6} ${b[1] + 4}`
          : `M ${b[0] - 4} ${b[1] - 6} L ${b[0]} ${b[1]} L ${b[0] + 4} ${b[1] - 6}`;
        return [makeSvg("path", { d: `M ${a[0]} ${a[1]} ${bend} ${tip}` })];
      }),
    );
  }
}

// Topic, and rate, losses and quality of service of what arrives.
function inputText({ topic, qos }, history) {
  const rate = rateOf(history, `received ${topic}`);
  const last = history.at(-1)?.values ?? {};
  const lost = Number(last[`replaced ${topic}`] ?? 0) + Number(last[`lost ${topic}`] ?? 0);
  return [topic, [rate === null ? "" : `${rate.toFixed(1)} Hz`, `${lost} dropped`, qos].filter((fact) => fact).join(" · ")];
}

// The five values that matter without a click.
function five(values) {
  const [stage] =
    Object.entries(values)
      .filter(([key]) => key.endsWith(" p99 ms"))
      .sort((a, b) => Number(b[1]) - Number(a[1]))[0] ?? [];
  const name = stage?.replace(" p99 ms", "");
  const age = Number(values.age_ms);
  return [
    ["Rate", values.rate_hz ? `${values.rate_hz} Hz` : "–"],
    ["Age", values.age_ms === undefined ? "–" : age < 60_000 ? `${rounded(age)} ms` : "recorded"],
    [
      name ? `${name} p50, p99` : "Stage",
      name ? `${rounded(Number(values[`${name} p50 ms`]))}, ${rounded(Number(values[stage]))} ms` : "–",
    ],
    ["Dropped", values.dropped_frames ?? "–"],
    [
      "Uses",
      values.engine
        ? `${values.engine} on ${values.stream ?? values.input ?? "?"}`
        : values.methods_used
          ? `${values.method}, trusted ${values.trusted ?? "no claim"}`
          : values.frames
            ? `${values.frames} frames sent`
            : "–",
    ],
  ];
}

function rows(list, entries) {
  const text = JSON.stringify(entries);
  if (list.dataset.is === text) return;
  list.dataset.is = text;
  list.replaceChildren(
    ...entries.map(([key, value]) => make("div", {}, make("dt", { textContent: key }), make("dd", { textContent: value }))),
  );
}
