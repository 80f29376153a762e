"""Readers that are suspended must not hold up the suite: camera and unwrap go on for all others, and each frame is in a count.

    venv/bin/python tests/peers/stalled.py target/debug/modulo [raw|recorder|page|ending|HIROZ [READERS [SECONDS [RATE]]]]

The readers of the image topics are raw zenoh peers (eclipse-zenoh), `modulo bag record`, `modulo view` with a page, or nodes of hiroz,
whose program is then named. They read for a while (the control), are suspended for so many seconds, and are killed. An own session
hears the camera and unwrap all the time. Fails where unwrap answers less than 80 % as many of the camera's frames as in the control in any four seconds, where a frame is in no count, or where a thread
of the suite waits in close(). With `ending` the readers are raw peers that outlive the suite, and it fails where a node does not end
in time.
"""

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import websockets
from clients import page, session

DOMAIN = int(os.environ.get("ROS_DOMAIN_ID", "138"))
IMAGE = "sensor_msgs::msg::dds_::Image_/RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
TOPICS = ["modulo", "saturated", "recovered"]
SOURCE = "scene://tunnel?width=640&height=192&frames=10"
CLOSE = "3" if os.uname().machine == "x86_64" else "57"  # the number of the system call
CONTROL_S = 8
WINDOW_S = 4
PORT = 8170
TOKEN = "standsstill"
# A raw peer announces this lease: after it, the suite closes its links to the peer. zenoh's own is 10 s.
LEASE_MS = 60_000 if "ending" in sys.argv else 3000


def opened():
    return session(DOMAIN, ("transport/link/tx/lease", str(LEASE_MS)))


def read_raw():
    own = opened()
    held = [own.declare_subscriber(f"{DOMAIN}/{topic}/{IMAGE}", lambda _: None) for topic in TOPICS]
    while held:
        time.sleep(1.0)


class Threads:
    """Counts the threads of the suite that wait in close()."""

    def __init__(self, launcher):
        self.launcher, self.seen = launcher, {}

    def look(self):
        children = " ".join(task.read_text() for task in Path(f"/proc/{self.launcher}/task").glob("*/children"))
        for task in (task for pid in children.split() for task in Path(f"/proc/{pid}/task").glob("*")):
            # A thread or a process may end meanwhile.
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                if (task / "syscall").read_text().split()[0] == CLOSE:
                    name = f"{task.parts[2]} {(task / 'comm').read_text().strip()}"
                    self.seen[name] = self.seen.get(name, 0) + 1


@contextlib.contextmanager
def started(*command, output=subprocess.DEVNULL):
    """A process that is killed at the end of the block."""
    process = subprocess.Popen(command, stdout=output, stderr=output)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def suite(modulo, rate, hears, folder):
    """A camera and unwrap, and a session that hears their topics; the camera waits for the session, in the place of a detector."""
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    arguments = [f"source:={SOURCE}", f"rate:={rate}", "loop:=true", "detectors:=[observer]", "--summary", f"{folder}/summary"]
    command = [modulo, "launch", "sensor.launch.yaml", *arguments]
    with open(f"{folder}/log", "w", encoding="utf-8") as log, started(*command, output=log) as launch:
        time.sleep(2.0)
        own, heard = opened(), set()

        def hear(topic, take):
            return lambda sample: (heard.add(topic), take(sample))

        held = [own.declare_subscriber(f"{DOMAIN}/{topic}/**", hear(topic, take)) for topic, take in hears.items()]
        held.append(own.liveliness().declare_token(f"@ros2_lv/{DOMAIN}/{own.info.zid()}/0/0/NN/%/%/observer"))
        deadline = time.monotonic() + 60
        while len(heard) < len(hears):
            assert time.monotonic() < deadline, "the suite did not start: " + Path(log.name).read_text(encoding="utf-8")
            time.sleep(0.1)
        yield launch
        held.clear()
        own.close()
        launch.send_signal(signal.SIGINT)
        launch.wait(60)


def readers(modulo, kind, count, folder):
    """The commands of the readers."""
    topics = [f"/{topic}" for topic in TOPICS]
    raw = lambda _: [sys.executable, __file__, "read", *sys.argv[2:3]]
    commands = {
        "raw": raw,
        "ending": raw,
        "recorder": lambda n: [modulo, "bag", "record", "-o", f"{folder}/bag{n}", *topics],
        "page": lambda n: [modulo, "view", "--port", str(PORT + n), "--token", TOKEN],
    }
    hiroz = lambda n: [kind, "receive", topics[n % len(topics)], "1000000", "3600"]
    return [commands.get(kind, hiroz)(n) for n in range(count)]


def look(number):
    """A page that watches the image topics until its viewer ends."""
    with contextlib.suppress(websockets.ConnectionClosed):
        asyncio.run(page(PORT + number, TOKEN, [f"/{topic}" for topic in TOPICS], 3600))


def run(modulo, kind, count, seconds, rate, folder):
    """Returns the seconds at which the suite was heard by topic, when the readers were suspended, and the threads in close()."""
    times = {"sensor_info": [], "recovery": []}
    hears = {topic: lambda _, heard=heard: heard.append(time.monotonic()) for topic, heard in times.items()}
    with suite(modulo, rate, hears, folder) as launch, contextlib.ExitStack() as stack:
        threads = Threads(launch.pid)
        processes = [stack.enter_context(started(*command)) for command in readers(modulo, kind, count, folder)]
        time.sleep(4.0)
        pages = [threading.Thread(target=look, args=(number,), daemon=True) for number in range(count if kind == "page" else 0)]
        for thread in pages:
            thread.start()
        time.sleep(CONTROL_S)
        assert all(thread.is_alive() for thread in pages), "a page has no viewer"
        assert all(process.poll() is None for process in processes), "a reader has ended"
        for process in processes:
            process.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        while time.monotonic() < stopped + seconds:
            threads.look()
            time.sleep(0.25)
        if kind == "ending":
            launch.send_signal(signal.SIGINT)
            launch.wait(60)
        stack.close()
        time.sleep(3.0)
    return times, stopped, threads.seen


def check(times, stopped, seen, seconds, summary, log):
    """Says what went on while the readers stood still, and returns whether it was right."""
    share = lambda start, end: tuple(sum(start <= t < end for t in times[topic]) for topic in ("recovery", "sensor_info"))
    answered, sent = share(stopped - CONTROL_S, stopped)
    control = answered / max(sent, 1)
    print(f"control: {answered} of {sent} frames answered")
    bad = []
    for second in range(int(seconds) - WINDOW_S + 1):
        answered, sent = share(stopped + second, stopped + second + WINDOW_S)
        line = f"seconds {second} to {second + WINDOW_S}: {answered} of {sent} frames answered"
        # The frames of the same seconds are the measure, as the machine may be busy; one frame may be on its way.
        if answered < 0.8 * control * sent - 1:
            bad.append(line)
        elif second % WINDOW_S == 0:
            print(line)
    if seen:
        bad.append(f"threads in close(), looks of 0.25 s: {seen}")
    bad += [line for line in log.splitlines() if "still runs" in line]
    topic = summary["topics"]["/modulo"]
    if topic["out"] != topic["in"] + topic["lost"]:
        bad.append("frames of /modulo in no count")
    print(f"/modulo: {topic}", *bad, sep="\n")
    return not bad


def main():
    modulo = sys.argv[1]
    kind, count, seconds, rate = [*sys.argv[2:], *["raw", "3", "16", "20"][len(sys.argv) - 2 :]]
    with tempfile.TemporaryDirectory() as folder:
        heard = run(modulo, kind, int(count), float(seconds), rate, folder)
        summary = json.loads(Path(f"{folder}/summary").read_text(encoding="utf-8"))
        print(f"{kind}, {count} suspended for {seconds} s, {rate} Hz")
        log = Path(f"{folder}/log").read_text(encoding="utf-8")
        if check(*heard, float(seconds), summary, log):
            return 0
        print(log[-3000:])
        return 1


if __name__ == "__main__":
    if sys.argv[1] == "read":
        read_raw()
    sys.exit(main())
