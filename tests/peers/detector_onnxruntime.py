#!/usr/bin/env python3
"""Compares the detector's boxes with those of PyPI's onnxruntime.

    detect_images MODEL ENGINE FOLDER > ours.json
    detector_onnxruntime.py FOLDER MODEL ours.json

Nothing of the detector is used here: OpenCV reads and pads the images (to
multiples of 32, right and below, grey 114), and onnxruntime runs the model.
`ours.json` is {"image.png": [[x1, y1, x2, y2, score, "class"], ...]}.
Exit code 1 when a count differs, a box overlaps its peer by less than 0.99 or
a score differs by more than 0.002.
Needs: pip install onnxruntime opencv-python-headless numpy
"""
import argparse
import ast
import json
import pathlib
import sys

import cv2
import numpy as np
import onnxruntime

LEAST_SIDE = 128
LEAST_IOU = 0.99
MOST_SCORE = 0.002


def padded(side):
    return max(-(-side // 32) * 32, LEAST_SIDE)


def peer_boxes(session, names, path, threshold):
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    below, right = padded(height) - height, padded(width) - width
    image = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114))
    tensor = cv2.cvtColor(image, cv2.COLOR_BGR2RGB).transpose(2, 0, 1)[None].astype(np.float32) / 255
    rows = session.run(None, {session.get_inputs()[0].name: np.ascontiguousarray(tensor)})[0][0]
    rows = rows[rows[:, 4] >= threshold]
    rows[:, :4] = rows[:, :4].clip(0, [width, height, width, height])
    return [[*row[:5].tolist(), names.get(int(row[5]), str(int(row[5])))] for row in rows]


def iou(a, b):
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    common = max(width, 0) * max(height, 0)
    area = lambda box: (box[2] - box[0]) * (box[3] - box[1])
    return common / (area(a) + area(b) - common)


def compare(ours, theirs):
    """(least IoU, largest score difference) over the best partner of each box."""
    least, most = 1.0, 0.0
    left = list(theirs)
    for box in ours:
        same = [other for other in left if other[5] == box[5]]
        if not same:
            return 0.0, 1.0
        best = max(same, key=lambda other: iou(box, other))
        left.remove(best)
        least, most = min(least, iou(box, best)), max(most, abs(box[4] - best[4]))
    return least, most


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("model")
    parser.add_argument("ours", type=pathlib.Path)
    parser.add_argument("--threshold", type=float, default=0.25)
    options = parser.parse_args()
    session = onnxruntime.InferenceSession(options.model, providers=["CPUExecutionProvider"])
    names = ast.literal_eval(session.get_modelmeta().custom_metadata_map.get("names", "{}"))
    ours = json.loads(options.ours.read_text())
    images = sorted(path for path in options.folder.iterdir() if path.name in ours)
    if not images or len(images) != len(ours):
        sys.exit(f"{len(ours)} images in {options.ours}, {len(images)} of them in {options.folder}")
    counts, least, most = [0, 0], 1.0, 0.0
    for path in images:
        theirs = peer_boxes(session, names, path, options.threshold)
        mine = [box for box in ours[path.name] if box[4] >= options.threshold]
        counts = [counts[0] + len(mine), counts[1] + len(theirs)]
        overlap, score = compare(mine, theirs) if len(mine) == len(theirs) else (0.0, 1.0)
        if overlap < LEAST_IOU or score > MOST_SCORE:
            print(f"{path.name}: {len(mine)} boxes against {len(theirs)}, IoU {overlap:.4f}, score {score:.5f}")
        least, most = min(least, overlap), max(most, score)
    print(f"onnxruntime {onnxruntime.__version__}, {len(images)} images: {counts[0]} boxes against {counts[1]}, "
          f"least IoU {least:.6f}, largest score difference {most:.6f}")
    sys.exit(least < LEAST_IOU or most > MOST_SCORE)


if __name__ == "__main__":
    main()
