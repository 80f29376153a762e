// The strip of at most the last two minutes: one axis of time for the latency, the rate, the age, the trust, the drops and the boxes.

import { byId, fitted, make, rounded, style, write } from "./dom.js";
import { classColour } from "./marks.js";
import { STRIP_MS, colourOf, droppedOf, frameOf, nameOf, nodesInOrder, now, quantile, shortName, stagesOf } from "./state.js";

const STAGES = ["camera", "unwrap", "detector"];
const STAGE_COLOURS = ["--series-1", "--series-2", "--series-3"];
const ROWS = [
  { name: "latency", title: "Latency by stage, ms until it is known here", height: 64 },
  { name: "rate", title: "Rate, frames/s", height: 34 },
  { name: "age", title: "Age of the newest frame, ms", height: 34 },
  { name: "trusted", title: "Trusted by unwrap", height: 12 },
  { name: "drops", title: "Dropped, frames/s", height: 26 },
  { name: "boxes", title: "Boxes by class", height: 44 },
];
const SPANS_MS = [20_000, 40_000, STRIP_MS]; // the strip is as long as what has been seen
const STRIP_REDRAW_MS = 200;

export class Timeline {
  constructor(actions) {
    this.rows = ROWS.map((row) => {
      const [legend, most, canvas] = [make("span", { className: "legend" }), make("span", { className: "most" }), make("canvas")];
      canvas.style.height = `${row.height}px`;
      const element = make(
        "div",
        { className: "row" },
        make("p", {}, make("strong", { textContent: row.title }), legend, most),
        canvas,
      );
      return { ...row, element, legend, most, canvas };
    });
    this.kept = make("div", { className: "kept", title: "Frames whose images are kept" });
    this.cursor = make("div", { className: "cursor" });
    this.plots = make(
      "div",
      { className: "plots", tabIndex: 0, role: "slider" },
      ...this.rows.map(({ element }) => element),
      this.kept,
      this.cursor,
    );
    this.plots.setAttribute("aria-label", "Time: arrow keys show the frames that are kept, escape goes on");
    this.axis = make("div", { className: "axis", ariaHidden: "true" }, ...[1, 2, 3, 4, 5].map(() => make("span")));
    this.readout = make("p", { className: "readout", role: "status" });
    byId("timeline").append(this.plots, this.axis, this.readout);
    const at = (event) => {
      const area = this.plots.getBoundingClientRect();
      return this.end - this.span * (1 - (event.clientX - area.left) / area.width);
    };
    this.plots.onpointermove = (event) => actions.hover(at(event));
    this.plots.onpointerleave = () => actions.hover(null);
    this.plots.onclick = (event) => actions.stopAt(at(event));
    this.drawnAt = 0;
  }

  draw(state) {
    const due = performance.now() - this.drawnAt >= STRIP_REDRAW_MS || this.width !== this.plots.clientWidth;
    if (!due && this.hover === state.hover && this.stopped === state.shown?.moment) return;
    [this.hover, this.stopped] = [state.hover, state.shown?.moment];
    this.end = now(state);
    this.width = this.plots.clientWidth;
    this.span = SPANS_MS.find((span) => this.end - span <= state.frames[0]?.at) ?? STRIP_MS;
    if (due) {
      // Moments that come faster than this draw the cursor only, and must not put the rows off.
      this.drawnAt = performance.now();
      this.drawRows(state);
    }
    this.drawCursor(state);
  }

  x(at) {
    return this.width * (1 - (this.end - at) / this.span);
  }

  drawRows(state) {
    [...this.axis.children].forEach((mark, place) => write(mark, place === 4 ? "now" : `${(this.span * (4 - place)) / 4000} s ago`));
    for (const row of this.rows) {
      const context = fitted(row.canvas, this.width, row.height);
      context.fillStyle = style("--line");
      context.fillRect(0, row.height - 1, this.width, 1);
      this[row.name](row, context, state);
    }
    const [first, last] = [state.moments[0], state.moments.at(-1)];
    this.kept.hidden = !first;
    if (!first) return;
    const left = Math.max(0, this.x(first.at));
    Object.assign(this.kept.style, { left: `${left}px`, width: `${Math.max(2, this.x(last.at) - left)}px` });
    this.plots.setAttribute("aria-valuemin", Math.round((first.at - this.end) / 1000));
    this.plots.setAttribute("aria-valuemax", 0);
  }

  label(row, entries, most) {
    const text = JSON.stringify(entries);
    if (row.legendIs !== text) {
      row.legend.replaceChildren(
        ...entries.map(([colour, words]) => {
          const mark = make("i", { className: "mark" });
          mark.style.background = colour;
          return make("span", {}, mark, words);
        }),
      );
      row.legendIs = text;
    }
    write(row.most, most);
  }

  bar(context, row, at, heights, colours, most) {
    let bottom = row.height - 1;
    heights.forEach((value, index) => {
      const height = ((row.height - 2) * value) / most;
      context.fillStyle = colours[index];
      context.fillRect(this.x(at), bottom - height, this.barWidth, height);
      bottom -= height;
    });
  }

  latency(row, context, { frames }) {
    const stages = frames.map(stagesOf);
    const of = (stage) => stages.map((all) => all[stage]).filter((value) => value !== null);
    const whole = stages.map((all) => STAGES.reduce((sum, stage) => sum + (all[stage] ?? 0), 0));
    const most = scaleOf(quantile(whole, 0.99) ?? 1);
    // As wide as frames are apart.
    const span = frames.length > 1 ? (frames.at(-1).at - frames[0].at) / (frames.length - 1) : 100;
    this.barWidth = Math.max(0.7, Math.min(12, (this.width * Math.min(span, 1000)) / this.span));
    const colours = STAGE_COLOURS.map(style);
    frames.forEach((frame, index) =>
      this.bar(
        context,
        row,
        frame.at,
        STAGES.map((stage) => Math.min(stages[index][stage] ?? 0, most)),
        colours,
        most,
      ),
    );
    const entries = STAGES.map((stage, index) => [colours[index], of(stage), stage]).filter(([, values]) => values.length);
    this.label(
      row,
      entries.map(([colour, values, stage]) => [
        colour,
        `${stage} p50 ${rounded(quantile(values, 0.5))}, p99 ${rounded(quantile(values, 0.99))}`,
      ]),
      `0 to ${most}`,
    );
  }

  // A line for each node of what `read` finds in its history.
  lines(row, context, state, read, format) {
    const points = (name) =>
      state.nodes
        .get(name)
        .history.map((entry) => [entry.at, read(entry.values)])
        .filter(([, value]) => Number.isFinite(value));
    const lines = nodesInOrder(state).map((name) => [name, points(name), style(colourOf(state, name))]);
    const drawn = lines.filter(([, points]) => points.length);
    const most = scaleOf(Math.max(...drawn.flatMap(([, points]) => points.map(([, value]) => value)), 1));
    drawn.forEach(([, points, colour]) => {
      context.strokeStyle = colour;
      context.lineWidth = 1.5;
      context.beginPath();
      points.forEach(([at, value], place) => {
        const next = [this.x(at), row.height - 1 - ((row.height - 3) * Math.min(value, most)) / most];
        if (place === 0 || at - points[place - 1][0] > 3000) context.moveTo(...next);
        else context.lineTo(...next);
      });
      context.stroke();
    });
    this.label(
      row,
      drawn.map(([name, points, colour]) => [colour, `${shortName(name)} ${format(points.at(-1)[1])}`]),
      drawn.length ? `0 to ${most}` : "not told",
    );
  }

  rate(row, context, state) {
    this.lines(
      row,
      context,
      state,
      (values) => Number(values.rate_hz ?? NaN),
      (value) => value.toFixed(1),
    );
  }

  // Frames of a recording have the age of the recording.
  age(row, context, state) {
    const read = ({ age_ms: age }) => (age !== undefined && Number(age) < 60_000 ? Number(age) : NaN);
    this.lines(row, context, state, read, rounded);
  }

  trusted(row, context, { frames }) {
    const told = frames.filter(({ trusted }) => trusted !== null);
    for (const frame of told) {
      context.fillStyle = style(frame.trusted ? "--good" : "--bad");
      context.fillRect(this.x(frame.at), 1, this.barWidth, row.height - 3);
    }
    const count = told.filter(({ trusted }) => trusted).length;
    this.label(
      row,
      told.length
        ? [
            [style("--good"), `${count} frames`],
            [style("--bad"), `${told.length - count} not`],
          ]
        : [],
      told.length ? "" : "no claim",
    );
  }

  drops(row, context, state) {
    const names = nodesInOrder(state);
    const steps = names.flatMap((name) => {
      const { history } = state.nodes.get(name);
      return history
        .slice(1)
        .map((entry, place) => ({
          name,
          from: history[place].at,
          at: entry.at,
          count: Math.max(0, droppedOf(entry) - droppedOf(history[place])),
        }));
    });
    const rates = steps.map((step) => ({ ...step, rate: step.count / Math.max(0.2, (step.at - step.from) / 1000) }));
    const most = scaleOf(Math.max(...rates.map(({ rate }) => rate), 1));
    for (const { name, from, at, rate } of rates) {
      context.fillStyle = style(colourOf(state, name));
      const height = ((row.height - 2) * rate) / most;
      context.fillRect(this.x(from), row.height - 1 - height, Math.max(1, this.x(at) - this.x(from)), height);
    }
    const sums = names.map((name) => [
      style(colourOf(state, name)),
      `${shortName(name)} ${steps.filter((step) => step.name === name).reduce((sum, { count }) => sum + count, 0)}`,
    ]);
    this.label(row, sums, `0 to ${most}`);
  }

  boxes(row, context, { frames }) {
    const counts = (frame) => Object.values(frame.classes).reduce((sum, count) => sum + count, 0);
    const names = [...new Set(frames.flatMap(({ classes }) => Object.keys(classes)))].sort();
    const most = scaleOf(Math.max(...frames.map(counts), 1));
    for (const frame of frames)
      this.bar(
        context,
        row,
        frame.at,
        names.map((name) => frame.classes[name] ?? 0),
        names.map(classColour),
        most,
      );
    const newest = frames.findLast(({ detected }) => detected.size);
    this.label(
      row,
      names.map((name) => [classColour(name), `${name} ${newest?.classes[name] ?? 0}`]),
      names.length ? `0 to ${most}` : "no boxes",
    );
  }

  drawCursor(state) {
    const at = state.hover ?? (state.stopped ? state.shown?.moment.at : null);
    this.cursor.hidden = at === null || at === undefined;
    this.plots.setAttribute("aria-valuenow", this.cursor.hidden ? 0 : Math.round((at - this.end) / 1000));
    if (this.cursor.hidden) return write(this.readout, "Point at the strip for the values of a frame; click to stop there.");
    this.cursor.style.left = `${Math.min(this.width, Math.max(0, this.x(at)))}px`;
    const frame = state.hover === null ? frameOf(state, state.shown.moment) : nearest(state.frames, at);
    write(this.readout, frame ? textOf(state, frame) : "No frame.");
  }
}

// The frame that is nearest to a time, if there is one within a second.
export function nearest(frames, at) {
  const best = frames.reduce(
    (found, frame) => (found && Math.abs(found.at - at) <= Math.abs(frame.at - at) ? found : frame),
    null,
  );
  return best && Math.abs(best.at - at) < 1000 ? best : null;
}

// The end of an axis: 1, 2 or 5 times a power of ten.
function scaleOf(most) {
  const power = 10 ** Math.floor(Math.log10(Math.max(most, 1e-3)));
  return [1, 2, 5, 10].map((step) => step * power).find((end) => end >= most);
}

function textOf(state, frame) {
  const stages = Object.entries(stagesOf(frame)).filter(([, value]) => value !== null);
  const boxes = Object.entries(frame.classes).map(([name, count]) => `${count} ${name}`);
  const trust = frame.trusted === null ? [] : [frame.trusted ? "trusted" : "not trusted"];
  const found = frame.detected.size ? [boxes.length ? boxes.join(", ") : "no boxes"] : ["no detector has answered it"];
  const facts = [...stages.map(([stage, value]) => `${stage} ${rounded(value)} ms`), ...trust, ...found];
  return `${nameOf(state, frame)}: ${facts.join("; ")}`;
}
