"""Shows, with zenoh alone and nothing of this suite, that a reader that stands still stops a process which sends to it.

    python3 -m venv venv && venv/bin/pip install eclipse-zenoh==1.10.2
    venv/bin/python tests/peers/linger.py

P and Q send 120 kB at 20 Hz to each other, and P to three readers R as well; each pair has two links, as after gossip. All R are
suspended. When their leases are over (10 s), P closes its links to them with unsent data inside. zenoh sets SO_LINGER to 10 s, so that
each close() blocks a thread of zenoh for as long: both threads `rx-*`, and P hears nobody, or the one thread `net-0`, and all links that
P has dialled stand. One R is enough, but not in each run.

Prints what Q and P hear in each second, and the threads of P that are in close(). Ends with 1 where one of them heard nothing for 3 s.
With `ZENOH_LINGER=off` (P runs with a library that leaves SO_LINGER out) it ends with 0.
"""

import ctypes
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

SUSPENDED_S = 24
READERS = range(2, 5)
PORT = 7480
CLOSE = "3"  # the number of the system call on x86-64


def session(own, others):
    import zenoh

    config = zenoh.Config()
    for key, value in [
        ("mode", '"peer"'),
        ("listen/endpoints", f'["tcp/127.0.0.1:{PORT + own}"]'),
        ("connect/endpoints", str([f"tcp/127.0.0.1:{PORT + other}" for other in others]).replace("'", '"')),
        ("scouting/multicast/enabled", "false"),
    ]:
        config.insert_json5(key, value)
    return zenoh.open(config)


def close_without_waiting():
    """What this suite does once a second: SO_LINGER off for all sockets of the process."""
    off = struct.pack("ii", 0, 0)
    while True:
        for number in os.listdir("/proc/self/fd"):
            ctypes.CDLL(None).setsockopt(int(number), socket.SOL_SOCKET, socket.SO_LINGER, off, len(off))
        time.sleep(1.0)


def peer(own, others, sends, hears):
    import zenoh

    if os.environ.get("ZENOH_LINGER") == "off":
        threading.Thread(target=close_without_waiting, daemon=True).start()
    opened = session(own, others)
    heard = [0]

    def count(_):
        heard[0] += 1

    held = [opened.declare_subscriber(key, count) for key in hears]
    publisher = opened.declare_publisher(sends, congestion_control=zenoh.CongestionControl.DROP) if sends else None
    while held:
        before = heard[0]
        for _ in range(20):
            if publisher:
                publisher.put(bytes(120_000))
            time.sleep(0.05)
        print(heard[0] - before, flush=True)


def threads_in_close(pid):
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [(task / "comm").read_text().strip() for task in tasks if (task / "syscall").read_text().split()[0] == CLOSE]


def main():
    start = lambda name: subprocess.Popen([sys.executable, __file__, name], stdout=subprocess.PIPE, text=True)
    readers = [start(f"{own}") for own in READERS]
    q, p = start("q"), start("p")
    silent, longest = [0, 0], 0
    try:
        for second in range(5 + SUSPENDED_S + 6):
            heard = [int(process.stdout.readline()) for process in (q, p)]
            print(f"{second:3} s: Q hears {heard[0]:3}, P hears {heard[1]:3}; in close(): {threads_in_close(p.pid)}", flush=True)
            silent = [before + 1 if now == 0 and second > 5 else 0 for before, now in zip(silent, heard)]
            longest = max(longest, *silent)
            if second == 5:
                [reader.send_signal(signal.SIGSTOP) for reader in readers]
            if second == 5 + SUSPENDED_S:
                [reader.kill() for reader in readers]
    finally:
        for process in (p, q, *readers):
            process.kill()
            process.wait()
    print(f"the longest silence was {longest} s")
    return 1 if longest >= 3 else 0


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["p"]:
            peer(0, [1, *READERS], "a", ["b"])
        case ["q"]:
            peer(1, [0], "b", ["a"])
        case [own]:
            peer(int(own), [0], None, ["a"])
        case _:
            sys.exit(main())
