"""The suite over a replay of the sample bag with `modulo view`, for the tests of the viewer."""

import contextlib
import os
import signal
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/samples/tunnel"


def check(holds, text):
    if not holds:
        raise SystemExit(f"FAILS {text}")
    print(f"ok    {text}", flush=True)


REPLAY = [
    ["run", "unwrap"],
    ["run", "detector", "--ros-args", "-p", "engine:=rten"],
    ["bag", "play", str(BAG), "--loop", "--rate", "0.5", "--topics", "/modulo", "/sensor_info", "--wait-for", "/unwrap", "/detector"],
]


@contextlib.contextmanager
def viewer(modulo, domain, *options, suite=REPLAY):
    """Starts the commands of `suite` (by default unwrap, the detector and a player) and the viewer with `options` in the ROS domain
    `domain`, and ends them all. Gives the process of the viewer, whose standard output can be read."""
    os.environ["ROS_DOMAIN_ID"] = domain
    started = []

    def start(*command, **more):
        started.append(subprocess.Popen([modulo, *command], cwd=ROOT, start_new_session=True, **more))
        return started[-1]

    try:
        for command in suite:
            start(*command)
        process = start("view", "--port", "0", *options, stdout=subprocess.PIPE, text=True)
        yield process
        process.send_signal(signal.SIGINT)
        check(process.wait(10) == 0, "SIGINT ends the viewer with exit code 0")
    finally:
        for process in started:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
        for process in started:
            process.wait(30)


def address(process, scheme):
    """The first word with this scheme in the next line of the viewer."""
    return next(word for word in process.stdout.readline().split() if word.startswith(scheme))
