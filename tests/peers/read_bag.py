"""Reads a bag with PyPI rosbags and with the mcap reader, as an independent peer.

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


def with_rosbags(bag: Path) -> Counter:
    """Every message deserialised by rosbags, counted by topic."""
    with Reader(bag) as reader:
        expected = {c.topic: c.msgcount for c in reader.connections}
        for connection in reader.connections:
            print("rosbags:", connection.topic, connection.msgtype, connection.msgcount, connection.digest[:16])
            print("  qos:", connection.ext.offered_qos_profiles)
    counts: Counter = Counter()
    with AnyReader([bag]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            header = message.header.stamp
            assert header.sec * 10**9 + header.nanosec == stamp, (connection.topic, stamp)
            counts[connection.topic] += 1
    assert counts == expected, (counts, expected)
    return counts


def with_mcap(bag: Path) -> Counter:
    """Every message decoded by the schema that the file itself carries."""
    counts: Counter = Counter()
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            print("mcap:", reader.get_header().profile, reader.get_header().library)
            print("mcap metadata:", [record.name for record in reader.iter_metadata()])
            for _, channel, _, message in reader.iter_decoded_messages():
                if hasattr(message, "encoding"):
                    assert len(message.data) == message.height * message.step
                counts[channel.topic] += 1
    return counts


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    first, second = with_rosbags(folder), with_mcap(folder)
    assert first == second, (first, second)
    print("agreed:", dict(first))
