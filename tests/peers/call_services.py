"""Calls services, all at once, and prints the names of those that have answered as JSON.

    python3 tests/peers/call_services.py '[["/NODE/SERVICE", "PACKAGE/srv/TYPE", "REQUEST AS YAML", ...], ...]'

Fails when a service is not in the graph within 20 s. An answer is waited for 5 s.
"""

import json
import os
import sys
import time

import rclpy
import yaml
from rosidl_runtime_py import set_message_fields
from rosidl_runtime_py.utilities import get_service

rclpy.init()
node = rclpy.create_node("caller")
futures = {}
for name, kind, request, *_ in json.loads(sys.argv[1]):
    type_of_service = get_service(kind)
    client = node.create_client(type_of_service, name)
    assert client.wait_for_service(20.0), f"{name} is not in the graph"
    message = type_of_service.Request()
    set_message_fields(message, yaml.safe_load(request))
    futures[name] = client.call_async(message)
end = time.monotonic() + 5.0
while time.monotonic() < end and not all(future.done() for future in futures.values()):
    rclpy.spin_once(node, timeout_sec=0.1)
print(json.dumps([name for name, future in futures.items() if future.done()]), flush=True)
# A denied query is still open: an orderly end would wait for it.
os._exit(0)
