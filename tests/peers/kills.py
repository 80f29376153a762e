"""Kills and suspends the nodes of a running suite, changes inputs, records and shows it, and looks whether the accounts close.

    venv/bin/python tests/peers/kills.py target/debug/modulo [SECONDS]

Each 17 s a node is killed (SIGKILL) or suspended for 5 s, and each 3 s a parameter changes. A recorder, `topic hz` and a page that
watches four topics come and go. An own session hears every result. Fails where a frame is answered twice, where the account of a
reader does not close, where a message is neither received nor counted with a reason, where a process or a file is left behind, or
where the viewer has more than 320 MB.
"""

import asyncio
import contextlib
import json
import os
import random
import re
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from clients import page, session

DOMAIN = 137
TOKEN = "killednodes"
PORT = 8164
PARAMETERS = [
    ("/detector", "input", ["modulo", "recovered", "saturated", "auto"]),
    ("/modulo_camera", "alpha", ["2.0", "4.0", "8.0"]),
    ("/unwrap", "method", ["auto", "spud", "lines"]),
    ("/detector", "input_size", ["auto", "640x192", "320x96"]),
]
WATCHED = ["/recovered", "/modulo", "/saturated", "/detector/annotated"]
PARTS = ["received", "lost", "before", "down", "elsewhere", "after"]


def children(launcher):
    """The process of each node of a launcher."""
    found = {}
    tasks = Path(f"/proc/{launcher}/task").glob("*/children")
    for child in (child for task in tasks for child in task.read_text().split()):
        with contextlib.suppress(OSError, IndexError):
            found[Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")[2].decode()] = int(child)
    return found


def memory_mb(process):
    status = Path(f"/proc/{process}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1000


class Results:
    """Counts the results of each frame, by its stamp."""

    def __init__(self):
        self.session, self.frames = session(DOMAIN), {}
        self.held = self.session.declare_subscriber(f"{DOMAIN}/detector/detections/**", self.take)

    def take(self, sample):
        stamp = struct.unpack_from("<iI", bytes(sample.payload), 4)
        self.frames[stamp] = self.frames.get(stamp, 0) + 1


def until(end, action):
    """Repeats an action in a thread of its own."""

    def repeat():
        while time.monotonic() < end:
            action()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    return thread


def command(seconds, *arguments):
    """Runs a command that a signal ends."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) in (0, 3), arguments


def tools(modulo, folder):
    command(5, modulo, "topic", "hz", "/recovered")
    bag = f"{folder}/bag{time.monotonic_ns()}"
    command(10, modulo, "bag", "record", "-o", bag, "/modulo", "/sensor_info", "/detector/detections")
    subprocess.run(["rm", "-r", bag], check=True)


def change(modulo):
    node, name, values = random.choice(PARAMETERS)
    # A node that is down or suspended does not answer.
    subprocess.run([modulo, "param", "set", node, name, random.choice(values)], capture_output=True, check=False)
    time.sleep(3)


def look():
    """A page that comes, and goes."""
    asyncio.run(page(PORT, TOKEN, WATCHED, 15))
    time.sleep(15)


def disturb(launcher, end):
    """Kills each node in turn, and suspends every fourth time."""
    turn = 0
    while time.monotonic() < end:
        time.sleep(17)
        node = ["detector", "unwrap", "modulo_camera"][(turn // 4 if turn % 4 == 3 else turn) % 3]
        if process := children(launcher).get(node):
            if turn % 4 == 3:
                os.kill(process, signal.SIGSTOP)
                time.sleep(5)
                os.kill(process, signal.SIGCONT)
            else:
                os.kill(process, signal.SIGKILL)
        turn += 1
    # The last one is back.
    time.sleep(8)


def faults(summary, heard, peak, before):
    """What was not right."""
    twice = sum(count > 1 for count in heard.values())
    found = [f"{twice} frames were answered twice"] if twice else []
    topics = summary["topics"]
    for account in summary["readers"]:
        line = f"{account['topic']} at {account['node']}: {account}"
        print(line)
        if account["sent"] != sum(account[part] for part in PARTS):
            found.append(f"does not close: {line}")
        # What was not made because nobody read it is in the account as well.
        if account["sent"] < topics[account["topic"]]["out"] or account["foreign"]:
            found.append(f"is not what was sent: {line}")
    if len(heard) > topics["/detector/detections"]["out"]:
        found.append(f"{len(heard)} results were heard, more than are counted")
    if peak > 320:
        found.append(f"the viewer had {peak:.0f} MB")
    # Those of zenoh are removed by its next process.
    left = {name for name in set(os.listdir("/dev/shm")) - before if not name.endswith(".zenoh")}
    return found + [f"left in /dev/shm: {left}"] * bool(left)


def run(modulo, seconds, folder, log):
    """Returns the summary, what was heard, and the most memory of the viewer, MB."""
    launch = ["recovered.launch.yaml", "source:=scene://tunnel?width=640&height=192", "rate:=10", "loop:=true"]
    summary = Path(folder) / "summary.json"
    launch += ["--summary", summary, "--max-restarts", "0"]
    with contextlib.ExitStack() as cleanup:
        start = lambda *arguments: subprocess.Popen([modulo, *arguments], stdout=log, stderr=log)
        suite, view = start("launch", *launch), start("view", "--port", str(PORT), "--token", TOKEN)
        cleanup.callback(suite.kill), cleanup.callback(view.kill)
        time.sleep(6)
        results, end, used = Results(), time.monotonic() + seconds, []
        watch = lambda: (used.append(memory_mb(view.pid)), time.sleep(5))
        actions = [watch, lambda: tools(modulo, folder), lambda: change(modulo), look]
        threads = [until(end, action) for action in actions]
        disturb(suite.pid, end)
        for thread in threads:
            thread.join()
        used.append(memory_mb(view.pid))
        for process in (suite, view):
            process.send_signal(signal.SIGINT)
        codes = suite.wait(60), view.wait(60)
        print(f"exit codes {codes}; memory of the viewer {used[0]:.0f} MB, at most {max(used):.0f} MB, {used[-1]:.0f} MB at the end")
        assert codes == (3, 0), codes
        results.session.close()
        time.sleep(1)
        return json.loads(summary.read_text()), results.frames, max(used)


def main():
    modulo, seconds = str(Path(sys.argv[1]).resolve()), float((sys.argv[2:] or ["60"])[0])
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    random.seed(5)
    before = set(os.listdir("/dev/shm"))
    with tempfile.TemporaryDirectory() as folder, open(f"{folder}/log", "w+", encoding="utf-8") as log:
        found = faults(*run(modulo, seconds, folder, log), before)
        if found:
            log.seek(0)
            print(log.read()[-3000:], *found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
