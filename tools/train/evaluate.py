"""AP50 of a checkpoint or an ONNX file on exported scenes, ideal and saturated.

    python evaluate.py MODEL DATA [--blur 1.0] [--alpha 4]
"""
import argparse

import numpy as np
import torch

from data import Scenes, blur
from export import opened
from metric import ap50
from net import CLASSES, EndToEnd


def load(path):
    """A function from [1,3,H,W] to [100,6]."""
    if path.endswith(".onnx"):
        import onnxruntime

        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        return lambda x: session.run(None, {"images": x.numpy()})[0][0]
    model = EndToEnd(opened(path).eval())
    return lambda x: model(x)[0].numpy()


def main():
    parse = argparse.ArgumentParser()
    parse.add_argument("model")
    parse.add_argument("data")
    parse.add_argument("--blur", type=float, default=1.0)
    parse.add_argument("--alpha", type=float, default=4.0)
    parse.add_argument("--every", type=int, default=1)
    args = parse.parse_args()
    torch.set_num_threads(1)
    model, scenes = load(args.model), Scenes(args.data)
    found = {"ideal": [], "saturated": []}
    images = range(0, len(scenes.images), args.every)
    with torch.no_grad():
        for i in images:
            x = torch.from_numpy(scenes.images[i].copy()).permute(2, 0, 1)[None].float() / 255.0
            x = blur(x, args.blur) if args.blur > 0 else x
            found["ideal"].append(model(torch.round(x * 255) / 255))
            found["saturated"].append(model(torch.round((x * args.alpha).clamp(max=1) * 255) / 255))
    presets = [scenes.keys[i][0] for i in images]
    truths = [scenes.labels[i] for i in images]
    print(f"{len(presets)} images, blur {args.blur} px, alpha {args.alpha:g}; AP50: mean | " + " ".join(CLASSES))
    for name in ["all", "day", "glare", "tunnel", "night"]:
        for stream, boxes in found.items():
            keep = [k for k, preset in enumerate(presets) if name in ("all", preset)]
            mean, each = ap50([boxes[k] for k in keep], [truths[k] for k in keep])
            print(f"{name:7} {stream:9} {mean:.3f} | " + " ".join(f"{a:.3f}" for a in each))


if __name__ == "__main__":
    main()
