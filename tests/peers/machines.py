"""Runs the camera on one host and unwrap and detector on another: network namespaces, joined by a router on each.

    venv/bin/pip install eclipse-zenoh
    venv/bin/python tests/peers/machines.py target/debug/modulo

Needs root, iproute2, faketime and openssl. The router is that of rmw_zenoh_cpp where a ROS 2 is sourced, else router.py. Fails when frames do not cross the link again after
a cut or after the death of a router, when a frame is neither received nor counted as lost, when frames grow older and older
on a slow link, when clocks that differ by 1 s are not reported, or when the configuration in docs/machines lets another
machine set a parameter of the camera.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

PATIENCE = 60.0
ROUTER = "rmw_zenoh_cpp/rmw_zenohd"
CAMERA, PERCEPTION = "modulo_a", "modulo_b"
LINK = "10.199.7"
MEGABIT = 50
FAKETIME = "/usr/$LIB/faketime/libfaketime.so.1"
ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = ROOT / "docs/machines"
# Small, so that the link and not the inference limits the rate.
MODEL = ROOT / "nodes/detector/tests/data/rows.onnx"
FRAMES = "scene://tunnel?seed=3&frames=1000000"


def sh(command):
    subprocess.run(command, shell=True, check=True)


def wait_until(what, condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"waited {PATIENCE:.0f} s for {what}"
        time.sleep(0.05)


class Process:
    """A command on a host, and the lines that it has printed."""

    def __init__(self, host, command, folder=None, **environment):
        self.lines = []
        self.child = subprocess.Popen(
            ["ip", "netns", "exec", host, *map(str, command)],
            env=os.environ | environment,
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        threading.Thread(target=lambda: self.lines.extend(self.child.stdout), daemon=True).start()

    def text(self):
        return "".join(self.lines)

    def end(self, how=signal.SIGINT):
        self.child.send_signal(how)
        return self.child.wait(PATIENCE)


class Network:
    """Two hosts with a link between them, and a router on each."""

    def __enter__(self):
        self.clear()
        for host in (CAMERA, PERCEPTION):
            sh(f"ip netns add {host} && ip -n {host} link set lo up")
        sh(f"ip link add eth0 netns {CAMERA} type veth peer name eth0 netns {PERCEPTION}")
        for number, host in enumerate((CAMERA, PERCEPTION), 1):
            sh(f"ip -n {host} addr add {LINK}.{number}/24 dev eth0 && ip -n {host} link set eth0 up")
        libraries = [Path(prefix) / "lib" for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":")]
        ours = [sys.executable, ROOT / "tests/peers/router.py"]
        self.router = next(([path / ROUTER] for path in libraries if (path / ROUTER).exists()), ours)
        print("router:", *self.router)
        self.routers = [Process(CAMERA, self.router), self.second_router()]
        return self

    def second_router(self):
        address = f'connect/endpoints=["tcp/{LINK}.1:7447"]'
        return Process(PERCEPTION, self.router, ZENOH_CONFIG_OVERRIDE=address)

    def replace_router(self):
        self.routers[1].end(signal.SIGKILL)
        self.routers[1] = self.second_router()

    def encrypt(self, folder):
        """Replaces the routers by those of docs/machines, with certificates that are made in `folder`."""
        for router in self.routers:
            router.end(signal.SIGKILL)
        subprocess.run([CONFIGURATION / "certificates.sh"], cwd=folder, check=True, stderr=subprocess.DEVNULL)
        hosts = Path(f"/etc/netns/{PERCEPTION}/hosts")
        hosts.parent.mkdir(parents=True, exist_ok=True)
        hosts.write_text(f"127.0.0.1 localhost\n{LINK}.1 camera\n")
        self.routers = [
            Process(host, self.router, folder, ZENOH_ROUTER_CONFIG_URI=str(CONFIGURATION / file))
            for host, file in ((CAMERA, "camera_router.json5"), (PERCEPTION, "perception_router.json5"))
        ]

    def cut(self, seconds):
        sh(f"ip -n {CAMERA} link set eth0 down")
        time.sleep(seconds)
        sh(f"ip -n {CAMERA} link set eth0 up")

    def slow_down(self):
        """Limits the link; netem delays it as well, where the kernel has it."""
        netem = f"tc -n {CAMERA} qdisc add dev eth0 root netem rate {MEGABIT}mbit delay 40ms limit 200"
        if subprocess.run(netem, shell=True, stderr=subprocess.DEVNULL).returncode == 0:
            return "40 ms of delay"
        sh(f"tc -n {CAMERA} qdisc add dev eth0 root tbf rate {MEGABIT}mbit burst 32kb latency 40ms")
        return "a queue of 40 ms (this kernel has no netem)"

    def sent(self):
        """The bytes that the camera's host has sent so far."""
        file = "/sys/class/net/eth0/statistics/tx_bytes"
        return int(subprocess.run(["ip", "netns", "exec", CAMERA, "cat", file], check=True, capture_output=True).stdout)

    def full_speed(self):
        sh(f"tc -n {CAMERA} qdisc del dev eth0 root")

    @staticmethod
    def clear():
        for host in (CAMERA, PERCEPTION):
            subprocess.run(f"ip netns pids {host} 2>/dev/null | xargs -r kill -9; ip netns del {host} 2>/dev/null", shell=True)
            shutil.rmtree(f"/etc/netns/{host}", ignore_errors=True)

    def __exit__(self, *_):
        self.clear()


class Suite:
    """The three nodes on two hosts, and a reader of the results beside the detector."""

    def __init__(self, modulo, rate, size="", perception=(), clock=None):
        self.folder = tempfile.TemporaryDirectory()
        reports = {"MODULO_REPORT_DIR": self.folder.name, "RUST_LOG": "warn"}

        def node(host, name, *parameters, **environment):
            settings = [argument for parameter in parameters for argument in ("-p", parameter)]
            return Process(host, [modulo, "run", name, "--ros-args", *settings], **reports, **environment)

        self.nodes = [
            node(PERCEPTION, "detector", f"model:={MODEL}", "engine:=rten"),
            node(PERCEPTION, "unwrap", "wait_for:=[detector]", *perception),
            node(
                CAMERA, "modulo_camera", f"source:={FRAMES}{size}", f"rate:={rate}", "wait_for:=[unwrap]",
                "psf_sigma:=1.0", **(clock or {}),
            ),
        ]
        self.reader = Process(PERCEPTION, [modulo, "topic", "echo", "/detector/detections"])
        self.wait_for(10)

    def count(self):
        return self.reader.text().count("\n---")

    def wait_for(self, more):
        before = self.count()
        wait_until(f"{more} results", lambda: self.count() >= before + more)

    def ages(self, count):
        """The ages of the next `count` results, s: their arrival minus the stamp of their frame."""
        ages, read, end = [], len(self.reader.lines), time.time() + 2 * PATIENCE
        while len(ages) < count:
            time.sleep(0.005)
            assert time.time() < end, f"{len(ages)} results in {2 * PATIENCE:.0f} s"
            now, lines = time.time(), self.reader.lines[read:]
            read += len(lines)
            # The stamp of the message is indented once, those of its detections more.
            stamps = re.findall(r"^    sec: (\d+)\n    nanosec: (\d+)", "".join(lines), re.MULTILINE)
            ages += [now - int(sec) - int(nanosec) / 1e9 for sec, nanosec in stamps]
        return ages

    def end(self):
        """Ends the nodes in the order of the data. Each frame has been received or counted as lost, but the last ones."""
        assert [node.child.poll() for node in self.nodes] == [None] * 3, "a node has ended"
        for node in reversed(self.nodes):
            node.end()
            time.sleep(1.0)
        self.reader.end()
        reports = {path.name.split(".")[0]: json.loads(path.read_text()) for path in Path(self.folder.name).iterdir()}
        sent = reports["modulo_camera"]["published"]
        received, lost = (reports["unwrap"][key] for key in ("received", "lost"))
        topic = next(name for name in received if name.startswith("/modulo"))
        self.folder.cleanup()
        return sent[topic], received[topic], lost[topic]


def accounted(name, counts):
    sent, received, lost = counts
    print(f"{name}: {sent} frames sent, {received} received, {lost} lost and counted")
    # The numbers of its neighbours show that a frame is missing. The first one, sent before the link knew its reader, and the one
    # that is sent while the camera ends have a neighbour on one side only.
    assert received > 0 and sent - 2 <= received + lost <= sent, counts


def percentile(values, percent):
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, len(ranked) * percent // 100)]


def cut_and_router(modulo, network):
    """A link that is cut for 5 s, and a router that is killed: results go on, and no loss is without a count."""
    suite = Suite(modulo, 10.0)
    network.cut(5.0)
    suite.wait_for(20)
    network.replace_router()
    suite.wait_for(20)
    accounted("link cut for 5 s, router killed", suite.end())


def slow_link(modulo, network):
    """More images than the link carries: the newest ones come, and none grows old."""
    for transport in ("raw", "compressed"):
        limits, before = network.slow_down(), network.sent()
        # A router gives an image up that needs much longer than 0.2 s; this one needs 60 ms.
        suite = Suite(modulo, 30.0, "&width=640&height=192", (f"image_transport:={transport}",))
        start = time.monotonic()
        first, last = suite.ages(10), suite.ages(10)
        rate = len(first + last) / (time.monotonic() - start)
        # The last frames of all must arrive, since nothing after them would show that they are missing.
        network.full_speed()
        suite.wait_for(10)
        counts = suite.end()
        assert network.sent() - before > 1e6, "the images have not crossed the link"
        print(
            f"{MEGABIT} Mbit/s with {limits}, 640x192 rgb8 at 30 Hz, {transport}: {rate:.1f} results/s, "
            f"age p50 {percentile(first + last, 50):.2f} s, p99 {percentile(first + last, 99):.2f} s, n = {len(first + last)}"
        )
        accounted(f"slow link, {transport}", counts)
        assert percentile(last, 50) < 1.5 * percentile(first, 50) + 0.2, "results grow older and older"
        assert percentile(last, 99) < 3.0, "the age is not bounded"


def clocks(modulo, _):
    """A camera whose clock is one second ahead or behind: the reader of its images says so."""
    for offset, words in (("+1s", "before they were sent"), ("-1s", "after they were sent")):
        # Not by the command faketime, which would get the signals in place of the camera.
        clock = {"LD_PRELOAD": FAKETIME, "FAKETIME": offset, "FAKETIME_DONT_FAKE_MONOTONIC": "1"}
        suite = Suite(modulo, 10.0, clock=clock)
        unwrap = suite.nodes[1]
        wait_until(f"a warning about a clock of {offset}", lambda: words in unwrap.text())
        print(f"clock of the camera {offset}:", next(line for line in unwrap.lines if words in line).strip())
        suite.end()


def encrypted(modulo, network):
    """The configuration in docs/machines: results come, and only the camera's own machine sets its parameters."""
    with tempfile.TemporaryDirectory() as folder:
        network.encrypt(folder)
        suite = Suite(modulo, 10.0)
        for host, possible in ((PERCEPTION, False), (CAMERA, True)):
            answer = Process(host, [modulo, "param", "set", "/modulo_camera", "alpha", "3.0"])
            code = answer.child.wait(PATIENCE)
            print(f"TLS, a parameter of the camera set on {host}: exit code {code}, {answer.text().strip()}")
            assert (code == 0) == possible
        denied(modulo)
        suite.wait_for(10)
        suite.end()


# The services of the nodes beside the camera: those that change something, and the others.
CHANGES = [
    "/modulo_camera/set_parameters", "/modulo_camera/set_parameters_atomically", "/modulo_camera/enable",
    "/logging/set_logger_levels",
    *(f"/rosbag2_player/{name}" for name in
      ("pause", "resume", "toggle_paused", "set_rate", "play_next", "burst", "seek", "play", "stop")),
]
READS = [f"/modulo_camera/{name}" for name in
         ("get_parameters", "list_parameters", "describe_parameters", "get_parameter_types")]


def denied(modulo):
    """Of the services beside the camera, the other machine gets an answer of those alone that change nothing."""
    nodes = [
        Process(CAMERA, [modulo, "bag", "play", ROOT / "bags/samples/tunnel", "--start-paused"]),
        Process(CAMERA, [modulo, "run", "unwrap", "--ros-args", "-r", "__node:=logging", "-r", "modulo:=/none", "-r",
                         "recovered:=/none/recovered", "-p", "enable_logger_service:=true"]),
    ]
    ask = [sys.executable, ROOT / "tests/peers/call_services.py", json.dumps([*CHANGES, *READS])]
    answer = Process(PERCEPTION, ask)
    code = answer.child.wait(2 * PATIENCE)
    wait_until("the output", lambda: code != 0 or answer.text().rstrip().endswith("}"))
    assert code == 0, answer.text()
    answered = json.loads(answer.lines[-1])
    print(f"TLS, services that answer the other machine: {answered}")
    assert answered["by type"] == READS and not set(answered["of any type"]) & set(CHANGES), answer.text()
    for node in nodes:
        node.end()


def main():
    modulo, only = Path(sys.argv[1]).resolve(), sys.argv[2:]
    with Network() as network:
        for scenario in (cut_and_router, slow_link, clocks, encrypted):
            if not only or scenario.__name__ in only:
                scenario(modulo, network)


if __name__ == "__main__":
    main()
