// How images are shown: the curve, the overlays, the histogram of radiance, and the values of a pixel.

import { CURVES } from "./curve.js";
import { byId, fitted, labelled, make, offer, rounded, style, write } from "./dom.js";

const LEAST_STOP = -8;
const BINS_OF_A_STOP = 2;
const STOPS = 12; // of the histogram, from LEAST_STOP on
const PLOT = 96; // height of the histogram, px

export class Display {
  constructor(actions) {
    const set = (name, read) => (event) => actions.choose({ [name]: read(event.target) });
    const range = (name, least, most, step) =>
      Object.assign(make("input", { type: "range", min: least, max: most, step }), {
        oninput: set(name, (input) => Number(input.value)),
      });
    const check = (name) => make("input", { type: "checkbox", onchange: set(name, (input) => input.checked) });
    this.controls = {
      curve: make(
        "select",
        { onchange: set("curve", (select) => select.value) },
        ...Object.entries(CURVES).map(([value, textContent]) => make("option", { value, textContent })),
      ),
      exposure: range("exposure", -6, 6, 0.5),
      score: range("score", 0, 1, 0.05),
      boxes: check("boxes"),
      truth: check("truth"),
      confidence: check("confidence"),
      together: check("together"),
    };
    this.outputs = { exposure: make("output"), score: make("output") };
    const { curve, exposure, score, boxes, truth, confidence, together } = this.controls;
    this.truth = labelled("Ground truth, dashed", truth, "control check");
    this.confidence = labelled("Confidence: pixels whose counts may be wrong", confidence, "control check");
    byId("display").append(
      labelled("Shown as", curve),
      Object.assign(this.withOutput("Exposure", exposure, "exposure"), {
        title: "Recovered images are exposed anew from their counts, and their boxes are found anew.",
      }),
      this.withOutput("Labels above", score, "score"),
      labelled("Boxes", boxes, "control check"),
      this.truth,
      this.confidence,
      labelled("One moment: wait for the slowest stream", together, "control check"),
    );
    this.select = make("select", { onchange: set("selected", (select) => select.value) });
    this.plot = make("canvas", { className: "plot", role: "img" });
    this.scale = make(
      "div",
      { className: "scale", ariaHidden: "true" },
      ...[-8, -6, -4, -2, 0, 2, 4].map((stop) => make("span", { textContent: stop > 0 ? `+${stop}` : `${stop}` })),
    );
    this.words = make("p", { className: "quiet" });
    byId("histogram").append(labelled("Stream", this.select), this.plot, this.scale, this.words);
    this.place = make("p", { className: "quiet", textContent: "Point at an image." });
    this.table = make("table", { hidden: true });
    byId("pixel").append(this.place, this.table);
  }

  withOutput(text, control, name) {
    return make("label", { className: "control slider" }, make("span", { textContent: text }), control, this.outputs[name]);
  }

  draw(state) {
    const { choice } = state;
    for (const [name, control] of Object.entries(this.controls)) {
      if (control.type === "checkbox") control.checked = choice[name];
      else if (control !== document.activeElement) control.value = choice[name];
    }
    write(this.outputs.exposure, `${choice.exposure > 0 ? "+" : ""}${choice.exposure} ${Math.abs(choice.exposure) === 1 ? "stop" : "stops"}`);
    write(this.outputs.score, choice.score.toFixed(2));
    this.truth.hidden = state.graph.truths.length === 0;
    this.confidence.hidden = !state.graph.images.some((topic) => topic.endsWith("/confidence"));
    this.drawHistogram(state);
    this.drawPixel(state);
  }

  drawHistogram(state) {
    const all = [...(state.shown?.moment.images.values() ?? [])].filter((image) => image.stops.length);
    byId("histogram").parentElement.hidden = all.length === 0;
    if (all.length === 0) return;
    const wanted = state.choice.selected || "/recovered";
    const image = all.find(({ topic }) => topic === wanted) ?? all[0];
    offer(
      this.select,
      all.map(({ topic }) => topic),
      image.topic,
    );
    const width = this.plot.clientWidth;
    if (this.drawn === image && this.width === width) return;
    [this.drawn, this.width] = [image, width];
    const context = fitted(this.plot, width, PLOT);
    const peakAt = (-LEAST_STOP / STOPS) * width;
    const bar = width / (STOPS * BINS_OF_A_STOP);
    const shares = image.stops.slice(0, STOPS * BINS_OF_A_STOP);
    // The least bin holds all that is darker: it must not flatten the others.
    const most = Math.max(...shares.slice(1), 0.02);
    shares.forEach((share, index) => {
      const height = Math.min(1, share / most) * (PLOT - 4);
      context.fillStyle = index / BINS_OF_A_STOP + LEAST_STOP >= 0 ? style("--over") : style("--accent");
      context.fillRect(index * bar + 0.5, PLOT - height, bar - 1, height);
    });
    context.strokeStyle = style("--text");
    context.setLineDash([4, 3]);
    context.strokeRect(peakAt, -1, 0, PLOT + 2);
    const above = image.stops.slice(-LEAST_STOP * BINS_OF_A_STOP).reduce((sum, share) => sum + share, 0);
    const told = image.stream === "modulo"
      ? "What is above the peak has wrapped to the dark side."
      : image.stream === "saturated"
        ? "What is above the peak is lost: it is white."
        : `${(100 * above).toFixed(1)} % of the samples are above the sensor's peak (0 stops): an ordinary sensor would have clipped them.`;
    write(this.words, told);
    this.plot.setAttribute("aria-label", `Radiance of ${image.topic} in stops from the sensor's peak. ${told}`);
  }

  // Of each image the codes, and below them what they stand for: wraps k, or radiance.
  drawPixel({ pixel, shown }) {
    if (!pixel || pixel === this.pixel) return;
    this.pixel = pixel;
    const { u, v, samples: all } = pixel;
    const told = all.length ? "codes, and the radiance in peaks of the sensor or the wraps k" : "the viewer no longer keeps this frame";
    write(this.place, `Column ${u}, row ${v}: ${told}`);
    const kept = ({ topic }) => shown?.moment.images.get(topic) ?? {};
    const text = (value) => (Number.isInteger(value) ? String(value) : value.toFixed(2));
    this.table.replaceChildren(
      ...all.map((image) => {
        const below = wrapsOf(image, all, kept) ?? image.radiance.map(rounded);
        const cells = image.samples.map((code, channel) =>
          make("td", { colSpan: 3 / image.samples.length }, text(code), make("small", { textContent: below[channel] ?? "" })),
        );
        return make("tr", {}, make("th", { scope: "row", textContent: image.topic }), ...cells);
      }),
    );
    this.table.hidden = all.length === 0;
  }
}

// k of x = y + k * 2^b: the radiance of an unwrapped image is that of the wrapped one and k peaks of the sensor.
function wrapsOf(image, all, kept) {
  const [{ radiance }, { stream, camera }] = [image, kept(image)];
  const ofCamera = all.filter((other) => kept(other).camera === camera);
  const unwrapped = ["hdr", "recovered"].map((kind) => ofCamera.find((other) => kept(other).stream === kind));
  const x = unwrapped.find((other) => other?.radiance.length === radiance.length);
  if (stream !== "modulo" || !x || !radiance.length) return null;
  return x.radiance.map((light, channel) => `k ${Math.round(light - radiance[channel])}`);
}
