"""The suite on DDS by its bridge, beside a real rclpy of PyPI on Fast DDS: images in, streams and boxes out, parameters, a crash.

    PYTHON_OF_ROS tests/peers/dds.py MODULO

`tests/peers/run dds` prepares what it needs. Exit code 1 when something does not hold.
"""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from replay import ROOT, check
from sensor_msgs.msg import Image

SIZE = (375, 1242, 3)
IMAGES = 100
PATIENCE = 90
RELIABLE = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)


def bare_type(package, name):
    """A message type without a Python class, whose messages are read as bytes."""
    library = ctypes.CDLL(f"lib{package}__rosidl_typesupport_c.so")
    handle = library[f"rosidl_typesupport_c__get_message_type_support_handle__{package}__msg__{name}"]
    handle.restype = ctypes.c_void_p
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype, capsule.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    converters = dict.fromkeys(["_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY", "_DESTROY_ROS_MESSAGE"], ())
    return type("Meta", (type,), converters | {"_TYPE_SUPPORT": capsule(handle(), None, None)})(name, (), {})


def boxes_in(data):
    """The stamp of a Detection2DArray and the number of its boxes."""
    second, nano, length = np.frombuffer(data, "<u4", 3, 4).tolist()
    return (second, nano), int(np.frombuffer(data, "<u4", 1, 16 + (length + 3) // 4 * 4)[0])


class Stack(Node):
    """A camera on DDS that hears what the suite makes of its images."""

    def __init__(self, context):
        super().__init__("stack", context=context)
        self.heard = {"/modulo": {}, "/recovered": {}}
        self.boxes = {}
        for topic, images in self.heard.items():
            self.create_subscription(Image, topic, lambda image, images=images: images.update({self.stamp(image): image}), RELIABLE)
        kind = bare_type("vision_msgs", "Detection2DArray")
        self.create_subscription(kind, "/detector/detections", lambda data: self.boxes.update([boxes_in(data)]), RELIABLE, raw=True)
        self.camera = self.create_publisher(Image, "/camera/image", RELIABLE)

    @staticmethod
    def stamp(image):
        return image.header.stamp.sec, image.header.stamp.nanosec

    def send(self, number):
        """Sends a picture of ramps, whose colours are those of the number."""
        rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
        picture = np.stack([columns // 8 + number % 16, rows // 4 + 60, (rows + columns) // 16], axis=2).astype(np.uint8)
        image = Image(height=SIZE[0], width=SIZE[1], encoding="rgb8", step=3 * SIZE[1])
        image.header.stamp.sec, image.header.frame_id = number, "lens"
        image.data.frombytes(picture.tobytes())
        self.camera.publish(image)
        return picture

    def call(self, kind, service, **fields):
        client = self.create_client(kind, service)
        check(client.wait_for_service(PATIENCE), f"{service} is on DDS")
        answer = client.call_async(kind.Request(**fields))
        until(answer.done, f"{service} answers")
        return answer.result()

    def set_input(self, stream):
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=stream)
        return self.call(SetParameters, "/detector/set_parameters", parameters=[Parameter(name="input", value=value)]).results[0]

    def input(self):
        return self.call(GetParameters, "/detector/get_parameters", names=["input"]).values[0].string_value


def until(holds, text):
    end = time.monotonic() + PATIENCE
    while not holds():
        if time.monotonic() > end:
            raise SystemExit(f"FAILS {text() if callable(text) else text}")
        time.sleep(0.1)


def take_images(stack):
    """Images of a camera on DDS to the suite, and its streams back: each one, once, unchanged where the sensor is undone."""
    sent, number = {}, 0
    # The first ones find the readers.
    while not stack.heard["/recovered"]:
        number += 1
        stack.send(number)
        time.sleep(0.2)
        if number == 5 * PATIENCE:
            raise SystemExit("FAILS no image of the camera comes back")
    for number in range(number + 1, number + 1 + IMAGES):
        sent[number, 0] = stack.send(number)
        until(lambda: all((number, 0) in images for images in stack.heard.values()), f"image {number} comes back on each topic")
    check(True, f"{IMAGES} of {IMAGES} images of {SIZE[1]} x {SIZE[0]} px go over DDS to the suite, and come back on {' and '.join(stack.heard)}")
    edge = 48  # the shaded columns, and what the lens mixes with them
    worst = max(int(np.abs(pixels(stack.heard["/recovered"][stamp])[:, edge:].astype(int) - picture[:, edge:]).max())
                for stamp, picture in list(sent.items())[::20])
    check(worst <= 2, f"the recovered images are those that were sent, within {worst} codes")


def pixels(image):
    return np.frombuffer(image.data, np.uint8).reshape(SIZE)


def main():
    modulo = str(Path(sys.argv[1]).resolve())
    os.environ |= {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_DOMAIN_ID": "93"}
    command = [modulo, "launch", str(ROOT / "launch/dds.launch.yaml"), "engine:=rten"]
    context = rclpy.Context()
    rclpy.init(context=context)
    stack, executor = Stack(context), SingleThreadedExecutor(context=context)
    executor.add_node(stack)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    try:
        for source, judge in [(["source:=topic:/camera/image"], take_images), (["source:=scene://tunnel?seed=3&frames=9999", "rate:=5.0"], drive)]:
            suite = subprocess.Popen([*command, *source], start_new_session=True, stdout=subprocess.DEVNULL)
            try:
                judge(stack)
            finally:
                os.killpg(suite.pid, signal.SIGINT)
                suite.wait(30)
    finally:
        executor.shutdown()
        rclpy.shutdown(context=context)
        spinning.join()


def drive(stack):
    """Boxes, nodes and parameters of the suite on DDS; a detector that dies is back with its parameters."""
    stack.boxes.clear()
    until(lambda: sum(map(bool, stack.boxes.values())) >= 10, lambda: f"boxes of ten frames come: {stack.boxes}")
    check(True, f"boxes are on DDS: {list(stack.boxes.values())[-5:]} in the last frames")
    nodes = lambda: {name for name, _ in stack.get_node_names_and_namespaces()}
    until(lambda: {"modulo_camera", "unwrap", "detector", "ros2_bridge"} <= nodes(), lambda: f"the nodes of the suite are on DDS: {nodes()}")
    check(stack.set_input("modulo").successful and stack.input() == "modulo", "the input of the detector is swapped from DDS")
    refusal = stack.set_input("nonsense")
    check(not refusal.successful and "must be one of" in refusal.reason, f"a wrong input is refused: {refusal.reason}")
    found = subprocess.run(["pgrep", "-f", "modulo run detector"], capture_output=True, text=True, check=True)
    for pid in found.stdout.split():
        if "ROS_DOMAIN_ID=93" in Path(f"/proc/{pid}/environ").read_text().split("\0"):
            os.kill(int(pid), signal.SIGKILL)
    stack.boxes.clear()
    until(lambda: len(stack.boxes) >= 3, "boxes come after the detector was killed")
    check(stack.input() == "modulo", "a detector that was killed is back on DDS with its parameters")


if __name__ == "__main__":
    main()
