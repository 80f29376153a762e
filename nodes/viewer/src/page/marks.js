// Boxes and their labels on an image.

import { fitted } from "./dom.js";
import { place } from "./plates.js";

// The colours of common classes are those of the suite's pictures; other names share them (FNV-1a, as there).
const COLOURS = [
  ["#ff9f1c", "car"],
  ["#ff4d8d", "pedestrian", "person"],
  ["#00c896", "cyclist", "rider"],
  ["#4cb4ff", "van"],
  ["#b07cff", "truck"],
  ["#e85020", "bus"],
  ["#a8d830", "bicycle", "bike"],
  ["#20d8e8", "motorcycle", "motorbike"],
  ["#3a6cf0", "tram", "train"],
  ["#f4e430", "traffic light"],
  ["#e090d8", "traffic sign", "stop sign"],
  ["#c09060", "dog"],
];

const groupColour = (name) => COLOURS.find(([, ...names]) => names.includes(name.toLowerCase()))?.[0];

export function classColour(name) {
  if (groupColour(name)) return groupColour(name);
  let hash = 0x811c9dc5;
  for (const byte of new TextEncoder().encode(name)) hash = Math.imul(hash ^ byte, 0x01000193) >>> 0;
  return COLOURS[hash % COLOURS.length][0];
}

const LABEL_PX = 11;

// Draws on a canvas of `width` x `height` px of the page. Boxes with a score below `choice.score` have thin lines and no label.
export function drawMarks(canvas, image, [width, height], choice, withLabels) {
  const context = fitted(canvas, width, height);
  if (!image) return;
  const { scale, origin } = choice.zoom;
  const sides = [
    [width, image.width],
    [height, image.height],
  ];
  const onScreen = ({ edges }) =>
    edges.map((edge, side) => (edge / sides[side % 2][1] - origin[side % 2]) * scale * sides[side % 2][0]);
  if (choice.truth) image.truth.forEach((label) => outline(context, onScreen(label), "#ffffff", 1.5, [5, 4]));
  if (!choice.boxes) return;
  const boxes = image.boxes.flatMap(([, found]) => found).sort((a, b) => b.score - a.score);
  for (const box of [...boxes].reverse())
    outline(context, onScreen(box), classColour(box.class), box.score >= choice.score ? 2 : 1, []);
  if (withLabels)
    drawLabels(
      context,
      boxes.filter((box) => box.score >= choice.score && isSeen(onScreen(box), [width, height])),
      onScreen,
      [width, height],
    );
}

const isSeen = ([left, top, right, bottom], [width, height]) => right > 0 && bottom > 0 && left < width && top < height;

const boxesOf = (image, score) => (image?.boxes ?? []).flatMap(([, found]) => found).filter((box) => box.score >= score);

// How many of the labels of an image were found or, where it has none, of the boxes in the ideal image of its moment.
export function scoreOf(image, ideal, score) {
  const wanted = image.truth.length || image === ideal ? image.truth : boxesOf(ideal, score);
  const found = `found ${foundOf(boxesOf(image, score), wanted)} of ${wanted.length}`;
  return wanted.length ? found + (image.truth.length ? "" : " of /ideal") : "";
}

// How many of `wanted` have a box of their own: of the same class or its other name, with an overlap of one half.
function foundOf(boxes, wanted) {
  const free = new Set(boxes);
  const group = (box) => groupColour(box.class) ?? box.class;
  const area = ([left, top, right, bottom]) => Math.max(0, right - left) * Math.max(0, bottom - top);
  const overlap = ({ edges: a }, { edges: b }) => {
    const both = area(a.map((edge, side) => (side < 2 ? Math.max(edge, b[side]) : Math.min(edge, b[side]))));
    return both / (area(a) + area(b) - both);
  };
  const isFound = (label) => {
    const [best] = [...free].filter((box) => group(box) === group(label)).sort((a, b) => overlap(label, b) - overlap(label, a));
    return best && overlap(label, best) >= 0.5 && free.delete(best);
  };
  return wanted.filter(isFound).length;
}

// A dark line around each line separates it from bright images.
function outline(context, [left, top, right, bottom], colour, line, dashes) {
  for (const [style, thickness] of [
    ["rgb(0 0 0 / 0.55)", line + 1.5],
    [colour, line],
  ]) {
    context.setLineDash(style === colour ? dashes : []);
    context.strokeStyle = style;
    context.lineWidth = thickness;
    if (style === colour || dashes.length === 0) context.strokeRect(left, top, right - left, bottom - top);
  }
  context.setLineDash([]);
}

function drawLabels(context, boxes, onScreen, size) {
  context.font = `600 ${LABEL_PX}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  const texts = boxes.map((box) => `${box.class} ${box.score.toFixed(2)}`);
  const sizes = texts.map((text) => [Math.ceil(context.measureText(text).width) + 6, LABEL_PX + 3]);
  place(boxes.map(onScreen), sizes, size).forEach((area, index) => {
    if (!area) return;
    const [left, top, right, bottom] = area;
    context.fillStyle = classColour(boxes[index].class);
    connect(context, onScreen(boxes[index]), area);
    context.fillRect(left, top, right - left, bottom - top);
    context.fillStyle = "#101010";
    context.fillText(texts[index], left + 3, (top + bottom) / 2 + 0.5);
  });
}

// A line from a box to a label that does not touch it.
function connect(context, box, label) {
  const nearest = (at, [left, top, right, bottom]) => [
    Math.min(Math.max(at[0], left), right),
    Math.min(Math.max(at[1], top), bottom),
  ];
  const from = nearest([(label[0] + label[2]) / 2, (label[1] + label[3]) / 2], box);
  const to = nearest(from, label);
  if (Math.hypot(from[0] - to[0], from[1] - to[1]) <= 1) return;
  context.strokeStyle = context.fillStyle;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
}
