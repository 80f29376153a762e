"""Reads `modulo view --foxglove` with a client of the Foxglove WebSocket protocol, over a replay of the sample bag.

    pip install websockets==17.4 protobuf==7.36.2
    python3 tests/peers/foxglove.py target/debug/modulo

The messages are decoded with the schemas that the server advertises, as Foxglove does. Exit code 1 when one cannot be decoded, an
image has no boxes of its own stamp, or a parameter cannot be read, or can be set without the token.
"""

import base64
import json
import struct
import sys
from pathlib import Path

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import connect

from replay import address, check, viewer

PATIENCE = 60


def message_class(channel):
    """The class of a channel's messages, from its schema."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


class Client:
    def __init__(self, socket):
        self.socket = socket
        self.channels = {}
        self.classes = {}

    def ask(self, **request):
        self.socket.send(json.dumps(request))

    def hear(self):
        """The next message: (op, content) of a text, (topic, message) of a subscription."""
        data = self.socket.recv(timeout=PATIENCE)
        if isinstance(data, str):
            message = json.loads(data)
            self.channels.update({channel["topic"]: channel for channel in message.get("channels", [])})
            return message["op"], message
        opcode, subscription, _time = struct.unpack_from("<BIQ", data)
        topic, kind = self.classes[subscription] if opcode == 1 else (None, None)
        return topic, kind.FromString(data[13:]) if kind else None

    def until(self, wanted, accept=lambda _: True):
        while True:
            name, message = self.hear()
            if name == wanted and accept(message):
                return message

    def subscribe(self, topic):
        while topic not in self.channels:
            self.hear()
        number = len(self.classes) + 1
        self.classes[number] = (topic, message_class(self.channels[topic]))
        self.ask(op="subscribe", subscriptions=[{"id": number, "channelId": self.channels[topic]["id"]}])

    def get(self, name):
        self.ask(op="getParameters", parameterNames=[name] if name else [], id="get")
        return {p["name"]: p.get("value") for p in self.until("parameterValues", lambda m: m.get("id") == "get")["parameters"]}

    def set(self, name, value):
        self.ask(op="setParameters", parameters=[{"name": name, "value": value}], id="set")
        self.until("parameterValues", lambda m: m.get("id") == "set")


def drive(client, token):
    check("parameters" in client.until("serverInfo")["capabilities"], "the server offers parameters")
    for topic in ["/modulo", "/recovered", "/detector/detections"]:
        client.subscribe(topic)
    for topic in ["/modulo", "/recovered"]:
        image = client.until(topic)
        check(image.format == "jpeg" and image.data[:2] == b"\xff\xd8", f"{topic} is decoded with the advertised schema")
    boxes = client.until("/detector/detections", lambda boxes: len(boxes.points) > 0)
    box = boxes.points[0]
    check(len(box.points) == 4 and len(boxes.texts) == len(boxes.points), "boxes are closed lines with labels")
    stamp = (boxes.timestamp.seconds, boxes.timestamp.nanos)
    image = client.until("/recovered")
    check((image.timestamp.seconds, image.timestamp.nanos) == stamp, "an image follows its boxes, with the same stamp")

    everything = client.get(None)
    check(everything["/detector.input"] == "recovered" and everything["token"] == "", "all parameters can be read")
    client.set("/detector.input", "modulo")
    check(client.get("/detector.input") == {"/detector.input": "recovered"}, "without the token no parameter is set")
    client.set("token", token)
    client.set("/detector.score_threshold", 0.5)
    check(client.get("/detector.score_threshold") == {"/detector.score_threshold": 0.5}, "with the token a parameter is set")


def main():
    modulo = str(Path(sys.argv[1]).resolve())
    with viewer(modulo, "140", "--foxglove", "0") as process:
        page, server = address(process, "http://"), address(process, "ws://")
        with connect(server, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
            drive(Client(socket), page.split("token=")[1])


if __name__ == "__main__":
    main()
