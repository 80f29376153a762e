"""A recorder in 512 MB of memory on a disk of 20 MB/s, under images of 200 MB/s.

    venv/bin/python slow_disk.py target/debug/modulo target/debug/examples/image_stream [SECONDS]

The recorder must stay within its memory, end within a second of SIGINT, leave a bag that PyPI rosbags reads, and print
as many losses as the numbers of the images in this bag have gaps. A recording that ends later is repeated up to twice,
since the whole machine may have stood still; a recorder that wrote all that waits would be late each time. The disk is a loop device that the block I/O
controller throttles; that takes Linux, root and cgroups, version 1 or 2. Skipped without these.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from rosbags.highlevel import AnyReader

DISK_BYTES_PER_SECOND = 20_000_000
MEGA_BYTES_PER_SECOND = 200
MEMORY = 512_000_000
CGROUPS = Path("/sys/fs/cgroup")
SECONDS_TO_END = 1.0
ATTEMPTS = 3
ENVIRONMENT = os.environ | {"ROS_DOMAIN_ID": "139"}


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@contextmanager
def limits(device):
    """Throttles `device`; gives the file that takes the processes whose memory is limited."""
    unified = (CGROUPS / "cgroup.controllers").exists()
    group = CGROUPS / ("" if unified else "memory") / f"modulo_slow_disk_{os.getpid()}"
    throttle = CGROUPS / "blkio/blkio.throttle.write_bps_device"
    if unified:
        (CGROUPS / "cgroup.subtree_control").write_text("+memory +io")
    group.mkdir()
    try:
        if unified:
            (group / "memory.max").write_text(str(MEMORY))
            (group / "io.max").write_text(f"{device} wbps={DISK_BYTES_PER_SECOND}")
        else:
            (group / "memory.limit_in_bytes").write_text(str(MEMORY))
            throttle.write_text(f"{device} {DISK_BYTES_PER_SECOND}")
        yield group / "cgroup.procs"
    finally:
        if not unified:
            throttle.write_text(f"{device} 0")
        group.rmdir()


@contextmanager
def slow_disk(folder):
    """Mounts a slow disk in `folder`; gives its folder and the file for the recorder's process."""
    image, disk = folder / "image", folder / "disk"
    disk.mkdir()
    run("truncate", "--size", "4G", str(image))
    run("mkfs.ext4", "-q", str(image))
    loop = run("losetup", "--find", "--show", str(image))
    try:
        run("mount", loop, str(disk))
        try:
            number = os.stat(loop).st_rdev
            with limits(f"{os.major(number)}:{os.minor(number)}") as processes:
                yield disk, processes
        finally:
            run("umount", str(disk))
    finally:
        run("losetup", "--detach", loop)


def resident(process):
    """Resident memory of a process, bytes; 0 when it has ended."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except FileNotFoundError:
        return 0
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    return int(found.group(1)) * 1024 if found else 0


def record(modulo, stream, bag, processes, seconds, under_load):
    """Records a stream into `bag`, ended after the stream or in the middle of it: (images sent, output, s to its end)."""
    recorder = subprocess.Popen(
        [modulo, "bag", "record", "--all", "-o", str(bag)],
        env=ENVIRONMENT, stdout=subprocess.PIPE, text=True,
        preexec_fn=lambda: processes.write_text(str(os.getpid())),
    )
    arguments = [str(MEGA_BYTES_PER_SECOND), str(10 * seconds if under_load else seconds)]
    sender = subprocess.Popen([stream, *arguments], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
    try:
        most, until = 0, time.monotonic() + (seconds if under_load else float("inf"))
        while sender.poll() is None and time.monotonic() < until:
            most = max(most, resident(recorder))
            assert recorder.poll() is None, f"the recorder ended with {recorder.returncode} at {most / 1e6:.0f} MB"
            time.sleep(0.5)
        asked = time.monotonic()
        recorder.send_signal(signal.SIGINT)
        output, _ = recorder.communicate(timeout=120)
        took = time.monotonic() - asked
        print(f"{bag.name}: at most {most / 1e6:.0f} MB, ended after {took:.2f} s: {output.strip()}", flush=True)
        assert recorder.returncode == 3, f"exit code {recorder.returncode}, 3 needed: images are lost at this rate"
        assert most < MEMORY, "more than its memory"
        return (None if under_load else int(sender.communicate()[0])), output, took
    finally:
        recorder.kill()
        sender.kill()
        recorder.wait()
        sender.wait()


def check(bag, sent, output):
    """Compares the numbers of the images in the bag with what the recorder printed."""
    with AnyReader([bag]) as reader:
        images = [c for c in reader.connections if c.topic == "/images"]
        stamps = (reader.deserialize(raw, c.msgtype).header.stamp for c, _, raw in reader.messages(images))
        numbers = [stamp.sec * 1_000_000_000 + stamp.nanosec for stamp in stamps]
    kept, lost = map(int, re.search(r"/images: (\d+) messages, (\d+) lost", output).groups())
    assert numbers and all(a < b for a, b in zip(numbers, numbers[1:])), "images in another order than they were sent"
    assert kept == len(numbers), f"{kept} messages printed, {len(numbers)} in the bag"
    # A recorder that ends under load cannot know what was still on its way to it.
    gaps = (numbers[-1] + 1 if sent is None else sent) - len(numbers)
    assert lost >= gaps if sent is None else lost == gaps, f"{lost} lost printed, {gaps} missing in the bag"


def main():
    modulo, stream, seconds = sys.argv[1], sys.argv[2], float((sys.argv[3:] or ["5"])[0])
    if os.geteuid() != 0 or not Path("/dev/loop-control").exists():
        print("skipped: root and loop devices are needed")
        return
    with tempfile.TemporaryDirectory() as folder, slow_disk(Path(folder)) as (disk, processes):
        for name, under_load in [("whole_stream", False), ("under_load", True)]:
            duration = 3 if under_load else seconds
            for attempt in range(ATTEMPTS):
                bag = disk / f"{name}_{attempt}"
                sent, output, took = record(modulo, stream, bag, processes, duration, under_load)
                check(bag, sent, output)
                if took < SECONDS_TO_END:
                    break
            else:
                raise AssertionError(f"{ATTEMPTS} recordings ended later than {SECONDS_TO_END} s after SIGINT")


main()
