"""AP50 of one class after another: one-to-one matching, ignore regions.

An object counts when it is at least 12 px high and at least half visible
(occlusion + truncation <= 0.5); all others are ignore regions of their class:
found or not, they neither help nor harm.
"""
import numpy as np

from net import CLASSES

IOU = 0.5


def overlap(a, b):
    """IoU of [n,4] and [m,4]."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    inter = np.prod(np.clip(high - low, 0, None), 2)
    area = lambda x: np.prod(np.clip(x[:, 2:] - x[:, :2], 0, None), 1)
    return inter / np.maximum(area(a)[:, None] + area(b)[None] - inter, 1e-9)


def match(found, truth):
    """(score, hit) of each detection of one class in one image, and the number of counted objects."""
    counts = (truth[:, 4] - truth[:, 2] >= 12.0) & (truth[:, 5] + truth[:, 6] <= 0.5)
    iou = overlap(found[:, :4], truth[:, 1:5]) if len(truth) and len(found) else np.zeros((len(found), len(truth)))
    used, marks = np.zeros(len(truth), bool), []
    for i in np.argsort(-found[:, 4], kind="stable"):
        free = np.where(used | ~counts, 0.0, iou[i])
        best = int(free.argmax()) if len(free) else -1
        if best >= 0 and free[best] >= IOU:
            used[best] = True
            marks.append((found[i, 4], 1))
        elif not len(truth) or iou[i][~counts].max(initial=0.0) < IOU:
            marks.append((found[i, 4], 0))
    return marks, int(counts.sum())


def average_precision(marks, total):
    """Area under the interpolated precision-recall curve, NaN without objects."""
    if total == 0:
        return float("nan")
    marks = sorted(marks, key=lambda m: -m[0])
    hits = np.cumsum([m[1] for m in marks]) if marks else np.zeros(0)
    precision = hits / np.arange(1, len(marks) + 1)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    recall = np.concatenate([[0.0], hits / total])
    return float(np.sum(np.diff(recall) * precision))


def ap50(detections, truths):
    """Mean over the classes present, and each class's AP, of a list of images."""
    each = []
    for kind in range(len(CLASSES)):
        marks, total = [], 0
        for found, truth in zip(detections, truths):
            m, n = match(found[found[:, 5] == kind], truth[truth[:, 0] == kind])
            marks += m
            total += n
        each.append(average_precision(marks, total))
    return float(np.nanmean(each)), each
