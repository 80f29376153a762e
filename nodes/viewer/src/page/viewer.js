"use strict";

// The page holds no state of the suite: everything that it shows comes over the socket, and each control asks for a change
// and shows what the node has answered.

const byId = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const STREAMS = ["modulo", "recovered", "saturated", "ideal"];

let socket = null;
let graph = { images: [], detectors: [], nodes: [], player: false };
let statuses = [];
let player = { paused: false, rate: 1 };
let chosen = null; // the shown topics; null until the page has chosen the first ones
const panes = new Map(); // topic -> { figure, canvas, caption, header, times }
const parameters = new Map(); // node -> list of parameters
let pointed = null; // the pixel under the pointer
let asked = false; // whether an answer about it is on its way

function ask(request) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
}

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/socket?token=${encodeURIComponent(token)}`);
  socket.binaryType = "arraybuffer";
  let opened = false;
  socket.onopen = () => {
    opened = true;
    // The answers to what was asked before are lost, and the parameters may have changed: all nodes are new to this socket.
    asked = false;
    graph = { images: [], detectors: [], nodes: [], player: false };
    say("connected", "on");
    if (chosen) ask({ watch: chosen });
  };
  socket.onmessage = (message) => (typeof message.data === "string" ? hear(JSON.parse(message.data)) : showImage(message.data));
  socket.onclose = () => {
    say(opened ? "the viewer has gone; trying again" : "no connection: open the address that modulo view has printed", "off");
    setTimeout(connect, 2000);
  };
}

function say(text, state) {
  byId("connection").textContent = text;
  byId("connection").className = state;
}

function hear(event) {
  const [kind, body] = Object.entries(event)[0];
  if (kind === "graph") showGraph(body);
  else if (kind === "status") showStatus(body);
  else if (kind === "parameters") { parameters.set(body.node, body.parameters); showControls(); if (byId("node").value === body.node) showParameters(); }
  else if (kind === "set") settled(body);
  else if (kind === "player") { player = body; showPlayer(); }
  else if (kind === "pixel") showPixel(body);
  else if (kind === "error") complain(body);
}

function complain(text) {
  byId("error").textContent = text;
  byId("error").hidden = !text;
}

// ---- streams ----

function showGraph(now) {
  const joined = now.nodes.filter((node) => !graph.nodes.includes(node));
  const replay = now.player && !graph.player;
  graph = now;
  if (chosen === null && now.images.length) {
    const first = STREAMS.map((name) => `/${name}`).filter((topic) => now.images.includes(topic));
    choose(first.length ? first : now.images.slice(0, 1));
  }
  byId("topic-list").replaceChildren(...now.images.map((topic, index) => {
    const box = make("input", { type: "checkbox", checked: (chosen ?? []).includes(topic) });
    box.onchange = () => turn(topic);
    return make("label", { title: index < 9 ? `key ${index + 1}` : "" }, box, ` ${topic}`);
  }));
  const select = byId("node");
  const before = select.value;
  select.replaceChildren(...now.nodes.map((node) => make("option", { value: node, textContent: node })));
  select.value = now.nodes.includes(before) ? before : now.nodes[0] ?? "";
  for (const node of joined) ask({ parameters: node });
  byId("player").hidden = !now.player;
  if (replay) ask({ player: "state" });
  showControls();
  showParameters();
}

function choose(topics) {
  chosen = topics;
  ask({ watch: topics });
  for (const [topic, pane] of panes) if (!topics.includes(topic)) { pane.figure.remove(); panes.delete(topic); }
  byId("empty").hidden = topics.length > 0;
}

function turn(topic) {
  const shown = chosen ?? [];
  choose(shown.includes(topic) ? shown.filter((other) => other !== topic) : [...shown, topic]);
  showGraph(graph);
}

function paneOf(topic) {
  if (!panes.has(topic)) {
    const canvas = make("canvas", { role: "img" });
    const [name, times] = [make("strong", { textContent: topic }), make("span")];
    const figure = make("figure", {}, canvas, make("figcaption", {}, name, times));
    canvas.onpointermove = (event) => point(canvas, event);
    canvas.onpointerdown = (event) => point(canvas, event);
    canvas.ondblclick = () => { choose([topic]); showGraph(graph); };
    panes.set(topic, { figure, canvas, caption: times, arrived: [] });
    // In the order of the list of topics, whichever image comes first.
    const order = [...panes.keys()].sort((a, b) => graph.images.indexOf(a) - graph.images.indexOf(b));
    byId("streams").replaceChildren(...order.map((name) => panes.get(name).figure));
  }
  return panes.get(topic);
}

async function showImage(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const file = new Blob([new Uint8Array(buffer, 4 + length)], { type: "image/jpeg" });
  try {
    const image = await createImageBitmap(file);
    if ((chosen ?? []).includes(header.topic)) draw(paneOf(header.topic), header, image);
    image.close();
  } catch (why) {
    complain(`${header.topic}: the browser cannot show the image: ${why.message}`);
  }
  ask({ drawn: header.topic });
}

function draw(pane, header, image) {
  const { canvas } = pane;
  if (canvas.width !== header.width || canvas.height !== header.height) Object.assign(canvas, { width: header.width, height: header.height });
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  const unit = Math.max(1, header.width / 700);
  let count = 0;
  for (const [, boxes] of header.boxes) for (const box of boxes) { drawBox(context, box, unit); count += 1; }
  pane.header = header;
  const now = performance.now();
  pane.arrived = [...pane.arrived.filter((time) => now - time < 3000), now];
  const stamp = `${header.stamp[0]}.${String(header.stamp[1]).padStart(9, "0")}`;
  const rate = ((pane.arrived.length - 1) * 1000) / Math.max(1, now - pane.arrived[0]);
  const white = header.white === null ? "" : `, white = ${header.white.toFixed(1)}`;
  pane.caption.textContent = `${header.boxes.length ? `${count} boxes, ` : ""}${rate.toFixed(1)} images/s shown, stamp ${stamp}${white}`;
  canvas.setAttribute("aria-label", `${header.topic}, ${count} boxes`);
  if (pointed) readPixel();
}

function drawBox(context, box, unit) {
  const [x1, y1, x2, y2] = box.edges;
  const colour = `hsl(${hue(box.class)} 90% 60%)`;
  context.lineWidth = 2 * unit;
  context.strokeStyle = colour;
  context.strokeRect(x1, y1, x2 - x1, y2 - y1);
  const label = `${box.class} ${box.score.toFixed(2)}`;
  context.font = `${12 * unit}px system-ui, sans-serif`;
  const [width, height] = [context.measureText(label).width + 6 * unit, 15 * unit];
  const top = y1 >= height ? y1 - height : y1;
  context.fillStyle = colour;
  context.fillRect(x1 - unit, top, width, height);
  context.fillStyle = "#000";
  context.fillText(label, x1 + 2 * unit, top + 11.5 * unit);
}

// Common classes are well apart; any other one has the same colour on every page, too.
const HUES = { car: 205, van: 175, truck: 50, bus: 30, train: 80, person: 340, pedestrian: 340, cyclist: 110, bicycle: 130, motorcycle: 270 };

function hue(text) {
  if (text in HUES) return HUES[text];
  let sum = 0;
  for (const letter of text) sum = (sum * 31 + letter.codePointAt(0)) % 360;
  return (sum * 137) % 360;
}

// ---- pixel ----

function point(canvas, event) {
  const place = canvas.getBoundingClientRect();
  const clamp = (value, size) => Math.min(size - 1, Math.max(0, Math.floor(value * size)));
  pointed = {
    u: clamp((event.clientX - place.left) / place.width, canvas.width),
    v: clamp((event.clientY - place.top) / place.height, canvas.height),
  };
  readPixel();
}

function readPixel() {
  if (!asked) { asked = true; ask({ pixel: pointed }); }
}

function showPixel({ u, v, samples }) {
  asked = false;
  byId("pixel-place").textContent = `Column ${u}, row ${v}; values in codes of the stream.`;
  const text = (value) => (value === undefined ? "" : Number.isInteger(value) ? String(value) : value.toFixed(2));
  byId("pixel").tBodies[0].replaceChildren(...samples.map(({ topic, samples: values }) => {
    const three = values.length === 1 ? [values[0], values[0], values[0]] : values;
    return make("tr", {}, make("td", { textContent: topic }), ...three.map((value) => make("td", { textContent: text(value) })));
  }));
  byId("pixel").hidden = samples.length === 0;
  showWraps(samples);
}

// x = y + k * 2^b, where both images are of the same moment and /hdr holds x.
function showWraps(samples) {
  const of = (name) => samples.find(({ topic }) => topic.endsWith(name));
  const [y, x] = [of("/modulo"), of("/hdr")];
  const sensor = statuses.find(({ name }) => name === "sensor");
  const bits = Number(sensor?.values.find(([key]) => key === "bits")?.[1]);
  const same = y && x && y.stamp.join() === x.stamp.join() && y.samples.length === x.samples.length && bits > 0;
  byId("wraps").hidden = !same;
  if (same) {
    const wraps = x.samples.map((value, channel) => Math.round((value - y.samples[channel]) / 2 ** bits));
    byId("wraps").textContent = `Wraps k of each channel: ${wraps.join(", ")} (x = y + k · 2^${bits})`;
  }
}

// ---- nodes ----

const LEVELS = ["", "warning", "error", "error"];
const history = new Map(); // status name -> the last medians of each stage, ms

function showStatus(list) {
  statuses = list;
  byId("status").replaceChildren(...list.map((status) => {
    const rows = status.values.flatMap(([key, value]) => [make("dt", { textContent: key }), make("dd", { textContent: value })]);
    return make("article", { className: LEVELS[status.level] ?? "" }, make("h3", { textContent: status.name }),
      make("p", { textContent: status.message }), strip(status), make("dl", {}, ...rows));
  }));
}

// A strip of the last durations of the stages, one line each.
function strip({ name, values }) {
  const stages = values.filter(([key, value]) => /\bms\b/.test(key) && /p50|median/.test(key) && Number.isFinite(Number(value)));
  if (stages.length === 0) return "";
  const past = [...(history.get(name) ?? []), stages.map(([, value]) => Number(value))].slice(-60);
  history.set(name, past);
  const top = Math.max(...past.flat(), 1);
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 60 20");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("class", "bars");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `Durations of the last minute, at most ${top.toFixed(1)} ms: ${stages.map(([key]) => key).join(", ")}`);
  stages.forEach((_, stage) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
    line.setAttribute("points", past.map((row, index) => `${index},${20 - 19 * ((row[stage] ?? 0) / top)}`).join(" "));
    line.setAttribute("fill", "none");
    line.setAttribute("stroke", `hsl(${(stage * 137) % 360} 70% 50%)`);
    line.setAttribute("vector-effect", "non-scaling-stroke");
    svg.append(line);
  });
  return svg;
}

// ---- parameters ----

function set(node, name, value) {
  ask({ set: { node, name, value: String(value) } });
}

function settled({ node, name, error }) {
  complain(error ? `${node} ${name}: ${error}` : "");
  // Shown is what the node has now, whether it took the value or not.
  ask({ parameters: node });
}

function find(name) {
  for (const node of graph.nodes) {
    const parameter = parameters.get(node)?.find((parameter) => parameter.name === name && !parameter.read_only);
    if (parameter) return { node, parameter };
  }
  return null;
}

function options(select, words, value) {
  if (document.activeElement !== select) select.replaceChildren(...words.map((word) => make("option", { value: word, textContent: word })));
  select.value = value;
}

// The value that is set stays in the list, even if there is no such topic now.
function inputs(node, value) {
  const offers = graph.detectors.find((detector) => detector.node === node)?.offers ?? [];
  return [...new Set([...offers, value])];
}

function showControls() {
  for (const name of ["input", "method"]) {
    const found = find(name);
    const words = found ? (name === "input" ? inputs(found.node, found.parameter.value) : found.parameter.words) : [];
    byId(`${name}-control`).hidden = words.length === 0;
    if (words.length === 0) continue;
    const select = byId(name);
    options(select, words, found.parameter.value);
    select.onchange = () => set(found.node, name, select.value);
  }
  // Only the camera's alpha changes the image; of the others, 0 means that of the camera.
  const cameras = graph.nodes.filter((node) => parameters.get(node)?.some(({ name }) => name === "source"));
  const camera = cameras.length ? parameters.get(cameras[0]).find(({ name }) => name === "alpha") : null;
  byId("alpha-control").hidden = !camera;
  if (camera) {
    const slider = byId("alpha");
    const [least, most] = camera.range ?? [1, 16];
    Object.assign(slider, { min: Math.max(1, least), max: Math.min(16, most) });
    if (document.activeElement !== slider) slider.value = camera.value;
    byId("alpha-value").textContent = ` ${camera.value}`;
    slider.onchange = () => set(cameras[0], "alpha", slider.value);
  }
}

function showParameters() {
  const node = byId("node").value;
  if (byId("parameters").contains(document.activeElement)) return;
  byId("parameters").replaceChildren(...(parameters.get(node) ?? []).map((parameter) => {
    const control = parameter.words.length ? make("select") : make("input", { type: "text" });
    if (parameter.words.length) options(control, parameter.words, parameter.value);
    else control.value = parameter.value;
    control.disabled = parameter.read_only;
    control.onchange = () => { set(node, parameter.name, control.value); control.blur(); };
    const range = parameter.range ? ` (${parameter.range[0]} to ${parameter.range[1]})` : "";
    return make("label", { title: `${parameter.description}${range}` }, parameter.name, control);
  }));
}

// ---- replay ----

function showPlayer() {
  byId("toggle").textContent = player.paused ? "Play" : "Pause";
  byId("next").disabled = !player.paused;
  byId("player-state").textContent = `${player.paused ? "paused" : "playing"} at speed ${player.rate}`;
  if (document.activeElement !== byId("rate")) byId("rate").value = player.rate;
}

byId("toggle").onclick = () => ask({ player: "toggle" });
byId("next").onclick = () => ask({ player: "next" });
byId("rate").onchange = (event) => ask({ player: { rate: Number(event.target.value) } });
byId("seek").onchange = (event) => ask({ player: { seek: Number(event.target.value) } });
byId("node").onchange = () => { ask({ parameters: byId("node").value }); showParameters(); };
byId("layout").onchange = (event) => byId("streams").classList.toggle("one", event.target.value === "one");

document.addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input, select, textarea, button");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const number = Number(event.key);
  if (number >= 1 && number <= graph.images.length) turn(graph.images[number - 1]);
  else if (event.key === "l") { const layout = byId("layout"); layout.value = layout.value === "one" ? "grid" : "one"; layout.onchange({ target: layout }); }
  else if (event.key === "i") { const select = byId("input"); select.selectedIndex = (select.selectedIndex + 1) % Math.max(1, select.length); select.onchange?.(); }
  else if (event.key === " " && graph.player) ask({ player: "toggle" });
  else if (event.key === "n" && graph.player) ask({ player: "next" });
  else return;
  event.preventDefault();
});

connect();
