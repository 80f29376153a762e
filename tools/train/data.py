"""Training pictures: exported scenes, blurred, brightened, flipped, cropped.

`ideal` shows the ideal stream only, `modulo` wrapped images only, and `mixture` each of them with a chance of one half.
"""
import csv
import os

import numpy as np
import torch
from torch.nn import functional as F

from net import CLASSES, STRIDE

HEIGHT, WIDTH = 192, 640
MIN_HEIGHT = 12.0  # px; smaller objects are ignored
FIRST_SEED = 4000  # the seeds below are those of evaluations
WRAPPED = {"ideal": 0.0, "modulo": 1.0, "mixture": 0.5}  # share of modulo images
HEADROOM, PEAK = 0.97, 256.0  # the default of the camera, and 2^8


class Scenes:
    """The folder that `export_scenes` wrote."""

    def __init__(self, folder):
        size = os.path.getsize(os.path.join(folder, "images.u8")) // (HEIGHT * WIDTH * 3)
        self.images = np.memmap(os.path.join(folder, "images.u8"), np.uint8, "r", shape=(size, HEIGHT, WIDTH, 3))
        self.labels = [[] for _ in range(size)]
        self.keys = [None] * size
        with open(os.path.join(folder, "labels.csv"), newline="") as file:
            for row in csv.DictReader(file):
                image = int(row["image"])
                if image >= size:
                    continue
                self.keys[image] = (row["preset"], int(row["seed"]), int(row["frame"]))
                if int(row["class"]) >= 0:
                    box = [float(row[k]) for k in ("x1", "y1", "x2", "y2", "occlusion", "truncation")]
                    self.labels[image].append([int(row["class"])] + box)
        self.labels = [np.array(rows, np.float32).reshape(-1, 7) for rows in self.labels]

    def may_train(self):
        """Refuses the seeds of evaluations."""
        seen = sorted({key[1] for key in self.keys if key[1] < FIRST_SEED})
        if seen:
            raise SystemExit(f"seed {seen[0]} is one of evaluations; training takes seeds from {FIRST_SEED} up")
        return self


def gaussian(sigma):
    at = torch.arange(-4, 5, dtype=torch.float32)
    k = torch.exp(-0.5 * (at / sigma) ** 2)
    return k / k.sum()


def blur(x, sigma):
    """Gaussian blur of [B,3,H,W], borders repeated."""
    k = gaussian(sigma).to(x)
    c = x.shape[1]
    x = F.conv2d(F.pad(x, (4, 4, 0, 0), mode="replicate"), k.view(1, 1, 1, 9).expand(c, 1, 1, 9), groups=c)
    return F.conv2d(F.pad(x, (0, 0, 4, 4), mode="replicate"), k.view(1, 1, 9, 1).expand(c, 1, 9, 1), groups=c)


def sample(scenes, index, crop, rng):
    """One random view: [3,H,crop] in [0,1] and its labels."""
    image, labels = scenes.images[index], scenes.labels[index].copy()
    left = int(rng.integers(0, WIDTH - crop + 1))
    x = torch.from_numpy(np.ascontiguousarray(image[:, left:left + crop])).permute(2, 0, 1).float() / 255.0
    labels[:, [1, 3]] -= left
    inside = np.clip(labels[:, [1, 3]], 0, crop)
    width = np.maximum(labels[:, 3] - labels[:, 1], 1e-3)
    lost = 1.0 - (inside[:, 1] - inside[:, 0]) / width
    labels[:, 6] = 1.0 - (1.0 - labels[:, 6]) * (1.0 - lost)
    labels[:, [1, 3]] = inside
    labels = labels[inside[:, 1] - inside[:, 0] > 1.0]
    if rng.random() < 0.5:
        x = x.flip(2)
        labels[:, [1, 3]] = crop - labels[:, [3, 1]]
    return x, labels


def degrade(x, rng):
    """Optics and exposure: blur of 0 or 0.6 to 1.4 px, gain 0.7 to 4, noise, 8 bit."""
    if rng.random() < 0.75:
        x = blur(x, float(rng.uniform(0.6, 1.4)))
    gain = torch.ones(x.shape[0], 1, 1, 1)
    for i in range(x.shape[0]):
        if rng.random() < 0.25:
            gain[i] = float(np.exp(rng.uniform(np.log(0.7), np.log(4.0))))
    x = x * gain + torch.randn_like(x) * (float(rng.uniform(0.0, 1.2)) / 255.0)
    return torch.round(x.clamp(0, 1) * 255.0) / 255.0


def wrap(x, rng):
    """Modulo images of 8 bits (crates/core/src/sensor.rs): blur of 0.6 to 1.4 px, alpha 1.5 to 8, noise, wrap.

    The source has 8 bits, which are fewer than those of alpha * 2^8 codes: noise within one of its steps fills them.
    """
    x = blur(x + (torch.rand_like(x) - 0.5) / 255.0, float(rng.uniform(0.6, 1.4))).clamp(0, 1)
    alpha = torch.from_numpy(np.exp(rng.uniform(np.log(1.5), np.log(8.0), (x.shape[0], 1, 1, 1))).astype(np.float32))
    x = HEADROOM * alpha * PEAK * x + torch.randn_like(x) * float(rng.uniform(0.0, 1.2))
    return torch.floor(x.clamp(min=0) % PEAK) / 255.0


def shown(x, images, rng):
    """The views of a batch as the detector gets them; `images` is a key of WRAPPED."""
    wrapped = rng.binomial(len(x), WRAPPED[images])
    parts = ((wrap, x[:wrapped]), (degrade, x[wrapped:]))
    return torch.cat([camera(part, rng) for camera, part in parts if len(part)])


def targets(labels, height, width):
    """Heat map [5,h,w], its weight, box distances [4,h,w] px and their weight [h,w]."""
    h, w = height // STRIDE, width // STRIDE
    heat, weight = np.zeros((len(CLASSES), h, w), np.float32), np.ones((len(CLASSES), h, w), np.float32)
    box, near = np.zeros((4, h, w), np.float32), np.zeros((h, w), np.float32)
    xs, ys = (np.arange(w) + 0.5) * STRIDE, (np.arange(h) + 0.5) * STRIDE
    order = np.argsort(labels[:, 4] - labels[:, 2])[::-1]
    for kind, x1, y1, x2, y2, occlusion, truncation in labels[order]:
        cx, cy, bw, bh = (x1 + x2) / 2, (y1 + y2) / 2, x2 - x1, y2 - y1
        sx, sy = max(bw * 0.12, 1.6), max(bh * 0.12, 1.6)
        bump = np.exp(-0.5 * (((ys - cy) / sy) ** 2)[:, None] - 0.5 * (((xs - cx) / sx) ** 2)[None])
        if bh < MIN_HEIGHT * 0.75 or occlusion + truncation > 0.65:
            weight[int(kind)][bump > 0.05] = 0.0
            continue
        col, row = min(int(cx / STRIDE), w - 1), min(int(cy / STRIDE), h - 1)
        bump[row, col] = 1.0
        unsure = bh < MIN_HEIGHT or occlusion + truncation > 0.5
        kept = heat[int(kind)]
        stronger = bump > kept
        kept[stronger] = bump[stronger]
        weight[int(kind)][stronger & (bump > 0.05)] = 0.5 if unsure else 1.0
        inner = (bump > 0.55) & (bump > near)
        dist = [xs[None] - x1 + 0 * ys[:, None], ys[:, None] - y1 + 0 * xs[None],
                x2 - xs[None] + 0 * ys[:, None], y2 - ys[:, None] + 0 * xs[None]]
        inner &= np.minimum.reduce(dist) > 0.2
        for k in range(4):
            box[k][inner] = dist[k][inner]
        near[inner] = bump[inner]
    return heat, weight, box, near


def batch(scenes, indices, crop, rng, images):
    """A batch ready for `loss`."""
    views = [sample(scenes, i, crop, rng) for i in indices]
    x = shown(torch.stack([v[0] for v in views]), images, rng)
    goals = [targets(v[1], HEIGHT, crop) for v in views]
    return (x, *(torch.from_numpy(np.stack([g[k] for g in goals])) for k in range(4)))
