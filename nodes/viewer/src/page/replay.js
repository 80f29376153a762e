// The transport of a replayed bag, and the parameters that are changed most.

import { byId, labelled, make, offer, write } from "./dom.js";
import { find } from "./state.js";

export class Replay {
  constructor(actions) {
    this.toggle = make("button", { type: "button", title: "Key: p", onclick: () => actions.player("toggle") });
    this.next = make("button", {
      type: "button",
      title: "Key: n",
      textContent: "Next message",
      onclick: () => actions.player("next"),
    });
    const number = (name, least) =>
      make("input", {
        type: "number",
        min: least,
        step: "any",
        onchange: (event) => actions.player({ [name]: Number(event.target.value) }),
      });
    [this.rate, this.seek] = [number("rate", 0.01), number("seek", 0)];
    this.state = make("span", { role: "status" });
    byId("replay").append(this.toggle, this.next, labelled("Speed", this.rate), labelled("Go to, s", this.seek), this.state);
  }

  draw({ graph, player }) {
    byId("replay").hidden = !graph.player;
    write(this.toggle, `${player.paused ? "Play" : "Pause"} the replay`);
    this.next.disabled = !player.paused;
    write(this.state, `${player.paused ? "paused" : "playing"} at speed ${player.rate}`);
    if (document.activeElement !== this.rate) this.rate.value = player.rate;
  }
}

// What a single node has is changed in the header: with several detectors, nobody could say whose input is meant.
export class Quick {
  constructor(actions) {
    this.actions = actions;
    this.input = make("select", { id: "input" });
    this.method = make("select", { id: "method" });
    this.alpha = make("input", { id: "alpha", type: "range", step: 0.1 });
    this.value = make("output");
    const alpha = make("label", { className: "control" }, make("span", { textContent: "Alpha" }), this.alpha, this.value);
    byId("quick").append(labelled("Detector input", this.input), labelled("Method", this.method), alpha);
  }

  draw(state) {
    const [input, method] = [find(state, "input"), find(state, "method")];
    // The value that is set stays in the list, even if there is no such topic now.
    const offers = input && state.graph.detectors.find(({ node }) => node === input.node)?.offers;
    this.drawList(this.input, input, offers ?? []);
    this.drawList(this.method, method, method?.parameter.words ?? []);
    // Only the camera's alpha changes the image; of the others, 0 means that of the camera.
    const camera = find(state, "source");
    const alpha = camera && state.parameters.get(camera.node).find(({ name }) => name === "alpha");
    this.alpha.parentElement.hidden = !alpha;
    if (!alpha) return;
    const [least, most] = alpha.range ?? [1, 16];
    Object.assign(this.alpha, { min: Math.max(1, least), max: Math.min(16, most) });
    if (document.activeElement !== this.alpha) this.alpha.value = alpha.value;
    write(this.value, alpha.value);
    this.alpha.onchange = () => this.actions.set(camera.node, "alpha", this.alpha.value);
  }

  drawList(select, found, words) {
    select.parentElement.hidden = !found || words.length === 0;
    if (select.parentElement.hidden) return;
    offer(select, words, found.parameter.value);
    select.onchange = () => this.actions.set(found.node, found.parameter.name, select.value);
  }
}
