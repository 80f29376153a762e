// The nodes of the suite, from the camera on, with the topics between them.

import { byId, make, makeSvg, rounded, write } from "./dom.js";
import { colourOf, healthOf, now, rateOf, shortName, visibleNodes } from "./state.js";

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
    const width = byId("graph").clientWidth;
    if (performance.now() - this.drawnAt < GRAPH_REDRAW_MS && width === this.width) return;
    [this.drawnAt, this.width] = [performance.now(), width];
    const names = visibleNodes(state);
    const links = state.graph.links.filter(({ from, to }) => names.includes(from) && names.includes(to));
    this.arrange(names, links);
    for (const name of names)
      this.drawCard(
        state,
        name,
        links.filter(({ to }) => to === name),
      );
    this.drawLines(state, links);
  }

  card(name) {
    if (!this.cards.has(name)) {
      const parts = {
        mark: make("i", { className: "mark" }),
        state: make("span", { className: "state" }),
        message: make("p", { className: "quiet" }),
        inputs: make("ul"),
        five: make("dl", { className: "five" }),
        all: make("dl", { className: "all" }),
      };
      const head = make("h3", { ariaLevel: 2 }, parts.mark, make("span", { textContent: shortName(name) }), parts.state);
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
    card.mark.style.background = `var(${colourOf(state, name)})`;
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

  // From the right edge of a card to the entry of the topic in a card of the next column; above the columns between to a later one.
  // Where cards are below each other, in the lane of the sender beside them. No line touches a card that it does not belong to.
  drawLines(state, links) {
    const origin = byId("graph").getBoundingClientRect();
    const columns = [...this.columns.children];
    const lanes = [...new Set(links.map(({ from }) => from))];
    byId("graph").style.setProperty("--lanes", lanes.length);
    for (const name of ["width", "height"]) this.lines.setAttribute(name, origin[name]);
    const of = (element) => {
      const { left, right, top, bottom } = element.getBoundingClientRect();
      return { left: left - origin.left, right: right - origin.left, middle: (top + bottom) / 2 - origin.top };
    };
    const line = ({ from, to, topic }) => {
      const [sender, reader] = [this.card(from).element, this.card(to).element];
      const entry = [...this.card(to).inputs.children].find((item) => item.firstChild.textContent === topic) ?? reader;
      const [start, { left }, { middle: y }] = [of(sender), of(reader), of(entry)];
      const [x, lane, end] = [start.right, lanes.indexOf(from), left - 1];
      const steps = columns.indexOf(reader.parentElement) - columns.indexOf(sender.parentElement);
      const way =
        left <= x
          ? `M ${start.left} ${start.middle} H ${4 + 6 * lane} V ${y} H ${end}`
          : steps === 1
            ? `M ${x} ${start.middle} C ${(x + end) / 2} ${start.middle} ${(x + end) / 2} ${y} ${end} ${y}`
            : `M ${x} ${start.middle} H ${x + 4 + 3 * lane} V ${2 + 4 * lane} H ${end - 10} V ${y} H ${end}`;
      return makeSvg("path", { d: `${way} m -6 -4 l 6 4 l -6 4`, stroke: `var(${colourOf(state, from)})` });
    };
    this.lines.replaceChildren(...links.map(line));
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
