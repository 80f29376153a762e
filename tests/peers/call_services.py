"""Calls services through the router of this machine, all at once, and prints those that have answered as JSON.

    python tests/peers/call_services.py '["/NODE/SERVICE", ...]'

The keys are those of the services' tokens, as rmw_zenoh_cpp has them; then the same with the type left open. Fails when a
service is not in the graph within 20 s. An answer is waited for 5 s.
"""

import json
import os
import struct
import sys
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["tcp/127.0.0.1:7447"]')
session = zenoh.open(config)
names = json.loads(sys.argv[1])


def keys():
    """The key of each service in the graph, by its name."""
    tokens = [str(reply.ok.key_expr).split("/") for reply in session.liveliness().get("@ros2_lv/0/**") if reply.ok]
    servers = {token[9].replace("%", "/"): token for token in tokens if token[5] == "SS"}
    return {name: f"0{name}/{token[10]}/{token[11]}" for name, token in servers.items()}


end = time.monotonic() + 20.0
while not set(names) <= (found := keys()).keys():
    assert time.monotonic() < end, f"not in the graph: {set(names) - found.keys()}"
    time.sleep(0.2)
answered = {"by type": set(), "of any type": set()}
for name in names:
    # Empty lists and texts; SetBool enables the node.
    request = bytes([0, 1, 0, 0, name.endswith("/enable")]) + bytes(31)
    attachment = struct.pack("<qqB", 1, time.time_ns(), 16) + b"another-machine!"
    for how, key in (("by type", found[name]), ("of any type", f"0{name}/*/*")):
        session.get(key, lambda reply, name=name, how=how: reply.ok and answered[how].add(name), payload=request,
                    attachment=attachment, target=zenoh.QueryTarget.ALL, timeout=5.0)
time.sleep(5.5)
print(json.dumps({how: [name for name in names if name in got] for how, got in answered.items()}), flush=True)
# A denied query is still open: an orderly end would wait for it.
os._exit(0)
