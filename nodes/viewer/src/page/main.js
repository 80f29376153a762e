// The page: messages change the one state, and all parts of the page are drawn from it. A control changes the choices of the user or
// asks for a change of the suite, and shows what the node has answered.

import { byId, write } from "./dom.js";
import { Display } from "./display.js";
import { Graph } from "./graph.js";
import { listenToKeys } from "./keys.js";
import { Parameters } from "./parameters.js";
import { Quick, Replay } from "./replay.js";
import { openSocket, playRecording, recordingText } from "./source.js";
import { Stage } from "./stage.js";
import { addressOf, choiceOf, exposureWanted, find, hear, hearImages, momentOf } from "./state.js";
import { namespaceOf, newState, noticeOf, now, takeExposed, topicsOf, zoomed } from "./state.js";
import { drawTabs } from "./tabs.js";
import { Timeline, nearest } from "./timeline.js";

const TICK_MS = 500;
const PLAYER_MS = 2000;
const LONGEST_WAIT_MS = 1000;
const recording = recordingText();
const state = newState(recording !== null);
if (!state.recorded) Object.assign(state.choice, choiceOf(location.search));

// ---- drawing ----

let isDue = false;

function redraw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    [...views, panels[drawTabs()]].forEach((view) => view.draw(state));
  });
}

const header = {
  draw() {
    const { domain, nodes } = state.graph;
    const isOn = state.link.level === "on" && domain !== undefined && !state.recorded;
    const count = nodes.length === 1 ? "1 node" : `${nodes.length || "no"} nodes`;
    write(byId("link"), isOn ? `Domain ${domain}: ${count}` : state.link.text);
    byId("link").className = isOn && nodes.length === 0 ? "off" : state.link.level;
    write(byId("live"), state.stopped ? "Play" : "Pause");
    const notice = noticeOf(state);
    write(byId("notice"), notice);
    byId("notice").hidden = !notice;
  },
};

// ---- requests ----

let ask = () => {};
let watched = "";
let known = new Set(); // the nodes whose parameters were asked for
let pixelAsked = ""; // what the viewer was asked for
let pixelComes = false; // whether it has yet to answer
let pointed = null; // where the pointer was last on an image

// The confidence of each camera that is shown is needed for its overlay, and its modulo image for another exposure.
function watch() {
  const topics = topicsOf(state);
  const names = [state.choice.confidence && "confidence", state.choice.exposure && "modulo"].filter((name) => name);
  const beside = topics.flatMap((topic) => names.map((name) => `${namespaceOf(topic)}/${name}`));
  const all = [...new Set([...topics, ...beside.filter((topic) => state.graph.images.includes(topic))])];
  if (all.join() === watched) return;
  watched = all.join();
  ask({ watch: all });
}

// The pixel under the pointer in each image that is shown.
function askPixel() {
  const shown = state.shown?.moment.images ?? new Map();
  const image = shown.get(pointed?.topic);
  if (!image || pixelComes) return;
  const [u, v] = pointed.share.map((share, axis) => {
    const size = axis ? image.height : image.width;
    return Math.min(size - 1, Math.max(0, Math.floor(share * size)));
  });
  const place = ({ topic }) => state.graph.images.indexOf(topic);
  const images = [...shown.values()].sort((a, b) => place(a) - place(b));
  const request = { pixel: { u, v, images: images.map(({ topic, stamp }) => [topic, stamp]) } };
  if (JSON.stringify(request) === pixelAsked) return;
  [pixelAsked, pixelComes] = [JSON.stringify(request), true];
  ask(request);
}

// ---- images ----

let decoding = Promise.resolve();
let answerExposed = null; // takes the viewer's answer to a request for another exposure; null: the connection was lost

// Exposes the recovered images of a moment as the slider says, before they are drawn. A recorded page has no counts.
async function expose(moment) {
  for (const { topic, original } of moment.images.values())
    if (original && state.choice.exposure === 0) moment.images.set(topic, original);
  for (let wanted = exposureWanted(state, moment); wanted && !state.recorded; wanted = exposureWanted(state, moment)) {
    const answer = await new Promise((done) => {
      answerExposed = done;
      ask({ expose: wanted });
    });
    if (!answer) return;
    takeExposed(state, moment, answer);
  }
}

// Decodes all images of a moment before any of them is drawn, so that the page shows one moment at a time. Images that are drawn
// already are not decoded again.
async function show(moment) {
  const known = state.shown?.bitmaps ?? new Map();
  const bitmaps = new Map();
  for (const image of moment.images.values()) {
    try {
      bitmaps.set(image, known.get(image) ?? (await createImageBitmap(image.file)));
    } catch (why) {
      state.error = `${image.topic}: the browser cannot show the image: ${why.message}`;
    }
  }
  state.shown = { moment, bitmaps };
  for (const [image, bitmap] of known) if (!bitmaps.has(image)) bitmap.close();
}

function queue(moment, done) {
  decoding = decoding
    .then(() => expose(moment))
    .then(() => show(moment))
    .then(() => {
      redraw();
      askPixel();
      if (done) requestAnimationFrame(done);
    });
}

// While the page is stopped it takes no more images: the viewer makes none, and the kept ones stay.
let held = null;

function takeImages(header, files) {
  const moment = hearImages(state, header, files);
  const drawn = () => ask({ drawn: header.images.map(({ topic }) => topic) });
  if (state.recorded) return;
  if (!moment) drawn();
  else if (state.stopped) held = drawn;
  else
    queue(moment, () => {
      if (state.stopped) held = drawn;
      else drawn();
    });
}

const actions = {
  choose(change) {
    Object.assign(state.choice, change);
    if (!state.recorded) history.replaceState(null, "", addressOf(location, state.choice));
    if ("together" in change) {
      state.newest.clear();
      ask({ together: state.choice.together });
    }
    if ("exposure" in change && state.shown) queue(state.shown.moment);
    watch();
    redraw();
  },
  turn(topic) {
    const shown = topicsOf(state);
    actions.choose({ topics: shown.includes(topic) ? shown.filter((other) => other !== topic) : [...shown, topic] });
  },
  select: (topic) => actions.choose(state.choice.layout === "grid" ? { selected: topic } : { selected: topic, left: topic }),
  open: (topic) => actions.choose({ layout: state.choice.layout === "one" ? "grid" : "one", left: topic, selected: topic }),
  wipe: (share) => actions.choose({ wipe: Math.round(100 * Math.min(1, Math.max(0, share))) }),
  zoom: (factor, share = [0.5, 0.5], at = share) => actions.choose({ zoom: zoomed(state.choice.zoom, factor, share, at) }),
  point(topic, share) {
    pointed = { topic, share };
    askPixel();
  },
  hover(at) {
    state.hover = at;
    redraw();
  },
  stop(stopped) {
    state.stopped = stopped;
    if (state.recorded) playOn(state.moments.indexOf(state.shown?.moment));
    else if (!stopped) {
      held?.();
      held = null;
      if (state.moments.length) queue(state.moments.at(-1));
    }
    redraw();
  },
  stopAt(at) {
    const moment = nearestKept(at);
    if (moment) actions.showMoment(state.moments.indexOf(moment));
  },
  showMoment(place) {
    state.stopped = true;
    queue(state.moments[place]);
  },
  step(by) {
    const place = state.moments.indexOf(state.shown?.moment);
    const last = state.moments.length - 1;
    if (last >= 0) actions.showMoment(Math.min(last, Math.max(0, (place < 0 ? last : place) + by)));
  },
  set: (node, name, value) => ask({ set: { node, name, value: String(value) } }),
  player: (call) => ask({ player: call }),
  nextInput() {
    const found = find(state, "input");
    const offers = found ? (state.graph.detectors.find(({ node }) => node === found.node)?.offers ?? []) : [];
    if (offers.length) actions.set(found.node, "input", offers[(offers.indexOf(found.parameter.value) + 1) % offers.length]);
  },
};

let playing = 0;

// Goes on in a recorded page with the moment behind this place, as long after it as it came; behind the last one is the first one.
function playOn(place) {
  clearTimeout(playing);
  redraw();
  if (state.stopped) return;
  const next = (place + 1) % state.moments.length;
  const wait = state.moments[next].at - (state.moments[place]?.at ?? 0);
  const show = () => {
    if (!state.stopped) queue(state.moments[next], () => playOn(next));
  };
  playing = setTimeout(show, Math.min(LONGEST_WAIT_MS, Math.abs(wait)));
}

// The kept moment of the frame at a time of the strip, else the kept one that is nearest to it.
function nearestKept(at) {
  const frame = nearest(state.frames, at);
  return (
    (frame && momentOf(state, frame)) ??
    state.moments.reduce((best, moment) => (best && Math.abs(best.at - at) <= Math.abs(moment.at - at) ? best : moment), null)
  );
}

// ---- messages ----

function takeEvent(event, at) {
  const kind = hear(state, event, at);
  if (kind === "graph") {
    for (const node of state.graph.nodes.filter((node) => !known.has(node))) ask({ parameters: node });
    known = new Set(state.graph.nodes);
    watch();
  }
  // Shown is what the node has now, whether it took the value or not.
  if (kind === "set") ask({ parameters: event.set.node });
  if (kind === "pixel") {
    pixelComes = false;
    askPixel();
  }
  if (kind === "exposed") answerExposed?.(event.exposed);
  redraw();
}

const listen = {
  event: takeEvent,
  images: takeImages,
  opened() {
    // The answers to what was asked before are lost, and the parameters may have changed: all nodes are new to this socket.
    [watched, known, pixelAsked, pixelComes, held] = ["", new Set(), "", false, null];
    answerExposed?.(null);
    state.link = { text: "connected", level: "on" };
    ask({ together: state.choice.together });
    watch();
    redraw();
  },
  closed(why) {
    state.link = { text: why || "The viewer has gone; trying again.", level: "off" };
    redraw();
  },
};

const views = [header, new Stage(actions), new Quick(actions), new Replay(actions)];
const panels = {
  look: new Display(actions),
  time: new Timeline(actions),
  nodes: new Graph(),
  parameters: new Parameters(actions),
};
listenToKeys(state, actions);
byId("live").onclick = () => actions.stop(!state.stopped);
addEventListener("resize", redraw);
addEventListener("hashchange", redraw);

if (state.recorded) {
  document.documentElement.classList.add("recorded");
  playRecording(recording, listen);
  state.stopped = true;
  if (state.moments.length) queue(state.moments.at(-1));
  redraw();
} else {
  ask = openSocket(listen);
  // The strip moves on, and what is missing is told, when no message comes.
  setInterval(() => {
    if (now(state)) redraw();
  }, TICK_MS);
  setInterval(() => {
    if (state.graph.player) ask({ player: "state" });
  }, PLAYER_MS);
}
