// All that the page knows, and the one place where messages change it. Nothing here touches an element of the page.

export const KEPT_MOMENTS = 60;
export const STRIP_MS = 120_000;
const GONE_MS = 30_000;
const COLOURS_OF_NODES = 8;

export function newState(recorded) {
  return {
    recorded,
    link: { text: recorded ? "a recording" : "connecting", level: recorded ? "on" : "wait" },
    error: "",
    graph: { images: [], first: [], detectors: [], truths: [], nodes: [], links: [], player: false },
    nodes: new Map(), // name -> { colour, goneAt, restarts, history: [{ at, values }] }
    statuses: new Map(), // name, or topic of a sensor description -> values
    parameters: new Map(), // node -> list of parameters
    refusals: new Map(), // "node name" -> the node's sentence
    frames: [], // in the order of their arrival
    counted: 0, // frames since the page was opened
    moments: [], // the newest ones, with their files
    stopped: false,
    shown: null, // the moment that is drawn, with its decoded images
    newest: new Map(), // topic -> its newest image
    nowAt: 0, // time of the newest message, ms
    heardAt: 0, // the same instant on the clock of the page
    hover: null, // the time under the pointer in the strip
    pixel: null,
    player: { paused: false, rate: 1 },
    choice: {
      topics: null,
      layout: "grid",
      left: "",
      right: "",
      wipe: 50,
      together: true,
      exposure: 0,
      curve: "film",
      score: 0.5,
      boxes: true,
      truth: false,
      confidence: false,
      selected: "",
      zoom: { scale: 1, origin: [0, 0] }, // of all images: the origin is the share of an image at its left and upper edge
      search: "",
    },
  };
}

// The choices that the address of the page keeps.
const KEPT = ["layout", "left", "right", "wipe", "curve", "topics"];

export function choiceOf(search) {
  const asked = new URLSearchParams(search);
  const kept = KEPT.filter((name) => asked.has(name)).map((name) => [name, asked.get(name)]);
  return Object.fromEntries(kept.map(([name, text]) => [name, { wipe: Number, topics: (all) => all.split(",") }[name]?.(text) ?? text]));
}

export function addressOf({ search, hash }, choice) {
  const address = new URLSearchParams(search);
  KEPT.filter((name) => choice[name]).forEach((name) => address.set(name, choice[name]));
  return `?${address}${hash}`;
}

export const stampKey = ([seconds, nanos]) => `${seconds}.${String(nanos).padStart(9, "0")}`;
export const stampMs = ([seconds, nanos]) => seconds * 1000 + nanos / 1e6;
export const namespaceOf = (topic) => topic.slice(0, topic.lastIndexOf("/"));
export const shortName = (node) => node.replace(/^\//, "");

// What the style sheet calls the colour of a node.
export const colourOf = (state, name) => `--series-${state.nodes.get(name).colour}`;

// The time on the axis: it goes on between two messages.
export function now(state) {
  return state.recorded || state.nowAt === 0 ? state.nowAt : state.nowAt + Math.min(5000, performance.now() - state.heardAt);
}

function advance(state, at) {
  if (at <= state.nowAt) return;
  state.nowAt = at;
  state.heardAt = performance.now();
}

// A zoom by `factor` more, at which the share `share` of an image is seen at the share `at` of its tile.
export function zoomed({ scale: before }, factor, share, at = share) {
  const scale = Math.min(16, Math.max(1, before * factor));
  return { scale, origin: share.map((part, axis) => Math.min(1 - 1 / scale, Math.max(0, part - at[axis] / scale))) };
}

// The streams that are exposed anew after the capture.
export const EXPOSED_ANEW = ["recovered", "metered"];

// ---- messages ----

export function hear(state, event, at) {
  const [kind, body] = Object.entries(event)[0];
  if (at) advance(state, at);
  if (kind === "graph") hearGraph(state, body);
  else if (kind === "status") body.forEach((status) => hearStatus(state, status));
  else if (kind === "notices") body.forEach((notice) => hearNotice(state, notice));
  else if (kind === "parameters") state.parameters.set(body.node, body.parameters);
  else if (kind === "set") hearSet(state, body);
  else if (kind === "player") state.player = body;
  else if (kind === "pixel") state.pixel = body;
  else if (kind === "error") state.error = body;
  return kind;
}

function hearGraph(state, graph) {
  // A node keeps the colour that it gets when it is first seen: first the camera, as the stages of a frame have theirs.
  for (const node of inOrder(graph.nodes, graph.links)) {
    const known = state.nodes.get(node);
    if (!known) state.nodes.set(node, { colour: (state.nodes.size % COLOURS_OF_NODES) + 1, goneAt: null, restarts: 0, history: [] });
    else if (known.goneAt !== null) Object.assign(known, { goneAt: null, restarts: known.restarts + 1, history: [] });
  }
  for (const [node, known] of state.nodes) {
    if (!graph.nodes.includes(node) && known.goneAt === null) known.goneAt = now(state);
  }
  state.graph = graph;
}

function hearStatus(state, status) {
  const values = Object.fromEntries(status.values.map(({ key, value }) => [key, value]));
  state.statuses.set(status.name, values);
  const node = state.nodes.get(`/${status.name}`);
  if (!node) return;
  node.history.push({ at: now(state), level: status.level, message: status.message, values });
  node.history = node.history.filter(({ at }) => at > now(state) - STRIP_MS);
}

function hearNotice(state, { at_ms: at, stamp, node, step }) {
  advance(state, at);
  const [kind, body] = typeof step === "string" ? [step, {}] : Object.entries(step)[0];
  if (kind === "detected" && !state.graph.detectors.some((detector) => detector.node === node)) return;
  const key = stampKey(stamp);
  let frame = state.frames.findLast((frame) => frame.key === key);
  // A replay in a loop repeats its stamps: a step that was taken before belongs to a frame of an earlier round. Several cameras take
  // the same step of the same stamp one right after the other.
  const taken =
    frame && { sensed: frame.sensed !== null, unwrapped: frame.unwrapped !== null, detected: frame.detected.has(node) }[kind];
  if (!frame || (taken && at - frame.at > 500)) {
    const number = (state.counted += 1);
    frame = { key, number, stamp, at, sensed: null, unwrapped: null, detected: new Map(), trusted: null, trust: {}, classes: {} };
    state.frames.push(frame);
    while (state.frames[0].at < at - STRIP_MS) state.frames.shift();
  }
  if (kind === "sensed") frame.sensed ??= at;
  else if (kind === "unwrapped") {
    Object.assign(frame, { unwrapped: at, trusted: body.trusted });
    frame.trust[body.camera] = frame.trust[node] = body;
  } else if (kind === "detected") {
    frame.detected.set(node, at);
    for (const [name, count] of Object.entries(body.classes)) frame.classes[name] = (frame.classes[name] ?? 0) + count;
  }
}

function hearSet(state, { node, name, error }) {
  if (error) state.refusals.set(`${node} ${name}`, error);
  else state.refusals.delete(`${node} ${name}`);
}

// Takes the images of a binary message. Returns the moment that they are a part of.
export function hearImages(state, header, files) {
  advance(state, header.at_ms);
  const { camera } = header;
  const images = header.images.map((image, index) => ({ ...image, camera, key: stampKey(image.stamp), file: files[index] }));
  for (const image of images) state.newest.set(image.topic, image);
  const isShown = ({ topic, stream }) => topicsOf(state).includes(topic) || topic.endsWith("/confidence") || stream === "modulo";
  const before = state.moments.at(-1)?.images.values() ?? [];
  // The images of the other cameras stay.
  const all = header.together
    ? [...[...before].filter((image) => image.camera !== camera && isShown(image)), ...images]
    : [...state.newest.values()].filter(isShown);
  if (all.length === 0) return null;
  const made = header.together ? images : all;
  const latest = made.reduce((best, image) => (stampMs(image.stamp) > stampMs(best.stamp) ? image : best), made[0]);
  const moment = {
    key: latest.key,
    stamp: latest.stamp,
    at: header.at_ms,
    images: new Map(all.map((image) => [image.topic, image])),
  };
  state.moments.push(moment);
  if (!state.recorded && state.moments.length > KEPT_MOMENTS) state.moments.shift();
  return moment;
}

// Takes a picture with another exposure for an image of `moment`. Without new boxes, those of the original exposure stay.
export function takeExposed(state, moment, { of, result: { Ok: exposed, Err: failed } }) {
  const image = moment.images.get(of.topic);
  const original = image.original ?? image;
  const detector = state.graph.detectors.find(({ node }) => node === of.detector)?.topic;
  const file = exposed && { file: fileOf(exposed.jpeg), exposure: of.stops };
  const found = exposed?.boxes && { boxes: [[detector, exposed.boxes]], anew: true };
  moment.images.set(of.topic, { ...original, original, tried: of.stops, why: failed ?? exposed.why, ...file, ...found });
}

const fileOf = (text) => new Blob([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))], { type: "image/jpeg" });

// ---- what follows from it ----

// The request for the next image of `moment` that lacks the exposure that is chosen.
export function exposureWanted(state, moment) {
  const { exposure: stops } = state.choice;
  const images = [...moment.images.values()];
  const lacks = ({ stream, topic, tried = 0 }) => EXPOSED_ANEW.includes(stream) && tried !== stops && topicsOf(state).includes(topic);
  for (const image of images.filter(lacks)) {
    const { topic, stamp, camera, key } = image;
    const modulo = images.find((other) => other.stream === "modulo" && other.camera === camera && other.key === key)?.topic;
    const answered = (detector) => (image.original ?? image).boxes.some(([topic]) => topic === detector.topic);
    const detector = state.graph.detectors.find(answered)?.node ?? null;
    if (modulo) return { topic, modulo, stamp, stops, detector };
  }
  return null;
}

// The image topics that are shown: those that the user has chosen, else those that the viewer offers first.
export const topicsOf = (state) => state.choice.topics ?? state.graph.first;

export function frameOf(state, moment) {
  return state.frames.findLast((frame) => frame.key === moment.key && frame.at <= moment.at);
}

// What people call a frame, or an image of none that has come at a time.
export const nameOf = (state, frame, at = frame.at) =>
  `${frame ? `frame ${frame.number}, ` : ""}${((now(state) - (frame?.at ?? at)) / 1000).toFixed(1)} s ago`;

export function momentOf(state, frame) {
  const isOf = (moment) => moment?.key === frame.key && moment.at >= frame.at;
  let place = state.moments.findIndex(isOf);
  // Cameras in step have moments of one stamp, the last of which shows all of them.
  while (place >= 0 && isOf(state.moments[place + 1])) place += 1;
  return state.moments[place];
}

// How long a frame took to each step, ms; null: not known. Stamps of a recording are no time of this clock.
export function stagesOf(frame) {
  const made = frame.sensed === null ? null : frame.sensed - stampMs(frame.stamp);
  const detected = frame.detected.size ? Math.max(...frame.detected.values()) : null;
  const before = frame.unwrapped ?? frame.sensed;
  return {
    camera: made !== null && made >= -5 && made < 60_000 ? Math.max(0, made) : null,
    unwrap: frame.unwrapped !== null && frame.sensed !== null ? Math.max(0, frame.unwrapped - frame.sensed) : null,
    detector: detected !== null && before !== null ? Math.max(0, detected - before) : null,
  };
}

export function quantile(values, share) {
  if (values.length === 0) return null;
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

// Messages that a node has left out up to an entry of its history.
export function droppedOf({ values }) {
  return Number(values.dropped_frames ?? 0);
}

// The counts of the last seconds per second: of `key` in the history of a node.
export function rateOf(history, key) {
  const [last, first] = [history.at(-1), history.at(-4) ?? history[0]];
  if (!last || last === first || !(key in last.values)) return null;
  return Math.max(0, (Number(last.values[key]) - Number(first.values[key] ?? 0)) / ((last.at - first.at) / 1000));
}

// What a node is worth a look for: "gone" after a crash, "skips" when it leaves frames out, "warns", or "runs".
export function healthOf(state, name) {
  const node = state.nodes.get(name);
  if (!node || node.goneAt !== null) return "gone";
  const last = node.history.at(-1);
  if (!last) return "starts";
  if (last.level >= 2) return "fails";
  const before = node.history.findLast(({ at }) => at < last.at - 5000) ?? node.history[0];
  if (droppedOf(last) > droppedOf(before)) return "skips";
  return last.level === 1 ? "warns" : "runs";
}

// Nodes from the camera on: those that read nothing, those between, and those that nobody reads.
function inOrder(nodes, links) {
  const rank = (name) => (links.some(({ to }) => to === name) ? 1 : 0) + (links.some(({ from }) => from === name) ? 0 : 1);
  return [...nodes].sort((a, b) => rank(a) - rank(b) || (a < b ? -1 : 1));
}

// All nodes that were seen.
export const nodesInOrder = (state) => inOrder(state.nodes.keys(), state.graph.links);

// Nodes that are there, and those that went away a short time ago.
export function visibleNodes(state) {
  const isSeen = ([, { goneAt }]) => goneAt === null || (now(state) - goneAt < GONE_MS && state.graph.nodes.length > 0);
  return [...state.nodes]
    .filter(isSeen)
    .map(([name]) => name)
    .sort();
}

// One sentence when something is not as it should be, else "".
export function noticeOf(state) {
  const gone = visibleNodes(state)
    .filter((name) => state.nodes.get(name).goneAt !== null)
    .map(shortName);
  if (state.link.level === "off") return state.link.text;
  if (state.nodes.size > 0 && state.graph.nodes.length === 0)
    return "The suite has ended. This page goes on when one starts again.";
  if (gone.length) return `Gone: ${gone.join(", ")}. The page goes on as soon as it is back.`;
  const { why } = [...(state.shown?.moment.images.values() ?? [])].find((image) => image.why) ?? {};
  if (why) return `The boxes are those of the original exposure: ${why}.`;
  if (state.graph.player && state.player.paused) return "The replay is paused.";
  const values = (name) => state.graph.nodes.flatMap((node) => state.parameters.get(node) ?? []).filter((one) => one.name === name);
  if (values("model").some(({ value }) => value === "demo") && values("source").some(({ value }) => !value.startsWith("scene://")))
    return "The embedded demonstration model knows rendered scenes only, and finds what is not there: set model to a real one.";
  return state.error;
}

// The sensor of the camera in the namespace of a topic or a node, if it has described itself.
export function sensorOf(state, name) {
  return state.statuses.get(`${namespaceOf(name)}/sensor_info`) ?? {};
}

// The only node that has a settable parameter of this name.
export function find(state, name) {
  const parameterOf = (node) => state.parameters.get(node)?.find((parameter) => parameter.name === name && !parameter.read_only);
  const [node, ...others] = state.graph.nodes.filter(parameterOf);
  return node && !others.length ? { node, parameter: parameterOf(node) } : null;
}
