// The transport of a replayed bag or of a recorded page, and the parameters that are changed most.

import { byId, labelled, make, offer, write } from "./dom.js";
import { find } from "./state.js";

// Requests of a bar that is dragged are this far apart.
const DRAG_MS = 200;

export class Replay {
  constructor(actions) {
    this.actions = actions;
    this.toggle = make("button", { type: "button", title: "Key: p", onclick: () => actions.player("toggle") });
    this.next = make("button", {
      type: "button",
      title: "Key: n",
      textContent: "Next message",
      onclick: () => actions.player("next"),
    });
    const rate = ({ target }) => actions.player({ rate: Number(target.value) });
    this.rate = make("input", { type: "number", min: 0.01, step: "any", onchange: rate });
    this.bar = make("input", { type: "range", min: 0, ariaLabel: "Time of the recording", oninput: () => this.drag() });
    this.place = make("output");
    this.speed = labelled("Speed", this.rate);
    byId("replay").append(this.toggle, this.next, this.speed, this.bar, this.place);
  }

  // A recorded page has its frames at hand.
  drag() {
    if (this.recorded) return this.actions.showMoment(Number(this.bar.value));
    this.dragged ??= setTimeout(() => {
      this.dragged = null;
      // The time may lie within a frame, whose messages are one of each topic at most: the next frame is whole.
      this.actions.player({ seek: [this.start + Number(this.bar.value), 2 * this.topics] });
    }, DRAG_MS);
  }

  draw({ graph, player, recorded, moments, shown, statuses }) {
    const { start_s, position_s, duration_s, topics } = statuses.get("rosbag2_player") ?? {};
    this.recorded = recorded;
    byId("replay").hidden = !graph.player && !recorded;
    for (const part of [this.toggle, this.next, this.speed]) part.hidden = recorded;
    write(this.toggle, `${player.paused ? "Play" : "Pause"} the replay`);
    this.next.disabled = !player.paused;
    if (document.activeElement !== this.rate) this.rate.value = player.rate;
    if (recorded) {
      const seconds = (moment) => ((moment.at - moments[0].at) / 1000).toFixed(1);
      this.move(moments.indexOf(shown?.moment), moments.length - 1, 1);
      write(this.place, shown ? `${seconds(shown.moment)} of ${seconds(moments.at(-1))} s` : "");
      return;
    }
    // A player of ROS 2 does not tell where it is.
    [this.start, this.topics] = [Number(start_s), Number(topics)];
    this.bar.hidden = !duration_s;
    this.move(position_s, duration_s, "any");
    write(this.place, duration_s ? `${Number(position_s).toFixed(1)} of ${Number(duration_s).toFixed(1)} s` : "");
  }

  move(value, max, step) {
    Object.assign(this.bar, { max, step });
    if (!this.dragged && !this.bar.matches(":active")) this.bar.value = value;
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
