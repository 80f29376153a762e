"""Bags of the suite read by PyPI rosbags, mcap and mcap-ros2-support, and theirs
by the suite.

    venv/bin/python bags.py target/release/modulo

Needs the packages that read_bag.py names. The images are made here.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from read_bag import check

ROOT = Path(__file__).resolve().parents[2]
START = 1_700_000_000_000_000_000
FRAMES = 12


def modulo(*arguments: str, codes: tuple = (0,)) -> str:
    done = subprocess.run([MODULO, *arguments], cwd=ROOT, text=True, capture_output=True, timeout=300)
    assert done.returncode in codes, (arguments, done.returncode, done.stdout, done.stderr)
    return done.stdout + done.stderr


def recorded(folder: Path, name: str, *options: str) -> None:
    """A launch of the suite, recorded, and read by the peers."""
    bag = folder / name
    recorder = subprocess.Popen([MODULO, "bag", "record", "--all", "-o", str(bag), *options], cwd=ROOT)
    while not bag.is_dir():
        time.sleep(0.05)
    try:
        # A detector that is too slow here drops frames, which is code 3.
        scene = "source:=scene://tunnel?frames=24"
        modulo("launch", "launch/recovered.launch.yaml", scene, "rate:=8", "engine:=rten", codes=(0, 3))
    finally:
        recorder.send_signal(signal.SIGINT)
        assert recorder.wait(30) in (0, 3)
    counts = check(bag)
    assert counts["/modulo"] > 0 and counts["/detector/detections"] > 0, counts
    print(name, len(list(bag.glob("*.mcap"))), "files:", dict(counts))


def messages(store):
    """(topic, type, stamp, message) of images with random pixels, plain and as a file."""
    time_type, header_type = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    image_type = store.types["sensor_msgs/msg/Image"]
    file_type = store.types["sensor_msgs/msg/CompressedImage"]
    random = np.random.default_rng(7)
    for number in range(FRAMES):
        stamp = START + number * 100_000_000
        # ROS 1 counts the headers.
        sequence = {"seq": number} if "seq" in header_type.__dataclass_fields__ else {}
        at = time_type(sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = header_type(stamp=at, frame_id="camera", **sequence)
        pixels = random.integers(0, 256, 48 * 64 * 3, dtype=np.uint8)
        image = image_type(header=header, height=48, width=64, encoding="rgb8", is_bigendian=0, step=192, data=pixels)
        yield "/camera/image_raw", "sensor_msgs/msg/Image", stamp, image
        data = random.integers(0, 256, 999, dtype=np.uint8)
        yield "/camera/compressed", "sensor_msgs/msg/CompressedImage", stamp + 1, file_type(header=header, format="png", data=data)
        text = store.types["std_msgs/msg/String"](data=f"number {number}")
        yield "/text", "std_msgs/msg/String", stamp + 2, text


def write(writer, store, serialize) -> None:
    with writer:
        connections = {}
        for topic, kind, stamp, message in messages(store):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp, serialize(message, kind))


def returned(bag: Path) -> list:
    """What the peers find in a bag."""
    with AnyReader([bag]) as reader:
        found = []
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            data = message.data if isinstance(message.data, str) else message.data.tobytes()
            found.append((connection.topic, stamp, data))
        return found


def converted(folder: Path, name: str, bag: Path) -> None:
    """A bag of a peer, through the suite, and back to the peer."""
    out = folder / f"{name}_converted"
    modulo("bag", "convert", str(bag), str(out), "--compression", "zstd", "-b", "60000")
    # rosbags writes down no quality of service.
    check(out, qos=False)
    store = get_typestore(Stores.ROS2_JAZZY)
    expected = [
        (topic, stamp, m.data if isinstance(m.data, str) else m.data.tobytes())
        for topic, _, stamp, m in messages(store)
    ]
    assert returned(out) == expected, name
    print(name, "returned with", len(expected), "messages in", len(list(out.glob("*.mcap"))), "files")


def beside(folder: Path, compression: CompressionType) -> None:
    """An attachment and a metadata record of PyPI mcap, copied by the suite, and returned to it."""
    data = np.random.default_rng(3).integers(0, 256, 3_000_001, dtype=np.uint8).tobytes()
    bag, expected = folder / f"beside_{compression.name}.mcap", {"weather": "rain", "car": "7"}
    with open(bag, "wb") as file:
        writer = McapWriter(file, compression=compression)
        writer.start("ros2")
        channel = writer.register_channel("/text", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data"), {"own": "kept"})
        writer.add_message(channel, 1, b"\0\1\0\0\1\0\0\0\0", 1)
        writer.add_attachment(create_time=2, log_time=3, name="calib.yaml", media_type="text/yaml", data=data)
        writer.add_metadata("drive", expected)
        writer.finish()
    for command in ("convert", "recover"):
        out = folder / f"beside_{compression.name}_{command}"
        modulo("bag", command, str(bag), str(out))
        with open(next(out.glob("*.mcap")), "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            (attachment,) = reader.iter_attachments()
            assert (attachment.name, attachment.media_type, attachment.create_time, attachment.log_time) == ("calib.yaml", "text/yaml", 2, 3)
            assert attachment.data == data
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            assert metadata["drive"] == expected, metadata
            (channel,) = reader.get_summary().channels.values()
            assert channel.metadata["own"] == "kept", channel
    said = modulo("bag", "info", str(out))
    assert "Name: calib.yaml | Media type: text/yaml | Size: 2.9 MiB" in said and "Name: drive" in said, said
    print("what is beside the messages returned from", bag.name)


def main() -> None:
    os.environ["ROS_DOMAIN_ID"] = "149"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for compression in CompressionType:
            beside(folder, compression)
        recorded(folder, "plain")
        recorded(folder, "zstd_by_time", "--compression", "zstd", "--max-bag-duration", "1")
        recorded(folder, "lz4_by_size", "--compression", "lz4", "--max-bag-size", "4000000")
        store = get_typestore(Stores.ROS2_JAZZY)
        for plugin in StoragePlugin:
            name = f"ros2_{plugin.name.lower()}"
            write(Writer2(folder / name, version=9, storage_plugin=plugin), store, store.serialize_cdr)
            converted(folder, name, folder / name)
        packed = Writer2(folder / "ros2_zstd", version=9, storage_plugin=StoragePlugin.MCAP)
        packed.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        write(packed, store, store.serialize_cdr)
        converted(folder, "ros2_zstd", folder / "ros2_zstd")
        each = Writer2(folder / "ros2_messages", version=9, storage_plugin=StoragePlugin.SQLITE3)
        each.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
        write(each, store, store.serialize_cdr)
        converted(folder, "ros2_messages", folder / "ros2_messages")
        whole = Writer2(folder / "ros2_file", version=9, storage_plugin=StoragePlugin.SQLITE3)
        whole.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
        write(whole, store, store.serialize_cdr)
        said = modulo("bag", "info", str(folder / "ros2_file"), codes=(1,))
        assert "compressed as a whole" in said and "`zstd -d " in said, said
        store = get_typestore(Stores.ROS1_NOETIC)
        old = folder / "ros1.bag"
        write(Writer1(old), store, store.serialize_ros1)
        said = modulo("bag", "info", str(old), codes=(1,))
        # The remedy is run as it stands there.
        remedy = re.search(r"`rosbags-convert (.*) FOLDER`", said)[1].split()
        subprocess.run([Path(sys.executable).parent / "rosbags-convert", *remedy, folder / "ros1"], check=True)
        converted(folder, "ros1", folder / "ros1")
    print("all agreed")


if __name__ == "__main__":
    MODULO = str(Path(sys.argv[1]).resolve())
    main()
