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


def model(file, size=("height", "width"), names=NAMES, boxes=BOXES, light=LIGHT, channels=3, outputs=None):
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
        helper.set_model_props(made, {"names": names})
    checker.check_model(made, full_check=True)
    (HERE / file).write_bytes(made.SerializeToString())


model("rows.onnx")
model("nameless.onnx", names=None)
model("static_96x64.onnx", size=(64, 96))
model("mono.onnx", channels=1)
# What YOLOv8 gives: candidates before non-maximum suppression.
model("candidates.onnx", boxes=np.zeros((1, 7, 9), np.float32), light=np.zeros((1, 7, 9), np.float32))
# A file that leaves its output open, and gives the wrong thing when it runs.
model("open_output.onnx", boxes=np.zeros((1, 7, 9), np.float32), light=np.zeros((1, 7, 9), np.float32),
      outputs=[1, "n", "m"])
