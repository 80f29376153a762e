// The keys of the page, which do what its controls do.

import { byId, make } from "./dom.js";
import { LAYOUTS } from "./stage.js";
import { openTab } from "./tabs.js";

const KEYS = [
  ["1 to 9", "shows or hides a stream"],
  ["l", "changes the layout"],
  ["space", "pauses at this frame, or plays on"],
  ["← →", "show the frame before or after"],
  ["z 0", "zoom in, show whole images; Ctrl and the wheel zoom, too"],
  ["+ −", "change the exposure"],
  ["b t c", "boxes, ground truth, confidence"],
  ["i", "changes the input of the detector"],
  ["p n", "pause a replay, play its next message"],
  ["/", "searches the parameters"],
];

export function listenToKeys(state, actions) {
  byId("keys").append(
    make(
      "dl",
      {},
      ...KEYS.map(([key, does]) => make("div", {}, make("dt", { textContent: key }), make("dd", { textContent: does }))),
    ),
  );
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target.closest?.("input, select, textarea, button, summary, a");
    if (event.key === "Escape") target?.blur();
    else if (target && !(target.type === "checkbox" && event.key !== " ")) return;
    const act = actionOf(event.key, state, actions);
    if (!act) return;
    act();
    event.preventDefault();
  });
}

function actionOf(key, { choice, graph, stopped }, actions) {
  const toggle = (name) => () => actions.choose({ [name]: !choice[name] });
  const number = Number(key);
  if (key !== " " && number >= 1 && number <= graph.images.length) return () => actions.turn(graph.images[number - 1]);
  const layouts = Object.keys(LAYOUTS);
  return {
    l: () => actions.choose({ layout: layouts[(layouts.indexOf(choice.layout) + 1) % layouts.length] }),
    " ": () => actions.stop(!stopped),
    Escape: stopped ? () => actions.stop(false) : null,
    ArrowLeft: () => actions.step(-1),
    ArrowRight: () => actions.step(1),
    z: () => actions.zoom(2),
    0: () => actions.zoom(0),
    "+": () => actions.choose({ exposure: Math.min(6, choice.exposure + 0.5) }),
    "-": () => actions.choose({ exposure: Math.max(-6, choice.exposure - 0.5) }),
    b: toggle("boxes"),
    t: toggle("truth"),
    c: toggle("confidence"),
    i: () => actions.nextInput(),
    p: graph.player ? () => actions.player("toggle") : null,
    n: graph.player ? () => actions.player("next") : null,
    "/": () => {
      openTab("parameters");
      byId("search").focus();
    },
  }[key];
}
