"""Reads a bag with PyPI rosbags and with the mcap reader, as independent peers.

    python3 -m venv venv && venv/bin/pip install rosbags mcap mcap-ros2-support
    venv/bin/python read_bag.py BAG_FOLDER

Prints what each of them found and fails when they disagree with metadata.yaml
or with each other.
"""

import sys
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore


def with_rosbags(bag: Path, qos: bool) -> Counter:
    """Every message deserialised by rosbags, counted by topic; with the QoS of its publishers if `qos`."""
    with Reader(bag) as reader:
        expected = {c.topic: c.msgcount for c in reader.connections if c.msgcount}
        for connection in reader.connections:
            print("rosbags:", connection.topic, connection.msgtype, connection.msgcount, connection.digest[:16])
            assert connection.digest.startswith("RIHS01_"), connection
            assert connection.ext.offered_qos_profiles or not qos, connection
    counts: Counter = Counter()
    with AnyReader([bag]) as reader:
        typestore = get_typestore(Stores.ROS2_JAZZY)
        for connection in reader.connections:
            # What the bag says of a type that ROS 2 Jazzy has is what Jazzy says.
            if connection.msgtype in typestore.fielddefs:
                assert typestore.hash_rihs01(connection.msgtype) == connection.digest, connection.msgtype
        last = 0
        for connection, stamp, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            assert stamp >= last, (connection.topic, stamp, last)
            last = stamp
            counts[connection.topic] += 1
    assert counts == expected, (counts, expected)
    return counts


def with_mcap(bag: Path) -> Counter:
    """Every message decoded by the schema that the files themselves carry."""
    counts: Counter = Counter()
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            assert reader.get_header().profile == "ros2", reader.get_header()
            assert [record.name for record in reader.iter_metadata()] == ["rosbag2"]
            for _, channel, _, message in reader.iter_decoded_messages():
                if hasattr(message, "encoding"):
                    assert len(message.data) == message.height * message.step
                counts[channel.topic] += 1
            print("mcap:", path.name, reader.get_header().library)
    return counts


def check(bag: Path, qos: bool = True) -> Counter:
    """Both of them, which must agree."""
    first, second = with_rosbags(bag, qos), with_mcap(bag)
    assert first == second, (first, second)
    assert first, "no message at all"
    return first


if __name__ == "__main__":
    print("agreed:", dict(check(Path(sys.argv[1]))))
