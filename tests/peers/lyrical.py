"""Speaks with the shipped binary as ROS 2 Lyrical does: rmw_zenoh_cpp 0.10.5 with its buffers, written down from its published
source (rmw_publisher_data.cpp, buffer_endpoint_helpers.hpp) over zenoh's Python binding.

    venv/bin/pip install eclipse-zenoh rosbags xxhash
    venv/bin/python tests/peers/lyrical.py target/debug/modulo

Fails when an image of either side is lost without a count or counted twice, while readers of four kinds join and leave, or
when a number that a reader with a buffer of its own has used is counted as a loss.
"""

import json
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xxhash
import zenoh
from rosbags.rosbag2 import Reader
from zenoh_peer import SENSOR_DATA, STORE, Peer, Suite, image_of, until

IMAGE = "sensor_msgs/msg/Image"
IMAGES = 200
JOINS = 20
RATE = 30.0
# The last part of a reader's token: of Jazzy, of Lyrical with its default, and with a buffer of its own.
LEGACY, CPU, APART = "", "/backends:cpu:", "/backends:cuda:0"


class Lyrical(Peer):
    """A session with one publisher and any number of readers."""

    def endpoint_token(self, kind, topic, backends):
        """The token of a new endpoint for images, with its last part."""
        domain, _, dds, digest = split(self.key(topic, IMAGE))
        mangled = topic.replace("/", "%")
        self.entity += 1
        return f"@ros2_lv/{domain}/{self.zid}/0/{self.entity}/{kind}/%/%/python/{mangled}/{dds}/{digest}/{SENSOR_DATA}{backends}"

    def reader(self, topic, backends, take=lambda sample: None):
        """Declares a reader; returns a function that ends it."""
        token, key = self.endpoint_token("MS", topic, backends), self.key(topic, IMAGE)
        keys = {LEGACY: [key], CPU: [key, f"{key}/_buf_cpu"], APART: [key, f"{key}/_buf/{gid(token).hex()}"]}[backends]
        mine = [self.session.declare_subscriber(each, take) for each in keys]
        mine.append(self.session.liveliness().declare_token(token))
        return lambda: [each.undeclare() for each in reversed(mine)]


def split(key):
    """Domain, name, type and hash of a topic's key."""
    domain, rest = key.split("/", 1)
    return domain, *rest.rsplit("/", 2)


def gid(token):
    return xxhash.xxh3_128(token.encode()).intdigest().to_bytes(16, "little")


class Publisher:
    """A publisher that is aware of buffers: `publish` and `publish_buffer_aware` of rmw_publisher_data.cpp."""

    def __init__(self, peer, topic):
        self.peer, self.key, self.sequence = peer, peer.key(topic, IMAGE), 0
        self.matched, self.discovered, self.topic = set(), {}, topic.replace("/", "%")
        token = peer.endpoint_token("MP", topic, CPU)
        self.gid, liveliness = gid(token), peer.session.liveliness()
        peer.held.append(liveliness.declare_subscriber(f"@ros2_lv/{split(self.key)[0]}/**", self.seen, history=True))
        peer.held.append(liveliness.declare_token(token))

    def seen(self, sample):
        parts = (token := str(sample.key_expr)).split("/")
        if parts[5] != "MS" or parts[9] != self.topic:
            return
        if sample.kind == zenoh.SampleKind.DELETE:
            # A reader that has left is no longer matched, but stays discovered.
            self.matched.discard(token)
            return
        self.matched.add(token)
        if len(parts) == 14:
            self.discovered[token] = "/" + parts[13]

    def publish(self, message, lose=False):
        """Sends a message, or loses it on the way; returns the ends of the keys that it was sent on."""
        if len(self.matched) > len(self.discovered):
            ends = [""]
        else:
            ends = ["/_buf_cpu"] if CPU in self.discovered.values() else []
            ends += [f"/_buf/{gid(token).hex()}" for token, backends in self.discovered.items() if backends != CPU]
        payload = bytes(STORE.serialize_cdr(message, IMAGE))
        for end in ends:
            self.sequence += 1
            attachment = struct.pack("<qqB", self.sequence, time.time_ns(), 16) + self.gid
            if not lose:
                self.peer.session.put(self.key + end, payload, attachment=attachment)
        return {end.rsplit("/", 1)[0] or end for end in ends}


class Images:
    """Sends small images at a steady rate, and counts them."""

    def __init__(self, publisher):
        self.publisher, self.sent, self.ends = publisher, 0, set()
        self.pixels = np.add.outer(np.arange(48), 2 * np.arange(64)).astype(np.uint8)

    def send(self, count, lose=False):
        for _ in range(count):
            self.sent += not lose
            self.ends |= self.publisher.publish(image_of(self.pixels, "mono8", 10 + self.sent), lose)
            time.sleep(1 / RATE)


def second_readers(binary, publisher, other, images):
    """A second reader of four kinds comes, hears five images and goes, again and again."""
    for number in range(JOINS):
        before = len(publisher.discovered)
        if number % 4 == 3:
            with Suite(binary, "topic", "echo", "/modulo", stdout=subprocess.DEVNULL):
                until("our reader", lambda: len(publisher.discovered) > before)
                images.send(5)
        else:
            backends = (LEGACY, CPU, APART)[number % 4]
            leave = other.reader("/modulo", backends)
            until("the reader", lambda: len(publisher.matched) == 3)
            # Each side hears of it on a way of its own.
            time.sleep(0.2)
            images.send(5)
            leave()
        until("its end", lambda: len(publisher.matched) == 2)
        images.send(2)


def to_modulo(binary):
    """Images of a publisher of Lyrical reach unwrap and a recorder, whatever second reader comes and goes."""
    sensor = ["--ros-args", "-p", "bits:=8", "-p", "alpha:=4.0"]
    with tempfile.TemporaryDirectory() as folder, Lyrical() as peer, Lyrical() as other:
        bag = Path(folder) / "bag"
        publisher = Publisher(peer, "/modulo")
        images = Images(publisher)
        with (
            Suite(binary, "bag", "record", "-o", str(bag), "/modulo"),
            Suite(binary, "run", "unwrap", *sensor, MODULO_REPORT_DIR=folder),
        ):
            until("both readers", lambda: len(publisher.matched) == 2)
            images.send(IMAGES - 7 * JOINS - 1)
            second_readers(binary, publisher, other, images)
            # What is lost is counted, however many numbers an image uses by now.
            images.send(3, lose=True)
            images.send(1)
            time.sleep(1.0)
        report = json.loads((Path(folder) / "unwrap.1.json").read_text())
        with Reader(bag) as reader:
            recorded = len({raw for _, _, raw in reader.messages()}), reader.message_count
    received, lost = (report[key].get("/modulo", 0) for key in ("received", "lost"))
    print(f"to modulo: {images.sent} images sent on {sorted(images.ends)}, {received} received, {recorded[1]} recorded;",
          f"{lost} of 3 lost images counted; {JOINS} second readers")
    assert images.ends == {"", "/_buf_cpu", "/_buf"}, images.ends
    assert (images.sent, received, lost, recorded) == (IMAGES, IMAGES, 3, (IMAGES, IMAGES)), (report, recorded)


def from_modulo(binary):
    """Images of the suite reach a reader of Lyrical, on the key of the topic."""
    scene = [f"source:=scene://tunnel?seed=3&frames={IMAGES}&width=64&height=48", f"rate:={RATE}", "wait_for:=[python]"]
    camera = ["run", "modulo_camera", "--ros-args", *(word for each in scene for word in ("-p", each))]
    numbers = []
    with Lyrical() as peer, Suite(binary, *camera):
        peer.reader("/modulo", CPU, lambda sample: numbers.append(struct.unpack_from("<q", bytes(sample.attachment))[0]))
        until("the first image", lambda: numbers)
        # Not before: the camera waits for one node of this name.
        with Lyrical() as other:
            for number in range(JOINS):
                leave = other.reader("/modulo", (LEGACY, CPU, APART)[number % 3])
                time.sleep(0.15)
                leave()
                time.sleep(0.1)
            until("the last image", lambda: numbers[-1] == IMAGES)
    print(f"from modulo: {len(numbers)} of {IMAGES} images received; {JOINS} second readers")
    assert numbers == list(range(1, IMAGES + 1)), numbers


if __name__ == "__main__":
    to_modulo(sys.argv[1])
    from_modulo(sys.argv[1])
