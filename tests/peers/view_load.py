"""What the page of `modulo view` costs, and whether it shows one moment beside a slow stream.

    python3 tests/peers/view_load.py target/release/modulo [SECONDS]

Four streams of 1242 x 375 at 10 Hz for SECONDS (30), with a detector of the embedded model. Prints the CPU time of the viewer in
percent of one core, the moments that the page shows in a second, and the rate of each node with the page and without it. Then the
detector is the slow stream (`/detector/annotated`), and all images of 200 moments must have one stamp. It needs two idle cores.
"""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from replay import ROOT, address, check
from view import MOMENTS, PATIENCE_MS, wait

SOURCE = "source:=scene://tunnel?seed=3&frames=60&width=1242&height=375"
STREAMS = ["/modulo", "/recovered", "/saturated", "/ideal"]
FRAMES = 200


@contextlib.contextmanager
def started(*command, **more):
    process = subprocess.Popen([MODULO, *command], cwd=ROOT, start_new_session=True, **more)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)


def cpu_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rates():
    """The rate of each node, as it publishes it once a second on /diagnostics."""
    echo = ["timeout", "-s", "INT", "3", MODULO, "topic", "echo", "/diagnostics"]
    heard = subprocess.run(echo, capture_output=True, text=True).stdout
    found = re.findall(r"name: (\S+)\n(?:(?!name: ).*\n)*?\s*(?:- )?key: rate_hz\n\s*value: '?([0-9.]+)", heard)
    return ", ".join(f"{node} {rate} Hz" for node, rate in sorted(dict(found).items()))


def main():
    global MODULO
    MODULO, seconds = str(Path(sys.argv[1]).resolve()), float((sys.argv[2:] or ["30"])[0])
    os.environ["ROS_DOMAIN_ID"] = "138"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with started("launch", "launch/recovered.launch.yaml", SOURCE, "loop:=true", "rate:=10.0", "engine:=rten", **quiet), sync_playwright() as playwright:
        time.sleep(seconds)
        print(f"without a page: {rates()}")
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        with started("view", "--port", "0", stdout=subprocess.PIPE, text=True) as viewer:
            page = browser.new_page(viewport={"width": 1500, "height": 1000})
            page.goto(address(viewer, "http://"))
            wait(page, "() => [...document.querySelectorAll('.picture')].filter(({ dataset }) => dataset.stamps).length >= 4")
            page.evaluate(MOMENTS)
            before, start = cpu_s(viewer.pid), time.monotonic()
            time.sleep(seconds)
            spent, shown = cpu_s(viewer.pid) - before, page.evaluate("() => new Set(window.moments.flat()).size")
            passed = time.monotonic() - start
            print(f"viewer: {100 * spent / passed:.0f} % of a core, {shown / passed:.1f} moments/s of {len(STREAMS)} streams shown")
            print(f"with a page: {rates()}")
            page.get_by_role("checkbox", name="/detector/annotated").check()
            page.evaluate("() => { window.moments.length = 0; }")
            page.wait_for_function(f"() => new Set(window.moments.flat()).size >= {FRAMES}", timeout=20 * PATIENCE_MS)
            moments = page.evaluate("() => window.moments")
            mixed = [stamps for stamps in moments if len(stamps) != 1]
            check(not mixed, f"all images have one stamp, over {FRAMES} moments beside a slow stream: {mixed[:3]}")
        browser.close()


if __name__ == "__main__":
    main()
