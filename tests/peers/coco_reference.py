"""AP by pycocotools on synthetic boxes, the peer that eval/ap/src/average.rs compares with.

Boxes lie on quarter pixels, so that both sides read the same numbers; no image and no data set is needed.

    pip install pycocotools==2.0.10 numpy
    python tests/peers/coco_reference.py > eval/ap/tests/data/coco_golden.json
"""

import contextlib
import io
import json
import random

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

IMAGES = 12


def box(rng):
    w, h = rng.randrange(8, 400) / 4, rng.randrange(8, 400) / 4
    return [rng.randrange(0, 1600) / 4, rng.randrange(0, 800) / 4, w, h]


def near(rng, bbox, jitter):
    moved = [side + rng.randrange(-jitter, jitter + 1) / 4 for side in bbox]
    return [moved[0], moved[1], max(moved[2], 1.0), max(moved[3], 1.0)]


def case(seed, jitter, crowds, extra):
    """Objects, detections near most of them, and some that are nowhere; image 0 has more than 100."""
    rng = random.Random(seed)
    images = []
    for number in range(IMAGES):
        truth = [box(rng) + [int(rng.random() < crowds)] for _ in range(rng.randrange(0, 9))]
        found = []
        for *bbox, crowd in truth:
            for _ in range(rng.choice([0, 1, 1, 2]) + 3 * crowd):
                found.append(near(rng, bbox, jitter) + [rng.randrange(2**14, 2**16) / 2**16])
        for _ in range(extra if number else 120):
            found.append(box(rng) + [rng.randrange(1, 2**15) / 2**16])
        images.append({"truth": truth, "found": found})
    return images


def evaluate(images):
    truth = {"info": {}, "images": [], "categories": [{"id": 1}], "annotations": []}
    found = []
    for number, image in enumerate(images):
        truth["images"].append({"id": number})
        for *bbox, crowd in image["truth"]:
            annotation = {"image_id": number, "category_id": 1, "bbox": bbox, "iscrowd": crowd}
            annotation.update(id=len(truth["annotations"]) + 1, area=bbox[2] * bbox[3])
            truth["annotations"].append(annotation)
        found += [{"image_id": number, "category_id": 1, "bbox": f[:4], "score": f[4]} for f in image["found"]]
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO()
        coco.dataset = truth
        coco.createIndex()
        run = COCOeval(coco, coco.loadRes(found), "bbox")
        run.evaluate()
        run.accumulate()
    precision = run.eval["precision"][:, :, 0, 0, 2]
    return {"ap50": float(np.mean(precision[0])), "ap50_95": float(np.mean(precision)),
            "precision50": [float(p) for p in precision[0]]}


cases = []
for arguments in [(1, 8, 0.0, 3), (2, 20, 0.0, 6), (3, 8, 0.3, 4), (4, 40, 0.1, 2), (5, 2, 0.5, 0)]:
    images = case(*arguments)
    cases.append({"images": images, **evaluate(images)})
print(json.dumps(cases, separators=(",", ":")))
