"""One detector for 2, 4 and 8 cameras: boxes per second, their age and how evenly the cameras are served, with several threads;
and whether a batch of images would be faster than one after the other.

    python3 -m venv venv && venv/bin/pip install onnxruntime==1.31.1 numpy==2.4.6
    venv/bin/python tests/peers/cameras.py MODULO MODEL FRAMES [SECONDS [RATE]]

MODULO is a release build, MODEL a YOLOv10 in ONNX format, FRAMES a source of images. Each camera is simulated at RATE frames per
second, which takes processor time that a real one does not take. The age of boxes is the time from the sending of the modulo image
to the end of the sending of its boxes, read from the traces. All settings take turns, twice. The last column has the images answered
of the camera with the fewest and of the one with the most, in the run where they are furthest apart: one image is a large part of few.
"""

import collections
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import onnxruntime

CAMERAS = (2, 4, 8)
# Threads of the detector, 0 for one for each core, and of each unwrap node. The first are the defaults.
THREADS = ((0, 1), (1, 1), (0, 2))
ROUNDS = 2
WARM_UP_S = 2.0
# No other test uses it: tests take the domains 100 to 232.
DOMAIN = "93"


def launch_file(cameras, source, model, seconds, rate, detector_threads, unwrap_threads):
    """A launch file of cameras in namespaces of their own with one detector. JSON is YAML."""
    def node(name, **parameters):
        values = [{"name": key, "value": value} for key, value in parameters.items()]
        # The run ends with the first camera; all have as many frames.
        ends = {"on_exit": "shutdown"} if name == "modulo_camera" else {}
        return {"node": {"pkg": "modulo", "exec": name, "param": values} | ends}

    names = [f"camera{number}" for number in range(cameras)]
    sensor = {"source": source, "loop": True, "rate": rate, "frames": int(rate * seconds), "alpha": 4.0, "psf_sigma": 1.4}
    groups = [
        {"group": [
            {"push_ros_namespace": {"namespace": name}},
            node("unwrap", threads=unwrap_threads, wait_for=["/detector"]),
            node("modulo_camera", wait_for=["unwrap"], **sensor),
        ]}
        for name in names
    ]
    detector = node("detector", cameras=[f"/{name}" for name in names], model=model, engine="ort", threads=detector_threads)
    return json.dumps({"launch": [detector, *groups]})


def spans(folder, node):
    """(frame, name, begin, end) of each span of the nodes of this name; ms."""
    for path in Path(folder).glob(f"*{node}.*.trace"):
        for line in path.read_text().splitlines():
            span = json.loads(line)
            if "dur" in span and "frame" in span.get("args", {}):
                yield path, span["args"]["frame"], span["name"], span["ts"] / 1e3, (span["ts"] + span["dur"]) / 1e3


def run(modulo, source, model, seconds, rate, cameras, threads):
    """(ages in ms, boxes per second, least and most images answered of a camera)"""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cameras.launch.yaml"
        file.write_text(launch_file(cameras, source, model, seconds, rate, *threads))
        environment = os.environ | {"MODULO_TRACE_DIR": folder, "ROS_DOMAIN_ID": DOMAIN}
        environment["ZENOH_CONFIG_OVERRIDE"] = "transport/shared_memory/enabled=true"
        subprocess.run([modulo, "launch", file], env=environment, check=True, stdout=subprocess.DEVNULL)
        sent = {frame: (path, begin) for path, frame, name, begin, _ in spans(folder, "modulo_camera") if name == "send"}
        start = min(begin for _, begin in sent.values()) + 1e3 * WARM_UP_S
        end = max(begin for _, begin in sent.values())
        answered = {}
        for _, frame, _, _, done in spans(folder, "detector"):
            answered[frame] = max(done, answered.get(frame, 0.0))
    counted = {frame: done for frame, done in answered.items() if frame in sent and start <= done <= end}
    per_camera = collections.Counter({path: 0 for path, _ in sent.values()})
    per_camera.update(sent[frame][0] for frame in counted)
    ages = [done - sent[frame][1] for frame, done in counted.items()]
    return ages, 1e3 * len(ages) / (end - start), (min(per_camera.values()), max(per_camera.values()))


def batches(model, threads):
    """Prints the time of an image in batches of one, two and four."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    times = collections.defaultdict(list)
    for turn in range(30):
        for size in (1, 2, 4):
            images = np.random.default_rng(turn).random((size, 3, 384, 1248), dtype=np.float32)
            start = time.perf_counter()
            session.run(None, {name: images})
            times[size].append(1e3 * (time.perf_counter() - start) / size)
    texts = [f"{size}: {statistics.median(values[5:]):.1f} ms" for size, values in times.items()]
    print(f"time of an image by the size of its batch, {threads} threads, 25 runs: {', '.join(texts)}")


def main():
    modulo, model, source, *rest = sys.argv[1:]
    seconds, rate = map(float, rest + ["20", "5"][len(rest):])
    found = collections.defaultdict(list)
    for _ in range(ROUNDS):
        for cameras in CAMERAS:
            for threads in THREADS:
                found[cameras, threads].append(run(modulo, source, model, seconds, rate, cameras, threads))
    print("cameras  detector threads  unwrap threads  images/s  age p50 ms  age p99 ms  least and most")
    for (cameras, threads), runs in found.items():
        ages = sorted(age for ages, _, _ in runs for age in ages)
        at = lambda share: ages[min(int(share * len(ages)), len(ages) - 1)]
        answered = statistics.mean(answered for _, answered, _ in runs)
        least, most = min((counts for _, _, counts in runs), key=lambda counts: counts[0] / max(counts[1], 1))
        print(f"{cameras:7} {threads[0]:17} {threads[1]:15} {answered:9.1f} {at(0.5):11.0f} {at(0.99):11.0f} {least:8} of {most}")
    for threads in (1, os.cpu_count()):
        batches(model, threads)


if __name__ == "__main__":
    main()
