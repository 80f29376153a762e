"""Trains the demo detector from a seed on exported scenes; see README.md.

    python train.py DATA OUT [--minutes 35 | --steps N] [--seed 1] [--images ideal|modulo|mixture] [--resume MODEL]

MODEL is a checkpoint or an ONNX file of `export.py`, whose network has no batch norms.

Each of `--ranks` processes computes with one thread on its own pictures, and
the gradients are averaged after each step: on a busy machine that is several
times faster than threads which wait for each other.
"""
import argparse
import copy
import math
import os
import resource
import time

import numpy as np
import torch
import torch.distributed as dist
from torch.utils.data import DataLoader, IterableDataset

from data import WRAPPED, Scenes, batch
from export import opened
from net import Detector, distances

CROP, BATCH, RATE = 320, 5, 2.0e-3


class Stream(IterableDataset):
    """Endless batches of random views, from a seed."""

    def __init__(self, scenes, seed, images):
        self.scenes, self.seed, self.images = scenes, seed, images

    def __iter__(self):
        torch.set_num_threads(1)
        torch.manual_seed(self.seed)
        rng = np.random.default_rng(self.seed)
        while True:
            yield batch(self.scenes, rng.integers(0, len(self.scenes.images), BATCH), CROP, rng, self.images)


def loss(raw, heat, weight, box, near):
    """Focal loss of the heat map, IoU and scaled L1 of the boxes."""
    raw = raw.float()
    p = torch.sigmoid(raw[:, :5]).clamp(1e-5, 1 - 1e-5)
    centre = heat >= 0.999
    hit = -torch.log(p) * (1 - p) ** 2 * centre
    miss = -torch.log(1 - p) * p ** 2 * (1 - heat) ** 4 * ~centre
    count = centre.sum().clamp(min=1)
    focal = ((hit + miss) * weight).sum() / count
    d = distances(raw[:, 5:])
    inter = torch.minimum(d, box)
    cut = (inter[:, 0] + inter[:, 2]) * (inter[:, 1] + inter[:, 3])
    area = lambda t: (t[:, 0] + t[:, 2]) * (t[:, 1] + t[:, 3])
    iou = cut / (area(d) + area(box) - cut).clamp(min=1e-3)
    size = torch.stack([box[:, 0] + box[:, 2], box[:, 1] + box[:, 3]] * 2, 1).clamp(min=1.0)
    sides = ((d - box).abs() / size).clamp(max=2.0).sum(1)
    share = near / near.sum().clamp(min=1e-3)
    return focal, ((1 - iou + 0.5 * sides) * share).sum()


def averaged(kept, net, step):
    """Moving average of the weights, slower as training goes on."""
    decay = min(0.998, (1 + step) / (10 + step))
    with torch.no_grad():
        for a, b in zip(kept.state_dict().values(), net.state_dict().values()):
            a.copy_(b) if not a.is_floating_point() else a.mul_(decay).add_(b, alpha=1 - decay)


def share(net, ranks):
    """Averages the gradients over all ranks."""
    if ranks > 1:
        flat = torch.cat([p.grad.reshape(-1) for p in net.parameters()])
        dist.all_reduce(flat)
        parts = (flat / ranks).split([p.numel() for p in net.parameters()])
        for p, part in zip(net.parameters(), parts):
            p.grad.copy_(part.view_as(p))


def step_once(net, rule, goal, ranks):
    """One step of gradient descent; (heat map loss, box loss)."""
    x, *goal = goal
    with torch.autocast("cpu", torch.bfloat16):
        raw = net(x.contiguous(memory_format=torch.channels_last))
    focal, box = loss(raw, *goal)
    rule.zero_grad(set_to_none=False)
    (focal + 2.0 * box).backward()
    share(net, ranks)
    torch.nn.utils.clip_grad_norm_(net.parameters(), 10.0)
    rule.step()
    return focal.item(), box.item()


def agreed(value, ranks):
    """Rank 0's value, on every rank."""
    told = torch.tensor([value])
    if ranks > 1:
        dist.broadcast(told, 0)
    return float(told)


def work(rank, args):
    """One rank's training."""
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    if args.ranks > 1:
        dist.init_process_group("gloo", f"file://{os.path.abspath(args.out)}/meeting", rank=rank, world_size=args.ranks)
    scenes = Scenes(args.data)
    net = opened(args.resume) if args.resume else Detector()
    kept = copy.deepcopy(net)
    net = net.to(memory_format=torch.channels_last).train()
    say = print if rank == 0 else lambda *_, **__: None
    say(f"{len(scenes.images)} images, {sum(p.numel() for p in net.parameters())} parameters, seed {args.seed}", flush=True)
    views = Stream(scenes, args.seed * 100 + rank, args.images)
    loader = iter(DataLoader(views, batch_size=None, num_workers=1, prefetch_factor=3, multiprocessing_context="fork"))
    rule = torch.optim.AdamW(net.parameters(), lr=args.rate, weight_decay=1e-3)
    start, step, last, sums, shown = time.time(), 0, 0, np.zeros(2), time.time()
    done = lambda: step / args.steps if args.steps else (time.time() - start) / (60 * args.minutes)
    while (gone := agreed(done(), args.ranks)) < 1.0:
        for group in rule.param_groups:
            group["lr"] = args.rate * min(1.0, (step + 1) / 100) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * gone)))
        sums += step_once(net, rule, next(loader), args.ranks)
        step += 1
        if rank == 0:
            averaged(kept, net, step)
        if step % 50 == 0 or step in (1, 10):
            rate = (step - last) / (time.time() - shown)
            say(f"step {step} at {gone:.3f}: heat {sums[0] / (step - last):.4f} box {sums[1] / (step - last):.4f}, {rate:.2f} steps/s", flush=True)
            sums, shown, last = np.zeros(2), time.time(), step
        if rank == 0 and step % 250 == 0:
            torch.save(kept.state_dict(), os.path.join(args.out, "last.pt"))
    if rank == 0:
        torch.save(kept.state_dict(), os.path.join(args.out, "last.pt"))
    say(f"done: {step} steps in {(time.time() - start) / 60:.1f} minutes", flush=True)


def main():
    parse = argparse.ArgumentParser()
    parse.add_argument("data")
    parse.add_argument("out")
    parse.add_argument("--minutes", type=float, default=35.0)
    parse.add_argument("--steps", type=int, help="ends after so many steps, whatever their time")
    parse.add_argument("--images", choices=WRAPPED, default="ideal")
    parse.add_argument("--seed", type=int, default=1)
    parse.add_argument("--ranks", type=int, default=2)
    parse.add_argument("--rate", type=float, default=RATE)
    parse.add_argument("--resume")
    args = parse.parse_args()
    Scenes(args.data).may_train()
    os.makedirs(args.out, exist_ok=True)
    meeting = os.path.join(args.out, "meeting")
    if os.path.exists(meeting):
        os.remove(meeting)
    torch.multiprocessing.spawn(work, (args,), nprocs=args.ranks)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{(used.ru_utime + used.ru_stime) / 3600:.3f} hours of processor time")


if __name__ == "__main__":
    main()
