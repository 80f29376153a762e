"""Runs the suite at 30 Hz, as processes and in one process at the same time, and looks at losses, memory and age.

    python3 tests/peers/soak.py target/release/modulo [SECONDS]

Fails when a frame is neither answered nor counted, when one process loses a frame, when a process has grown by more than
5 % since the first minute (in a run of less than three minutes: by more than 15 % since a third of the run), or when results
are older at the end than at the beginning.
"""

import contextlib
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RATE = 30
# Small, so that two suites hold the rate on two cores.
MODEL = ROOT / "nodes/detector/tests/data/rows.onnx"
SCENE = "scene://tunnel?seed=3&width=320&height=96"
# No other test uses it: tests take the domains 100 to 232.
DOMAINS = {"live": "97", "composed": "98"}


def percentile(values, percent):
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, len(ranked) * percent // 100)]


def memory(process):
    """Resident memory of a process, MB; None when it has ended."""
    try:
        found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{process}/status").read_text())
    except FileNotFoundError:
        return None
    return int(found[1]) / 1000 if found else None


def processes(launcher):
    """The launcher and its nodes, by a name."""
    names = {launcher: "launcher"}
    tasks = Path(f"/proc/{launcher}/task").glob("*/children")
    for child in (int(child) for task in tasks for child in task.read_text().split()):
        arguments = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
        names[child] = arguments[2].decode() if len(arguments) > 2 else "process"
    return names


class Run:
    """A launch of the suite without end of its source."""

    def __init__(self, modulo, mode, folder):
        self.mode, self.summary = mode, Path(folder) / f"{mode}.json"
        environment = {"ROS_DOMAIN_ID": DOMAINS[mode], "PATH": "/usr/bin:/bin", "HOME": folder}
        command = [modulo, "launch", ROOT / "launch/recovered.launch.yaml", f"source:={SCENE}", f"rate:={RATE}", "loop:=true"]
        command += [f"model:={MODEL}", "engine:=rten", "--summary", self.summary] + (["--compose"] if mode == "composed" else [])
        self.log = open(Path(folder) / f"{mode}.log", "w+")
        self.start = time.monotonic()
        self.child = subprocess.Popen(command, env=environment, stdout=self.log, stderr=self.log)
        self.reader, self.ages = None, []
        if mode == "live":
            echo = [modulo, "topic", "echo", "/detector/detections"]
            self.reader = subprocess.Popen(echo, env=environment, stdout=subprocess.PIPE, text=True)
        time.sleep(5)
        self.names = processes(self.child.pid)

    def read_ages(self, end):
        """Reads results until `end`: seconds from the stamp of the frame to the arrival of its result."""
        stamp = re.compile(r"^    (sec|nanosec): (\d+)$")
        seconds = 0
        for line in self.reader.stdout:
            if found := stamp.match(line):
                if found[1] == "sec":
                    seconds = int(found[2])
                else:
                    self.ages.append(time.time() - seconds - int(found[2]) / 1e9)
            if time.monotonic() > end:
                return

    def memory(self):
        return {name: memory(process) for process, name in self.names.items()}

    def kill(self):
        """Leaves nothing behind: nodes end when their launcher was killed."""
        for process in filter(None, (self.child, self.reader)):
            process.kill()
            process.wait()

    def end(self):
        # 2 is SIGINT.
        self.child.send_signal(2)
        code = self.child.wait(60)
        self.log.seek(0)
        self.seconds = time.monotonic() - self.start
        assert code == 0, f"{self.mode}: exit code {code}\n{self.log.read()}"
        return json.loads(self.summary.read_text())


def check_account(run, summary):
    mode, topics = run.mode, summary["topics"]
    answered = topics["/detector/detections"]["out"]
    streams = [topics["/modulo"], topics["/recovered"]]
    replaced, lost, unread = (sum(stream[field] for stream in streams) for field in ("replaced", "lost", "unread"))
    print(f"{mode}: {summary['frames']} frames in {run.seconds:.0f} s, {answered} answered, {replaced} replaced by newer ones, {lost} lost, {unread} unread")
    # Between processes the transport of a machine that is overloaded may drop a frame, which is then counted as lost.
    assert lost == 0 or mode == "live", f"{mode}: frames were lost"
    assert answered + replaced + lost + unread == summary["frames"], f"{mode}: a frame is in no count: {json.dumps(summary)}"


def check_memory(mode, early, late, limit):
    for name, before in early.items():
        after = late[name]
        print(f"{mode} {name}: {before:.1f} MB, at the end {after:.1f} MB")
        assert after < before * limit, f"{mode}: {name} grows"


def main():
    modulo, seconds = Path(sys.argv[1]).resolve(), float((sys.argv[2:] or ["60"])[0])
    first, limit = (60, 1.05) if seconds >= 180 else (seconds / 3, 1.15)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as cleanup:
        runs = [Run(modulo, mode, folder) for mode in DOMAINS]
        for run in runs:
            cleanup.callback(run.kill)
        start = time.monotonic()
        live = runs[0]
        live.read_ages(start + first)
        early, young = [run.memory() for run in runs], live.ages[len(live.ages) // 2 :]
        live.ages = []
        live.read_ages(start + seconds - first)
        live.ages = []
        live.read_ages(start + seconds)
        late, old = [run.memory() for run in runs], live.ages
        summaries = [run.end() for run in runs]
    print(
        f"age of a result p50 {1e3 * percentile(old, 50):.1f} ms, p99 {1e3 * percentile(old, 99):.1f} ms in the last "
        f"{first:.0f} s (n = {len(old)}), p50 {1e3 * percentile(young, 50):.1f} ms at the beginning (n = {len(young)})"
    )
    for run, before, after, summary in zip(runs, early, late, summaries):
        check_account(run, summary)
        check_memory(run.mode, before, after, limit)
    assert percentile(old, 50) < 2 * percentile(young, 50) + 0.1, "results become older"


if __name__ == "__main__":
    main()
