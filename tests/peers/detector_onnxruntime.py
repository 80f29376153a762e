#!/usr/bin/env python3
"""Compares the detector's boxes with those of PyPI's onnxruntime and OpenCV.

    detector_onnxruntime.py MODULO [MODEL FOLDER [THRESHOLD]]

The images of FOLDER are PNG. Without a MODEL, small heads of
each form are made, whose boxes are known. Nothing of the detector is used on
the other side: OpenCV reads and pads the images (to multiples of 32, right and
below, or centred in the size of the model, grey 114), onnxruntime runs the
model, and OpenCV removes overlapping boxes (NMSBoxesBatched).
Exit code 1 when boxes are missing or too many. A box is the same within
0.5 px and a score within 0.001.
Needs: pip install onnxruntime opencv-python-headless onnx numpy
"""
import ast
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import onnxruntime

LEAST_SIDE = 128
MOST_PX = 0.5
MOST_SCORE = 0.001
NMS_IOU = 0.7
MAX_DET = 300
LIBRARY = next((pathlib.Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so*"))


def ours(program, model, folder, threshold):
    environment = {**os.environ, "ORT_DYLIB_PATH": str(LIBRARY)}
    found = {path.name: [] for path in pathlib.Path(folder).glob("*.png")}
    with tempfile.TemporaryDirectory() as out:
        command = [program, "detect", folder, "--model", model, "-o", out, "--save-coco", "engine:=ort", f"score_threshold:={threshold}"]
        finished = subprocess.run(command, env=environment, capture_output=True, text=True)
        if finished.returncode:
            sys.exit(finished.stderr)
        for one in json.loads((pathlib.Path(out) / "predictions.json").read_text()):
            x, y, width, height = one["bbox"]
            found[one["file_name"]].append([x, y, x + width, y + height, one["score"], one["category_name"]])
    return found


def padded(image, size):
    """The image in the input of the model, and the place of its upper left corner."""
    height, width = image.shape[:2]
    if isinstance(size[0], int):
        (below, right), (top, left) = (size[0] - height, size[1] - width), ((size[0] - height) // 2, (size[1] - width) // 2)
    else:
        below, right = (max(-(-side // 32) * 32, LEAST_SIDE) - side for side in (height, width))
        top, left = 0, 0
    grey = (114, 114, 114)
    return cv2.copyMakeBorder(image, top, below - top, left, right - left, cv2.BORDER_CONSTANT, value=grey), (top, left)


def candidates(output, classes):
    """Rows of x1, y1, x2, y2, score, class of an output of any form, and whether they overlap."""
    if output.shape[1] == 6 and classes != 1:
        return output, False
    anchors = output.T if output.shape[0] == 4 + classes else output
    scores = anchors[:, 4:] if output.shape[0] == 4 + classes else anchors[:, 4:5] * anchors[:, 5:]
    centre, half = anchors[:, :2], anchors[:, 2:4] / 2
    return np.column_stack([centre - half, centre + half, scores.max(1), scores.argmax(1)]), True


def theirs(session, names, path, threshold):
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    port = session.get_inputs()[0]
    tensor, (top, left) = padded(image, port.shape[2:])
    tensor = cv2.cvtColor(tensor, cv2.COLOR_BGR2RGB).transpose(2, 0, 1)[None].astype(np.float32) / 255
    tensor = np.ascontiguousarray(tensor, np.float16 if port.type == "tensor(float16)" else np.float32)
    output = session.run(None, {port.name: tensor})[0][0].astype(np.float32)
    rows, overlap = candidates(output, len(names))
    rows = rows[rows[:, 4] >= threshold]
    if overlap and len(rows):
        boxes = np.column_stack([rows[:, :2], rows[:, 2:4] - rows[:, :2]]).astype(float)
        classes = rows[:, 5].astype(int).tolist()
        # OpenCV leaves out a score that equals its threshold.
        kept = cv2.dnn.NMSBoxesBatched(boxes.tolist(), rows[:, 4].tolist(), classes, 0.0, NMS_IOU)
        rows = rows[kept[:MAX_DET]]
    rows[:, :4] = (rows[:, :4] - [left, top, left, top]).clip(0, [width, height, width, height])
    rows = rows[(rows[:, 2] > rows[:, 0]) & (rows[:, 3] > rows[:, 1])]
    return [[*row[:5].tolist(), names.get(int(row[5]), str(int(row[5])))] for row in rows]


def differences(mine, other):
    """Boxes of one side without the same box on the other side."""
    left, alone = list(other), []
    for box in mine:
        same = (one for one in left if one[5] == box[5] and abs(one[4] - box[4]) <= MOST_SCORE
                and max(abs(a - b) for a, b in zip(one[:4], box[:4])) <= MOST_PX)
        partner = next(same, None)
        if partner is None:
            alone.append(box)
        else:
            left.remove(partner)
    return alone + left


def compare(program, model, folder, threshold="0.25"):
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    names = ast.literal_eval(session.get_modelmeta().custom_metadata_map["names"])
    found = ours(program, model, folder, threshold)
    assert found, f"no image in {folder}"
    count, wrong = 0, []
    for name, boxes in sorted(found.items()):
        expected = theirs(session, names, pathlib.Path(folder) / name, float(threshold))
        count += len(expected)
        wrong += [f"{name}: {box}" for box in differences(boxes, expected)]
    print(f"onnxruntime {onnxruntime.__version__}, OpenCV {cv2.__version__}, {pathlib.Path(model).name}: {len(found)} images, "
          f"{count} boxes, {len(wrong)} of one side alone")
    print("\n".join(wrong[:10]), end="\n" if wrong else "")
    return not wrong and count > 0


def small_head(folder, name, output, kind):
    """A model that always gives this output, with the three names person, bicycle, car, in numbers of this kind."""
    from onnx import TensorProto, helper, numpy_helper

    nodes = [
        helper.make_node("ReduceMean", ["images"], ["mean"], axes=[0, 1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["boxes", "nothing"], ["output0"]),
    ]
    output = np.asarray(output, kind)[None]
    element = TensorProto.FLOAT if kind is np.float32 else TensorProto.FLOAT16
    graph = helper.make_graph(
        nodes, "head", [helper.make_tensor_value_info("images", element, [1, 3, "height", "width"])],
        [helper.make_tensor_value_info("output0", element, output.shape)],
        [numpy_helper.from_array(output, "boxes"), numpy_helper.from_array(kind(0), "zero")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"names": "{0: 'person', 1: 'bicycle', 2: 'car'}"})
    (folder / name).write_bytes(model.SerializeToString())
    return str(folder / name)


def known(program):
    """Each form of a head with the same boxes: a car, a worse copy of it, a person in its place, and a bicycle."""
    expected = [[20, 10, 60, 40, 0.9, "car"], [20, 10, 60, 40, 0.8, "person"], [70, 50, 90, 60, 0.5, "bicycle"]]
    centres = np.array([[40, 25, 40, 30], [41, 25, 40, 30], [40, 25, 40, 30], [80, 55, 20, 10]])
    scores = np.array([[0, 0.1, 0.9], [0, 0, 0.7], [0.8, 0.1, 0], [0, 0.5, 0.4]])
    columns = np.column_stack([centres, scores]).T
    rows = np.column_stack([centres, [1, 1, 0.8, 0.5], scores / [[1], [1], [0.8], [0.5]]])
    numbers = [[*box[:5], {"person": 0, "bicycle": 1, "car": 2}[box[5]]] for box in expected]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "images").mkdir()
        cv2.imwrite(str(folder / "images/a.png"), np.zeros((96, 160, 3), np.uint8))
        right = True
        forms = [("end_to_end.onnx", numbers, np.float32), ("columns.onnx", columns, np.float32), ("rows.onnx", rows, np.float32),
                 ("halves.onnx", numbers, np.float16)]
        for name, output, kind in forms:
            model = small_head(folder, name, output, kind)
            right &= compare(program, model, str(folder / "images"))
            wrong = differences(ours(program, model, str(folder / "images"), "0.25")["a.png"], expected)
            print("\n".join(f"{name}: {box} is not as known" for box in wrong), end="\n" if wrong else "")
            right &= not wrong
        return right


if __name__ == "__main__":
    program, *rest = sys.argv[1:]
    sys.exit(not (compare(program, *rest) if rest else known(program)))
