"""A recorder that was suspended records again, and what it missed is counted.

    venv/bin/python tests/peers/stopped.py target/debug/modulo [SECONDS [SECONDS_AFTER [RATE]]]

`modulo bag record` reads a camera, is suspended for so many seconds, goes on for so many, and is ended by SIGINT. An own session hears the
camera all the time. Fails where messages of the camera are neither in the bag nor counted as lost, where the exit code hides a loss, or
where the recorder hears nothing any more.
"""

import re
import signal
import sys
import tempfile
import time
from pathlib import Path

import stalled
from mcap.reader import make_reader

TOPICS = ["modulo", "saturated", "sensor_info"]
# Messages on their way at the start and the end of the recording.
ON_THEIR_WAY = 12


def number(sample):
    return int.from_bytes(sample.attachment.to_bytes()[:8], "little", signed=True)


def run(modulo, seconds, after, rate, folder):
    """Returns the lines and the exit code of the recorder, and by topic how many messages were sent while it recorded."""
    last = {}
    hears = {topic: lambda sample, topic=topic: last.__setitem__(topic, number(sample)) for topic in TOPICS}
    command = [modulo, "bag", "record", "-o", f"{folder}/bag", *(f"/{topic}" for topic in TOPICS)]
    said = Path(f"{folder}/recorder")
    with (
        stalled.suite(modulo, rate, hears, folder),
        said.open("w", encoding="utf-8") as lines,
        stalled.started(*command, output=lines) as recorder,
    ):
        while "recording into" not in said.read_text(encoding="utf-8"):
            assert recorder.poll() is None, said.read_text(encoding="utf-8")
            time.sleep(0.05)
        first = dict(last)
        time.sleep(4.0)
        recorder.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        recorder.send_signal(signal.SIGCONT)
        time.sleep(after)
        sent = {topic: last[topic] - first[topic] for topic in TOPICS}
        recorder.send_signal(signal.SIGINT)
        code = recorder.wait(60)
    return said.read_text(encoding="utf-8"), code, sent


def check(lines, code, sent, folder):
    with open(f"{folder}/bag/bag_0.mcap", "rb") as file:
        recorded = [channel.topic[1:] for _, channel, _ in make_reader(file).iter_messages()]
    lost = {topic: int(re.search(rf"^/{topic}: .* (\d+) lost", lines, re.MULTILINE)[1]) for topic in TOPICS}
    bad = []
    for topic in TOPICS:
        count = recorded.count(topic)
        print(f"/{topic}: {sent[topic]} sent, {count} recorded, {lost[topic]} lost")
        if abs(sent[topic] - count - lost[topic]) > ON_THEIR_WAY:
            bad.append(f"/{topic}: messages that are in no count")
    if code != (3 if any(lost.values()) else 0):
        bad.append(f"the recorder ended with {code}")
    print(*bad, sep="\n")
    return not bad


def main():
    modulo = sys.argv[1]
    seconds, after, rate = [*sys.argv[2:], *["8", "3", "20"][len(sys.argv) - 2 :]]
    with tempfile.TemporaryDirectory() as folder:
        lines, code, sent = run(modulo, float(seconds), float(after), rate, folder)
        print(f"suspended for {seconds} s, then {after} s, {rate} Hz; the recorder ended with {code}")
        if check(lines, code, sent, folder):
            return 0
        print(lines)
        return 1


if __name__ == "__main__":
    sys.exit(main())
