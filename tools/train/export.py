"""Writes a checkpoint as ONNX with YOLOv10's end-to-end contract.

    python export.py CHECKPOINT OUT.onnx

`opened` reads checkpoints and such files back into the network.

`images` [1,3,H,W] RGB in [0,1], H and W multiples of 32, to `output0`
[1,100,6] = x1, y1, x2, y2, score, class, best first. Weights are stored as
float16 and widened by Cast nodes; all arithmetic is float32.
"""
import argparse
import io

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from net import CLASSES, TOP, Conv, Detector, EndToEnd


def fold(module):
    """Puts every batch norm into its convolution."""
    for part in module.modules():
        if isinstance(part, Conv):
            conv, norm = part.conv, part.norm
            gain = norm.weight / torch.sqrt(norm.running_var + norm.eps)
            conv.weight = nn.Parameter(conv.weight * gain[:, None, None, None])
            conv.bias = nn.Parameter(norm.bias - norm.running_mean * gain)
            part.norm = nn.Identity()
    return module


def opened(path):
    """The network of a checkpoint or of an ONNX file of this script, whose norms are folded already."""
    if path.endswith(".onnx"):
        weights = {w.name.removeprefix("net.").removesuffix("_f16"): torch.from_numpy(numpy_helper.to_array(w).astype(np.float32))
                   for w in onnx.load(path).graph.initializer if w.name.startswith("net.")}
    else:
        weights = torch.load(path)
    net = Detector()
    if not any(".norm." in name for name in weights):
        fold(net)
    net.load_state_dict(weights)
    return net


def narrow(model):
    """Stores every larger float32 weight as float16."""
    kept, casts = [], []
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.size < 512:
            kept.append(tensor)
            continue
        kept.append(numpy_helper.from_array(values.astype(np.float16), tensor.name + "_f16"))
        casts.append(helper.make_node("Cast", [tensor.name + "_f16"], [tensor.name], to=TensorProto.FLOAT))
    nodes = casts + list(model.graph.node)
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(kept)
    model.graph.node.extend(nodes)


def main():
    parse = argparse.ArgumentParser()
    parse.add_argument("checkpoint")
    parse.add_argument("out")
    args = parse.parse_args()
    net = opened(args.checkpoint)
    folded = isinstance(net.stem[0].norm, nn.Identity)
    model = EndToEnd(net.eval() if folded else fold(net.eval()))
    raw = io.BytesIO()
    torch.onnx.export(
        model, torch.rand(1, 3, 192, 640), raw, opset_version=17, dynamo=False,
        input_names=["images"], output_names=["output0"],
        dynamic_axes={"images": {2: "height", 3: "width"}},
    )
    graph = onnx.load_from_string(raw.getvalue())
    narrow(graph)
    for axis, size in zip(graph.graph.output[0].type.tensor_type.shape.dim, (1, TOP, 6)):
        axis.dim_value = size
    names = "{" + ", ".join(f"{i}: '{name}'" for i, name in enumerate(CLASSES)) + "}"
    facts = {"names": names, "stride": "32", "task": "detect", "license": "Apache-2.0",
             "description": "modulo demo detector, trained on procedural scenes only; not for roads"}
    for key, value in facts.items():
        entry = graph.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.checker.check_model(graph)
    onnx.save(graph, args.out)
    print(f"{args.out}: {graph.ByteSize()} bytes, ops {sorted({n.op_type for n in graph.graph.node})}")


if __name__ == "__main__":
    main()
