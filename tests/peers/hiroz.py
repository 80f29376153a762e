"""Runs the suite beside nodes of hiroz, which share no code with it: the program in tests/peers/hiroz.

    venv/bin/python tests/peers/hiroz.py target/debug/modulo target/hiroz/debug/hiroz-peer

Fails when one of them does not see, read, describe or set what the other one has, or when an image is lost without a count.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from encodings_of_cameras import HEIGHT, WIDTH, encodings
from zenoh_peer import DETECTIONS_HASH, DOMAIN, IMAGE_HASH, ROOT, SENSOR_DATA, Suite, until

IMAGES = 200
ENV = dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN))
SCENE = "source:=scene://tunnel?seed=3&frames=100000&width=160&height=48"
IMAGE, DETECTIONS = "sensor_msgs::msg::dds_::Image_", "vision_msgs::msg::dds_::Detection2DArray_"
MODULO, HIROZ = sys.argv[1:3]


def start(*command):
    return subprocess.Popen([HIROZ, *command], env=ENV, stdout=subprocess.PIPE, text=True)


def end(process):
    output, _ = process.communicate(timeout=90)
    assert process.returncode == 0, process.args
    return json.loads(output.splitlines()[-1])


def hiroz(*command):
    return end(start(*command))


def modulo(*command):
    done = subprocess.run([MODULO, *command], env=ENV, capture_output=True, text=True, timeout=60)
    return done.stdout + done.stderr


def graph():
    """Nodes, topics with types, hashes and quality of service, and services."""
    found = hiroz("list")
    nodes, services = ({(one.get("namespace"), one["name"]) for one in found[key]} for key in ("nodes", "services"))
    assert {("/", node) for node in ("modulo_camera", "unwrap", "detector")} <= nodes, nodes
    assert {"/detector/set_parameters", "/unwrap/get_type_description"} <= {name for _, name in services}, services
    for end_of in [
        ["/recovered", "Publisher", "unwrap", IMAGE, IMAGE_HASH, SENSOR_DATA],
        ["/recovered", "Subscription", "detector", IMAGE, IMAGE_HASH, SENSOR_DATA],
        ["/modulo", "Subscription", "unwrap", IMAGE, IMAGE_HASH, SENSOR_DATA],
        ["/detector/detections", "Publisher", "detector", DETECTIONS, DETECTIONS_HASH, "::,10:,:,:,,"],
    ]:
        assert end_of in found["ends"], (end_of, found["ends"])
    print(f"graph: {len(nodes)} nodes, {len(found['ends'])} publishers and subscriptions, {len(services)} services")


def parameters():
    """Values, descriptions and refusals, and an input that is switched."""
    got = hiroz("get", "/detector", "input", "score_threshold")
    assert got["values"] == ['String("recovered")', "Double(0.25)"], got["values"]
    assert "from_value: 0.0, to_value: 1.0" in got["described"][1] and "wait_for" in got["listed"], got
    refused = [hiroz("set", "/detector", *pair)[0] for pair in [("score_threshold", "1.5"), ("input", "nonsense")]]
    assert [ok for ok, _ in refused] == [False, False] and "in 0 to 1" in refused[0][1], refused
    assert "must be one of modulo" in refused[1][1], refused
    assert hiroz("set", "/detector", "input", "modulo") == [[True, ""]]
    found = hiroz("list")["ends"]
    assert ["/modulo", "Subscription", "detector", IMAGE, IMAGE_HASH, SENSOR_DATA] in found, found
    print("parameters: read, described, refused, set; the input is switched")


def descriptions():
    """A type of the suite to hiroz, one of hiroz to the suite; parameters of a node of hiroz in a namespace."""
    found = hiroz("describe", "/detector/detections")
    assert found == {"fields": ["header", "detections"], "hash": DETECTIONS_HASH, "type": "vision_msgs/msg/Detection2DArray"}, found
    talker = start("talk")
    try:
        until("the talker", lambda: "/far/hiroz_talk" in modulo("node", "list"))
        # hiroz describes its types without their text, which bags need.
        assert "has no .msg text of geometry_msgs/msg/TwistStamped" in modulo("topic", "echo", "--once", "/cmd")
        assert "0.5" in modulo("param", "get", "/far/hiroz_talk", "speed")
        for name, value, shown in [("speed", "0.75", "0.75"), ("names", "[b, 'c d']", "['b', 'c d']")]:
            assert "successful" in modulo("param", "set", "/far/hiroz_talk", name, value)
            assert shown in modulo("param", "get", "/far/hiroz_talk", name)
        assert "did you mean '/far/hiroz_talk'?" in modulo("param", "get", "/hiroz_talk", "speed")
    finally:
        talker.kill()
        talker.wait()
    print("descriptions: a type of the suite; parameters of a node of hiroz")


def crash(suite):
    """A camera that is killed comes back, and its images with it."""
    reader = start("receive", "/modulo", str(IMAGES), "10")
    time.sleep(3.0)
    of_launch = subprocess.run(["pgrep", "-P", str(suite.process.pid), "-f", "run modulo_camera"], capture_output=True, text=True)
    os.kill(int(of_launch.stdout.split()[0]), signal.SIGKILL)
    numbers = [image[0] for image in end(reader)]
    again = [at for at in range(1, len(numbers)) if numbers[at] <= numbers[at - 1]]
    assert len(numbers) == IMAGES and len(again) == 1, (len(numbers), again)
    print(f"crash: {again[0]} images before and {IMAGES - again[0]} after the camera was killed")


def from_modulo():
    """Each image of a camera, to a reader that was there before it."""
    reader = start("receive", "/far/modulo", str(IMAGES), "3")
    scene = SCENE.replace("100000", str(IMAGES))
    wait, space = ["-p", "wait_for:=[/hiroz_receive]"], ["-r", "__ns:=/far"]
    with Suite(MODULO, "run", "modulo_camera", "--ros-args", "-p", scene, "-p", "rate:=30.0", *wait, *space):
        images = end(reader)
    assert [image[0] for image in images] == list(range(1, IMAGES + 1)), [image[0] for image in images]
    print(f"from modulo: {len(images)} of {IMAGES} images")


def to_modulo(folder):
    """Each image of hiroz to unwrap; none is lost without a count."""
    ramp = (np.add.outer(np.arange(48), 2 * np.arange(64)) % 256).astype(np.uint8)
    images, sensor = folder / "ramp.json", ["-p", "bits:=8", "-p", "alpha:=4.0"]
    images.write_text(json.dumps([["mono8", 64, 48, 64, ramp.tobytes().hex()]]))
    reports = folder / "reports"
    reports.mkdir()
    with Suite(MODULO, "run", "unwrap", "--ros-args", *sensor, MODULO_REPORT_DIR=str(reports)):
        assert hiroz("send", "/modulo", str(images), str(IMAGES), "30") == IMAGES
        time.sleep(0.5)
    report = json.loads((reports / "unwrap.1.json").read_text())
    received, lost = (report[key].get("/modulo", 0) for key in ("received", "lost"))
    assert (received, lost) == (IMAGES, 0), report
    print(f"to modulo: {received} of {IMAGES} images, {lost} lost")


def cameras(folder):
    """An image in each encoding of cameras, and the ideal image that the suite makes of it."""
    each, images = list(encodings()), folder / "encodings.json"
    images.write_text(json.dumps([[name, WIDTH, HEIGHT, step, data.hex()] for name, step, data, _ in each]))
    # Black columns would shade all of such small images.
    source = ["-p", "source:=topic:/camera/image_raw", "-p", "alpha:=1.0", "-p", "psf_sigma:=0.0", "-p", "optical_black:=0"]
    with Suite(MODULO, "run", "modulo_camera", "--ros-args", *source):
        reader = start("receive", "/ideal", "100000", "4")
        time.sleep(1.0)
        assert hiroz("send", "/camera/image_raw", str(images), "8", "20") == 8 * len(each)
        heard = {image[1]: image for image in end(reader)}
    for second, (name, _, _, colour) in enumerate(each, 1):
        _, _, frame, width, height, encoding, _, pixel = heard[second]
        wanted = colour if encoding != "mono8" else colour[:1]
        assert (frame, width, height) == ("hiroz", WIDTH, HEIGHT), heard[second]
        assert np.abs(np.subtract(pixel[-len(wanted):], wanted)).max() <= 2, (name, heard[second], colour)
    print(f"cameras: {len(each)} encodings in, and the ideal image back")


if __name__ == "__main__":
    with Suite(MODULO, "launch", "launch/recovered.launch.yaml", SCENE, "rate:=20", "engine:=rten", "--verbose") as suite:
        # Not by a command of the suite, which would be the one that others connect to until it ends.
        until("the suite", lambda: "'modulo_camera'" in str(hiroz("list")["nodes"]))
        graph()
        parameters()
        descriptions()
        crash(suite)
    from_modulo()
    with tempfile.TemporaryDirectory() as work:
        to_modulo(Path(work))
        cameras(Path(work))
