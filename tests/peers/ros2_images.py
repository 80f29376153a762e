"""Images between a node of a real ROS 2 and the suite: each encoding of cameras in, the streams of the suite out.

`tests/peers/ros2_suite.py images` runs it.
"""

import threading
import time

import numpy as np
import rclpy
from encodings_of_cameras import HEIGHT, WIDTH, encodings
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

PATIENCE = 30


class Camera(Node):
    """Sends images with their calibration, and hears the streams that the suite makes of them."""

    def __init__(self, context):
        super().__init__("real_camera", context=context)
        self.heard, self.warnings = {}, []
        self.info = CameraInfo(height=HEIGHT, width=WIDTH, distortion_model="plumb_bob", d=[-0.3, 0.1, 0.0, 0.0, 0.0],
                               k=[40.0, 0.0, 16.0, 0.0, 41.0, 8.0, 0.0, 0.0, 1.0],
                               r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                               p=[40.0, 0.0, 16.0, 0.0, 0.0, 41.0, 8.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        self.images = self.create_publisher(Image, "/camera/image_raw", qos_profile_sensor_data)
        self.infos = self.create_publisher(CameraInfo, "/camera/camera_info", qos_profile_sensor_data)
        self.twelve = self.create_publisher(Image, "/twelve/image_raw", qos_profile_sensor_data)
        self.listening = [self.create_subscription(kind, f"/suite/{name}", lambda message, name=name: self.hear(name, message),
                                                   qos_profile_sensor_data)
                          for name, kind in [("ideal", Image), ("modulo", Image), ("saturated", Image), ("recovered", Image),
                                             ("camera_info", CameraInfo)]]
        self.listening.append(self.create_subscription(Log, "/rosout", self.warn, 100))

    def hear(self, name, message):
        self.heard[name] = message

    def warn(self, line):
        if line.level == Log.WARN:
            self.warnings.append(line.msg)

    def send(self, publisher, encoding, step, data, number):
        """Sends an image of the second `number`, with its calibration."""
        image = Image(height=HEIGHT, width=WIDTH, encoding=encoding, step=step)
        image.data.frombytes(data)
        image.header.frame_id = "lens"
        image.header.stamp.sec = number
        self.info.header = image.header
        self.infos.publish(self.info)
        publisher.publish(image)

    def fault(self, colour):
        """What is wrong with the last streams of an image of `colour`; nothing if they all belong to it."""
        if len(self.heard) < 5:
            return f"only {sorted(self.heard)} have come"
        stamps = {(message.header.stamp.sec, message.header.frame_id) for message in self.heard.values()}
        if len(stamps) > 1:
            return f"the streams have the stamps {stamps}"
        info = self.heard["camera_info"]
        theirs, ours = [[list(i.k), list(i.d), list(i.p), i.distortion_model, i.width] for i in (self.info, info)]
        if theirs != ours:
            return f"the camera info is {ours}, not {theirs}"
        ideal = self.heard["ideal"]
        pixels = np.frombuffer(ideal.data, np.uint8).reshape(HEIGHT, WIDTH, -1)
        # Each code stands for an interval, and the camera takes any value of it.
        if pixels.shape[2] not in (1, 3) or np.abs(pixels - np.array(colour[: pixels.shape[2]])).max() > 2:
            return f"ideal ({ideal.encoding}) is {pixels[0, 0]}, not {colour}"
        return None


def until(send, fault):
    """Sends image after image until there is no fault; returns the last fault otherwise."""
    end = time.monotonic() + PATIENCE
    number = 1
    while time.monotonic() < end:
        send(number)
        number += 1
        time.sleep(0.05)
        if not (found := fault()):
            return None
    return found


def check(start, failure):
    """Each encoding, and codes of 12 bits in 16. `start` starts a command, `failure` is raised."""
    context = rclpy.Context()
    rclpy.init(context=context)
    camera = Camera(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(camera)
    threading.Thread(target=executor.spin, daemon=True).start()
    namespace = ["--ros-args", "-r", "__ns:=/suite"]
    start("modulo", "run", "modulo_camera", *namespace, "-p", "source:=topic:/camera/image_raw", "-p", "alpha:=1.0", "-p", "optical_black:=0")
    start("modulo", "run", "unwrap", *namespace)
    start("modulo", "run", "detector", *namespace, "-p", "input:=/twelve/image_raw", "-p", "engine:=rten")
    try:
        for encoding, step, data, colour in encodings():
            camera.heard.clear()
            send = lambda number: camera.send(camera.images, encoding, step, data, number)
            if found := until(send, lambda: camera.fault(colour)):
                raise failure(f"{encoding} to the suite and back: {found}; it says {camera.warnings[-3:]}")
            print(f"ok    {encoding} to the suite, and its streams back with the calibration", flush=True)
        data = np.full(HEIGHT * WIDTH, 2000, "<u2").tobytes()
        told = lambda: None if any("set the parameter bits to 12" in line for line in camera.warnings) else "no warning"
        if found := until(lambda number: camera.send(camera.twelve, "mono16", 2 * WIDTH, data, number), told):
            raise failure(f"codes of 12 bits in mono16 to the detector: {found}; it says {camera.warnings}")
        print("ok    codes of 12 bits in mono16 are told", flush=True)
    finally:
        executor.shutdown()
        rclpy.shutdown(context=context)
