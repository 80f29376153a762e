#!/usr/bin/env python3
"""Writes the tiny models that the tests of this crate load (pip install onnx).

`rows = BOXES + mean(image) * LIGHT`: the boxes are constant, and the score of
the last row is the mean of the input, so a test can see what the model got.
"""
import pathlib

import numpy as np
from onnx import TensorProto, checker, helper, numpy_helper

HERE = pathlib.Path(__file__).parent
NAMES = "{0: 'person', 1: 'bicycle', 2: 'car'}"
BOXES = np.array([[[8, 4, 40, 20, 0.5, 2], [16, 8, 30, 28, 0.9, 0], [1, 1, 5, 5, 0, 7]]], np.float32)
LIGHT = np.zeros_like(BOXES)
LIGHT[0, 2, 4] = 1


def model(file, size=("height", "width"), names=NAMES, boxes=BOXES, light=LIGHT, channels=3, outputs=None, properties={}):
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["mean"], axes=[0, 1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["mean", "light"], ["lit"]),
        helper.make_node("Add", ["boxes", "lit"], ["output0"]),
    ]
    graph = helper.make_graph(
        nodes,
        "rows",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, channels, *size])],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, outputs or boxes.shape)],
        [numpy_helper.from_array(boxes, "boxes"), numpy_helper.from_array(light, "light")],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if names:
        helper.set_model_props(made, {"names": names, **properties})
    checker.check_model(made, full_check=True)
    (HERE / file).write_bytes(made.SerializeToString())


model("rows.onnx")
model("nameless.onnx", names=None)
model("static_96x64.onnx", size=(64, 96))
model("mono.onnx", channels=1)
# Raw heads. In both, the first two boxes are one car and a worse copy of it, the third one is a person in the same place.
HEAD = np.array([[24, 12, 32, 16], [25, 12, 32, 16], [24, 12, 32, 16], [60, 40, 20, 8]], np.float32)
SCORES = np.array([[0.1, 0, 0.8], [0, 0.1, 0.6], [0.7, 0.1, 0.2], [0, 0.4, 0.1]], np.float32)
columns = np.concatenate([HEAD, SCORES], axis=1).T[None]
model("columns.onnx", boxes=columns, light=np.zeros_like(columns))
# Objectness and class scores whose product is the same; the file leaves its output open.
rows = np.concatenate([HEAD, np.full((4, 1), 0.8), SCORES / 0.8], axis=1).astype(np.float32)[None]
model("rows_of_anchors.onnx", boxes=rows, light=np.zeros_like(rows), outputs=[1, "n", "m"])
# YOLOv5 of one class: 3 * (4 * 4 + 2 * 2 + 1) rows of 6.
one_class = np.tile(np.array([16, 16, 8, 8, 1e-4, 0.9], np.float32), (1, 63, 1))
one_class[0, 40] = [20, 12, 16, 8, 0.9, 0.5]
model("one_class.onnx", size=(32, 32), names="{0: 'car'}", boxes=one_class, light=np.zeros_like(one_class))
model("segments.onnx", properties={"task": "segment"})
