"""Sends or receives images of 1242 x 375 px, rgb8, at 30 Hz in a ROS 2 graph, and measures losses and lag.

    python3 tests/peers/image_probe.py send TOPIC COUNT      # after the first subscriber has appeared
    python3 tests/peers/image_probe.py receive TOPIC COUNT   # prints a line of JSON

RMW_IMPLEMENTATION chooses the graph. The stamp of an image is the time at which it was sent, its frame_id the number of
the image from 0. The lag is the time from there to the subscription, serialization included.
"""

import json
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import Image

PERIOD = 1 / 30
PATIENCE = 60
QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def send(node, topic, count):
    """Sends `count` images."""
    publisher = node.create_publisher(Image, topic, QOS)
    image = Image(height=375, width=1242, encoding="rgb8", step=3 * 1242)
    image.data.frombytes(bytes(range(250)) * (375 * 1242 * 3 // 250))
    end = time.monotonic() + PATIENCE
    while publisher.get_subscription_count() == 0 and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(2)
    start = time.monotonic()
    for number in range(count):
        time.sleep(max(0, start + number * PERIOD - time.monotonic()))
        image.header.frame_id = str(number)
        image.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(serialize_message(image))
    time.sleep(3)


def receive(node, topic, count):
    """Receives images until the last one has come, or none for 10 s after the first."""
    lags, numbers = [], []
    last = [time.monotonic() + PATIENCE]

    def heard(image):
        lags.append((node.get_clock().now() - Time.from_msg(image.header.stamp)).nanoseconds / 1e6)
        numbers.append(int(image.header.frame_id))
        last[0] = time.monotonic() + 10

    node.create_subscription(Image, topic, heard, QOS)
    while time.monotonic() < last[0] and (not numbers or numbers[-1] + 1 < count):
        rclpy.spin_once(node, timeout_sec=0.1)
    ranked = sorted(lags) or [0.0]
    quantile = lambda q: round(ranked[min(len(ranked) - 1, int(q * len(ranked)))], 2)
    print(json.dumps({"received": len(numbers), "lost": count - len(set(numbers)), "in_order": numbers == sorted(numbers),
                      "lag_ms": {"p50": quantile(0.5), "p99": quantile(0.99), "max": round(ranked[-1], 2)}}))


def main():
    command, topic, count = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node(f"image_probe_{command}")
    {"send": send, "receive": receive}[command](node, topic, int(count))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
