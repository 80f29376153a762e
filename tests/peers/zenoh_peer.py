"""Speaks with the shipped binary as an independent rmw_zenoh peer: zenoh's own
Python binding, rosbags for CDR and type hashes, and nothing of this project.

    python3 -m venv venv && venv/bin/pip install eclipse-zenoh rosbags
    venv/bin/python tests/peers/zenoh_peer.py target/debug/modulo

Fails when a key, a hash, an attachment, a message or a service is not as ROS 2
has it.
"""

import os
import queue
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import zenoh
from clients import session
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

DOMAIN = 137
ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 60.0

# As a real ROS 2 Jazzy node announces them; rosbags has no services.
SET_PARAMETERS = (
    "rcl_interfaces::srv::dds_::SetParameters_",
    "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
)
DETECTIONS_HASH = "RIHS01_214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968"
IMAGE_HASH = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
SENSOR_DATA = "2::,5:,:,:,,"


def types():
    """The types of Jazzy, with what it does not install by itself."""
    store = get_typestore(Stores.ROS2_JAZZY)
    more = {}
    for path in (ROOT / "msgs/interfaces/vision_msgs/msg").glob("*.msg"):
        more |= get_types_from_msg(path.read_text(), f"vision_msgs/msg/{path.stem}")
    more |= get_types_from_msg("rcl_interfaces/Parameter[] parameters", "peer/msg/SetParametersRequest")
    more |= get_types_from_msg("rcl_interfaces/SetParametersResult[] results", "peer/msg/SetParametersResponse")
    store.register({name: fields for name, fields in more.items() if name not in store.fielddefs})
    return store


STORE = types()


class Peer:
    """A node of its own session, written down from the convention alone."""

    def __init__(self):
        self.session = session(DOMAIN)
        self.zid = str(self.session.info.zid())
        self.entity = 0
        self.held = []
        self.token("NN", "")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()

    def token(self, kind, rest):
        key = f"@ros2_lv/{DOMAIN}/{self.zid}/0/{self.entity}/{kind}/%/%/python{rest}"
        self.held.append(self.session.liveliness().declare_token(key))
        self.entity += 1

    def key(self, topic, ros_type):
        package, name = ros_type.split("/msg/")
        digest = STORE.hash_rihs01(ros_type)
        return f"{DOMAIN}/{topic.strip('/')}/{package}::msg::dds_::{name}_/{digest}"

    def endpoint(self, kind, topic, ros_type, qos):
        _, dds, digest = self.key(topic, ros_type).rsplit("/", 2)
        self.token(kind, f"/{topic.replace('/', '%')}/{dds}/{digest}/{qos}")

    def hear(self, topic, ros_type, qos):
        """A queue of (message, attachment)."""
        heard = queue.Queue()
        self.endpoint("MS", topic, ros_type, qos)
        subscriber = self.session.declare_subscriber(
            self.key(topic, ros_type), lambda sample: heard.put(opened(sample, ros_type))
        )
        self.held.append(subscriber)
        return heard

    def publisher(self, topic, ros_type, qos):
        """A function that publishes a message as rmw_zenoh does."""
        self.endpoint("MP", topic, ros_type, qos)
        publisher = self.session.declare_publisher(self.key(topic, ros_type))
        sequence = iter(range(1, 1 << 62))

        def publish(message):
            payload = bytes(STORE.serialize_cdr(message, ros_type))
            attachment = struct.pack("<qqB", next(sequence), time.time_ns(), 16) + b"a-peer-in-python"
            publisher.put(payload, attachment=attachment)

        return publish

    def tokens(self):
        """Parts of every token of the domain."""
        replies = self.session.liveliness().get(f"@ros2_lv/{DOMAIN}/**", timeout=5.0)
        return [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok]

    def reads(self, node, topic):
        return any(t[5] == "MS" and t[8] == node and t[9] == topic.replace("/", "%") for t in self.tokens())

    def set_parameter(self, node, name, text, key="/".join(SET_PARAMETERS)):
        """rcl_interfaces/srv/SetParameters with one string; its result, or the text of an error."""
        cls = {key: STORE.types[f"rcl_interfaces/msg/{key}"] for key in ("Parameter", "ParameterValue")}
        value = cls["ParameterValue"](
            type=4, bool_value=False, integer_value=0, double_value=0.0, string_value=text,
            byte_array_value=np.array([], np.uint8), bool_array_value=np.array([], bool),
            integer_array_value=np.array([], np.int64), double_array_value=np.array([], np.float64),
            string_array_value=[],
        )
        request = STORE.types["peer/msg/SetParametersRequest"]([cls["Parameter"](name, value)])
        sent = struct.pack("<qqB", 7, time.time_ns(), 16) + b"a-client-of-them"
        replies = list(
            self.session.get(
                f"{DOMAIN}/{node}/set_parameters/{key}",
                payload=bytes(STORE.serialize_cdr(request, "peer/msg/SetParametersRequest")),
                attachment=sent,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=10.0,
            )
        )
        assert len(replies) == 1, replies
        if not replies[0].ok:
            return replies[0].err.payload.to_string()
        sample = replies[0].ok
        got = bytes(sample.attachment)
        assert len(got) == 33 and got[:8] == sent[:8] and got[17:] == sent[17:], got
        payload = bytes(sample.payload)
        return STORE.deserialize_cdr(payload, "peer/msg/SetParametersResponse").results[0]


def opened(sample, ros_type):
    """The message, and sequence, stamp and publisher of its attachment."""
    assert sample.attachment is not None, f"{sample.key_expr}: no attachment"
    raw = bytes(sample.attachment)
    assert len(raw) == 33 and raw[16] == 16, raw
    sequence, stamp = struct.unpack_from("<qq", raw)
    assert abs(time.time_ns() - stamp) < 60e9, stamp
    return STORE.deserialize_cdr(bytes(sample.payload), ros_type), (sequence, raw[17:])


def next_of(heard, what, wanted=lambda message: True):
    """The first message for which `wanted` holds; numbers must not repeat."""
    end, last = time.monotonic() + PATIENCE, {}
    while time.monotonic() < end:
        try:
            message, (sequence, gid) = heard.get(timeout=1.0)
        except queue.Empty:
            continue
        assert sequence > last.get(gid, 0), (sequence, last)
        last[gid] = sequence
        if wanted(message):
            return message
    raise AssertionError(f"waited in vain: {what}")


def until(what, done):
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.1)


class Suite:
    """A command of the shipped binary; ended with SIGINT."""

    def __init__(self, binary, *arguments, stdout=None, **environment):
        env = dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN), **environment)
        self.process = subprocess.Popen([binary, *arguments], env=env, cwd=ROOT, stdout=stdout)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        assert kind or code in (0, 3), f"exit status {code}"


def receives_and_switches(binary):
    """Our images and boxes arrive; the detector's input is switched by a call."""
    scene = "source:=scene://glare?seed=3&frames=100000"
    with Suite(binary, "launch", "launch/recovered.launch.yaml", scene, "rate:=4", "engine:=rten"), Peer() as peer:
        assert peer.key("/x", "sensor_msgs/msg/Image").endswith(IMAGE_HASH)
        assert peer.key("/x", "vision_msgs/msg/Detection2DArray").endswith(DETECTIONS_HASH)
        images = peer.hear("/recovered", "sensor_msgs/msg/Image", SENSOR_DATA)
        boxes = peer.hear("/detector/detections", "vision_msgs/msg/Detection2DArray", "::,10:,:,:,,")
        found = next_of(boxes, "boxes", lambda m: len(m.detections) > 0)
        image = next_of(images, "an image")
        assert image.encoding == "rgb8" and image.step == 3 * image.width, image.encoding
        assert len(image.data) == image.height * image.step
        one = found.detections[0]
        assert one.header == found.header and 0.0 < one.results[0].hypothesis.score <= 1.0
        # Readers of images name the buffers that they take, as since Lyrical.
        odd = [t for t in peer.tokens() if not all(t) or len(t) not in (9, 13) and t[13:] != ["backends:cpu:"]]
        assert not odd, odd
        print(f"received {image.width} x {image.height} {image.encoding}, {len(found.detections)} boxes,",
              one.results[0].hypothesis.class_id, round(one.results[0].hypothesis.score, 3))

        assert peer.reads("detector", "/recovered") and not peer.reads("detector", "/modulo")
        result = peer.set_parameter("detector", "input", "modulo")
        assert result.successful and not result.reason, result
        until("the switch", lambda: peer.reads("detector", "/modulo") and not peer.reads("detector", "/recovered"))
        next_of(boxes, "boxes after the switch")
        result = peer.set_parameter("detector", "input", "sideways")
        assert not result.successful and "sideways" in result.reason and "recovered" in result.reason, result
        print("refused:", result.reason)
        # A pattern would pass the rules of a router, which name keys.
        result = peer.set_parameter("detector", "input", "recovered", key="*/*")
        assert "pattern" in result, result


def is_received(binary):
    """An image of ours on the modulo topic is recovered exactly, and detected."""
    sensor = ["--ros-args", "-p", "bits:=8", "-p", "alpha:=4.0"]
    detector = ["--ros-args", "-p", "engine:=rten"]
    with Suite(binary, "run", "unwrap", *sensor), Suite(binary, "run", "detector", *detector), Peer() as peer:
        until("the nodes", lambda: {"unwrap", "detector"} <= {t[8] for t in peer.tokens() if t[5] == "NN"})
        hdr = peer.hear("/hdr", "sensor_msgs/msg/Image", SENSOR_DATA)
        boxes = peer.hear("/detector/detections", "vision_msgs/msg/Detection2DArray", "::,10:,:,:,,")
        publish = peer.publisher("/modulo", "sensor_msgs/msg/Image", SENSOR_DATA)
        until("the reader of /modulo", lambda: peer.reads("unwrap", "/modulo"))
        time.sleep(1.0)

        ramp = np.add.outer(np.arange(96), 2 * np.arange(320)).astype(np.uint16)
        publish(image_of((ramp % 256).astype(np.uint8), "mono8", 5))
        got = next_of(hdr, "the ramp", lambda m: m.header.stamp.sec == 5)
        assert got.encoding == "mono16" and got.header.frame_id == "python", got.encoding
        counts = got.data.view("<u2").reshape(got.height, got.step // 2)
        offset = np.unique(counts.astype(int) - ramp)
        assert len(offset) == 1 and offset[0] % 256 == 0, offset
        print("recovered a ramp of", int(ramp.max()), "from 8 bits, without an error in", ramp.size, "samples")

        with Reader(ROOT / "bags/samples/tunnel") as reader:
            connections = [c for c in reader.connections if c.topic == "/modulo"]
            raw = next(reader.messages(connections))[2]
        frame = STORE.deserialize_cdr(raw, "sensor_msgs/msg/Image")
        frame.header.stamp.sec, frame.header.stamp.nanosec = 6, 789
        publish(frame)
        found = next_of(boxes, "boxes", lambda m: m.header.stamp.sec == 6)
        assert found.header == frame.header and len(found.detections) > 0, found
        print("detected", len(found.detections), "boxes on an image of Python's")


def image_of(pixels, encoding, seconds):
    header = STORE.types["std_msgs/msg/Header"](STORE.types["builtin_interfaces/msg/Time"](seconds, 0), "python")
    height, width = pixels.shape
    return STORE.types["sensor_msgs/msg/Image"](header, height, width, encoding, 0, width, pixels.reshape(-1))


if __name__ == "__main__":
    receives_and_switches(sys.argv[1])
    is_received(sys.argv[1])
    print("as ROS 2 has it")
