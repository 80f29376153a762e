// Places labels so that they cover neither each other nor, if possible, objects: `crates/draw/src/plates.rs` of the suite in short. An area
// is [left, top, right, bottom].

const shared = (a, b) =>
  Math.max(0, Math.min(a[2], b[2]) - Math.max(a[0], b[0])) * Math.max(0, Math.min(a[3], b[3]) - Math.max(a[1], b[1]));
const sizeOf = (area) => Math.max(1, (area[2] - area[0]) * (area[3] - area[1]));

// Above, below, inside and beside the box; then rings farther and farther away.
function around([left, top, right, bottom], [width, height], ring) {
  if (ring === 0) {
    return [
      [left, top - height],
      [right - width, top - height],
      [left, bottom],
      [right - width, bottom],
      [left, top],
      [right - width, top],
      [left, bottom - height],
      [right, top],
      [left - width, top],
    ];
  }
  const far = 0.5 * height * ring;
  const columns = [left, right - width, (left + right - width) / 2, left - width - far, right + far];
  const sides = [top, bottom - height].flatMap((y) => [
    [right + far, y],
    [left - width - far, y],
  ]);
  return [
    ...columns.flatMap((x) => [
      [x, top - height - far],
      [x, bottom + far],
    ]),
    ...sides,
  ];
}

// The area of each label, that of the first box first; null for a label without a free place.
export function place(boxes, sizes, [width, height]) {
  const placed = [];
  boxes.forEach((box, own) => {
    const size = sizes[own];
    let best = null;
    for (let ring = 0; ring <= 12 && size[0] <= width && size[1] <= height; ring += 1) {
      const least = ring === 0 ? 0 : 0.3 + 0.08 * ring;
      if (best && best.cost <= least) break;
      around(box, size, ring).forEach(([x, y], rank) => {
        const [left, top] = [Math.min(Math.max(x, 0), width - size[0]), Math.min(Math.max(y, 0), height - size[1])];
        const area = [left, top, left + size[0], top + size[1]];
        if (placed.some((other) => other && shared(other, area) > 0)) return;
        const covered = boxes.reduce(
          (sum, other, index) => sum + ((index === own ? 0.5 : 1) * shared(other, area)) / Math.min(sizeOf(other), sizeOf(area)),
          0,
        );
        const cost = least + (ring === 0 ? 0.01 * rank : 0) + covered;
        if (!best || cost < best.cost) best = { cost, area };
      });
    }
    placed.push(best?.area ?? null);
  });
  return placed;
}
