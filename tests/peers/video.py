"""Live cameras over the loopback interface: numbered frames by RTSP with a password and by HTTP, seen by a reader of another process.

    venv/bin/python tests/peers/video.py target/release/modulo [SECONDS]

Prints the age of images and boxes from the moment at which the camera has made the frame, the frames that were replaced, and the
processor time of each process. Fails when a frame that arrived is in no count, when the suite is not back in time after its ffmpeg was
killed or the server was gone for 10 s, when a frame of a slow camera of motion JPEG is lost, and when a password is in an output. Needs ffmpeg, and the packages of tests/peers/zenoh_peer.py.
"""

import http.server
import json
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from zenoh_peer import DOMAIN, ROOT, SENSOR_DATA, Peer

RATE, WIDTH, HEIGHT, BLOCK, BITS = 30, 320, 192, 16, 16
PASSWORD = "s3cr3t"
# A new frame must be there so soon after ffmpeg was killed: in 2 s on a machine without other work, where the run is long.
BACK_S, BACK_BUSY_S, LONG_S = 2.0, 4.0, 20.0
# No other test uses them: tests take the domains 100 to 232.
DOMAINS = ["91", "92", "93", "94"]
ENCODER = ["ffmpeg", "-v", "error", "-f", "rawvideo", "-pix_fmt", "gray", "-s", f"{WIDTH}x{HEIGHT}", "-r", str(RATE), "-i", "-",
           "-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", str(RATE // 2), "-pix_fmt", "yuv420p",
           "-f", "mpegts", "-flush_packets", "1", "-muxdelay", "0", "-"]


class Camera:
    """A camera of one stream, which serves all who ask by HTTP and by RTSP over TCP."""

    def __init__(self):
        self.sent, self.clients, self.lock = {}, [], threading.Lock()
        self.encoder = subprocess.Popen(ENCODER, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for work in (self.film, self.send):
            threading.Thread(target=work, daemon=True).start()
        self.listeners = {}
        self.ports = {self.http: 0, self.rtsp: 0}
        self.serve()

    def film(self):
        start = time.monotonic()
        for number in range(1 << BITS):
            row = b"".join((b"\xe0" if number >> bit & 1 else b"\x10") * BLOCK for bit in range(BITS))
            picture = (row + b"\x10" * (WIDTH - len(row))) * BLOCK
            shade = bytes((x + number) % 160 + 30 for x in range(WIDTH))
            time.sleep(max(0.0, start + number / RATE - time.monotonic()))
            self.sent[number] = time.time()
            self.encoder.stdin.write(picture + shade * (HEIGHT - BLOCK))
            self.encoder.stdin.flush()

    def send(self):
        while packets := self.encoder.stdout.read1(1316 * 64):
            with self.lock:
                for client in list(self.clients):
                    try:
                        client(packets)
                    except OSError:
                        self.clients.remove(client)

    def serve(self):
        for answer, port in list(self.ports.items()):
            listener = socket.create_server(("127.0.0.1", port))
            self.ports[answer] = listener.getsockname()[1]
            self.listeners[answer] = listener
            threading.Thread(target=self.accept, args=(listener, answer), daemon=True).start()

    def accept(self, listener, answer):
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=answer, args=(client,), daemon=True).start()

    def stop(self):
        """Closes the server and all connections; the camera goes on."""
        for listener in self.listeners.values():
            listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        with self.lock:
            for client in self.clients:
                client.socket.shutdown(socket.SHUT_RDWR)
            self.clients.clear()

    def add(self, client, write):
        # One that reads nothing must not hold the others up.
        client.settimeout(1.0)
        write.socket = client
        with self.lock:
            self.clients.append(write)

    def http(self, client):
        client.recv(4096)
        client.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: video/mp2t\r\n\r\n")

        def write(packets):
            client.sendall(packets)

        self.add(client, write)

    def rtsp(self, client):
        lines, state = client.makefile("rb"), {"sequence": 0, "rest": b""}

        def write(packets):
            data = state["rest"] + packets
            whole = len(data) - len(data) % 188
            state["rest"] = data[whole:]
            for place in range(0, whole, 1316):
                part = data[place : min(place + 1316, whole)]
                stamp = int(time.monotonic() * 90000) & 0xFFFFFFFF
                head = struct.pack(">BBHII", 0x80, 33, state["sequence"] & 0xFFFF, stamp, 7)
                state["sequence"] += 1
                client.sendall(struct.pack(">cBH", b"$", 0, len(part) + 12) + head + part)

        while request := lines.readline():
            if request[:1] == b"$":  # a report of the reader, which has no lines
                return self.add(client, write)
            method, fields = request.split(b" ")[0], {}
            while (line := lines.readline().strip()):
                name, _, value = line.partition(b":")
                fields[name.lower()] = value.strip()
            status, more, body = b"200 OK", b"", b""
            if b"authorization" not in fields and method != b"OPTIONS":
                status, more = b"401 Unauthorized", b'WWW-Authenticate: Basic realm="camera"\r\n'
            elif method == b"DESCRIBE":
                body = b"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\nm=video 0 RTP/AVP 33\r\na=control:0\r\n"
                more = b"Content-Type: application/sdp\r\n"
            elif method == b"SETUP":
                more = b"Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
            more += b"CSeq: %s\r\nContent-Length: %d\r\n\r\n" % (fields.get(b"cseq", b"0"), len(body))
            client.sendall(b"RTSP/1.0 " + status + b"\r\n" + more + body)
            if method == b"PLAY" and status.startswith(b"200"):
                return self.add(client, write)


class SlowCamera(http.server.ThreadingHTTPServer):
    """A camera of motion JPEG at `rate` Hz, which has no times."""

    JPEG = "ffmpeg -v error -f lavfi -i testsrc=s=320x192 -frames:v 1 -c:v mjpeg -f image2pipe -".split()

    def __init__(self, rate):
        self.rate, self.sent, self.picture = rate, 0, subprocess.check_output(self.JPEG)
        super().__init__(("127.0.0.1", 0), SlowCamera.Stream)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    class Stream(http.server.BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            head = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(self.server.picture)
            try:
                while True:
                    self.wfile.write(head + self.server.picture + b"\r\n")
                    self.server.sent += 1
                    time.sleep(1 / self.server.rate)
            except OSError:
                pass


def percentile(values, percent):
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, len(ranked) * percent // 100)]


def descendants(process):
    """The processes below one, each with the first words of its command line."""
    found = {}
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            name = b" ".join(words[1:3] if words[0].endswith(b"modulo") else words[:1]).decode()
            found |= {child: name} | descendants(child)
    return found


def busy(process):
    """Processor time of a process, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Suite:
    def __init__(self, modulo, source, domain, folder):
        self.summary, self.log = Path(folder) / f"{domain}.json", Path(folder) / f"{domain}.log"
        command = [modulo, "launch", ROOT / "launch/recovered.launch.yaml", f"source:={source}", "--summary", self.summary]
        environment = dict(os.environ, ROS_DOMAIN_ID=str(domain))
        self.child = subprocess.Popen(command, env=environment, stdout=open(self.log, "w"), stderr=subprocess.STDOUT)

    def ffmpeg(self):
        return next(child for child, name in descendants(self.child.pid).items() if "ffmpeg" in name)

    def end(self):
        self.child.send_signal(signal.SIGINT)
        code, log = self.child.wait(60), self.log.read_text()
        assert code == 0, f"exit code {code}\n{log}"
        assert PASSWORD not in log + self.summary.read_text(), log
        summary = json.loads(self.summary.read_text())
        live = summary["live"]["/modulo_camera"]
        arrived, replaced, connections = map(int, re.findall(r"\d+", live)[:3])
        # A frame that arrived was sent, replaced, or is the one that waited at the end.
        assert 0 <= arrived - replaced - summary["frames"] <= connections, (live, summary["frames"])
        topics = {topic: count["replaced"] for topic, count in summary["topics"].items() if count["replaced"]}
        print(f"  {arrived} frames arrived, {replaced} replaced in the camera, {topics} replaced in readers, {connections} connections, "
              f"{summary['topics']['/detector/detections']['out']} answered")
        return arrived, connections


class Watch:
    """Finds the age of each frame."""

    def __init__(self, camera):
        self.camera, self.peer, self.numbers, self.last = camera, Peer(), {}, None
        self.images = self.peer.hear("/ideal", "sensor_msgs/msg/Image", SENSOR_DATA)
        self.boxes = self.peer.hear("/detector/detections", "vision_msgs/msg/Detection2DArray", SENSOR_DATA)

    def age(self, heard, patience):
        """The age of the next message, s; None when none comes."""
        try:
            message, _ = heard.get(timeout=patience)
        except queue.Empty:
            return None
        now, stamp = time.time(), (message.header.stamp.sec, message.header.stamp.nanosec)
        if heard is self.images:
            row = message.data[BLOCK // 2 * message.step :][: message.step]
            channels = message.step // message.width
            bits = [row[(bit * BLOCK + BLOCK // 2) * channels] > 100 for bit in range(BITS)]
            self.numbers[stamp] = sum(bool(value) << bit for bit, value in enumerate(bits))
        number = self.numbers.get(stamp)
        return None if number is None else now - self.camera.sent[number]

    def run(self, seconds):
        """Ages of the images and of the boxes that come within `seconds`."""
        end, ages = time.monotonic() + seconds, ([], [])
        while time.monotonic() < end:
            for heard, found in zip((self.images, self.boxes), ages):
                while not heard.empty():
                    if (age := self.age(heard, 1.0)) is not None:
                        found.append(age)
            time.sleep(0.001)
        return ages

    def next(self, patience):
        """Waits for a frame that is filmed from now on; seconds until it is there."""
        start = time.time()
        while time.time() - start < patience:
            age = self.age(self.images, 0.2)
            if age is not None and age < time.time() - start:
                return time.time() - start
        raise AssertionError(f"no frame within {patience} s")


def main():
    modulo, seconds = Path(sys.argv[1]).resolve(), float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    camera = Camera()
    http = f"http://127.0.0.1:{camera.ports[camera.http]}/live"
    rtsp = f"rtsp://admin:{PASSWORD}@127.0.0.1:{camera.ports[camera.rtsp]}/live"
    with tempfile.TemporaryDirectory() as folder:
        for source in (rtsp, http):
            print(source.split(":")[0])
            suite = Suite(modulo, source, DOMAIN, folder)
            time.sleep(5)
            watch = Watch(camera)
            watch.next(60)
            before = {child: busy(child) for child in descendants(suite.child.pid)}
            images, boxes = watch.run(seconds)
            for name, ages in (("image", images), ("boxes", boxes)):
                p50, p99 = (1000 * percentile(ages, percent) for percent in (50, 99))
                print(f"  age of {name}: p50 {p50:.0f} ms, p99 {p99:.0f} ms, {len(ages)} in {seconds:.0f} s")
            for child, name in descendants(suite.child.pid).items():
                print(f"  processor: {name} {100 * (busy(child) - before.get(child, 0)) / seconds:.0f} %")
            os.kill(suite.ffmpeg(), signal.SIGKILL)
            while not watch.images.empty():
                watch.age(watch.images, 0)
            print(f"  ffmpeg killed: a new frame after {watch.next(BACK_S if seconds >= LONG_S else BACK_BUSY_S):.1f} s")
            camera.stop()
            time.sleep(10)
            camera.serve()
            print(f"  server gone for 10 s: a new frame after {watch.next(15):.1f} s")
            watch.peer.session.close()
            suite.end()
        print("four at once")
        suites = [Suite(modulo, http, domain, folder) for domain in DOMAINS]
        time.sleep(10 + seconds)
        for suite in suites:
            suite.end()
        for rate in (5, 10, 30):
            print(f"motion JPEG at {rate} Hz")
            slow = SlowCamera(rate)
            suite = Suite(modulo, f"http://127.0.0.1:{slow.server_port}/stream", DOMAIN, folder)
            time.sleep(10 + seconds)
            sent = slow.sent
            arrived, connections = suite.end()
            # ffmpeg keeps the last one back until the next one begins.
            assert connections == 1 and arrived >= sent - 2, f"{arrived} of {sent} frames in {connections} connections"
    camera.encoder.kill()


main()
