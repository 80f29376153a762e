"""Writes the messages and services of the suite as a real rclpy has them: its type hashes, and the bytes of filled messages.

    venv/bin/pip install ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-diagnostic-msgs ros-std-srvs
    venv/bin/python tests/peers/rclpy_messages.py FILE

The test `messages_of_a_peer_are_read_and_written` of modulo-msgs reads FILE. Types of packages that have no wheel are named.
"""

import array
import importlib
import json
import sys
from pathlib import Path

import rclpy
from rclpy.serialization import serialize_message

INTERFACES = Path(__file__).resolve().parents[2] / "msgs/interfaces"
PREFIX = Path(sys.prefix)
counter = iter(range(1, 1 << 30))


def filled(message):
    """Gives each field of a message a value that no other one has; sequences get two elements."""
    for field, kind in message.get_fields_and_field_types().items():
        old = getattr(message, field)
        if hasattr(old, "get_fields_and_field_types"):
            filled(old)
            continue
        sequence = "[" in kind or kind.startswith("sequence<")
        element = kind.removeprefix("sequence<").split("[")[0].split(",")[0].rstrip(">")
        if not sequence:
            setattr(message, field, value(element))
            continue
        # As in double[9] and in sequence<IntegerRange, 1>.
        bound = int(kind.rstrip(">").rsplit(",", 1)[1]) if "," in kind else 2
        values = [value(element) for _ in range(len(old) if "[" in kind else min(bound, 2))]
        setattr(message, field, array.array(old.typecode, values) if isinstance(old, array.array) else values)
    return message


def value(kind):
    number = next(counter)
    if "/" in kind:
        package, name = kind.split("/")
        return filled(getattr(importlib.import_module(f"{package}.msg"), name)())
    if kind.startswith("string"):
        return f"text {number}"
    if kind == "boolean":
        return number % 2 == 0
    if kind in ("octet", "byte"):
        return bytes([number % 256])
    if kind in ("double", "float"):
        return number + 0.5
    return number % 100


def types():
    """The name of each message and service of the suite, with its class where rclpy has it."""
    for file in sorted(INTERFACES.glob("*/*/*")):
        package, kind, name = file.parts[-3], file.parts[-2], file.stem
        try:
            yield f"{package}/{kind}/{name}", getattr(importlib.import_module(f"{package}.{kind}"), name)
        except ModuleNotFoundError:
            yield f"{package}/{kind}/{name}", None


def hash_of(name, node):
    """The hash in the description that the package installs; for a message also that of a publisher."""
    described = json.loads((PREFIX / f"share/{name}.json").read_text())
    found = next(one["hash_string"] for one in described["type_hashes"] if one["type_name"] == name)
    if "/msg/" in name:
        package, _, short = name.split("/")
        publisher = node.create_publisher(getattr(importlib.import_module(f"{package}.msg"), short), "probe", 1)
        offered = {str(info.topic_type_hash) for info in node.get_publishers_info_by_topic("/probe")}
        node.destroy_publisher(publisher)
        assert offered == {found}, (name, offered, found)
    return found


def main():
    rclpy.init()
    node, written, missing = rclpy.create_node("probe"), [], []
    for name, cls in types():
        if cls is None:
            missing.append(name)
            continue
        parts = {f"{name}_Request": cls.Request, f"{name}_Response": cls.Response} if "/srv/" in name else {name: cls}
        messages = {part: filled(each()) for part, each in parts.items()}
        written.append({
            "name": name,
            "hash": hash_of(name, node),
            "messages": {part: [serialize_message(m).hex(), list(m.get_fields_and_field_types())] for part, m in messages.items()},
        })
    Path(sys.argv[1]).write_text(json.dumps(written))
    print(f"{len(written)} types of rclpy; without a wheel: {sorted({name.split('/')[0] for name in missing})}")


if __name__ == "__main__":
    main()
