"""Runs the suite beside a real ROS 2 Jazzy: its launch files under `ros2 launch`, and each `ros2` command on its nodes.

    . /opt/ros/jazzy/setup.bash && . WORKSPACE/install/setup.bash
    python3 tests/peers/ros2_suite.py launch foreign crash graph types parameters data images dds images_dds

`colcon build` has installed the suite in WORKSPACE, for the last two checks with the bridge. The rmw of the first eight is
rmw_zenoh_cpp, whose router is started here; of the last two it is rmw_cyclonedds_cpp. Exit code 1 when a command fails or
does not print what is expected of it.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import rclpy
import ros2_images
import yaml
from geometry_msgs.msg import TwistStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from vision_msgs.msg import Detection2DArray

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/samples/tunnel"
SCENE = "source:=scene://tunnel?seed=3&frames="
IMAGE_HASH = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
PATIENCE = 90
RUNNING = []
# The arguments that keep a run going while its camera is killed.
RATE = {"recovered": ["rate:=5.0"], "cameras": []}
WORK = Path(tempfile.mkdtemp())


class Failure(Exception):
    """A command that does not do what is expected of it."""


def run(*command, limit=PATIENCE):
    """Exit code, standard output and standard error of a command. It gets SIGINT at `limit` seconds, and its whole group
    SIGKILL 10 s later."""
    paths = WORK / "output", WORK / "errors"
    with paths[0].open("w") as output, paths[1].open("w") as errors:
        process = subprocess.Popen(command, stdout=output, stderr=errors, start_new_session=True)
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            code = stop(process)
    return code, *(path.read_text(errors="replace") for path in paths)


def stop(process, patience=10):
    """The exit code after SIGINT."""
    if process.poll() is not None:
        return process.returncode
    os.killpg(process.pid, signal.SIGINT)
    try:
        return process.wait(patience)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.wait()


def expect(text, *command, stopped_after=None):
    """Runs a command that must print each line of `text`, and end with 0 unless it is stopped; returns both outputs.
    A second and a third try are for a graph that is still being found out, and for rmw_zenoh_cpp 0.2.10, whose clients hang at
    times when they are destroyed (its issue 993)."""
    for _ in range(3):
        got, output, errors = run(*command, limit=stopped_after or PATIENCE)
        missing = [line for line in text.splitlines() if line not in output + errors]
        if not missing and (got == 0 or stopped_after):
            print(f"ok    {' '.join(map(str, command))}", flush=True)
            return output, errors
        time.sleep(2)
    raise Failure(f"{' '.join(map(str, command))}: exit code {got}, without {missing}:\n{(output + errors)[-1500:]}")


def start(*command):
    """Starts a command that runs until the end of its check."""
    log = (WORK / f"{Path(command[0]).name}.log").open("a")
    process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    RUNNING.append(process)
    return process


class Boxes(Node):
    """Hears /detector/detections: boxes by stamp."""

    def __init__(self, context):
        super().__init__("boxes", context=context)
        self.by_stamp = {}
        self.create_subscription(Detection2DArray, "/detector/detections", self.heard, QoSProfile(depth=100))

    def heard(self, message):
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        self.by_stamp[stamp] = [
            (d.bbox.center.position.x, d.bbox.center.position.y, d.bbox.size_x, d.bbox.size_y,
             d.results[0].hypothesis.class_id, d.results[0].hypothesis.score)
            for d in message.detections
        ]


def boxes_of(*command):
    """The boxes of a run that replays the sample bag."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Boxes(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spin = threading.Thread(target=executor.spin, daemon=True)
    spin.start()
    code, output, errors = run(*command)
    time.sleep(1)
    executor.shutdown()
    rclpy.shutdown(context=context)
    if code != 0:
        raise Failure(f"{' '.join(command)}: exit code {code}:\n{(output + errors)[-1500:]}")
    return node.by_stamp


def launch():
    """Each launch file: its arguments, a run to a clean end, and the same boxes as `modulo launch` on the sample bag."""
    for file in sorted((ROOT / "launch").glob("*.launch.yaml")):
        expect("default:", "ros2", "launch", "modulo", file.name, "--show-args")
        if file.name in ("detector.launch.yaml", "replay.launch.yaml", "dds.launch.yaml"):
            continue
        arguments = {
            "sensor.launch.yaml": [f"{SCENE}4", "detectors:=[]"],
            "cameras.launch.yaml": [f"{SCENE}4".replace("source", camera) for camera in ["front", "rear"]],
        }.get(file.name, [f"{SCENE}4"])
        output = "".join(expect("[modulo_camera-", "ros2", "launch", "modulo", file.name, *arguments))
        started, ended = output.count("process started with pid"), output.count("process has finished cleanly")
        if not started or started != ended:
            raise Failure(f"ros2 launch modulo {file.name}: {started} processes, {ended} ended cleanly:\n{output[-1500:]}")
    # It has no source, so that it runs until SIGINT.
    process = start("ros2", "launch", "modulo", "detector.launch.yaml")
    expect("/detector", "ros2", "node", "list")
    if (code := stop(process, 20)) != 0:
        raise Failure(f"ros2 launch modulo detector.launch.yaml: exit code {code} after SIGINT")
    print("ok    ros2 launch modulo detector.launch.yaml")
    theirs = boxes_of("ros2", "launch", "modulo", "replay.launch.yaml", f"bag:={BAG}", "play_rate:=0")
    ours = boxes_of("modulo", "launch", str(ROOT / "launch/replay.launch.yaml"), f"bag:={BAG}", "play_rate:=0")
    if not theirs or theirs != ours:
        differ = [stamp for stamp in sorted(theirs | ours) if theirs.get(stamp) != ours.get(stamp)]
        raise Failure(f"boxes of the sample bag: {len(theirs)} frames under ros2 launch, {len(ours)} under modulo launch; "
                      f"these stamps have other boxes or are missing: {differ}")
    print(f"ok    the same boxes on {len(theirs)} frames of the sample bag")


FOREIGN = """
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch_ros.actions import SetParameter, SetParametersFromFile

def generate_launch_description():
    return LaunchDescription([
        SetParameter("wheel_radius", 0.383),
        SetParametersFromFile("{stack}"),
        IncludeLaunchDescription(AnyLaunchDescriptionSource("{file}"), launch_arguments={{"source": "{source}"}}.items()),
    ])
"""


def foreign():
    """A launch file of another package, which sets parameters of all nodes: each of ours ignores them with one warning."""
    stack, file = WORK / "stack.yaml", WORK / "foreign.launch.py"
    stack.write_text("/**:\n  ros__parameters:\n    robot_base_frame: base_link\n")
    file.write_text(FOREIGN.format(stack=stack, file=ROOT / "launch/recovered.launch.yaml", source=SCENE.split(":=")[1] + "4"))
    output = "".join(expect("[modulo_camera-", "ros2", "launch", str(file)))
    warnings = [line for line in output.splitlines() if "are ignored" in line]
    if len(warnings) != 3 or not all("wheel_radius" in line and "robot_base_frame" in line for line in warnings):
        raise Failure(f"a launch file of another package: not one warning of each node:\n" + "\n".join(warnings))


def crash():
    """A camera that is killed under `ros2 launch` comes back alone, and the run ends with its last frame."""
    for name, sources in [("recovered", ["source"]), ("cameras", ["front", "rear"])]:
        arguments = [SCENE.replace("source", source, 1) + "40" for source in sources]
        log = WORK / f"crash_{name}.log"
        with log.open("w") as output:
            process = subprocess.Popen(["ros2", "launch", "modulo", f"{name}.launch.yaml", *arguments, *RATE[name]],
                                       stdout=output, stderr=output, start_new_session=True)
        RUNNING.append(process)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and log.read_text().count("ready") < 3 * len(sources):
            time.sleep(0.1)
        camera = re.search(r"\[modulo_camera-\d+\]: process started with pid \[(\d+)\]", log.read_text())
        os.kill(int(camera[1]), signal.SIGKILL)
        code = process.wait(PATIENCE)
        text = log.read_text()
        died, cameras = text.count("process has died"), text.count("[modulo_camera-") and len(re.findall(
            r"\[modulo_camera-\d+\]: process started", text))
        if (code, died, cameras) != (0, 1, len(sources) + 1):
            raise Failure(f"{name}: exit code {code}, {died} processes died, {cameras} starts of a camera:\n{text[-2500:]}")
        print(f"ok    ros2 launch modulo {name}.launch.yaml with a camera that was killed")


def suite():
    """The suite at 5 Hz, once its detector answers."""
    process = start("modulo", "launch", str(ROOT / "launch/recovered.launch.yaml"), "--verbose", "rate:=5.0",
                    f"{SCENE}5000")
    expect("/modulo_camera\n/unwrap\n/detector", "ros2", "node", "list")
    return process


def graph():
    suite()
    expect("/recovered: sensor_msgs/msg/Image\n/detector/detections: vision_msgs/msg/Detection2DArray\n"
           "/detector/set_parameters: rcl_interfaces/srv/SetParameters", "ros2", "node", "info", "/detector")
    expect("/modulo [sensor_msgs/msg/Image]\n/detector/detections [vision_msgs/msg/Detection2DArray]",
           "ros2", "topic", "list", "-t")
    expect(f"{IMAGE_HASH}\nReliability: BEST_EFFORT\nNode name: detector", "ros2", "topic", "info", "-v", "/recovered")
    # One publisher of a node is listed once, whatever the node and its driver publish on the topic.
    listed, _ = expect("Node name: unwrap", "ros2", "topic", "info", "-v", "/diagnostics")
    if (count := listed.count("Node name: unwrap\n")) != 1:
        raise Failure(f"/unwrap is {count} times on /diagnostics")
    # A tool that has ended is no node any longer.
    viewer = start("modulo", "view", "--port", "0")
    expect("/viewer", "ros2", "node", "list")
    stop(viewer)
    if "/viewer" in expect("/detector", "ros2", "node", "list")[0]:
        raise Failure("/viewer is a node after its end")
    for command, word in [("node", "-a"), ("topic", "--include-hidden-topics")]:
        for more in [[], [word]]:
            theirs, ours = (set(expect("", tool, command, "list", *more)[0].splitlines()) for tool in ["ros2", "modulo"])
            # The tools themselves are nodes, too, with names that differ at each run.
            if differ := {name for name in theirs ^ ours if "cli" not in name}:
                raise Failure(f"{command} list {more}: listed by one of ros2 and modulo alone: {differ}")
    for topic in ["modulo", "recovered", "saturated", "ideal", "hdr", "detector/annotated"]:
        expect("height: \nwidth: \nencoding: ", "ros2", "topic", "echo", "--once", "--no-arr", f"/{topic}")
    for topic in ["detector/detections", "ground_truth"]:
        expect("header:\ndetections: ", "ros2", "topic", "echo", "--once", "--no-arr", f"/{topic}")
    for topic, form in [("modulo", "png"), ("recovered", "jpeg"), ("detector/annotated", "jpeg")]:
        expect(f"frame_id: camera_optical\nformat: rgb8; {form} compressed bgr8",
               "ros2", "topic", "echo", "--once", "--no-arr", f"/{topic}/compressed")
    expect("frame_id: camera_optical\nheight: \nwidth: ", "ros2", "topic", "echo", "--once", "--no-arr", "/camera_info")
    latched = ["--once", "--qos-durability", "transient_local", "--qos-reliability", "reliable"]
    expect("database_location: /detector/label_info", "ros2", "topic", "echo", *latched, "/detector/vision_info")
    expect("class_name: car\nthreshold: ", "ros2", "topic", "echo", *latched, "/detector/label_info")
    expect("name: 'detector: state'\nkey: stream\nvalue: ", "ros2", "topic", "echo", *latched, "/detector/state")
    expect("name: 'unwrap: recovery'\nname: detector", "ros2", "topic", "echo", "/diagnostics", stopped_after=8)
    expect("name: \nmsg: ", "ros2", "topic", "echo", "--once", "/rosout")
    expect("average rate: ", "ros2", "topic", "hz", "/detector/detections", stopped_after=8)
    expect("/s from ", "ros2", "topic", "bw", "/recovered", stopped_after=8)
    expect("average delay: ", "ros2", "topic", "delay", "/recovered", stopped_after=8)
    expect("Type: vision_msgs/msg/Detection2DArray", "ros2", "topic", "info", "/detector/detections")
    expect("/detector/get_parameters [rcl_interfaces/srv/GetParameters]", "ros2", "service", "list", "-t")
    expect("rcl_interfaces/srv/SetParameters", "ros2", "service", "type", "/unwrap/set_parameters")
    expect("successful=True", "ros2", "service", "call", "/detector/get_type_description",
           "type_description_interfaces/srv/GetTypeDescription", "{type_name: sensor_msgs/msg/Image}")


def types():
    """A message of a package that the suite does not know: the node that publishes it describes it."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("talker", context=context)
    publisher = node.create_publisher(TwistStamped, "/cmd", 10)
    message = TwistStamped()
    message.twist.linear.x = 1.5
    node.create_timer(0.1, lambda: publisher.publish(message))
    arrays = {"bytes": ([b"\x01"], "[2, 255]", "Byte values are: [2, 255]"),
              "bools": ([True], "[no, true]", "Boolean values are: [False, True]"),
              "integers": ([1], "[3, -4]", "Integer values are: [3, -4]"),
              "doubles": ([0.5], "[1, 2.5]", "Double values are: [1.0, 2.5]"),
              "strings": (["a"], "[b, 'c d']", "String values are: ['b', 'c d']")}
    for name, (default, _, _) in arrays.items():
        node.declare_parameter(name, default)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    try:
        for name, (_, value, shown) in arrays.items():
            expect("Set parameter successful", "modulo", "param", "set", "/talker", name, value)
            expect(shown, "modulo", "param", "get", "/talker", name)
        expect("twist:\n  linear:\n    x: 1.5", "modulo", "topic", "echo", "--once", "/cmd")
        expect("", "modulo", "bag", "record", "-o", WORK / "typed", "/cmd", stopped_after=5)
        expect("Topic: /cmd | Type: geometry_msgs/msg/TwistStamped", "ros2", "bag", "info", WORK / "typed")
        if b"MSG: geometry_msgs/msg/Vector3" not in b"".join(file.read_bytes() for file in (WORK / "typed").glob("*.mcap")):
            raise Failure("the bag has no definition of geometry_msgs/msg/TwistStamped")
    finally:
        executor.shutdown()
        rclpy.shutdown(context=context)


def parameters():
    suite()
    ask_parameters()


def ask_parameters(info="/modulo: sensor_msgs/msg/Image"):
    """Every `ros2 param` command on the running suite; `info` is in `ros2 node info` of the detector after the swap."""
    expect("/detector:\n  input\n  score_threshold", "ros2", "param", "list")
    expect("String value is: recovered", "ros2", "param", "get", "/detector", "input")
    expect("Set parameter successful", "ros2", "param", "set", "/detector", "input", "modulo")
    expect(info, "ros2", "node", "info", "/detector")
    expect("must be one of modulo", "ros2", "param", "set", "/detector", "input", "nonsense")
    expect("in 0 to 1", "ros2", "param", "set", "/detector", "score_threshold", "1.5")
    expect("Set parameter successful", "ros2", "param", "set", "/detector", "classes", "[]")
    expect("Max value: 1.0", "ros2", "param", "describe", "/detector", "score_threshold")
    for node in ["/modulo_camera", "/unwrap", "/detector"]:
        dump = WORK / "dump.yaml"
        output, _ = expect("ros__parameters:", "ros2", "param", "dump", node)
        # rmw_zenoh_cpp writes its own coloured warnings between the lines of the same output.
        dump.write_text("".join(line for line in output.splitlines(keepends=True) if "\x1b" not in line))
        if not yaml.safe_load(dump.read_text())[node]["ros__parameters"]:
            raise Failure(f"ros2 param dump {node} is empty")
        output = "".join(expect("", "ros2", "param", "load", node, str(dump)))
        if "failed" in output.lower():
            raise Failure(f"ros2 param load {node} does not take its own dump:\n{output}")


def data():
    """Bags both ways, and a single node under `ros2 run`."""
    process = suite()
    expect("", "ros2", "bag", "record", "-o", WORK / "theirs", "/modulo", "/sensor_info", "/detector/detections", stopped_after=8)
    stop(process)
    expect("/detector/detections\n/modulo", "modulo", "bag", "info", WORK / "theirs")
    expect("Topic: /modulo | Type: sensor_msgs/msg/Image", "ros2", "bag", "info", BAG)
    player = start("modulo", "bag", "play", str(BAG), "--start-paused")
    expect("durability: volatile\nuse_sim_time: false", "ros2", "param", "dump", "/rosbag2_player")
    expect("success=False", "ros2", "service", "call", "/rosbag2_player/play", "rosbag2_interfaces/srv/Play")
    # No second try: the service ends with the player. A client that hangs when it is destroyed may not print the answer.
    code, output, errors = run("ros2", "service", "call", "/rosbag2_player/stop", "rosbag2_interfaces/srv/Stop")
    if code == 0 and "Stop_Response" not in output:
        raise Failure(f"ros2 service call /rosbag2_player/stop: no answer:\n{(output + errors)[-1500:]}")
    if (code := player.wait(20)) != 0:
        raise Failure(f"modulo bag play: exit code {code} after the service stop")
    heard = boxes_of("modulo", "launch", str(ROOT / "launch/replay.launch.yaml"), f"bag:={WORK / 'theirs'}")
    if len(heard) < 10:
        raise Failure(f"a bag of ros2 bag record, replayed and detected: {len(heard)} frames with an answer")
    start("ros2", "run", "modulo", "unwrap", "--ros-args", "-r", "__node:=undo", "-p", "alpha:=4.0",
          "-p", "enable_logger_service:=true", "-p", "qos_overrides./recovered.publisher.reliability:=reliable")
    expect("/undo", "ros2", "node", "list")
    expect("Reliability: RELIABLE", "ros2", "topic", "info", "-v", "/recovered")
    expect("String value is: reliable", "ros2", "param", "get", "/undo", "qos_overrides./recovered.publisher.reliability")
    levels = "rcl_interfaces/srv/{}etLoggerLevels"
    expect("level=20", "ros2", "service", "call", "/undo/get_logger_levels", levels.format("G"), "{names: [undo]}")
    expect("successful=True", "ros2", "service", "call", "/undo/set_logger_levels", levels.format("S"),
           "{levels: [{name: undo, level: 10}]}")
    expect("level=10", "ros2", "service", "call", "/undo/get_logger_levels", levels.format("G"), "{names: [undo]}")
    start("ros2", "bag", "play", str(BAG), "--loop")
    expect("encoding: ", "ros2", "topic", "echo", "--once", "--no-arr", "/recovered")


def images():
    """Images of a real camera into the suite, and the streams of the suite back."""
    ros2_images.check(start, Failure)


def dds():
    """The suite on CycloneDDS: its nodes under their own names, their parameters, the stream swapped, a node that dies."""
    with on_dds():
        start("modulo", "launch", str(ROOT / "launch/dds.launch.yaml"), "input:=recovered", "rate:=5.0", f"{SCENE}5000")
        expect("/modulo_camera\n/unwrap\n/detector\n/ros2_bridge", "ros2", "node", "list")
        expect("/detector/detections: vision_msgs/msg/Detection2DArray\n"
               "/detector/set_parameters: rcl_interfaces/srv/SetParameters", "ros2", "node", "info", "/detector")
        ask_parameters(info="/detector/annotated: sensor_msgs/msg/Image")
        for topic in ["modulo", "recovered", "detector/annotated"]:
            expect("height: \nwidth: \nencoding: ", "ros2", "topic", "echo", "--once", "--no-arr", f"/{topic}")
        expect("String value is: modulo", "ros2", "param", "get", "/detector", "input")
        expect("header:\ndetections: ", "ros2", "topic", "echo", "--once", "--no-arr", "/detector/detections")
        subprocess.run(["pkill", "-KILL", "-f", "modulo run detector"], check=True)
        expect("String value is: modulo", "ros2", "param", "get", "/detector", "input")
        print("ok    a node that was killed is back on DDS with its parameters")


def images_dds():
    """1242 x 375 px, rgb8, at 30 Hz both ways at once for a minute (IMAGE_SECONDS): nothing is lost."""
    count = str(30 * int(os.environ.get("IMAGE_SECONDS", "60")))
    probe = [sys.executable, str(ROOT / "tests/peers/image_probe.py")]
    with on_dds():
        lists = [f"{way}:=[{topic}:sensor_msgs/msg/Image]"
                 for way, topic in [("zenoh_to_dds", "/to_dds"), ("dds_to_zenoh", "/to_zenoh")]]
        bridge = start("ros2", "run", "modulo_ros2_bridge", "ros2_bridge", "--ros-args", "-p", lists[0], "-p", lists[1])
        ways = {"/to_dds": ("rmw_zenoh_cpp", "rmw_cyclonedds_cpp"), "/to_zenoh": ("rmw_cyclonedds_cpp", "rmw_zenoh_cpp")}
        readers = {}
        for topic, (sender, receiver) in ways.items():
            environment = lambda rmw: os.environ | {"RMW_IMPLEMENTATION": rmw}
            readers[topic] = subprocess.Popen([*probe, "receive", topic, count], env=environment(receiver), stdout=subprocess.PIPE,
                                              start_new_session=True)
            RUNNING.append(readers[topic])
            RUNNING.append(subprocess.Popen([*probe, "send", topic, count], env=environment(sender), stderr=subprocess.DEVNULL,
                                            start_new_session=True))
        # Both are judged before the check fails, so that one fault does not hide the other.
        faults = []
        for topic, reader in readers.items():
            found = yaml.safe_load(reader.communicate()[0])
            if found["lost"] or not found["in_order"]:
                faults.append(topic)
            print(f"{'FAILS' if topic in faults else 'ok   '} {topic}: {found} of {count} images", flush=True)
        # At its end the bridge logs how many messages it has replaced and lost.
        stop(bridge)
        if faults:
            raise Failure(f"images on {faults}:\n{(WORK / 'ros2.log').read_text()[-1500:]}")


@contextlib.contextmanager
def on_dds():
    """CycloneDDS instead of zenoh for the `ros2` commands and the bridge."""
    before = os.environ["RMW_IMPLEMENTATION"]
    subprocess.run(["ros2", "daemon", "stop"], capture_output=True)
    os.environ["RMW_IMPLEMENTATION"] = "rmw_cyclonedds_cpp"
    try:
        yield
    finally:
        subprocess.run(["ros2", "daemon", "stop"], capture_output=True)
        os.environ["RMW_IMPLEMENTATION"] = before


def main():
    os.environ |= {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ROS_LOG_DIR": str(WORK)}
    os.environ.setdefault("ROS_DOMAIN_ID", "91")
    subprocess.run(["ros2", "daemon", "stop"], capture_output=True)
    router = start("ros2", "run", "rmw_zenoh_cpp", "rmw_zenohd")
    RUNNING.clear()
    time.sleep(2)
    failed = 0
    for name in sys.argv[1:]:
        try:
            globals()[name]()
        except Failure as why:
            failed += 1
            print(f"FAILS {name}: {why}", flush=True)
        finally:
            while RUNNING:
                stop(RUNNING.pop())
    subprocess.run(["ros2", "daemon", "stop"], capture_output=True)
    stop(router)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
