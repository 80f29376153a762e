#!/usr/bin/env python3
"""Write a copy of a YOLOv10 model that computes with 8 bits.

    modulo eval launch/recovered.launch.yaml source:=FOLDER model:=MODEL -o out --images   # the frames as the detector gets them
    python tools/quantise.py MODEL out/recovered COPY
    modulo eval --kitti OTHER_FOLDER --model MODEL,COPY --stream recovered --engine ort --time-frames 100 -o int8    # what it loses and saves

The quantisation is static: the frames give the range of each tensor, so take other frames than those that are scored. The last
module, which makes the boxes and the scores, keeps its 32 bits.
Needs: pip install onnxruntime==1.24.1 onnx opencv-python-headless numpy
"""

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import onnx
import onnxruntime
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

# Between two of these a tensor keeps its 8 bits. With Conv alone, the way to 32 bits and back takes longer than it saves.
OPERATORS = ["Conv", "Mul", "Add", "Concat", "MaxPool", "Resize", "Split"]


def parse():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path, help="the model, an ONNX file")
    parser.add_argument("frames", type=Path, help="folder with PNG files")
    parser.add_argument("copy", type=Path, help="the file that is written")
    parser.add_argument("--keep", default="/model.23/", help="nodes whose names begin so keep 32 bits (%(default)s)")
    return parser.parse_args()


def tensor(path):
    """The picture as the detector pads it: to multiples of 32, right and below, grey 114."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    below, right = (-side % 32 for side in image.shape[:2])
    image = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114))
    image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB).transpose(2, 0, 1)[None]
    return np.ascontiguousarray(image, dtype=np.float32) / 255


class Frames(CalibrationDataReader):
    """The pictures, one after the other."""

    def __init__(self, name, paths):
        self.feeds = ({name: tensor(path)} for path in paths)

    def get_next(self):
        return next(self.feeds, None)


def folded(model, folder):
    """The model with its constants computed, such as weights that are stored with 16 bits. Returns the path."""
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(folder / "folded.onnx")
    onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    return folder / "folded.onnx"


def main():
    options = parse()
    paths = sorted(options.frames.glob("*.png"))
    if not paths:
        sys.exit(f"{options.frames}: there is no PNG file")
    with tempfile.TemporaryDirectory() as folder:
        model = folded(options.model, Path(folder))
        graph = onnx.load(model).graph
        kept = [node.name for node in graph.node if node.name.startswith(options.keep)]
        quantize_static(
            model,
            options.copy,
            Frames(graph.input[0].name, paths),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=OPERATORS,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            nodes_to_exclude=kept,
        )
    print(f"{options.copy}: {len(paths)} frames, {len(kept)} nodes with 32 bits")


if __name__ == "__main__":
    main()
